"""Acconeer's HDF5 recordings of the A111, as the maker's `acconeer-exptool` up to version 5 saves them.

At the top of the file stand `data` (sweeps, sensors, bins), uint16 for the envelope and complex for IQ;
`sample_times` (sweeps,), Unix seconds; and JSON texts: `session_info` (`range_start_m`, `step_length_m`,
`data_length`, often `range_length_m`), `sensor_config_dump` (`mode`, `sensor`: the sensors' numbers, `profile`,
`update_rate`, ...) and `data_info`, which holds for each sweep and sensor `missed_data`, `data_saturated`,
`data_quality_warning` and `sensor_comm_error`. `mode` and `rss_version` are texts.

A file may be damaged: nothing is read before its size is known to be within what the file can hold.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped]
import numpy as np

from jaxradar._errors import LogError
from jaxradar.drive import FULL_SCALE, MAKERS_FLAGS, Drive, SensorSeries, SweepFlag, unrounded_bin_m
from jaxradar.labcsv import odd_times, read_truth, truth_path
from jaxradar.logs.hdf5_text import heap_text
from jaxradar.units import NANOSECONDS

__all__ = ["read_acconeer_h5"]

# Deflate packs zeros 1032 times; more than that no file of this size can hold.
_MOST_PACKED = 1040
_MOST_BYTES = 4 << 30
_READABLE = "an A111 recording in the envelope or IQ mode can be read"


def read_acconeer_h5(path: Path) -> Drive:
    """Read a recording. Of IQ the modulus is kept, as float32 if that holds it exactly, else as float64.

    Raises `LogError`, naming file and dataset, for what is no such recording: damaged files, the sparse and power-bin
    modes, recordings of the A121, files that hold processed output alone.
    """
    try:
        with path.open("rb") as file:
            file.read(1)
        with h5py.File(path, "r", locking=False) as file:
            return _Recording(path, file).drive()
    except LogError:
        raise
    except OSError as error:
        raise LogError(path, f"cannot be read as HDF5: {error!s:.120}.") from error
    except Exception as error:  # the HDF5 library lets damage show in any exception
        raise LogError(path, f"is a damaged HDF5 file ({type(error).__name__}: {error!s:.120}).") from error


class _Recording:
    """One open file."""

    def __init__(self, path: Path, file: Any) -> None:
        self.path = path
        self.file = file
        self.names = sorted(file)
        self.limit = min(_MOST_BYTES, path.stat().st_size * _MOST_PACKED)

    def drive(self) -> Drive:
        self._check_kind()
        config, session = self._object("sensor_config_dump"), self._object("session_info")
        self._check_mode(config)
        data = self._data()
        seconds = self._array("sample_times", 1, "f")
        if seconds.shape != data.shape[:1]:
            raise LogError(self.path, f"`sample_times` has shape {seconds.shape} for `data` of shape {data.shape}.")
        numbers = self._sensors(config, data.shape[1])
        range_m = self._range_axis(session, data.shape[2])
        flags = self._flags(data.shape[:2])
        times_ns, started_at_ns = self._times(seconds)
        config = _finite(config)
        spec = config | {"rss_version": self._text("rss_version")} if "rss_version" in self.names else config
        sensors = []
        for column, number in sorted(enumerate(numbers), key=lambda item: item[1]):
            sweeps = np.ascontiguousarray(data[:, column])
            own = flags[:, column].copy()
            own[(sweeps == FULL_SCALE).any(axis=1)] |= np.uint16(SweepFlag.SATURATED)
            sensors.append(SensorSeries(number, times_ns, sweeps, range_m, own, spec))
        truth, mounting = read_truth(truth_path(self.path))
        problems = odd_times(times_ns, "sample_times")
        if not len(times_ns):
            problems.append(f"{self.path.name}: holds no sweep.")
        return Drive(
            sensors=tuple(sensors),
            mounting=mounting,
            truth=truth,
            started_at_ns=started_at_ns,
            problems=tuple(problems),
        )

    def _refuse(self, name: str, problem: str) -> LogError:
        return LogError(self.path, f"`{name}` {problem}")

    def _check_kind(self) -> None:
        held = ", ".join(self.names[:8]) or "nothing"
        if "sessions" in self.names or "generation" in self.names:
            kind = self._text("generation") if "generation" in self.names else "a121"
            raise LogError(self.path, f"is a recording of the {kind.upper():.20} generation; {_READABLE}.")
        if "data" not in self.names:
            raise LogError(self.path, f"holds {held:.200}, but no `data`; {_READABLE}.")

    def _check_mode(self, config: dict[str, Any]) -> None:
        mode = self._text("mode") if "mode" in self.names else config.get("mode")
        if not isinstance(mode, str) or mode.lower() not in ("envelope", "iq"):
            raise LogError(self.path, f"`mode` is {mode!r:.40}; {_READABLE}.")

    def _dataset(self, name: str) -> Any:
        if name not in self.names:
            raise LogError(self.path, f"lacks `{name}`; {_READABLE}.")
        dataset = self.file[name]
        if not isinstance(dataset, h5py.Dataset):
            raise self._refuse(name, "is no dataset.")
        if dataset.is_virtual or dataset.external:
            raise self._refuse(name, "lies in another file; expected a recording in one piece.")
        chunk = int(np.prod(dataset.chunks or (1,), dtype=object)) * dataset.dtype.itemsize
        size = int(np.prod(dataset.shape or (1,), dtype=object)) * dataset.dtype.itemsize
        if max(size, chunk) > self.limit:
            raise self._refuse(
                name,
                f"claims {size} bytes in pieces of {chunk}, more than a file of this size can hold; it is damaged.",
            )
        return dataset

    def _array(self, name: str, dimensions: int, kinds: str) -> np.ndarray:
        dataset = self._dataset(name)
        if dataset.dtype.kind not in kinds or dataset.ndim != dimensions:
            raise self._refuse(
                name, f"is {dataset.dtype} of shape {dataset.shape}; expected {dimensions} dimensions of kind {kinds}."
            )
        return np.asarray(dataset[()])

    def _data(self) -> np.ndarray:
        """(sweeps, sensors, bins) amplitudes."""
        dimensions = 2 if self._dataset("data").ndim == 2 else 3  # one sensor alone
        data = self._array("data", dimensions, "uc")
        data = data[:, None] if dimensions == 2 else data
        if data.shape[1] < 1 or data.shape[2] < 2:
            raise self._refuse("data", f"has shape {data.shape}; expected (sweeps, sensors, bins) with 2 bins or more.")
        if data.dtype.kind == "u":
            if data.dtype.itemsize != 2:
                raise self._refuse("data", f"is {data.dtype}; expected uint16.")
            return data.astype(np.uint16, copy=False)
        modulus: np.ndarray = np.abs(data)
        if not np.isfinite(modulus).all():
            raise self._refuse(
                "data", f"holds a number that is not finite, at {np.argwhere(~np.isfinite(modulus))[0]}."
            )
        with np.errstate(over="ignore"):
            single: np.ndarray = modulus.astype(np.float32)
        return single if np.array_equal(single, modulus) else modulus.astype(np.float64)

    def _text(self, name: str) -> str:
        dataset = self._dataset(name)
        if dataset.shape != () or dataset.dtype.kind not in "OS":
            raise self._refuse(name, f"is {dataset.dtype} of shape {dataset.shape}; expected one text.")
        value = dataset[()] if dataset.dtype.kind == "S" else self._heap_text(name, dataset)
        try:
            return bytes(value).decode()
        except UnicodeDecodeError as error:
            raise self._refuse(name, f"is no UTF-8: {error}.") from error

    def _heap_text(self, name: str, dataset: Any) -> bytes:
        offset = dataset.id.get_offset()
        if offset is None or self.file.id.get_create_plist().get_sizes() != (8, 8) or self.file.userblock_size:
            raise self._refuse(name, "is not stored as h5py stores a text.")
        try:
            return heap_text(self.path, offset)
        except ValueError as error:
            raise self._refuse(name, f"is damaged: {error}.") from error

    def _json(self, name: str) -> Any:
        try:
            return json.loads(self._text(name))
        except (ValueError, RecursionError) as error:
            raise self._refuse(name, f"is no JSON: {error}.") from error

    def _object(self, name: str) -> dict[str, Any]:
        value = self._json(name)
        if not isinstance(value, dict):
            raise self._refuse(name, f"is {value!r:.60}; expected an object.")
        return value

    def _sensors(self, config: dict[str, Any], count: int) -> Sequence[int]:
        numbers = config.get("sensor", list(range(1, count + 1)))
        numbers = [numbers] if isinstance(numbers, int) else numbers
        valid = isinstance(numbers, list) and all(type(number) is int and number >= 0 for number in numbers)
        if not valid or len(numbers) != count or len(set(numbers)) != count:
            raise self._refuse("sensor_config_dump", f"names `sensor` {numbers!r:.60}; `data` has {count}.")
        return numbers

    def _range_axis(self, session: dict[str, Any], bins: int) -> np.ndarray:
        start: Any = session.get("range_start_m")
        step: Any = session.get("step_length_m")
        if not all(type(value) in (int, float) and abs(value) < 1e6 for value in (start, step)) or not step > 0:
            raise self._refuse(
                "session_info",
                f"has `range_start_m` {start!r:.40} and `step_length_m` {step!r:.40}; expected metres, a step above 0.",
            )
        length = session.get("data_length", bins)
        if length != bins:
            raise self._refuse("session_info", f"has `data_length` {length!r:.40}; `data` has {bins} bins.")
        whole: Any = session.get("range_length_m")
        if type(whole) in (int, float):
            step = unrounded_bin_m(step, whole, bins)
        range_m: np.ndarray = start + np.arange(bins) * float(step)
        if not (np.diff(range_m) > 0).all():
            raise self._refuse("session_info", f"has a `step_length_m` of {step!r}, too small to tell bins apart.")
        return range_m

    def _flags(self, shape: tuple[int, int]) -> np.ndarray:
        """(sweeps, sensors) uint16."""
        flags = np.zeros(shape, np.uint16)
        if "data_info" not in self.names:
            return flags
        infos = self._json("data_info")
        if not isinstance(infos, list) or len(infos) != shape[0]:
            raise self._refuse("data_info", f"does not hold one entry for each of {shape[0]} sweeps.")
        for sweep, entry in enumerate(infos):
            row = [entry] if isinstance(entry, dict) else entry
            if not isinstance(row, list) or len(row) != shape[1] or not all(isinstance(info, dict) for info in row):
                raise self._refuse("data_info", f"[{sweep}] is {entry!r:.60}; expected one object for each sensor.")
            for column, info in enumerate(row):
                for name, flag in MAKERS_FLAGS.items():
                    if not isinstance(value := info.get(name) or False, bool):
                        raise self._refuse(
                            "data_info", f"[{sweep}] has `{name}` {value!r:.40}; expected true or false."
                        )
                    if value:
                        flags[sweep, column] |= np.uint16(flag)
        return flags

    def _times(self, seconds: np.ndarray) -> tuple[np.ndarray, int | None]:
        """(sweeps,) int64 nanoseconds since the first sweep, and the first sweep's Unix time."""
        wrong = ~(np.abs(seconds) < 4e9)  # int64 nanoseconds end at 9.2e9 s
        if wrong.any():
            place = int(np.argmax(wrong))
            raise self._refuse("sample_times", f"[{place}] is {seconds[place]}; expected Unix seconds.")
        if not len(seconds):
            return np.empty(0, np.int64), None
        # Whole seconds and the rest apart: their product with 1e9 in one would lose the last 8 bits.
        whole = np.floor(seconds)
        times = whole.astype(np.int64) * NANOSECONDS + np.rint((seconds - whole) * NANOSECONDS).astype(np.int64)
        return times - times[0], int(times[0])


def _finite(value: Any) -> Any:
    """A setting that is no number is none: it is written again as strict JSON, which knows neither NaN nor infinity."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
