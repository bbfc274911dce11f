"""Detectors as TOML files: what comes back, and what is refused in which words."""

from __future__ import annotations

from pathlib import Path

import equinox as eqx
import numpy as np
import pytest

from jaxradar._errors import ConfigError
from jaxradar.drive import Mounting
from jaxradar.systems.step import DETECTORS, DefaultDetector, DetectorFile, ShiftDetector, dump_detector, load_detector


@pytest.mark.parametrize("name", DETECTORS)
def test_the_printed_file_is_the_default(name: str, tmp_path: Path) -> None:
    path = tmp_path / "detector.toml"
    path.write_text(dump_detector(name), encoding="utf-8")
    read = load_detector(path)
    assert type(read.detector) is DETECTORS[name]
    assert eqx.tree_equal(read.detector, DETECTORS[name]())
    settings = [line for line in dump_detector(name).splitlines()[3:] if line and not line.startswith("[")]
    assert settings
    assert all("#" in line for line in settings)  # each is explained


def test_everything_comes_back(tmp_path: Path) -> None:
    path = tmp_path / "detector.toml"
    mounting = Mounting(0.35, 45.0, None)
    provenance = {"data": 'a "folder"', "seed": 7, "scores": [0.1, 0.2], "final": True, "made by": "me"}
    path.write_text(dump_detector(DetectorFile(ShiftDetector(evidence=0.123456789, cell_m=0.01), mounting, provenance)))
    read = load_detector(path)
    assert isinstance(read.detector, ShiftDetector)
    assert float(read.detector.evidence) == 0.123456789
    assert read.detector.cell_m == 0.01
    assert read.mounting == mounting
    assert read.provenance == provenance


HEAD = 'format = 1\ndetector = "shift"\n'
PARTS = 'format = 1\ndetector = "default"\n'
REFUSED = {
    "no format": ('detector = "default"\n', "`format` must be 1; got 'none'"),
    "newer format": ('format = 2\ndetector = "default"\n', "`format` must be 1; got 2"),
    "unknown detector": ('format = 1\ndetector = "defalt"\n', "`detector` 'defalt' (did you mean `default`?)"),
    "unknown key": (HEAD + "evidense = 0.1\n", "unknown key `evidense` (did you mean `evidence`?)"),
    "another detector's key": (HEAD + "threshold_m_s = 0.1\n", "unknown key `threshold_m_s`"),
    "out of bounds": (HEAD + "evidence = 1.5\n", "`ShiftDetector(evidence=...)` must be between 0.0 and 1.0"),
    "not a number": (HEAD + 'evidence = "0.1"\n', "`evidence` in the detector `shift` must be a number; got '0.1'"),
    "a truth for a number": (
        HEAD + "evidence = true\n",
        "`evidence` in the detector `shift` must be a number; got True",
    ),
    "nan": (HEAD + "evidence = nan\n", "must be between 0.0 and 1.0; got nan"),
    "not TOML": ("format = \n", "expected a TOML file: Invalid value (at line 1"),
    "mounting's key": (HEAD + "[mounting]\nhight_m = 1\n", "unknown key `hight_m` (did you mean `height_m`?)"),
    "mounting's value": (HEAD + "[mounting]\nheight_m = inf\n", "`height_m` in [mounting] must be a finite number"),
    "a date": (HEAD + "[provenance]\nday = 2024-01-01\n", "`day` in [provenance] must be a text"),
    "part's key": (PARTS + "[shift]\nevidense = 1\n", "unknown key `evidense` (did you mean"),
    "part's value": (PARTS + "[shift]\nevidence = 2\n", "[shift]: `ShiftDetector(evidence=...)`"),
    "part no table": (PARTS + "shift = 1\n", "`shift` must be a table of settings, or false"),
    "no part": (
        PARTS + "shift = false\napproach = false\n",
        "`DefaultDetector(approach=..., shift=...)` needs one of the two.",
    ),
    "mounting no table": (HEAD + "mounting = 3\n", "[mounting] must be a table; got 3"),
}


@pytest.mark.parametrize(("text", "message"), REFUSED.values(), ids=REFUSED)
def test_refused_in_one_sentence_that_names_the_file(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as error:
        load_detector(path)
    assert message in str(error.value)
    assert str(path) in str(error.value)


def test_parts_keep_what_the_file_leaves_out(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('format = 1\ndetector = "default"\napproach = false\n[shift]\nevidence = 0.2\n')
    read = load_detector(path).detector
    assert isinstance(read, DefaultDetector)
    assert read.approach is None
    assert read.shift is not None
    assert float(read.shift.evidence) == 0.2
    assert float(read.shift.still_s) == float(DefaultDetector().shift.still_s) > 0  # the part's own default
    path.write_text(dump_detector(DetectorFile(read)), encoding="utf-8")
    assert eqx.tree_equal(load_detector(path).detector, read)


def test_unknown_name_is_answered_with_the_nearest() -> None:
    with pytest.raises(
        ConfigError, match=r"unknown detector `thesys` \(did you mean `thesis`\?\); expected thesis, lab"
    ):
        load_detector("thesys")
    with pytest.raises(ConfigError, match=r"missing.toml: cannot be read: No such file"):
        load_detector("missing.toml")


def test_construction_names_argument_bound_and_value() -> None:
    with pytest.raises(ValueError, match=r"`ShiftDetector\(window_s=...\)` must be between 0.001 and 10.0 s; got 0.0"):
        ShiftDetector(window_s=0.0)
    with pytest.raises(ValueError, match="got nan"):
        ShiftDetector(evidence=np.nan)
