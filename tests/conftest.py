"""Every test runs with jaxtyping's shapes and types checked by beartype."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

# The tests build the same programs again and again: one cache for all workers of this run, before JAX is imported.
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    os.environ["JAX_COMPILATION_CACHE_DIR"] = tempfile.mkdtemp(prefix="jaxradar-tests-")
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.1"
# What one worker of this run makes for all.
os.environ.setdefault("JAXRADAR_TESTS_SHARED", tempfile.mkdtemp(prefix="jaxradar-tests-"))

import pytest
from jaxtyping import install_import_hook

install_import_hook("jaxradar", "typechecker.check")

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def road_recordings() -> dict[str, Path]:
    """The A111 recordings of road surfaces, by name; skips where they are not at hand."""
    files = sorted((SHARED / "a111_road").glob("*.h5"))
    if not files:
        pytest.skip("the road recordings are not in ../shared/data/a111_road")
    return {file.stem: file for file in files}


@pytest.fixture(params=["pyarrow", "numpy"])
def csv_parser(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Runs the test with pyarrow, and as on a device that has NumPy alone."""
    if request.param == "numpy":
        monkeypatch.setitem(sys.modules, "pyarrow", None)
    return request.param


@pytest.fixture(params=["float32", "float64"])
def precision(request: pytest.FixtureRequest):
    """Runs the test in JAX's default precision and in double."""
    import jax

    with jax.enable_x64(request.param == "float64"):
        yield request.param


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.get_closest_marker("long") and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(3600))
