"""Settings of a detector out of drives whose truth is known, by gradient.

- `examples_of`: drives as arrays. `tune`: the fit, after a `Plan`, to `Costs`; gives a `Tuned`.
- `uncertainty`: how well the drives determine each setting, as `Fitted`. `split`: drives into those to fit to and those
  to validate on.
- `smooth_outcome`: what is to be expected of a detector whose threshold is blurred, as an `Outcome`.
- `Space`: settings between bounds as a vector without.
"""

from jaxradar.tuning.examples import Examples, examples_of, split
from jaxradar.tuning.fit import Plan, Start, Tuned, tune
from jaxradar.tuning.loss import Costs, Outcome, smooth_outcome
from jaxradar.tuning.space import Space
from jaxradar.tuning.uncertainty import Fitted, uncertainty

__all__ = [
    "Costs",
    "Examples",
    "Fitted",
    "Outcome",
    "Plan",
    "Space",
    "Start",
    "Tuned",
    "examples_of",
    "smooth_outcome",
    "split",
    "tune",
    "uncertainty",
]
