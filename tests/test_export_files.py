"""A compiled detector's file: whole or refused in a sentence, and a program where there is NumPy and IREE alone."""

from __future__ import annotations

import dataclasses
import json
import math
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from live_samples import assert_same_events, exported, wandering

from jaxradar._errors import ConfigError, LogError
from jaxradar.cli import main
from jaxradar.export import archive_bytes, write_archive
from jaxradar.export.archive import MODULES
from jaxradar.live.app import main as device_main
from jaxradar.live.artefact import DECISION, FORMAT, HEADER, Artefact, Header, is_artefact, read_artefact
from jaxradar.logs import write_log
from jaxradar.motion import MOTION_FIELDS

SMALL = Header(
    "thesis", 'detector = "thesis"\n', 0.7, "range rate", "m/s", (0.1, 0.2, 0.30000000000000004), "uint16", "float64",
    (0.0, -1.5), MOTION_FIELDS, DECISION, "host", "jax", (1, 3), {"jax": "0.10.0"},
)  # fmt: skip
PROGRAM = bytes(range(256))


@pytest.fixture
def small(tmp_path: Path) -> Path:
    write_archive(tmp_path / "small.pyz", Artefact(SMALL, PROGRAM))
    return tmp_path / "small.pyz"


def rebuilt(source: Path, changes: dict[str, bytes | None]) -> Path:
    """The same archive with other content, all checksums of the archive right; None: without."""
    with zipfile.ZipFile(source) as archive:
        held = {name: archive.read(name) for name in archive.namelist()} | changes
    target = source.with_name("rebuilt.pyz")
    with zipfile.ZipFile(target, "w") as archive:
        for name, content in held.items():
            if content is not None:
                archive.writestr(name, content)
    return target


def with_header(source: Path, **changes: Any) -> Path:
    with zipfile.ZipFile(source) as archive:
        record = json.loads(archive.read(HEADER)) | changes
    return rebuilt(source, {HEADER: json.dumps(record).encode()})


def test_what_was_written_is_read(small: Path) -> None:
    assert read_artefact(small) == Artefact(SMALL, PROGRAM)
    assert is_artefact(small)
    assert write_archive(small, Artefact(SMALL, PROGRAM)) == small.stat().st_size


numbers = st.floats(allow_nan=False, allow_infinity=False)


@settings(max_examples=50, deadline=None)
@given(
    text=st.text(),
    threshold=numbers,
    range_m=st.lists(numbers, max_size=4).map(tuple),
    sensors=st.lists(st.integers(0, 9)).map(tuple),
    program=st.binary(),
)
def test_any_header_comes_back(text: str, threshold: float, range_m: Any, sensors: Any, program: bytes) -> None:
    header = dataclasses.replace(
        SMALL, config=text, detector=text, threshold=threshold, range_m=range_m, state=range_m, sensors=sensors
    )
    made = Artefact(header, program)
    with tempfile.NamedTemporaryFile() as file:
        Path(file.name).write_bytes(archive_bytes(made))
        assert read_artefact(file.name) == made


def test_the_same_content_gives_the_same_bytes(small: Path) -> None:
    assert archive_bytes(read_artefact(small)) == small.read_bytes()


def test_a_flipped_byte_anywhere_is_noticed_or_changes_nothing(small: Path) -> None:
    whole, expected = small.read_bytes(), read_artefact(small)
    for place in range(len(whole)):
        for flip in (0x01, 0x80, 0xFF):
            small.write_bytes(whole[:place] + bytes([whole[place] ^ flip]) + whole[place + 1 :])
            try:
                found = read_artefact(small)
            except ConfigError as error:
                assert str(error).startswith(f"{small}: ")
            else:
                assert found == expected, place
            is_artefact(small)


def test_a_truncated_file_is_refused(small: Path) -> None:
    whole = small.read_bytes()
    for length in range(0, len(whole) - 1, 7):
        small.write_bytes(whole[:length])
        with pytest.raises(ConfigError, match="is damaged, or no compiled detector; export it again"):
            read_artefact(small)
        assert not is_artefact(small)


