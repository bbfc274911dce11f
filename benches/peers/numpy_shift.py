"""The part of `numpy_step` that sees a shift of the whole echo out of stillness."""

from __future__ import annotations

import math

import numpy as np

from jaxradar.drive import FULL_SCALE
from jaxradar.systems.step import RangeAxis, ShiftDetector

__all__ = ["ZERO", "Shift", "number", "single"]

AGE, GAP, QUIET, STILL, JUMPING = range(5)  # the clocks
FIRST_CLOCK = 3  # of those of the whole detector
FAR_S = 1e6
SIGMA = 1.0 / (2.0 * math.sqrt(2.0 * math.log(2.0)))  # of a full width at half maximum
EPS = float(np.finfo(np.float32).eps)


def number(value: float) -> np.ndarray:
    """A constant as an array of no axes: a number of Python's costs each operation 0.2 us more."""
    return np.array(value, np.float32)


def single(setting: np.ndarray) -> float:
    """A setting as the detector has it: 0.3 s in single precision is a little more."""
    return float(np.float32(setting))


ZERO = number(0.0)


def vertex(left: float, middle: float, right: float) -> tuple[float, float]:
    """Offset and height of the parabola through three neighbours."""
    curvature = left - 2.0 * middle + right
    if not curvature < -4.0 * EPS * (abs(left) + abs(middle) + abs(right)):
        return 0.0, middle
    offset = min(max(0.5 * (left - right) / curvature, -0.5), 0.5)
    return offset, middle - 0.25 * (left - right) * offset


def sine(correlation: float) -> float:
    return math.sqrt(1.0 - min(correlation, 1.0) ** 2 + 0.03**2)


