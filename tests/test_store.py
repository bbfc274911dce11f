"""A store: what goes in comes out, only what changed is read again, and nothing that is damaged is taken."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from log_samples import FIGURE_TEXT, assert_drives_equal, drives, lab_text

from jaxradar._errors import LogError
from jaxradar.cli import main
from jaxradar.drivefile import write_drive
from jaxradar.ingest import import_each
from jaxradar.logs import find_logs, read_log, write_log
from jaxradar.store import (
    CATALOGUE,
    DRIVES,
    MARKER,
    Catalogue,
    entry_of,
    is_archive,
    make_store,
    open_store,
    pack,
)
from jaxradar.store.marker import marker_content

ROWS = [[0.01 * row, *(100 * row + column for column in range(6))] for row in range(20)]


def text(seed: int) -> str:
    return lab_text(
        [0.1 * column + 0.1 for column in range(6)], [[row[0], *(v + seed for v in row[1:])] for row in ROWS]
    )


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    """Four logs in folders, one of them broken in line 3."""
    for number in range(4):
        folder = tmp_path / "logs" / f"day{number % 2}" / f"log{number}"
        folder.mkdir(parents=True)
        (folder / "3.csv").write_text(text(number))
    (tmp_path / "logs" / "day1" / "log3" / "3.csv").write_text(text(3).replace("\n0.010000", "\n0.0x"))
    return tmp_path / "logs"


def done(logs: Any, store: Path, **options: Any) -> dict[str, str]:
    given = [logs] if isinstance(logs, Path) else logs
    return {Path(one.entry.source).name: one.done for one in import_each(given, store, workers=1, **options)}


def test_what_is_imported_is_what_was_read(logs: Path, tmp_path: Path) -> None:
    store = tmp_path / "store"
    assert done(logs, store) == {"log0": "imported", "log1": "imported", "log2": "imported", "log3": "failed"}
    held = open_store(store)
    assert [entry.name for entry in held.entries] == ["logs/day0/log0", "logs/day0/log2", "logs/day1/log1", None]
    assert [entry.error is None for entry in held.entries] == [True, True, True, False]
    assert "3.csv, line 3, column 1" in str(held.entries[-1].error)
    for entry in held.drives:
        assert_drives_equal(held.read(entry, verify=True), read_log(entry.source))
        (sensor,) = entry.sensors
        assert (sensor.sensor, sensor.sweeps, sensor.bins, sensor.dtype) == (3, 20, 6, "uint16")
        assert (entry.steps, entry.bytes) == (None, (Path(entry.source) / "3.csv").stat().st_size)
    assert find_logs([store]) == sorted(store / DRIVES / f"{entry.name}.drive" for entry in held.drives)
    # A store below a folder is its drives, too, and its own folders are not searched for logs.
    assert find_logs([tmp_path / "store", tmp_path]) == find_logs([tmp_path])


def test_only_what_changed_is_read_again(logs: Path, tmp_path: Path) -> None:
    store = tmp_path / "store"
    done(logs, store)
    assert set(done(logs, store).values()) == {"unchanged", "failed before"}
    (logs / "day0" / "log0" / "3.csv").write_text(text(7))
    os.utime(logs / "day0" / "log2" / "3.csv", ns=(5, 5))
    (logs / "day1" / "log3" / "3.csv").write_text(text(3))
    (logs / "day1" / "log1" / "truth.json").write_text('{"steps": [{"impact_s": 0.1}]}')
    assert done(logs, store) == {"log0": "imported", "log1": "imported", "log2": "same", "log3": "imported"}
    held = {Path(entry.source).name: entry for entry in open_store(store).entries}
    assert held["log1"].steps == 1
    assert open_store(store).read(held["log0"]).sensors[0].sweeps[0, 0] == 7
    assert set(done(logs, store).values()) == {"unchanged"}


def test_a_source_that_breaks_later_keeps_its_drive(logs: Path, tmp_path: Path) -> None:
    store = tmp_path / "store"
    done(logs, store)
    (logs / "day0" / "log0" / "3.csv").write_text("nonsense")
    assert done(logs, store)["log0"] == "failed"
    held = {Path(entry.source).name: entry for entry in open_store(store).entries}
    assert held["log0"].name == "logs/day0/log0"
    assert held["log0"].error is not None
    assert open_store(store).read(held["log0"]).sensors[0].sweeps[1, 0] == 100
    assert done(logs, store)["log0"] == "failed before"


def test_a_source_that_moved_is_in_the_store_once(logs: Path, tmp_path: Path) -> None:
    store, elsewhere = tmp_path / "store", tmp_path / "elsewhere"
    done(logs, store)
    shutil.copytree(logs / "day0", tmp_path / "copy")
    assert "moved" not in done(tmp_path / "copy", store).values()  # both are there: two logs, as they were given
    logs.rename(elsewhere)
    outcomes = [one.done for one in import_each([elsewhere], store, workers=1)]
    assert sorted(outcomes) == ["failed", *["imported"] * 3, *["moved"] * 3]
    names = [entry.name for entry in open_store(store).drives]
    assert names == ["copy/log0", "copy/log2", "elsewhere/day0/log0", "elsewhere/day0/log2", "elsewhere/day1/log1"]
    assert sorted(str(path.relative_to(store / DRIVES)) for path in store.rglob("*.drive")) == [
        f"{n}.drive" for n in names
    ]


def test_a_drive_that_is_gone_is_made_again(logs: Path, tmp_path: Path) -> None:
    store = tmp_path / "store"
    done(logs, store)
    shutil.rmtree(store / DRIVES / "logs/day0/log0.drive")
    assert done(logs, store)["log0"] == "imported"


def test_sources_of_one_name_and_their_own_kinds(logs: Path, tmp_path: Path) -> None:
    store, other = tmp_path / "store", tmp_path / "else" / "logs" / "day0"
    shutil.copytree(logs / "day0" / "log0", other / "log0")
    write_drive(read_log(other / "log0"), other / "taken.drive")
    (other / "one.csv").write_text(FIGURE_TEXT)
    assert set(done([logs, tmp_path / "else" / "logs", other / "one.csv"], store).values()) == {"imported", "failed"}
    names = sorted(entry.name for entry in open_store(store).drives)
    assert names == [
        *("logs/day0/log0", "logs/day0/log0-2", "logs/day0/log2", "logs/day0/one", "logs/day0/taken", "logs/day1/log1"),
    ]


def test_a_store_inside_the_logs_is_not_imported_into_itself(logs: Path) -> None:
    assert len(done(logs, logs / "store")) == 4
    assert len(done(logs, logs / "store")) == 4


_KILLED = """
import sys
from jaxradar.ingest import import_each
if __name__ == "__main__":
    for one in import_each(sys.argv[2:], sys.argv[1], workers=2):
        print(one.done, flush=True)