DAMAGES: dict[str, tuple[Any, str]] = {
    "flipped": (
        lambda file: rebuilt(file, {"step.jaxexport": PROGRAM[:9] + b"x" + PROGRAM[10:]}),
        "its program is not the one that its header names",
    ),
    "cut off": (lambda file: rebuilt(file, {"step.jaxexport": PROGRAM[:-1]}), "its program is not the one"),
    "no program": (lambda file: rebuilt(file, {"step.jaxexport": None}), "not whole"),
    "no header": (lambda file: rebuilt(file, {HEADER: None}), "holds no compiled detector; expected a file that"),
    "no JSON": (lambda file: rebuilt(file, {HEADER: b"{nonsense"}), "its format is None, and this program reads"),
    "no text": (lambda file: rebuilt(file, {HEADER: b"\xff\xfe\xfd"}), "its format is None"),
    "a list": (lambda file: rebuilt(file, {HEADER: b"[1]"}), "its format is None"),
    "another format": (lambda file: with_header(file, format=2), f"its format is 2, and this program reads {FORMAT}"),
    "another kind": (lambda file: with_header(file, kind="onnx"), "not whole"),
    "no hash": (lambda file: with_header(file, sha256=None), "its program is not the one"),
    "no axis": (lambda file: with_header(file, range_m=None), "not whole"),
    "words for an axis": (lambda file: with_header(file, range_m=["near", "far"]), "not whole"),
    "words for a state": (lambda file: with_header(file, state=["none"]), "not whole"),
    "no number": (lambda file: with_header(file, threshold="high"), "not whole"),
    "no finite number": (lambda file: with_header(file, state=[1.0, math.inf]), "not whole"),
    "a number beyond all": (lambda file: with_header(file, threshold=10**400), "not whole"),
    "no name": (lambda file: with_header(file, detector=5), "not whole"),
    "no type": (lambda file: with_header(file, vectors="float16"), "not whole"),
    "no type of sweeps": (lambda file: with_header(file, sweeps="complex"), "not whole"),
    "other decisions": (lambda file: with_header(file, decision=["event"]), "not whole"),
    "other motion": (lambda file: with_header(file, motion=["speed_m_s"]), "not whole"),
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_is_refused_in_a_sentence(damage: str, small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    change, words = DAMAGES[damage]
    file = change(small)
    with pytest.raises(ConfigError, match=words):
        read_artefact(file)
    for program, arguments in ((main, ["live"]), (device_main, [])):
        assert program([*arguments, "--source", "replay", "nowhere", "--detector", str(file)]) == 2
        said = capsys.readouterr()
        assert said.out == ""
        assert len(said.err.splitlines()) == 1
        assert words in said.err


def test_files_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "text.pyz").write_text("nothing")
    for name, words in (("gone.pyz", "No such file"), ("text.pyz", "no compiled detector"), ("", "Is a directory")):
        with pytest.raises(ConfigError, match=words):
            read_artefact(tmp_path / name)
        assert not is_artefact(tmp_path / name)


def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "folder.pyz").mkdir()
    (tmp_path / "folder.pyz" / "kept").touch()
    with pytest.raises(LogError, match=r"folder\.pyz"):
        write_archive(tmp_path / "folder.pyz", Artefact(SMALL, PROGRAM))
    assert [path.name for path in tmp_path.rglob("*")] == ["folder.pyz", "kept"]


def test_the_archive_holds_its_modules_and_nothing_else() -> None:
    with zipfile.ZipFile(exported("thesis")) as archive:
        names = archive.namelist()
    assert names[:3] == [HEADER, "step.vmfb", "__main__.py"]
    assert all(name.startswith("jaxradar/") and name.endswith((".py", ".pyc")) for name in names[3:])
    assert {name.split("/")[1].replace(".pyc", ".py") for name in names[3:]} == set(MODULES)
    assert exported("thesis").read_bytes().startswith(b"#!/usr/bin/env python3\n")


# Refuses all that a device need not have, and the package from anywhere but the archive.
ALONE = """
import importlib.machinery, runpy, sys
archive = sys.argv[1]

class Alone:
    def find_spec(name, path=None, target=None):
        top = name.partition(".")[0]
        if top == "jaxradar":
            found = importlib.machinery.PathFinder.find_spec(name, path or [archive])
            if found is None or not found.origin.startswith(archive):
                raise ModuleNotFoundError(name)
            return found
        if top not in ("__main__", *sys.stdlib_module_names, "numpy", "iree", "ml_dtypes"):  # the last is the runtime's
            raise ModuleNotFoundError(name)

sys.meta_path.insert(0, Alone)
for module in ("jax", "equinox", "h5py", "matplotlib", "optimistix", "pyarrow", "jaxtyping", "scipy", "rich", "serial"):
    try:
        __import__(module)
    except ModuleNotFoundError:
        continue
    raise SystemExit(f"{module} is not kept out")
sys.argv = sys.argv[1:]
runpy.run_path(archive, run_name="__main__")
"""


def alone(file: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-I", "-c", ALONE, str(file), *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        cwd="/",
        timeout=120,
    )


