"""What `jaxradar.pareto` measures: inputs with known truth, and everybody who claims to find it.

- `range`: the range of one echo in one sweep, in white noise and in noise as recorded, SNR 0 to 50 dB.
- `speed`: the range rate at the newest sweep, from noisy ranges at jittered times.
- `steps`: detections of steps in the road, at equal false alarms.
- `spacing`: the echo of a simulated road against the spacing of its scatterers.
"""

from collections.abc import Callable, Mapping

from jaxradar.pareto import Task
from jaxradar.tasks.echo import EchoRange
from jaxradar.tasks.spacing import ScattererSpacing
from jaxradar.tasks.speed import RadialSpeed
from jaxradar.tasks.steps import StepDetection

__all__ = ["TASKS", "EchoRange", "RadialSpeed", "ScattererSpacing", "StepDetection"]

TASKS: Mapping[str, Callable[[], Task]] = {
    kind.name: kind for kind in (EchoRange, RadialSpeed, StepDetection, ScattererSpacing)
}
