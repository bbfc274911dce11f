"""How live detection ends: by a signal at any time, and by a source that fails; what was counted is told."""

from __future__ import annotations

import argparse
import json
import os
import signal
from collections.abc import Iterator

import numpy as np
import pytest
from live_samples import wandering

from jaxradar._errors import SourceError
from jaxradar.live import LiveSweep, Replay, Source
from jaxradar.live.app import detect_live
from jaxradar.live.artefact import DECISION, Header
from jaxradar.live.detect import LiveDetector
from jaxradar.live.options import add_live_options


class Silent:
    """A program that finds nothing."""

    def __init__(self, inputs: int) -> None:
        self.inputs = np.zeros(inputs, np.float32)

    def run(self) -> np.ndarray:
        return np.zeros(len(DECISION), np.float32)

    def another(self) -> Silent:
        return Silent(len(self.inputs))


def detector(source: Source) -> LiveDetector:
    range_m = tuple(source.range_m.tolist())
    header = Header(
        "silent", "", 0.7, "x", "m", range_m, "uint16", "float32", (0.0,), (), DECISION, "host", "iree", (), {}
    )
    return LiveDetector(header, Silent(header.inputs))


def arguments(*options: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_live_options(parser, {"replay": "a log"})
    return parser.parse_args(["--source", "replay", "log", *options])


class SignalledBefore(Replay):
    """As a source that takes long to open."""

    def open(self) -> None:
        os.kill(os.getpid(), signal.SIGTERM)
        super().open()


class SignalledWithin(Replay):
    """As a server's client that the signal takes the connection from."""

    def open(self) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        raise SourceError("lost the connection.")


class Failing(Replay):
    """As a server that goes away after five sweeps."""

    def __iter__(self) -> Iterator[LiveSweep]:
        for place, sweep in enumerate(super().__iter__()):
            if place == 5:
                raise SourceError("lost the connection.")
            yield sweep


def test_a_signal_while_the_source_is_opened_ends_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert detect_live(arguments("--json"), SignalledBefore(wandering(), None), detector) == 128 + signal.SIGTERM
    assert json.loads(capsys.readouterr().out)["summary"]["sweeps"] == 0
    assert detect_live(arguments("--json"), SignalledWithin(wandering(), None), detector) == 128 + signal.SIGINT
    assert capsys.readouterr() == ("", "")


def test_a_source_that_fails_leaves_the_summary(capsys: pytest.CaptureFixture[str]) -> None:
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(SourceError):
        detect_live(arguments("--json"), Failing(wandering(), None), detector)
    assert json.loads(capsys.readouterr().out)["summary"]["sweeps"] == 5
    assert signal.getsignal(signal.SIGINT) is before
