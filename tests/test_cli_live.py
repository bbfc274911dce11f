"""`jaxradar export` and `jaxradar live`: what they print, and wrong input in one sentence."""

from __future__ import annotations

import dataclasses
import json
import signal
from pathlib import Path

import numpy as np
import pytest
from live_samples import assert_same_events, exported, wandering

from jaxradar.cli import main
from jaxradar.drive import Drive
from jaxradar.live import LiveSweep, Replay, app
from jaxradar.live.artefact import read_artefact
from jaxradar.live.detect import LiveDecision
from jaxradar.live.run import Listener, Moment
from jaxradar.logs import write_log


@pytest.fixture
def log(tmp_path: Path) -> Path:
    write_log(wandering(), tmp_path / "log.drive")
    return tmp_path / "log.drive"


def live(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[list[dict], dict]:
    """Detections and summary of a replay as fast as it goes."""
    assert main(["live", "--source", "replay", *map(str, arguments), "--fast", "--json"]) == 0
    *events, last = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    return [event["event"] for event in events], last["summary"]


def test_a_detector_by_its_name_finds_what_evaluate_finds(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found, summary = live(capsys, log, "--detector", "thesis")
    assert main(["evaluate", str(log), "--detector", "thesis", "--json", "-"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    for line in lines:
        own = [event for event in found if event["sensor"] == line["sensor"]]
        assert_same_events(own, [{"sensor": line["sensor"], **event} for event in line["detections"]])
    assert len(found) > 6
    assert {key: summary[key] for key in ("sweeps", "events", "missed", "misfits")} == {
        "sweeps": 180, "events": len(found), "missed": 0, "misfits": 0,
    }  # fmt: skip
    some, summary = live(capsys, log, "--detector", "thesis", "--sensors", "3", "--sweeps", "30")
    assert some == [event for event in found if event["sensor"] == 3 and event["sweep"] < 30]
    assert summary["sweeps"] == 30


def test_a_compiled_file_is_read_and_not_run(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    compiled = live(capsys, log, "--detector", exported("thesis"))[0]
    (tmp_path / "same.toml").write_text(read_artefact(exported("thesis")).header.config)
    by_jax = live(capsys, log, "--detector", tmp_path / "same.toml")[0]
    assert len(compiled) == len(by_jax) > 6
    assert_same_events(compiled, by_jax)


def test_amplitudes_with_a_fraction_are_not_cut_off(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Between the two bins lies less than a count; a detector for whole counts refuses them."""
    one = wandering((1,)).sensors[0]
    sweeps = np.full(one.sweeps.shape, 100.0, np.float32)
    sweeps[:, 40] = 100.25
    sweeps[45:, 50] = 100.75
    write_log(Drive((dataclasses.replace(one, sweeps=sweeps * 1.0),)), tmp_path / "float.drive")
    found, _ = live(capsys, tmp_path / "float.drive", "--detector", "range-rate")
    assert main(["evaluate", str(tmp_path / "float.drive"), "--detector", "range-rate", "--json", "-"]) == 0
    line = json.loads(capsys.readouterr().out)
    assert [event["sweep"] for event in found] == [event["sweep"] for event in line["detections"]]
    arguments = ["live", "--source", "replay", str(tmp_path / "float.drive"), "--fast"]
    assert main([*arguments, "--detector", str(exported("thesis"))]) == 2
    assert "amplitudes are float32, and the detector is compiled for uint16" in capsys.readouterr().err


def test_a_replay_says_what_its_amplitudes_are() -> None:
    parts = wandering((1, 2)).sensors
    mixed = dataclasses.replace(parts[1], sweeps=parts[1].sweeps.astype(np.float32))
    assert Replay(Drive(parts)).dtype == np.uint16
    assert Replay(Drive((parts[0], mixed))).dtype == np.float32
    assert Replay(Drive((parts[0], mixed)), sensors=(1,)).dtype == np.uint16


def test_stablehlo_from_the_log_to_live(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("flatbuffers")
    made = tmp_path / "step.pyz"
    arguments = ["export", "thesis", "-o", str(made), "--like", str(log), "--format", "stablehlo"]
    assert main([*arguments, "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert (record["file"], record["bytes"]) == (str(made), made.stat().st_size)
    assert (record["detector"], record["bins"], record["kind"], record["target"]) == ("thesis", 128, "jax", "host")
    assert record["sha256"] == read_artefact(made).sha256
    assert read_artefact(made).header.sensors == (1, 3)
    assert main(arguments) == 0
    assert "jaxradar live --detector" in capsys.readouterr().out
    assert live(capsys, log, "--detector", made)[0] == live(capsys, log, "--detector", "thesis")[0]


EXPORTS = [
    (["thesis", "-o", "a.zip", "--like", "log.drive"], "must end with .pyz."),
    (["thesis", "-o", "no/a.pyz", "--like", "log.drive"], "there is no such folder."),
    (["thesis", "-o", "folder.pyz", "--like", "log.drive"], "is a folder; expected a file."),
    (["thesis", "-o", "a.pyz"], "expected either --like LOG or --range M:M --bins N."),
    (["thesis", "-o", "a.pyz", "--like", "log.drive", "--range", "0.1:0.8"], "expected either --like LOG or --range"),
    (["thesis", "-o", "a.pyz", "--range", "0.1:0.8"], "--range needs --bins"),
    (["thesis", "-o", "a.pyz", "--like", "log.drive", "--bins", "9"], "--bins goes with --range"),
    (
        ["thesis", "-o", "a.pyz", "--like", "log.drive", "--sensors", "2"],
        "log.drive: has no sensor 2; expected some of 1, 3.",
    ),
    (["thesis", "-o", "a.pyz", "--range", "0.8:0.1", "--bins", "9"], "expected two ranges in metres such as 0.1:0.8"),
    (["thesis", "-o", "a.pyz", "--range", "0.1.2:4", "--bins", "9"], "expected two ranges in metres such as 0.1:0.8"),
    (["thesis", "-o", "a.pyz", "--range", f"0:{10**400}", "--bins", "9"], "expected two ranges in metres"),
    (["thesis", "-o", "a.pyz", "--range", "0.1:0.8", "--bins", "1"], "1"),
    (["thesis", "-o", "a.pyz", "--range", "0.1:0.8", "--bins", "9", "--sensors", "1;3"], "sensor numbers such as 1,3"),
    (["thesis", "-o", "a.pyz", "--range", "0.1:0.8", "--bins", "9", "--target", "z80"], "unknown target `z80`"),
    (["thesiz", "-o", "a.pyz", "--range", "0.1:0.8", "--bins", "9"], "thesiz"),
    (["thesis", "-o", "a.pyz", "--like", "gone"], "gone"),
]
LIVES = [
    (["--source", "replay"], "--source replay needs a log: --source replay LOG."),
    (["--source", "scene"], "--source scene needs a scene: --source scene SCENE."),
    (["--source", "scene", "no-scene"], "no-scene"),
    (["--source", "replay", "gone"], "gone"),
    (["--source", "replay", "log.drive", "--sensors", "2"], "the drive has no sensor 2"),
    (["--source", "replay", "log.drive", "--sensors", "1,1"], "expected sensor numbers such as 1,3"),
    (["--source", "replay", "log.drive", "--pace", "0"], "expected a number > 0"),
    (["--source", "replay", "log.drive", "--pace", "nan"], "expected a number > 0"),
    (["--source", "replay", "log.drive", "--sweeps", "0"], "expected a whole number >= 1"),
    (["--source", "replay", "log.drive", "--sweeps", "²"], "expected a whole number >= 1"),
    (["--source", "replay", "log.drive", "--sensors", "²"], "expected sensor numbers such as 1,3"),
    (
        ["--source", "replay", "log.drive", "--detector", "gone.pyz"],
        "gone.pyz: cannot be read: No such file or directory; expected a file that `jaxradar export` made.",
    ),
    (["--source", "replay", "log.drive", "--detector", "thesiz"], "thesiz"),
    (["--source", "nowhere"], "nowhere"),
    (["--source", "replay", "log.drive", "--running-average", "0.5"], "--running-average is not for --source replay"),
    (
        ["--source", "scene", "trial", "--from", "0.2"],
        "--from is not for --source scene; it goes with --source acconeer",
    ),
    (["--source", "acconeer", "--pace", "2"], "--pace is not for --source acconeer; it goes with what was recorded."),
]


@pytest.mark.parametrize(
    ("command", "arguments", "words"),
    [*(("export", *one) for one in EXPORTS), *(("live", *one) for one in LIVES)],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_wrong_input_is_one_sentence(
    command: str, arguments: list[str], words: str, tmp_path: Path, log: Path,
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.pyz").mkdir()
    try:
        status = main([command, *arguments])
    except SystemExit as ended:
        status = int(ended.code or 0)
    said = capsys.readouterr()
    assert said.out == ""
    assert "Traceback" not in said.err
    assert words in said.err
    assert len(said.err.splitlines()) == 1, said.err
    assert status == (1 if "gone" in arguments else 2)  # a log that is not there: some of it failed
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder.pyz", "log.drive"]


def test_another_range_axis_is_refused_in_plain_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    parts = [dataclasses.replace(one, range_m=one.range_m + 0.001) for one in wandering().sensors]
    write_log(Drive(tuple(parts)), tmp_path / "further")
    arguments = ["live", "--source", "replay", str(tmp_path / "further"), "--fast"]
    assert main([*arguments, "--detector", str(exported("thesis"))]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert "the sweeps have 128 bins from 0.101 to 0.994293 m, and the detector is compiled for 128 bins" in said.err
    assert "`jaxradar export --like`" in said.err


def test_without_the_compiler_it_is_said_how_to_get_it(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "iree.compiler", None)
    assert main(["export", "thesis", "-o", str(tmp_path / "a.pyz"), "--like", str(log)]) == 2
    assert "install it with `pip install 'jaxradar[export]'`" in capsys.readouterr().err
    assert not (tmp_path / "a.pyz").exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_loop_in_good_order(
    number: signal.Signals, log: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Signalling(Listener):
        swept = 0

        def hear(self, live: LiveSweep, decision: LiveDecision, moment: Moment) -> None:
            self.swept += 1
            if self.swept == 5:
                signal.raise_signal(number)

    printed = app.listeners_of
    monkeypatch.setattr(app, "listeners_of", lambda args: [*printed(args), Signalling()])
    before = signal.getsignal(number)
    arguments = ["live", "--source", "replay", str(log), "--fast", "--json", "--detector", str(exported("thesis"))]
    assert main(arguments) == 128 + number
    assert signal.getsignal(number) is before
    said = capsys.readouterr()
    assert json.loads(said.out.splitlines()[-1])["summary"]["sweeps"] == 5
    assert said.err == ""
