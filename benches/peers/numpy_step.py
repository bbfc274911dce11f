"""The default detector in NumPy, one sweep a call: as one would write it by hand for the device, without a compiler.

float32, vectorised over cells, places and speeds. What the settings and the axis say is worked out once, arrays are
written in place, numbers of their own are Python's, and what a sweep does not need is left out.
"""

from __future__ import annotations

import copy
import math

import numpy as np

from jaxradar.drive import SweepFlag
from jaxradar.systems.step import ApproachDetector, DefaultDetector, RangeAxis
from peers.numpy_shift import ZERO, Shift, number, single

__all__ = ["NumpyDefault"]

INVALID, SATURATED = int(SweepFlag.INVALID), int(SweepFlag.SATURATED)
SHOWN = 0.75  # of its threshold: weaker evidence of a corner leaves the echo on show
CLOCKS = 9  # 0 to 2 of the corner, 3 to 7 of the shift, 8: since the last detection of either
AGE, GAP, QUIET = range(3)  # the corner's: since its tracks began, since a valid sweep, since its last detection
JUMP = 5  # places that evidence may move on by within a sweep
HALF, ONE, NOWHERE, LEAST, SPECKLE = map(number, (0.5, 1.0, JUMP + 1, 1e-5, 0.79))


class NumpyDefault:
    """As `jaxradar.live.program.Program` of a `PackedStep`: vectors of the same layout, in `jaxradar.live.detect.Step`.

    Takes sweeps as whole counts of 16 bits on a range axis that rises, and a detector both of whose parts are on
    (`ValueError` otherwise).
    """

    def __init__(self, detector: DefaultDetector, axis: RangeAxis) -> None:
        if detector.approach is None or detector.shift is None:
            raise ValueError("`NumpyDefault` takes a detector with both of its parts.")
        self._level, self._refractory = single(detector.level), single(detector.refractory_s)
        self._own = single(detector.approach.evidence), single(detector.shift.evidence)
        self._corner = Approach(detector.approach, axis, self._level)
        self._echo = Shift(detector.shift, axis, self._level)
        self._bins = axis.bins
        self._begin()

    def _begin(self) -> None:
        self._inputs = np.zeros(self._bins + 2, np.float32)
        self._sweep = self._inputs[: self._bins]
        # All times of either part in one array, which passes in one addition.
        self._clocks = np.zeros(CLOCKS, np.float32)
        self._clocks[8] = self._refractory
        self._corner.begin(self._sweep, self._clocks[0:3])
        self._echo.begin(self._sweep, self._clocks[3:8])

    def another(self) -> NumpyDefault:
        """The same from its first state on, for another sensor; constants are shared."""
        other = copy.copy(self)
        other._corner, other._echo = copy.copy(self._corner), copy.copy(self._echo)
        other._begin()
        return other

    @property
    def inputs(self) -> np.ndarray:
        """(bins + 2,) amplitudes, flags and seconds since the sweep before; to be written in place."""
        return self._inputs

    def run(self) -> np.ndarray:
        """(8,) float32, `DECISION_FIELDS`; the state goes on."""
        clocks = self._clocks
        flags, dt = int(self._inputs.item(self._bins)), self._inputs.item(self._bins + 1)
        if dt >= 0:
            clocks += dt
        else:
            # A clock that was set back: only the gap since the last valid sweep knows.
            clocks[[GAP, 3 + GAP]] += np.float32(dt)
        times = clocks.tolist()
        usable, saturated = not flags & INVALID, bool(flags & SATURATED)
        corner = self._corner.run(usable, dt, times)
        echo = self._echo.run(usable, saturated, dt, times)
        near, far = corner[3] / max(self._own[0], 1e-9), echo[3] / max(self._own[1], 1e-9)
        shown = corner if near > SHOWN and near > far else echo
        event = (corner[6] or echo[6]) and times[8] > self._refractory
        if event:
            clocks[8] = 0.0
        return np.array((*shown[:3], max(near, far), corner[4], shown[5], saturated, event), np.float32)


