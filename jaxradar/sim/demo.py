"""One small synthetic drive over a step, for `jaxradar demo` and for tests; it proves nothing about a road.

What is modelled, and from where ("thesis": the A111 work that this project began with; "assumed": free to be replaced):

- The range axis of the thesis's table C.1: 128 bins from 0.099768 m, 7.0338 mm apart.
- One echo of the road, Gaussian in amplitude, 60 mm wide at half maximum (assumed). It lies at 1.1 times the height
  above the road, where recordings at 45° on real roads have it, not at √2 times: the road that reflects it lies 0.45
  times the height ahead of the sensor's foot. It fades as patches of road go by, about one in each 0.2 m (assumed).
- The receiver's noise is complex and Gaussian, 164 counts in each part (a Rayleigh of that scale has table C.1's mean
  of 206), so that the envelope of echo and noise is Rician. Amplitudes are multiples of 8, as in table C.1.
- Sweeps come at 100 Hz with 1 ms of jitter (assumed).
- A step of height h changes the echo's range as a whole, r -> r (1 − h/H), while its face goes by under the beam, which
  takes h / speed. The front axle lies 0.15 m behind the sensor. A tyre of 0.2 m radius touches the step's edge
  √(2 r h − h²) before its axle is above the face: that is the truth's impact.
- The body moves as a quarter car (assumed: 55 and 11 kg, 7 and 80 kN/m, 370 N s/m) whose wheel climbs evenly from the
  contact until its axle is above the face: over 40 mm it passes 15 m/s² 18 ms after the contact and peaks at 18 m/s².
  Its rise brings the echo back. The sensor rises with the body; pitch, the rear axle, the beam's footprint and every
  other effect are left out.
- The acceleration is kept as the lab's program does: times to the millisecond, whole m/s², here with noise of 0.7 m/s².
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from jaxradar.drive import FULL_SCALE, NANOSECONDS, Channel, Drive, Motion, Mounting, RoadStep, SensorSeries, Truth

__all__ = ["DemoScene", "demo_drive"]

_BINS = 128
_RANGE_START_M = 0.099768
_BIN_M = 0.0070338
_PULSE_FWHM_M = 0.060
_ECHO_PER_HEIGHT = 1.1
_LOOK_AHEAD_PER_HEIGHT = 0.45
_NOISE_COUNTS = 164.0
_COUNTS_STEP = 8
_PATCH_M = 0.2
_TYRE_RADIUS_M = 0.2
_BODY_KG, _WHEEL_KG, _SPRING_N_M, _DAMPER_N_S_M, _TYRE_N_M = 55.0, 11.0, 7e3, 370.0, 80e3
_FINE_S = 1e-4


@dataclass(frozen=True)
class DemoScene:
    """What is driven and seen. Raises `ValueError` for a value outside its bounds.

    - `duration_s`, `rate_hz`: length and sweeps per second. `jitter_s`: standard deviation of a sweep's time.
    - `speed_m_s`: the car's. `impact_s`: when a front tyre touches the step.
    - `step_m`: the step's height, positive upwards; 0 for a flat road.
    - `height_m`: the sensor's above the road. `front_wheel_m`: how far the front axle lies behind it.
    - `amplitude`: the echo's mean amplitude in counts. `fading`: standard deviation of its logarithm.
    """

    duration_s: float = 2.0
    rate_hz: float = 100.0
    jitter_s: float = 0.001
    speed_m_s: float = 30 / 3.6
    impact_s: float = 1.2
    step_m: float = 0.04
    height_m: float = 0.35
    front_wheel_m: float = 0.15
    amplitude: float = 2000.0
    fading: float = 0.25

    def __post_init__(self) -> None:
        for name in ("duration_s", "rate_hz", "speed_m_s", "height_m"):
            if not getattr(self, name) > 0:
                raise ValueError(f"`DemoScene({name}=...)` must be > 0; got {getattr(self, name)}.")
        for name in ("jitter_s", "amplitude", "fading", "front_wheel_m"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"`DemoScene({name}=...)` must be >= 0; got {getattr(self, name)}.")
        if not 0 <= self.step_m < min(_TYRE_RADIUS_M, self.height_m):
            bound = min(_TYRE_RADIUS_M, self.height_m)
            raise ValueError(f"`DemoScene(step_m=...)` must be >= 0 and < {bound}; got {self.step_m}.")

    @property
    def tyre_m(self) -> float:
        """How far before its axle a tyre touches the step's edge."""
        return math.sqrt(2 * _TYRE_RADIUS_M * self.step_m - self.step_m**2)

    @property
    def face_s(self) -> float:
        """When the step's face comes to the road that the echo is from."""
        ahead_m = self.front_wheel_m + _LOOK_AHEAD_PER_HEIGHT * self.height_m
        return self.impact_s - (ahead_m - self.tyre_m) / self.speed_m_s


