"""The public names, and what importing the package costs."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from log_samples import sample_drive

import jaxradar

ROOT = Path(__file__).parents[1]


def fresh(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)


@pytest.mark.parametrize("name", jaxradar.__all__)
def test_every_public_name_resolves_and_is_documented(name: str) -> None:
    value = getattr(jaxradar, name)
    assert value.__name__ == name
    assert value.__doc__
    assert jaxradar.__doc__ is not None
    assert f"`{name}`" in jaxradar.__doc__


def test_public_names_stand_in_every_list_of_them() -> None:
    homes = [name for names in jaxradar._HOMES.values() for name in names.split()]
    assert sorted(homes) == sorted(jaxradar.__all__)
    assert set(jaxradar.__all__) <= set(dir(jaxradar))


def test_version_is_the_projects() -> None:
    assert jaxradar.__version__ == tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]


def test_unknown_names_are_refused() -> None:
    with pytest.raises(AttributeError, match="no attribute 'read_logs'"):
        jaxradar.read_logs  # noqa: B018
    with pytest.raises(ImportError):
        fresh_import = "read_logs"
        exec(f"from jaxradar import {fresh_import}")


def test_importing_the_package_imports_nothing_heavy() -> None:
    loaded = fresh("import sys, jaxradar; print(*sys.modules)").stdout.split()
    assert not {"numpy", "jax", "equinox", "matplotlib", "h5py", "pyarrow", "rich"} & set(loaded)


def test_help_imports_nothing_heavy() -> None:
    code = "import sys; from jaxradar.cli import main; assert main(['--help']) == 0; print('#', *sys.modules)"
    loaded = fresh(code).stdout.split("#")[1].split()
    assert not {"numpy", "jax", "equinox", "matplotlib", "h5py", "pyarrow", "rich"} & set(loaded)


def test_info_imports_neither_jax_nor_tables_of_statistics(tmp_path: Path) -> None:
    jaxradar.write_log(sample_drive(), tmp_path / "a.drive")
    code = f"import sys; from jaxradar.cli import main; assert main(['info', {str(tmp_path / 'a.drive')!r}]) == 0; "
    loaded = fresh(code + "print('#', *sys.modules)").stdout.rsplit("#", 1)[1].split()
    assert not {"jax", "equinox", "matplotlib", "scipy.stats"} & set(loaded)


def test_the_labs_csv_needs_numpy_alone(tmp_path: Path) -> None:
    loaded = fresh("import sys, jaxradar.labcsv; print(*sys.modules)").stdout.split()
    assert not {"jax", "jaxtyping", "equinox", "matplotlib", "h5py", "pyarrow", "scipy", "rich"} & set(loaded)
    code = f"""
import sys

class NumPyAlone:
    def find_spec(name, path=None, target=None):
        if name.partition(".")[0] not in (*sys.stdlib_module_names, "numpy", "jaxradar"):
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, NumPyAlone)
from pathlib import Path
from jaxradar.labcsv import read_lab_csv, use_one_thread
from jaxradar.labcsv.writer import write_lab_csv

use_one_thread()
log = Path({str(tmp_path / "log")!r})
assert write_lab_csv(read_lab_csv(log), log.with_name("again")) == []
print(*sys.modules)
"""
    drive = sample_drive()
    bare = replace(drive, sensors=tuple(replace(one, spec={}, flags=one.flags * 0) for one in drive.sensors))
    jaxradar.write_log(replace(bare, started_at_ns=None, problems=()), tmp_path / "log")
    assert not {"jax", "equinox", "matplotlib", "h5py", "pyarrow"} & set(fresh(code).stdout.split())
    texts = [{path.name: path.read_text() for path in (tmp_path / name).iterdir()} for name in ("log", "again")]
    assert texts[0] == texts[1]


def test_the_readers_need_no_jax() -> None:
    loaded = fresh("import sys, jaxradar; jaxradar.read_log, jaxradar.match_steps; print(*sys.modules)")
    assert not {"jax", "equinox", "matplotlib"} & set(loaded.stdout.split())
