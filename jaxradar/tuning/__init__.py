"""Settings of a detector out of drives whose truth is known, by gradient.

- `examples_of`: drives as arrays. `tune`: the fit, after a `Plan`, to `Costs`; gives a `Tuned`.
- `smooth_outcome`: what is to be expected of a detector whose threshold is blurred, as an `Outcome`.
- `Space`: settings between bounds as a vector without.
"""

from jaxradar.tuning.examples import Examples, examples_of
from jaxradar.tuning.fit import Plan, Start, Tuned, tune
from jaxradar.tuning.loss import Costs, Outcome, smooth_outcome
from jaxradar.tuning.space import Space

__all__ = [
    "Costs",
    "Examples",
    "Outcome",
    "Plan",
    "Space",
    "Start",
    "Tuned",
    "examples_of",
    "smooth_outcome",
    "tune",
]