@pytest.mark.parametrize("form", ["drive", "csv"])
def test_without_jax_it_says_what_evaluate_says(form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = exported("thesis")
    log = tmp_path / ("log.drive" if form == "drive" else "log")
    write_log(wandering(), log)
    ran = alone(file, "--source", "replay", log, "--fast", "--json")
    assert (ran.returncode, ran.stderr) == (0, "")
    *events, last = [json.loads(line) for line in ran.stdout.splitlines()]

    (tmp_path / "same.toml").write_text(read_artefact(file).header.config)
    assert main(["evaluate", str(log), "--detector", str(tmp_path / "same.toml"), "--json", "-"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    wanted = [{"sensor": line["sensor"], **event} for line in lines for event in line["detections"]]
    assert len(wanted) > 6
    found = sorted((event["event"] for event in events), key=lambda event: (event["sensor"], event["sweep"]))
    assert_same_events(found, wanted)
    assert last["summary"]["sweeps"] == sum(line["sweeps"] for line in lines)
    assert last["summary"]["events"] == len(wanted)


def test_the_file_runs_by_itself(tmp_path: Path) -> None:
    """As a user starts it; with another compiled detector, and for so many sweeps."""
    file = exported("thesis")
    write_log(wandering(), tmp_path / "log.drive")
    begin = [sys.executable, "-I", str(file), "--source", "replay", str(tmp_path / "log.drive"), "--fast"]
    ran = subprocess.run([*begin, "--sweeps", "20"], capture_output=True, text=True, check=False, cwd="/", timeout=120)
    assert ran.returncode == 0
    assert ran.stderr.startswith("20 sweeps in 0.1 s, ")
    assert "step 0.3" in ran.stdout
    assert "sensor 1: " in ran.stdout


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--source", "replay"], "--source replay needs a log: --source replay LOG."),
        (["--source", "replay", "gone.csv"], "gone.csv: cannot be read: No such file or directory."),
        (["--source", "replay", "log.h5"], "is neither the lab's CSV nor a .drive"),
        (["--source", "replay", "log.drive", "--rate", "9"], "--rate is not for --source replay"),
        (["--source", "acconeer", "--fast"], "--fast is not for --source acconeer"),
        (["--source", "replay", "log.drive", "--detector", "gone.pyz"], "gone.pyz: cannot be read: No such file"),
        (["--source", "replay", "short.drive"], "export it for these sweeps"),
        (["--source", "replay", "log.drive", "--sensors", "2"], "the drive has no sensor 2; expected some of 1, 3"),
        (["--source", "scene", "trial"], "invalid choice: 'scene'"),
        (["--source", "replay", "log.drive", "--detector", "log.h5"], "is damaged, or no compiled detector"),
        ([], "the following arguments are required: --source"),
    ],
    ids=lambda value: " ".join(value)[:40] if isinstance(value, list) else "",
)  # fmt: skip
def test_wrong_input_on_the_device_is_one_sentence(arguments: list[str], words: str, tmp_path: Path) -> None:
    import h5py

    file = exported("thesis")
    drive = wandering(count=3)
    write_log(drive, tmp_path / "log.drive")
    write_log(
        dataclasses.replace(
            drive,
            sensors=tuple(
                dataclasses.replace(one, sweeps=one.sweeps[:, :90], range_m=one.range_m[:90]) for one in drive.sensors
            ),
        ),
        tmp_path / "short.drive",
    )
    with h5py.File(tmp_path / "log.h5", "w") as held:
        held["data"] = np.zeros(3)
    there = [str(tmp_path / one) if "." in one else one for one in arguments]
    ran = alone(file, *there)
    log = arguments[2] if arguments[1:2] == ["replay"] and len(arguments) == 3 else ""
    assert ran.returncode == (1 if log in ("gone.csv", "log.h5") else 2)  # as `jaxradar live`: a log that is none
    assert ran.stdout == ""
    assert len(ran.stderr.splitlines()) == 1
    assert ran.stderr.startswith("thesis.pyz: ")
    assert words in ran.stderr


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_full_disk_behind_the_output_is_one_sentence(tmp_path: Path) -> None:
    write_log(wandering(), tmp_path / "log.drive")
    begin = [sys.executable, "-I", str(exported("thesis")), "--source", "replay", str(tmp_path / "log.drive"), "--fast"]
    with Path("/dev/full").open("w") as full:
        ran = subprocess.run(
            [*begin, "--json"], stdout=full, stderr=subprocess.PIPE, check=False, text=True, timeout=120
        )
    assert (ran.returncode, ran.stderr) == (1, "thesis.pyz: standard output: No space left on device.\n")


@pytest.mark.parametrize(
    ("lacks", "words"),
    [
        ("sys.modules['numpy'] = None", "needs NumPy; install it with `pip install numpy 'iree-base-runtime>="),
        ("sys.version_info = (3, 9, 2)", "needs Python 3.11 or newer; this is "),
        (
            "sys.modules['iree.runtime'] = None",
            "needs IREE's runtime; install it with `pip install 'iree-base-runtime>=",
        ),
    ],
    ids=["numpy", "python", "runtime"],
)
def test_what_the_device_lacks_is_said(lacks: str, words: str) -> None:
    program = f"import runpy, sys; {lacks}; del sys.argv[0]; runpy.run_path(sys.argv[0], run_name='__main__')"
    ran = subprocess.run(
        [sys.executable, "-I", "-c", program, str(exported("thesis")), "--source", "replay", "log"],
        capture_output=True, text=True, check=False, timeout=120,
    )  # fmt: skip
    assert (ran.returncode, ran.stdout, len(ran.stderr.splitlines())) == (2, "", 1)
    assert words in ran.stderr