def demo_drive(seed: int = 0, scene: DemoScene | None = None) -> Drive:
    """Drive over the scene's step; the same `seed` gives the same drive.

    The drive has one sensor, number 3 (the one that the thesis's own loader reads), acceleration, mounting and truth.
    """
    scene = DemoScene() if scene is None else scene
    clock, fade, receiver, shaker = (np.random.default_rng([seed, stream]) for stream in range(4))
    times_s = _sweep_times(scene, clock)
    rise_m, acceleration = _body(scene)
    fine_s = np.arange(len(rise_m)) * _FINE_S

    # What the echo's road lies higher by: the face goes by in h / speed.
    passed = np.clip((times_s - scene.face_s) * scene.speed_m_s / scene.step_m, 0, 1) if scene.step_m else 0.0
    height_m = scene.height_m - scene.step_m * passed + np.interp(times_s, fine_s, rise_m)
    echo_m = _ECHO_PER_HEIGHT * height_m
    range_m = _RANGE_START_M + _BIN_M * np.arange(_BINS)
    pulse = np.exp(-4 * math.log(2) * ((range_m - echo_m[:, None]) / _PULSE_FWHM_M) ** 2)
    noise = receiver.normal(0, _NOISE_COUNTS, (2, *pulse.shape))
    envelope = np.hypot(_amplitude(scene, times_s, fade)[:, None] * pulse + noise[0], noise[1])
    counts = np.clip(np.rint(envelope / _COUNTS_STEP) * _COUNTS_STEP, 0, FULL_SCALE)

    samples_s = np.rint(np.arange(0, scene.duration_s, 1 / scene.rate_hz) * 1e3) / 1e3
    measured = np.rint(np.interp(samples_s, fine_s, acceleration) + shaker.normal(0, 0.7, samples_s.shape))
    steps = (RoadStep(scene.impact_s, scene.step_m),) if scene.step_m else ()
    return Drive(
        sensors=(
            SensorSeries(
                sensor=3,
                times_ns=_nanoseconds(times_s),
                sweeps=counts.astype(np.uint16),
                range_m=range_m,
                flags=np.zeros(len(times_s), np.uint16),
            ),
        ),
        motion=Motion(acceleration_m_s2=Channel(_nanoseconds(samples_s), measured)),
        mounting=Mounting(height_m=scene.height_m, angle_deg=45.0, front_wheel_m=scene.front_wheel_m),
        truth=Truth(steps),
    )


def _nanoseconds(times_s: np.ndarray) -> np.ndarray:
    # To the microsecond, as the lab's log has them, so that nothing is lost on the way through it.
    return np.rint(times_s * 1e6).astype(np.int64) * (NANOSECONDS // 1_000_000)


def _sweep_times(scene: DemoScene, random: np.random.Generator) -> np.ndarray:
    period_s = 1 / scene.rate_hz
    count = max(1, round(scene.duration_s * scene.rate_hz))
    late_s = np.clip(random.normal(0, scene.jitter_s, count), -0.45 * period_s, 0.45 * period_s)
    times_s = np.arange(count) * period_s + late_s
    return times_s - times_s[0]


def _amplitude(scene: DemoScene, times_s: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """One level for each patch of road, and a smooth way from one to the next; in counts."""
    patches = times_s * scene.speed_m_s / _PATCH_M
    levels = random.normal(0, scene.fading, math.ceil(patches.max(initial=0.0)) + 2)
    patch = np.floor(patches).astype(int)
    share = 0.5 - 0.5 * np.cos(np.pi * (patches - patch))
    return scene.amplitude * np.exp(levels[patch] * (1 - share) + levels[patch + 1] * share)


def _body(scene: DemoScene) -> tuple[np.ndarray, np.ndarray]:
    """Rise in metres and acceleration in m/s² of the body, each `_FINE_S`, from the drive's start.

    The state is (body, wheel) positions and velocities. Its answer to a sudden step is the matrix exponential's; a
    wheel that climbs evenly for a while answers with the mean of that over this while.
    """
    spring, damper = _SPRING_N_M, _DAMPER_N_S_M
    rates = np.array(
        [
            [0, 0, 1, 0],
            [0, 0, 0, 1],
            [-spring / _BODY_KG, spring / _BODY_KG, -damper / _BODY_KG, damper / _BODY_KG],
            [spring / _WHEEL_KG, -(spring + _TYRE_N_M) / _WHEEL_KG, damper / _WHEEL_KG, -damper / _WHEEL_KG],
        ]
    )
    fine_s = np.arange(math.ceil((scene.duration_s + 1) / _FINE_S)) * _FINE_S
    after_s = np.maximum(fine_s - scene.impact_s, 0.0)
    values, vectors = np.linalg.eig(rates)
    # At rest on the new road both stand `step_m` higher; before the step they are that much below it.
    start = np.linalg.solve(vectors, np.array([-scene.step_m, -scene.step_m, 0.0, 0.0], complex))
    sudden = (vectors @ (start[:, None] * np.exp(values[:, None] * after_s))).real
    climb = max(1, round(scene.tyre_m / scene.speed_m_s / _FINE_S))
    rise_m, acceleration = sudden[0] + scene.step_m, np.where(fine_s < scene.impact_s, 0.0, rates[2] @ sudden)
    even = np.full(climb, 1 / climb)
    return np.convolve(rise_m, even)[: len(fine_s)], np.convolve(acceleration, even)[: len(fine_s)]