class Shift:
    """Profiles held against their running mean, and the echo that is followed in them."""

    def __init__(self, made: ShiftDetector, axis: RangeAxis, level: float) -> None:
        range_m = np.asarray(axis.range_m, np.float64)
        self._per = per = max(1, min(round(made.cell_m / axis.bin_m), axis.bins // 2))
        self._count = count = axis.bins // per
        self._ones, self._part = np.ones(per, np.float32), number(1.0 / per)
        centres = range_m[: count * per].reshape(count, per).mean(axis=1)
        self._cell_m = float(centres[-1] - centres[0]) / (count - 1)
        self._centres, self._range = centres.tolist(), range_m.tolist()
        exponent = single(made.exponent)
        self._gain = ((2.0 * centres) ** exponent).astype(np.float32) if exponent else None
        self._evidence, self._release = single(made.evidence) * level, single(made.release) * level
        self._most_unexplained, self._most_left = single(made.most_unexplained), single(made.most_left)
        self._least, self._down, self._window_s = single(made.least_shift_m), made.steps_down, single(made.window_s)
        self._settle, self._refractory = single(made.settle_s), single(made.refractory_s)
        self._longest, self._still, self._sudden = (
            single(made.longest_gap_s),
            single(made.still_s),
            single(made.sudden_s),
        )
        self._restless = single(made.restless) * self._evidence
        self._over_floor, self._over_scatter = single(made.over_floor), single(made.over_scatter)
        self._pulse = made.pulse_m
        self._reach = max(1, min(round(made.reach_m / (per * axis.bin_m)), count - 1))
        self._around = min(math.ceil(made.pulse_m / (per * axis.bin_m)) + 1, (count - 1) // 2)
        # Correlations with a pulse and its first two derivatives, in one product.
        self._fwhm = max(single(made.template_m) / axis.bin_m, 1.0)
        self._half = half = min(max(1, round(0.5 * made.window_m / axis.bin_m)), (axis.bins - 1) // 2)
        offset = np.arange(-half, half + 1) / (SIGMA * self._fwhm)
        pulse = np.exp(-0.5 * offset * offset)
        self._template = np.stack([pulse, pulse * offset, pulse * (offset * offset - 1.0)]).astype(np.float32)

    def begin(self, sweep: np.ndarray, clocks: np.ndarray) -> None:
        count, reach = self._count, self._reach
        self._sweep, self._clocks = sweep, clocks
        clocks[[STILL, JUMPING]] = FAR_S
        self._binned = sweep[: count * self._per].reshape(count, self._per)
        self._ended = np.zeros(count + 2, np.float32)  # the first and the last cell repeated
        self._cells = self._ended[1:-1]
        self._over, self._change, self._reference, self._quiet_cells = np.zeros((4, count), np.float32)
        self._padded = np.zeros(count + 2 * reach, np.float32)
        self._profile = self._padded[reach : reach + count]
        self._tracking, self._armed, self._began, self._rested = False, True, False, True
        self._range_m = self._reference_m = self._lost = 0.0

    def run(
        self, usable: bool, saturated: bool, dt: float, times: list[float]
    ) -> tuple[float, float, float, float, float, bool, bool]:
        """As of `Approach`."""
        age, gap, quiet, still, jumping = times[FIRST_CLOCK : FIRST_CLOCK + 5]
        clocks, profile, before = self._clocks, self._profile, self._reference_m
        place, strength, level, scatter = self._strongest()
        seen = usable and strength > max(0.0, self._over_floor * level, self._over_scatter * scatter)
        tracking = self._tracking and abs(gap) <= self._longest
        compared, fresh = seen and tracking, seen and not tracking
        self._tracking = tracking or seen
        cells = explained = statistic = share = 0.0
        explains = False
        if seen:
            np.subtract(self._cells, 1.1 * level, out=profile)
            np.maximum(profile, ZERO, out=profile)
            share = 1.0
            if compared:
                share = -math.expm1(-max(gap, 0.0) / self._window_s)
                cells, stays, left = self._moved()
                explained = stays - left
                explains = left <= self._most_unexplained and left <= self._most_left * explained
                shift_m = cells * self._cell_m
                if (abs(shift_m) if self._down else -shift_m) >= self._least:
                    statistic = max(explained, 0.0)
            np.subtract(profile, self._reference, out=self._change)
            self._change *= share
            self._reference += self._change
            clocks[GAP] = 0.0
            found_m = self._refined(place, saturated)
            taken_up = self._follow(found_m, fresh, compared, statistic, cells * self._cell_m, gap)
            if taken_up:
                self._reference_m = self._range_m
            else:
                self._reference_m += share * (self._range_m - self._reference_m)

        rises = explained > self._restless
        if rises or (fresh and self._began):
            still = clocks[STILL] = 0.0
        if rises and self._rested:
            jumping = clocks[JUMPING] = 0.0
        self._rested = still >= self._still
        if fresh:
            age = clocks[AGE] = 0.0
        self._began = age > 0
        if not (jumping <= self._sudden or self._still <= 0):
            statistic = 0.0
        counts = compared and age >= self._settle and gap > 0 and explains
        shown = statistic if counts else 0.0
        event = self._armed and shown > self._evidence
        if event:
            clocks[QUIET] = 0.0
            self._armed = False
        elif quiet >= self._refractory and (statistic < self._release or quiet >= 5.0 * self._refractory):
            self._armed = True
        speed = (self._range_m - before) * share / gap if compared and not taken_up and gap > 0 else 0.0
        return self._range_m, speed, strength, shown, 0.0, seen, event

    def _strongest(self) -> tuple[float, float, float, float]:
        """Place of the strongest echo in bins, its amplitude over the floor; the floor's level and scatter."""
        cells, ended, over, quiet_cells, count = self._cells, self._ended, self._over, self._quiet_cells, self._count
        np.dot(self._binned, self._ones, out=cells)
        cells *= self._part
        ended[0], ended[-1] = ended[1], ended[-2]
        # The floor: of the cells at or below the mean.
        quiet = cells <= (1.0 + 4.0 * EPS) * (float(np.add.reduce(cells)) / count)
        quiet_cells[:] = quiet
        level = float(quiet_cells.dot(cells)) / int(np.count_nonzero(quiet))
        pairs = quiet[1:] & quiet[:-1]
        steps = cells[1:] - cells[:-1]
        steps *= pairs
        squares, found = float(steps.dot(steps)), int(np.count_nonzero(pairs))
        scatter = math.sqrt(0.5 * squares / found) if found else 0.0
        # The largest mean of three neighbours.
        np.add(ended[:-2], cells, out=over)
        np.add(over, ended[2:], out=over)
        if self._gain is None:
            middle = int(over.argmax())
        else:
            by = np.maximum(over / np.float32(3.0) - level, 0.0)
            by *= self._gain
            middle = int(by.argmax())
        strength = max(over.item(middle) / 3.0 - level, 0.0)
        if not strength:
            middle = 0
        # And of the three the largest; one at an end has no parabola.
        five = cells[max(middle - 2, 0) : middle + 3].tolist()
        own = min(middle, 2)
        near = [five[min(max(own + k, 0), len(five) - 1)] for k in (-1, 0, 1)]
        beside = 1 if near[2] > max(near[0], near[1]) else -1 if near[0] > near[1] else 0
        cell, own = min(max(middle + beside, 0), count - 1), own + beside
        between = 0.0 if cell in (0, count - 1) else vertex(five[own - 1], five[own], five[own + 1])[0]
        return (cell + 0.5 + between) * self._per - 0.5, strength, level, scatter

    def _refined(self, place: float, saturated: bool) -> float:
        """Slant range: one Newton step on the logarithm of the correlation with a pulse, or a clipped top's middle."""
        sweep, half = self._sweep, self._half
        if saturated and sweep.item(sweep.argmax()) >= FULL_SCALE:
            first = int(sweep.argmax())
            below = sweep[first:] < sweep[first]
            position = first + 0.5 * ((int(below.argmax()) if below.any() else len(below)) - 1)
        else:
            near = round(place)
            start = min(max(near - half, 0), len(sweep) - 2 * half - 1)
            most, rise, bend = self._template.dot(sweep[start : start + 2 * half + 1]).tolist()
            position = 0.0
            if most > 0:
                rise, bend = rise / most, bend / most
                bend -= rise * rise
                step = SIGMA * self._fwhm * -rise / bend if bend < 0 else 0.0
                low, high = max(near - start - 0.5 * self._fwhm, 0.0), min(near - start + 0.5 * self._fwhm, 2.0 * half)
                position = start + min(max(half + step, low), high)
        whole = min(max(math.floor(position), 0), len(self._range) - 2)
        return self._range[whole] + (position - whole) * (self._range[whole + 1] - self._range[whole])

    def _moved(self) -> tuple[float, float, float]:
        """By how many cells the profile lies further out, and what is left of it unexplained if not, and if so."""
        profile, reference = self._profile, self._reference
        norms = math.sqrt(profile.dot(profile)) * math.sqrt(reference.dot(reference))
        if not norms > 0:
            return 0.0, sine(0.0), sine(0.0)
        products = np.correlate(self._padded, reference)
        best, found = int(products.argmax()), [product / norms for product in products.tolist()]
        highest, offset = found[best], 0.0
        most = highest
        if 0 < best < len(found) - 1 and min(found[best - 1], found[best + 1]) > 0:
            offset, height = vertex(*map(math.log, found[best - 1 : best + 2]))
            most = math.exp(height)
        return best - self._reach + offset if highest > 0 else 0.0, sine(found[self._reach]), sine(most)

    def _follow(
        self, found_m: float, fresh: bool, compared: bool, statistic: float, shift_m: float, gap: float
    ) -> bool:
        """Where the followed echo is now, in `_range_m`; whether another was taken up."""
        expected = self._range_m
        if abs(found_m - expected) > self._pulse and statistic > self._release:
            expected = self._reference_m + shift_m
        lost, followed = False, found_m
        if not fresh and abs(found_m - expected) > self._pulse:
            lost, followed = self._local(expected)
        if compared and (lost or self._lost):
            passed = max(gap, 0.0)
            self._lost = max(float(np.float32(self._lost) + np.float32(passed if lost else -passed)), 0.0)
        taken_up = fresh or self._lost > self._longest
        if taken_up:
            self._lost, followed = 0.0, found_m
        self._range_m = followed
        return taken_up

    def _local(self, expected: float) -> tuple[bool, float]:
        """Whether a far stronger echo stands elsewhere, and the range of the one nearest to where it is expected."""
        profile, centres, width = self._profile, self._centres, 2 * self._around + 1
        start = min(max(round((expected - centres[0]) / self._cell_m) - self._around, 0), self._count - width)
        taps = profile[start : start + width]
        places = centres[0] + self._cell_m * np.arange(start, start + width)
        offset = (places - expected) / (0.5 * self._pulse)
        top, last = int(np.argmax(taps * np.exp(-0.5 * offset * offset))), width - 1
        three = (min(abs(top - 1), last), top, max(last - abs(last - top - 1), 0))
        between, height = vertex(*(taps.item(place) for place in three))
        local = centres[start + top] + self._cell_m * between
        weak = height < 0.5 * float(profile.max())
        return weak, expected if weak or abs(local - expected) > self._pulse else local
