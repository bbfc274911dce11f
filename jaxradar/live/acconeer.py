"""Live sweeps of an A111 from Acconeer's exploration server, through the maker's own client."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from jaxradar._errors import ConfigError, JaxradarError, SourceError
from jaxradar.drive import FULL_SCALE, MAKERS_FLAGS, SweepFlag, kept_bins
from jaxradar.live.acconeer_link import INSTALL, ExplorationLink, client_package
from jaxradar.live.acconeer_range import ActualRange, actual_range, range_problems, sensor_problems
from jaxradar.live.sweeps import LiveSweep, Source

__all__ = ["AcconeerSource"]

_PORT = 6110
_LONGEST_STOP_S = 1.0


class AcconeerSource(Source):
    """Envelope sweeps of one A111 or several, timed by the sensor ("streaming").

    The defaults are those of the lab's program (thesis, listing C.1); what it leaves alone is the maker's default.

    - `host`, `port`: of the exploration server.
    - `sensors`: their numbers on the connector board.
    - `start_m`, `length_m`: slant range asked for, metres; the server rounds both (`actual`).
    - `rate_hz`: sweeps a second of each sensor.
    - `running_average`: the sensor's own exponential smoothing over sweeps, 0 (off) to below 1.
    - `bins`: how many range bins are kept, by `jaxradar.drive.kept_bins`; all if None.
    - `profile`: 1 (finest in range) to 5 (strongest); `gain`: of the receiver, 0 to 1; `averages`: pulses averaged into
      one bin, 1 to 63 (HWAAS).
    - `timeout_s`: how long the server may be silent, beyond one period of the sensor.
    - `mock`: the client's own simulated sensor in place of a server.

    Sweeps are stamped by the host's monotonic clock when they arrive; all sensors of one message have one stamp. A
    message without amplitudes is a sweep of zeros under `SweepFlag.NO_AMPLITUDES`.

    Raises `ConfigError` for settings that no A111 has, here or, where the client or the server knows better, in `open`.
    """

    def __init__(
        self,
        host: str,
        sensors: Sequence[int] = (1, 3),
        start_m: float = 0.1,
        length_m: float = 0.7,
        rate_hz: float = 100.0,
        running_average: float = 0.0,
        bins: int | None = 128,
        *,
        profile: int = 2,
        gain: float = 0.5,
        averages: int = 10,
        port: int = _PORT,
        timeout_s: float = 2.0,
        mock: bool = False,
    ) -> None:
        numbers = tuple(sensors)
        if not numbers or len(set(numbers)) != len(numbers) or min(numbers) < 1:
            raise ConfigError(f"`sensors` is {list(numbers)}; expected different numbers from 1 up, at least one.")
        for name, value, fits, wanted in (
            ("host", host, bool(host.strip()) or mock, "a name or an address"),
            ("port", port, 0 < port < 65536, "1 to 65535"),
            ("start_m", start_m, math.isfinite(start_m), "metres"),
            ("length_m", length_m, length_m > 0 and math.isfinite(length_m), "metres above 0"),
            ("rate_hz", rate_hz, rate_hz > 0 and math.isfinite(rate_hz), "sweeps a second, above 0"),
            ("running_average", running_average, 0 <= running_average < 1, "0 (off) to below 1"),
            ("bins", bins, bins is None or bins >= 2, "2 or more"),
            ("profile", profile, profile in range(1, 6), "1 to 5"),
            ("gain", gain, 0 <= gain <= 1, "0 to 1"),
            ("averages", averages, 0 < averages < 64, "1 to 63"),
            ("timeout_s", timeout_s, timeout_s > 0 and math.isfinite(timeout_s), "seconds above 0"),
        ):
            if not fits:
                raise ConfigError(f"`{name}` is {value!r}; expected {wanted}.")
        self._sensors = numbers
        self._asked = (start_m, length_m)
        self._rate_hz = float(rate_hz)
        self._settings = {
            "sensor": list(numbers),
            "range_interval": [start_m, start_m + length_m],
            "update_rate": float(rate_hz),
            "running_average_factor": float(running_average),
            "gain": float(gain),
            "hw_accelerated_average_samples": averages,
        }
        self._profile = profile
        self._bins = bins
        self._mock = mock
        self._link = None if mock else ExplorationLink(host, port, timeout_s)
        self._place = "the simulated sensor" if self._link is None else f"the exploration server at {self._link.place}"
        self._client: Any = None
        self._busy = threading.Lock()  # held by whoever talks to the client
        self._closing = False
        self._streaming = False
        self._first_ns: int | None = None
        self._range_m: np.ndarray = np.empty(0)
        self._kept: np.ndarray | None = None
        self._length = 0
        self._missed = 0
        self.actual: ActualRange | None = None  # known after `open`
        self._problems: tuple[str, ...] = ()

    @property
    def range_m(self) -> np.ndarray:
        """(bins,) float64 slant range in metres, actual start + i·step; (0,) before the first `open`."""
        return self._range_m

    @property
    def period_s(self) -> float:
        """As asked for."""
        return 1.0 / self._rate_hz

    @property
    def sensors(self) -> tuple[int, ...]:
        """Their numbers on the connector board."""
        return self._sensors

    @property
    def problems(self) -> tuple[str, ...]:
        """One sentence for each thing that is not as asked for."""
        return self._problems

    @property
    def missed(self) -> int:
        """Sweeps before which the sensor says it lost data, of all sensors; the protocol does not say how much."""
        return self._missed

    def open(self) -> None:
        """Connect and set the sensors up; they start when iteration does.

        Raises `ConfigError` where the client is not installed, refuses a setting, or has fewer bins than are to be
        kept; `SourceError` where no server answers, or not as one.
        """
        if self._client is not None:
            raise ValueError("`AcconeerSource` is open already.")
        a111 = client_package()
        config = self._config(a111)
        self._closing, self._streaming, self._first_ns, self._missed = False, False, None, 0
        self._client = self._new_client(a111)
        try:
            with self._reported("setting it up"):
                self._client.connect()
                session = self._client.setup_session(config)
            self._take_range(session)
        except BaseException:
            self._hang_up()
            raise

    def close(self) -> None:
        """Stop the sensors and disconnect; where a sweep is being waited for, in another thread or in what a signal
        has interrupted, iteration does it at once."""
        self._closing = True
        if self._busy.acquire(blocking=False):
            try:
                self._stop()
            finally:
                self._busy.release()
        elif self._link is not None:
            self._link.wake()

    def __iter__(self) -> Iterator[LiveSweep]:
        """From now on. Raises `ValueError` unless the source is open, `SourceError` when the server fails."""
        if self._client is None and not self._closing:
            raise ValueError("`AcconeerSource` must be opened before it is iterated over.")
        return self._stream()

    def _stream(self) -> Iterator[LiveSweep]:
        while True:
            with self._busy:
                message = None if self._closing else self._next()
                if self._closing:
                    self._stop()
                    return
            for sweep in message or ():
                if not self._closing:  # maybe since another sensor's of this message
                    yield sweep

    def _next(self) -> list[LiveSweep] | None:
        """One message: a sweep of each sensor; None if the source was closed meanwhile."""
        try:
            with self._reported("streaming"):
                if not self._streaming:
                    self._client.start_session()
                    self._streaming = True
                infos, data = self._client.get_next()
                now_ns = time.monotonic_ns()
                return self._sweeps(infos, data, now_ns)
        except JaxradarError:
            if self._closing:
                return None
            self._hang_up()
            raise

    def _sweeps(self, infos: Any, data: Any, now_ns: int) -> list[LiveSweep]:
        infos = [infos] if isinstance(infos, dict) else infos  # the client squeezes a single sensor's
        count, empty = len(self._sensors), data is None
        rows = np.zeros((count, self._length)) if empty else np.asarray(data).reshape(count, -1)
        if len(infos) != count or rows.shape[1] != self._length:
            raise SourceError(
                f"{self._place} sends {rows.shape[1]} bins of {len(infos)} sensors; "
                f"it was set up for {self._length} of {count}."
            )
        kept = rows if self._kept is None else rows[:, self._kept]
        sweeps = np.clip(np.rint(kept), 0, FULL_SCALE).astype(np.uint16)
        self._first_ns = now_ns if self._first_ns is None else self._first_ns
        message = []
        for sensor, info, sweep in zip(self._sensors, infos, sweeps, strict=True):
            flags = SweepFlag.NO_AMPLITUDES if empty else SweepFlag(0)
            for key, flag in MAKERS_FLAGS.items():
                if info.get(key):
                    flags |= flag
            self._missed += SweepFlag.MISSED_DATA in flags
            last = sensor == self._sensors[-1]
            message.append(LiveSweep(sensor, now_ns - self._first_ns, sweep, int(flags), last=last))
        return message

    def _config(self, a111: Any) -> Any:
        config = a111.EnvelopeServiceConfig()
        try:
            config.profile = next(item for item in type(config).Profile if item.json_value == self._profile)
            config.repetition_mode = type(config).RepetitionMode.SENSOR_DRIVEN
            for name, value in self._settings.items():
                setattr(config, name, value)
        except (ValueError, TypeError) as error:
            raise ConfigError(f"the A111 cannot be set to `{name}` {value!r}: {error!s:.120}.") from error
        wrong = [alert for alert in config.check() if alert.severity.name == "ERROR"]
        if wrong:
            raise ConfigError(
                f"the A111 cannot be set to {self._asked[1]:g} m from {self._asked[0]:g} m on at "
                f"{config.update_rate:g} Hz: `{wrong[0].param}`: {wrong[0].msg}."
            )
        return config

    def _new_client(self, a111: Any) -> Any:
        if self._link is None:
            return a111.Client(mock=True)
        client = a111.Client(host=self._link.place)
        if not hasattr(client.subclient, "_link"):
            raise ConfigError(f"this version of acconeer-exptool is not one that is known; {INSTALL}.")
        client.subclient._link = self._link
        return client

    def _take_range(self, session: Any) -> None:
        try:
            actual, length = actual_range(session)
        except ValueError as error:
            raise SourceError(f"{self._place} {error}") from error
        axis = actual.start_m + np.arange(length) * actual.step_m
        self._kept = None if self._bins is None else kept_bins(length, self._bins)
        self._range_m = axis if self._kept is None else axis[self._kept]
        self.actual, self._length = actual, length
        found = range_problems(axis, actual, self._asked)
        if self._link is not None:
            found += sensor_problems(self._link.answer, self._sensors, actual, length)
        self._problems = tuple(f"{self._place}: {problem}" for problem in found)

    @contextlib.contextmanager
    def _reported(self, doing: str) -> Iterator[None]:
        """Whatever goes wrong inside, as one sentence."""
        try:
            yield
        except JaxradarError:
            raise
        except Exception as error:  # the client lets garbage show in any exception
            answer = {} if self._link is None else self._link.answer
            system, status = answer.get("system_info"), answer.get("status")
            if isinstance(system, dict) and system.get("sensor", "a111") != "a111":
                raise SourceError(f"{self._place} has an {system['sensor']!s:.40}; expected an A111.") from error
            if status not in (None, "ok", "start"):
                told = answer.get("message") or "without a reason"
                raise SourceError(f"{self._place} answers `{status!s:.40}` while {doing}: {told!s:.200}.") from error
            raise SourceError(
                f"{self._place} is not understood while {doing} ({type(error).__name__}: {error!s:.120})."
            ) from error

    def _stop(self) -> None:
        """In good order if the server still answers."""
        if self._client is not None:
            if self._link is not None:
                self._link.timeout = min(self._link.timeout, _LONGEST_STOP_S)
            with contextlib.suppress(Exception):
                self._client.disconnect()  # stops the stream first
        self._hang_up()

    def _hang_up(self) -> None:
        self._client = None
        if self._link is not None:
            self._link.disconnect()
