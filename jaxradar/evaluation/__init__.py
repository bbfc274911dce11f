"""What a detector finds in logs, held against the truth: one log or thousands, as tables.

- `evaluate`: run a detector over logs and stores, as an `Evaluation`; `evaluate_each` gives the results one by one,
  `evaluate_parts` from the workers of a cluster.
- `operating_curve`: hits and false alarms over the threshold.

The rule of what is a hit is in `jaxradar.matching`.
"""

from jaxradar.evaluation.records import Drawn, Events, Failure, Picture, SeriesResult, failure_record, record_of
from jaxradar.evaluation.roc import OperatingPoint, operating_curve
from jaxradar.evaluation.run import evaluate, evaluate_each, evaluate_parts
from jaxradar.evaluation.selection import Selection, Settings
from jaxradar.evaluation.table import Evaluation

__all__ = [
    "Drawn",
    "Evaluation",
    "Events",
    "Failure",
    "OperatingPoint",
    "Picture",
    "Selection",
    "SeriesResult",
    "Settings",
    "evaluate",
    "evaluate_each",
    "evaluate_parts",
    "failure_record",
    "operating_curve",
    "record_of",
]
