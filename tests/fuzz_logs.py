"""Malformed variants of valid logs, stores, archives and settings: bytes flipped, inserted, deleted, repeated, cut off.

Whatever comes out must be what was asked for, or a `LogError` or `ConfigError` that names the file, within a second of
computing and without taking memory. The
variants are a function of their number, so that a failure can be repeated.
"""

from __future__ import annotations

import json
import random
import resource
import shutil
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
from log_samples import FIGURE_TEXT, sample_drive

from jaxradar._errors import ConfigError, LogError
from jaxradar.drive import Drive
from jaxradar.drivefile import DriveWriter, SensorLayout, write_drive
from jaxradar.logs import read_log, write_log
from jaxradar.sim import dump_scene, load_scene
from jaxradar.store import CATALOGUE, DRIVES, Catalogue, entry_of, make_store, open_store, pack
from jaxradar.systems.step import dump_detector, load_detector

__all__ = ["KINDS", "check_variants", "write_h5", "write_seeds"]

KINDS = {".csv", "folder", ".h5", ".drive", ".store", ".zip", ".toml"}

SECONDS = 1.0
MOST_MEGABYTES = 200
TOKENS = (
    b",",
    b"\n",
    b"\r",
    b"\0",
    b"nan",
    b"inf",
    b"1e999",
    b'"',
    b"-",
    b"\xff",
    b"\xef\xbb\xbf",
    b"9" * 40,
    b"[" * 99,
)


def write_h5(path: Path, sweeps: int = 6, bins: int = 24, **changes: object) -> Path:
    """A recording as the maker's tool saves it; `changes` replace datasets, None leaves one out."""
    rng = np.random.default_rng(5)
    info = {"missed_data": False, "data_saturated": False, "data_quality_warning": False, "sensor_comm_error": False}
    config = {"mode": "ENVELOPE", "sensor": [3], "profile": "PROFILE_2", "update_rate": 30.0}
    session = {"range_start_m": 0.2, "range_length_m": 0.6, "data_length": bins, "step_length_m": 0.000484}
    content: dict[str, object] = {
        "data": rng.integers(0, 9000, (sweeps, 1, bins)).astype(np.uint16),
        "sample_times": 1_632_137_110.25 + np.arange(sweeps) / 32,
        "sensor_config_dump": json.dumps(config),
        "session_info": json.dumps(session),
        "data_info": json.dumps([[info]] * sweeps),
        "mode": "envelope",
        "rss_version": "2.8.2",
    } | changes
    with h5py.File(path, "w") as file:
        for name, value in content.items():
            if isinstance(value, np.ndarray) and value.size:
                file.create_dataset(name, data=value, compression="gzip")
            elif value is not None:
                file[name] = value
    return path


def write_seeds(folder: Path) -> list[Path]:
    """Valid logs of every kind."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "3.csv").write_text(FIGURE_TEXT)
    (folder / "3.truth.json").write_text(
        '{"steps": [{"impact_s": 1.5, "height_m": 0.03}], "mounting": {"angle_deg": 45}}'
    )
    write_log(sample_drive(), folder / "log")
    write_h5(folder / "envelope.h5")
    iq = np.ones((6, 1, 24)) * (3 + 4j)
    write_h5(folder / "iq.h5", data=iq, sensor_config_dump='{"mode": "IQ", "sensor": 1}', mode="iq")
    write_drive(sample_drive(), folder / "closed.drive")
    writer = DriveWriter(folder / "open.drive", [SensorLayout(3, np.array([0.1, 0.2]))])
    writer.append(3, np.arange(5), np.arange(10, dtype=np.uint16).reshape(5, 2))
    store = folder / "some.store"
    make_store(store)
    with Catalogue(store / CATALOGUE, write=True) as catalogue:
        for name in ("one", "below/two"):
            write_drive(sample_drive(), store / DRIVES / f"{name}.drive", durable=False)
            entry = entry_of(sample_drive(), source=name, name=name, stamp="[]", hash=name, bytes=1)
            catalogue.put([replace(entry, problems=("a sentence",))])
    pack(store, folder / "some.zip")
    (folder / "detector.toml").write_text(dump_detector("default"))
    (folder / "scene.toml").write_text(dump_scene(load_scene("trial")))
    names = ("3.csv", "log", "envelope.h5", "iq.h5", "closed.drive", "open.drive")
    return [folder / name for name in (*names, "some.store", "some.zip", "detector.toml", "scene.toml")]


def _read(target: Path) -> bool:
    """Whether all of it could be read; the error names the file."""
    try:
        if target.suffix == ".toml":
            (load_detector if target.stem == "detector" else load_scene)(target)
        elif target.suffix in (".store", ".zip"):
            store = open_store(target)
            for entry in store.drives:
                _use(store.read(entry))
        else:
            _use(read_log(target))
    except (LogError, ConfigError) as error:
        assert str(error).startswith(str(target.parent)), f"names no file: {error}"
        return False
    return True


def _use(drive: Drive) -> None:
    for series in drive.sensors:
        np.array(series.sweeps)


def mutate(content: bytes, rng: random.Random) -> bytes:
    """One malformed variant."""
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 2, 4, 16))):
        place = rng.randrange(len(data) + 1)
        length = rng.choice((1, 1, 2, 4, 8, 64))
        kind = rng.randrange(6)
        if kind == 0 and place < len(data):
            data[place] ^= 1 << rng.randrange(8)
        elif kind == 1:
            data[place : place + length] = rng.randbytes(length)
        elif kind == 2:
            data[place:place] = rng.choice(TOKENS)
        elif kind == 3:
            del data[place : place + length]
        elif kind == 4:
            data[place:place] = data[place : place + 16 * length]
        elif rng.random() < 0.3:
            del data[place:]
        else:
            data[place : place + length] = rng.choice((b"\0", b"\xff")) * length
    return bytes(data)


def check_variants(seeds: list[Path], work: Path, first: int, count: int) -> Counter[str]:
    """Read `count` variants; how often a drive or an error came out. Raises `AssertionError` naming the variant."""
    outcomes: Counter[str] = Counter()
    for number in range(first, first + count):
        rng = random.Random(number)
        seed = seeds[number % len(seeds)]
        target = work / seed.name
        if seed.is_dir():
            shutil.copytree(seed, target)
            part = rng.choice(sorted(path for path in target.rglob("*") if path.is_file()))
        else:
            shutil.copy(seed, target)
            beside = seed.with_name(f"{seed.stem}.truth.json")
            part = target
            if beside.exists():
                part = rng.choice((target, target, Path(shutil.copy(beside, work))))
        part.write_bytes(mutate(part.read_bytes(), rng))
        start = time.process_time()  # not the clock on the wall: a busy machine would fail what is sound
        try:
            sound = _read(target)
        except BaseException as error:
            raise AssertionError(f"variant {number} of {seed.name}: {type(error).__name__}: {error}") from error
        took = time.process_time() - start
        assert took < SECONDS, f"variant {number} of {seed.name} took {took:.1f} s"
        outcomes[f"{seed.suffix or 'folder'} {'sound' if sound else 'error'}"] += 1
        shutil.rmtree(work)
        work.mkdir()
    return outcomes


def peak_megabytes() -> float:
    """The most memory that this process ever held."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
