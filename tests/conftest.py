"""Every test runs with jaxtyping's shapes and types checked by beartype."""

from __future__ import annotations

from pathlib import Path

import pytest
from jaxtyping import install_import_hook

install_import_hook("jaxradar", "beartype.beartype")

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def road_recordings() -> dict[str, Path]:
    """The A111 recordings of road surfaces, by name; skips where they are not at hand."""
    files = sorted((SHARED / "a111_road").glob("*.h5"))
    if not files:
        pytest.skip("the road recordings are not in ../shared/data/a111_road")
    return {file.stem: file for file in files}


@pytest.fixture(params=["float32", "float64"])
def precision(request: pytest.FixtureRequest):
    """Runs the test in JAX's default precision and in double."""
    import jax

    with jax.enable_x64(request.param == "float64"):
        yield request.param