"""


@pytest.mark.parametrize("after", [0, 1, 5])
def test_a_kill_costs_only_what_was_under_way(after: int, tmp_path: Path) -> None:
    for number in range(12):
        (tmp_path / "logs" / f"{number}x").mkdir(parents=True)
        (tmp_path / "logs" / f"{number}x" / "3.csv").write_text(text(number))
    store, script = tmp_path / "store", tmp_path / "killed.py"
    script.write_text(_KILLED)
    run = subprocess.Popen(
        [sys.executable, str(script), str(store), str(tmp_path / "logs")],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert run.stdout is not None
    for _ in range(after):
        assert run.stdout.readline() == "imported\n"
    while not (store / CATALOGUE).exists():
        time.sleep(0.01)
    os.killpg(run.pid, signal.SIGKILL)
    run.wait()
    run.stdout.close()
    assert set(done(tmp_path / "logs", store).values()) <= {"imported", "unchanged"}
    held = open_store(store)
    assert len(held.drives) == 12
    for entry in held.drives:
        assert_drives_equal(held.read(entry, verify=True), read_log(entry.source))
    assert not [path for path in (store / DRIVES).rglob(".*") if path.suffix == ".old"]


def test_a_reader_that_dies_is_one_log_that_failed(logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The worker imports this in the place of the package's own reader.
    (tmp_path / "deadly.py").write_text(
        "import os, jaxradar.ingest as ingest\n"
        "read = ingest.read_log\n"
        "def deadly(path):\n"
        "    if path.name == 'log2': os._exit(9)\n"
        "    return read(path)\n"
        "ingest.read_log = deadly\n"
    )
    script = tmp_path / "run.py"
    script.write_text(
        "import sys; sys.path.insert(0, sys.argv[1]); import deadly\n"
        "from jaxradar.ingest import import_each\n"
        "if __name__ == '__main__':\n"
        "    for one in import_each([sys.argv[2]], sys.argv[3], workers=2):\n"
        "        print(one.entry.source.rpartition('/')[2], one.done, one.entry.error)\n"
    )
    ran = subprocess.run(
        [sys.executable, str(script), str(tmp_path), str(logs), str(tmp_path / "store")],
        capture_output=True,
        text=True,
        check=True,
    )
    said = dict(line.split(" ", 1) for line in ran.stdout.splitlines())
    assert said["log0"] == said["log1"] == "imported None"
    assert said["log2"].startswith("failed ")
    assert "log2: its reader died" in said["log2"]
    assert said["log3"].startswith("failed ")


def test_what_is_no_fault_of_the_log_is_tried_again(
    logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store, locked = tmp_path / "store", logs / "day0" / "log0" / "3.csv"
    if os.geteuid() == 0:  # who may read everything
        (store / DRIVES / "logs" / "day0").mkdir(parents=True)
        (store / DRIVES / "logs" / "day0" / "log0.drive").write_text("something else stands here")
        (store / "store.json").write_bytes(marker_content())
    else:
        locked.chmod(0)
    assert done(logs, store)["log0"] == "failed"
    if os.geteuid() == 0:
        (store / DRIVES / "logs" / "day0" / "log0.drive").unlink()
    else:
        locked.chmod(0o600)
    assert done(logs, store) == {"log0": "imported", "log1": "unchanged", "log2": "unchanged", "log3": "failed before"}


def test_a_link_is_read_under_its_own_name(tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    (tmp_path / "blob").write_text(text(0))
    (tmp_path / "logs" / "3.csv").symlink_to(tmp_path / "blob")
    truth = tmp_path / "logs" / "3.truth.json"
    truth.write_text(json.dumps({"steps": [{"impact_s": 0.1}]}))
    store = tmp_path / "store"
    done([tmp_path / "logs" / "3.csv"], store)
    (entry,) = open_store(store).drives
    assert (entry.steps, entry.sensors[0].sensor) == (1, 3)
    truth.write_text(json.dumps({"steps": []}))
    assert list(done([tmp_path / "logs" / "3.csv"], store).values()) == ["imported"]
    assert open_store(store).drives[0].steps == 0


def test_a_name_that_is_no_text_stops_nothing(logs: Path, tmp_path: Path) -> None:
    strange = Path(os.fsdecode(os.fsencode(logs) + b"/day0/x\xff"))
    shutil.copytree(logs / "day0" / "log0", strange)
    outcomes = list(import_each(logs, tmp_path / "store", workers=1))
    assert sorted(one.done for one in outcomes) == ["failed", "failed", "imported", "imported", "imported"]
    assert any("no UTF-8" in str(one.entry.error) for one in outcomes)
    assert len(open_store(tmp_path / "store").drives) == 3


def test_a_worker_killed_while_nobody_asks_stops_nothing(logs: Path, tmp_path: Path) -> None:
    for number in range(30):
        shutil.copytree(logs / "day0" / "log0", logs / f"more{number}")
    outcomes = []
    for one in import_each(logs, tmp_path / "store", workers=2):
        outcomes.append(one.done)
        if len(outcomes) == 2:
            for child in multiprocessing_children():
                os.kill(child, signal.SIGKILL)
            time.sleep(0.5)
    assert sorted(outcomes) == ["failed", *["imported"] * 33]


def multiprocessing_children() -> list[int]:
    """The workers, which are children of the fork server."""
    found = []
    for status in Path("/proc").glob("[0-9]*/status"):
        with contextlib.suppress(OSError):
            fields = dict(line.split(":", 1) for line in status.read_text().splitlines() if ":" in line)
            parent = Path("/proc", fields["PPid"].strip())
            command = (parent / "cmdline").read_bytes()
            mine = f"PPid:\t{os.getpid()}\n" in (parent / "status").read_text()
            if mine and b"forkserver" in command:
                found.append(int(status.parent.name))
    return found


def test_two_imports_at_once_are_told(logs: Path, tmp_path: Path) -> None:
    store = tmp_path / "store"
    first = import_each([logs], store, workers=1)
    next(first)
    with pytest.raises(LogError, match="is being written or packed by another import"):
        done(logs, store)
    first.close()
    assert len(done(logs, store)) == 4


# Archives


@settings(max_examples=15, deadline=None)
@given(drive=drives(), second=drives())
def test_an_archive_gives_every_drive_back(tmp_path_factory: pytest.TempPathFactory, drive: Any, second: Any) -> None:
    folder = tmp_path_factory.mktemp("archive")
    store = folder / "store"
    make_store(store)
    with Catalogue(store / CATALOGUE, write=True) as catalogue:
        for name, one in (("a", drive), ("b/c", second)):
            write_drive(one, store / DRIVES / f"{name}.drive", durable=False)
            catalogue.put([entry_of(one, source=name, name=name, stamp="[]", hash="", bytes=0)])
    pack(store, folder / "store.zip")
    archive = open_store(folder / "store.zip")
    assert archive.entries == open_store(store).entries
    for entry, wanted in zip(archive.entries, (drive, second), strict=True):
        assert_drives_equal(archive.read(entry), wanted)
        assert_drives_equal(read_log(archive.place(entry)), wanted)
    assert find_logs([folder / "store.zip"]) == [archive.place(entry) for entry in archive.entries]


def test_an_archive_is_made_from_logs_and_unpacked(logs: Path, tmp_path: Path, capsys: Any) -> None:
    archive = tmp_path / "all.zip"
    assert main(["import", str(logs), "-o", str(archive), "--quiet"]) == 1
    assert "3.csv, line 3" in capsys.readouterr().err
    assert is_archive(archive)
    assert main(["import", str(archive), "-o", str(tmp_path / "again")]) == 0
    assert capsys.readouterr().out.splitlines() == ["3 imported.", str(tmp_path / "again")]
    assert len(open_store(tmp_path / "again").drives) == 3
    assert main(["import", str(archive), "-o", str(tmp_path / "again")]) == 0
    assert capsys.readouterr().out.splitlines()[0] == "3 unchanged."
    assert main(["evaluate", str(archive), "--detector", "thesis", "--json", "-", "--quiet"]) == 0
    one = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert main(["evaluate", str(tmp_path / "all"), "--detector", "thesis", "--json", "-", "--quiet"]) == 0
    other = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    strip = lambda lines: [{**line, "path": ""} for line in lines]  # noqa: E731
    assert len(one) == 3
    assert strip(one) == strip(other)


def test_an_archive_of_files_dated_before_zip_and_during_an_import(logs: Path, tmp_path: Path) -> None:
    store = tmp_path / "store"
    done(logs, store)
    os.utime(store / "store.json", (0, 0))
    pack(store, tmp_path / "a.zip")
    assert len(open_store(tmp_path / "a.zip").drives) == 3
    under_way = import_each(logs, store, workers=1)
    next(under_way)
    with pytest.raises(LogError, match="written or packed"):
        pack(store, tmp_path / "b.zip")
    under_way.close()


def test_an_archive_is_not_replaced_unasked(logs: Path, tmp_path: Path, capsys: Any) -> None:
    (tmp_path / "all.zip").write_text("mine")
    assert main(["import", str(logs), "-o", str(tmp_path / "all.zip"), "--quiet", "--overwrite"]) == 1
    assert "something else" in capsys.readouterr().err
    assert (tmp_path / "all.zip").read_text() == "mine"


# What is damaged


def test_what_is_no_store_is_left_alone(logs: Path, tmp_path: Path, capsys: Any) -> None:
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "file").write_text("kept")
    assert main(["import", str(logs), "-o", str(mine)]) == 1
    assert (
        capsys.readouterr().err
        == f"jaxradar: {mine}: exists and is no store (it has no {MARKER}); it was left alone.\n"
    )
    assert [path.name for path in mine.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda store: (store / CATALOGUE).unlink(), "is missing"),
        (lambda store: (store / CATALOGUE).write_bytes(b"SQLite format 3\0" + bytes(500)), "cannot be used"),
        (lambda store: (store / CATALOGUE).write_bytes(b"no base"), "cannot be used"),
        (lambda store: (store / MARKER).write_text("{"), "is not JSON"),
        (lambda store: (store / MARKER).write_text('{"format": "jaxradar.store", "version": 2}'), "of version 1"),
        (lambda store: _execute(store, "PRAGMA user_version = 7"), "has version 7"),
        (lambda store: _execute(store, "UPDATE drives SET sensors = '[1]'"), "no entry"),
        (lambda store: _execute(store, "UPDATE drives SET problems = '{'"), "no entry"),
        (lambda store: _execute(store, "UPDATE drives SET problems = '[3]'"), "no entry"),
        (lambda store: _execute(store, "DROP TABLE drives"), "cannot be used"),
    ],
)
def test_a_damaged_store_is_one_sentence(damage: Any, said: str, logs: Path, tmp_path: Path, capsys: Any) -> None:
    store = tmp_path / "store"
    done(logs, store)
    damage(store)
    with pytest.raises(LogError, match=said):
        open_store(store)
    assert main(["evaluate", str(store), "--detector", "thesis"]) == 1
    err = capsys.readouterr().err
    assert said in err
    assert len(err.splitlines()) == 1


def _execute(store: Path, command: str) -> None:
    base = sqlite3.connect(store / CATALOGUE)
    base.execute(command)
    base.commit()
    base.close()


def test_a_damaged_archive_is_one_sentence(logs: Path, tmp_path: Path) -> None:
    done(logs, tmp_path / "store")
    pack(tmp_path / "store", tmp_path / "store.zip")
    whole = (tmp_path / "store.zip").read_bytes()
    rng = np.random.default_rng(0)
    broken = tmp_path / "broken.zip"
    for turn in range(150):
        content = bytearray(whole)
        if turn % 3 == 0:
            content = content[: int(rng.integers(40, len(content)))]
        else:
            for _ in range(1 + turn % 5):
                content[int(rng.integers(40, len(content)))] = int(rng.integers(256))
        broken.write_bytes(content)
        os.utime(broken, ns=(turn, turn))
        try:
            held = open_store(broken)
            for entry in held.drives:
                held.read(entry)
        except LogError as error:
            assert str(error).startswith(str(broken))


def test_the_command_line(logs: Path, tmp_path: Path, capsys: Any) -> None:
    store = tmp_path / "store"
    assert main(["import", str(logs), "-o", str(store), "--json"]) == 1
    said = json.loads(capsys.readouterr().out)
    assert (said["store"], said["imported"], said["failed"], len(said["errors"])) == (str(store), 3, 1, 1)
    assert main(["import", str(logs), "-o", str(store)]) == 1
    captured = capsys.readouterr()
    assert captured.out.splitlines() == ["3 unchanged, 1 could not be read before and have not changed.", str(store)]
    assert main(["import", str(tmp_path / "none"), "-o", str(store), "--quiet"]) == 1
    assert "none: cannot be read" in capsys.readouterr().err
    assert len(open_store(store).entries) == 4  # what is not there has no row
    (tmp_path / "empty").mkdir()
    assert main(["import", str(tmp_path / "empty"), "-o", str(store)]) == 2
    assert "no logs there" in capsys.readouterr().err
    write_log(read_log(logs / "day0" / "log0"), tmp_path / "back")
    assert main(["info", str(store / DRIVES / "logs/day0/log0.drive")]) == 0