class Approach:
    """A corner that closes in: evidence over speeds and places."""

    def __init__(self, made: ApproachDetector, axis: RangeAxis, level: float) -> None:
        range_m = np.asarray(axis.range_m, np.float64)
        self._per = per = max(1, min(round(made.cell_m / axis.bin_m), axis.bins // 2))
        self._count = count = axis.bins // per
        self._ones, self._part = np.ones(per, np.float32), number(1.0 / per)
        centres = range_m[: count * per].reshape(count, per).mean(axis=1)
        self._evidence = single(made.evidence) * level
        self._release = single(made.release) * self._evidence
        self._reference, self._longest = single(made.reference_s), single(made.longest_gap_s)
        self._settle, self._start = single(made.settle_s), single(made.start_s)
        self._refractory, self._noise_share = single(made.refractory_s), single(made.noise_share)
        self._height, self._farthest = single(made.height_m), single(made.farthest_m)
        self._place = single(made.place_m)
        self._wheel, self._look = single(made.front_wheel_m) - single(made.contact_m), number(single(made.look_m))
        self._look_m = single(made.look_m)
        self._stands_share = 0.21 * single(made.stands)

        # Before the first place lies one where there never is evidence: what moves in from there is none.
        places = made.places
        ahead = self._farthest - self._place * np.arange(places)
        slant = np.hypot(self._height, ahead)
        where = (slant - centres[0]) * ((count - 1) / (centres[-1] - centres[0]))
        inside = (where >= 0) & (where <= count - 1) & (ahead > 0)
        at = np.maximum(1.0 - np.abs(np.clip(where, 0.0, count - 1.0)[:, None] - np.arange(count)), 0.0)
        reach = max(1, round(0.5 * made.around_m / (per * axis.bin_m)))
        around = np.zeros((count, count))
        for offset in range(-reach, reach + 1):
            np.add.at(around, (np.arange(count), np.clip(np.arange(count) + offset, 0, count - 1)), 1 / (2 * reach + 1))
        tilt = np.linspace(single(made.tilt_far), single(made.tilt_near), places)
        erf = np.array([math.erf(0.5 * one) for one in tilt])
        cost = 0.25 * tilt**2 + np.log(np.exp(-0.25 * tilt**2) + 0.5 * math.sqrt(math.pi) * tilt * (1.0 + erf))
        first = lambda values: np.concatenate([values[:1], values])  # noqa: E731
        none = lambda values: np.concatenate([0.0 * values[:1], values]).astype(np.float32)  # noqa: E731
        self._expecting = np.concatenate([first(at), single(made.fade_share) * first(at @ around)]).astype(np.float32)
        self._tilted = none((tilt * inside)[:, None] * at)
        self._cost = none(cost * inside)
        self._width = places + 1

        # The detector's own to the last digit: ways add up over hundreds of sweeps, and where one comes to lie between
        # two places the last digit says on which.
        self._speeds = np.asarray(made.tracks(axis).speeds, np.float32)
        self._speed_column = self._speeds[:, None]
        self._speed_list = self._speeds.tolist()
        # By speed and whole places: where in the bank the evidence comes from; of more than `JUMP` places, from none.
        moved = np.maximum(np.arange(self._width) - np.arange(JUMP + 2)[:, None], 0)
        moved[-1] = 0
        rows = np.arange(made.speeds)[:, None, None] * self._width
        self._from = (rows + moved).reshape(-1, self._width).astype(np.intp)
        self._first_jump = np.arange(made.speeds, dtype=np.float32) * (JUMP + 2)

        # Of every other cell those where what stands straight below does not show: the last ones.
        far = centres > math.hypot(self._height, 0.5 * ahead[0])
        self._far = slice(2 * int(np.argmax(far[::2])) if far[::2].any() else count, None, 2)

    def begin(self, sweep: np.ndarray, clocks: np.ndarray) -> None:
        speeds, width = len(self._speeds), self._width
        self._clocks, self._binned = clocks, sweep[: self._count * self._per].reshape(self._count, self._per)
        # Power and mean of each cell, and those of the newest sweep, in pairs.
        self._held, self._now, self._change = np.zeros((3, 2, self._count), np.float32)
        self._power, self._far_power = self._held[0], self._held[0, self._far]
        self._far_mean = self._held[1, self._far]
        self._bank, self._moved = np.zeros((2, speeds, width), np.float32)
        self._shares = np.empty((speeds, width), np.float32)
        self._travel, self._way, self._whole = np.zeros((3, speeds), np.float32)
        self._jumps = np.empty(speeds, np.intp)
        self._index = np.empty((speeds, width), np.intp)
        self._expected = np.empty(2 * width, np.float32)
        self._inverse, self._root, self._score = np.empty((3, width), np.float32)
        self._noise = self._least = self._age = 0.0
        self._stands = self._stood = self._tracking = False
        self._armed = True

    def run(self, usable: bool, dt: float, times: list[float]) -> tuple[float, float, float, float, float, bool, bool]:
        """Range, speed, strength, statistic, seconds to the impact, whether valid, whether a detection."""
        cells, clocks, age, gap, quiet = self._now[1], self._clocks, times[AGE], times[GAP], times[QUIET]
        np.dot(self._binned, self._ones, out=cells)
        cells *= self._part
        strength = cells.item(cells.argmax())
        valid = usable and strength > 0
        tracking = self._tracking and abs(gap) <= self._longest
        goes_on, fresh = valid and tracking, valid and not tracking
        still = goes_on and self._stands
        elapsed = max(dt, 0.0) if tracking else 0.0
        on, counts = tracking and not still, goes_on and not still
        if fresh or (goes_on and self._stood and self._age <= 0):
            np.multiply(cells, cells, out=self._power)
            self._held[1] = cells
            self._least = self._power.item(self._power.argmin())
        if fresh or still:
            age = clocks[AGE] = 0.0
        self._age, self._stood = age, (self._stood and tracking) or still
        self._tracking = tracking or valid

        statistic, at = self._gathered(on, counts, elapsed)
        if valid:
            clocks[GAP] = 0.0
            self._renew(goes_on, max(gap, 0.0), age)
        self._stands = age >= self._settle and self._is_still()
        counts = counts and age >= (self._start if self._stood else self._settle)

        event = counts and self._armed and statistic > self._evidence
        if event:
            clocks[QUIET] = 0.0
            self._armed = False
        elif statistic < self._release and quiet >= self._refractory:
            self._armed = True
        speed, place = divmod(at, self._width)
        speed_m_s = self._speed_list[speed]
        ahead = self._farthest - self._place * (max(place - 1, 0) + self._travel.item(speed))
        range_m = math.sqrt(self._height**2 + ahead**2)
        impact = max((ahead + self._wheel) / speed_m_s, 0.0) if counts and statistic > self._release else 0.0
        return (
            range_m,
            -speed_m_s * ahead / range_m if valid and statistic > 0 else 0.0,
            strength if valid else 0.0,
            statistic if counts else 0.0,
            impact,
            valid,
            event,
        )

    def _gathered(self, on: bool, counts: bool, elapsed: float) -> tuple[float, int]:
        """The most evidence after this sweep, and where in the bank."""
        if not on:
            self._bank[:] = 0.0
            self._travel[:] = 0.0
            return 0.0, 0
        way, whole, bank = self._way, self._whole, self._moved
        np.multiply(self._speeds, elapsed / self._place, out=way)
        way += self._travel
        np.add(way, HALF, out=whole)
        np.floor(whole, out=whole)
        np.subtract(way, whole, out=self._travel)
        np.minimum(whole, NOWHERE, out=whole)
        whole += self._first_jump
        self._jumps[:] = whole
        self._from.take(self._jumps, axis=0, out=self._index, mode="clip")
        self._bank.take(self._index, out=bank, mode="clip")
        if counts:
            score, shares = self._weighed()
            np.divide(self._speed_column * elapsed, shares, out=self._shares)
            np.minimum(self._shares, ONE, out=self._shares)
            self._shares *= score
            bank += self._shares
            np.maximum(bank, ZERO, out=bank)
        self._bank, self._moved = bank, self._bank
        at = int(bank.argmax())
        return bank.item(at), at

    def _weighed(self) -> tuple[np.ndarray, np.ndarray]:
        """What each place adds for a whole look, and how much of the way that is."""
        width, expected, inverse = self._width, self._expected, self._inverse
        np.dot(self._expecting, self._power, out=expected)
        expected = np.maximum(expected[:width], expected[width:], out=expected[:width])
        # Silence that nothing is expected in says nothing; of the usual sweep every cell has some power.
        silent = None if self._least > 0 else expected <= 0
        if silent is not None:
            expected[silent] = 1.0
        np.reciprocal(expected, out=inverse)
        np.sqrt(inverse, out=self._root)
        score = np.dot(self._tilted, self._now[1], out=self._score)
        score *= self._root
        score -= self._cost
        if silent is not None:
            score[silent] = 0.0
        inverse *= -self._look_m * self._noise
        inverse += self._look
        return score, np.maximum(inverse, LEAST, out=inverse)

    def _renew(self, goes_on: bool, since: float, age: float) -> None:
        """Take a valid sweep into the means: a plain one at first, a running one later."""
        power, cells = self._now
        if goes_on:
            np.multiply(cells, cells, out=power)
            np.subtract(self._now, self._held, out=self._change)
            self._change *= since / (min(self._reference, age) + since + 1e-9)
            self._held += self._change
        self._least = self._power.item(self._power.argmin())
        self._noise = self._noise_share * self._least

    def _is_still(self) -> bool:
        """Whether the road's echoes keep their amplitudes."""
        power = self._far_power
        if self._least > 0:
            inverse = np.reciprocal(power)
            weight = inverse * -self._noise
            weight += ONE
            np.maximum(weight, ZERO, out=weight)
        else:
            some = power > 0
            inverse = 1.0 / np.where(some, power, np.float32(1.0))
            weight = np.where(some, np.maximum(1.0 - self._noise * inverse, 0.0), np.float32(0.0))
        weight *= weight
        inverse *= self._far_mean
        inverse *= self._far_mean
        inverse -= SPECKLE
        return float(weight.dot(inverse)) - self._stands_share * float(weight.dot(weight)) > 0.015
