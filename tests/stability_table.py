"""The table of what must stay stable: every public function that computes, at its hard inputs.

A `Case` is one function of one input, all of whose hard inputs of one shape go through one program. What
`public_names` finds and is neither in a case nor in `NOT_NUMERIC` fails `test_stability.py`.
"""

from __future__ import annotations

from stability_case import Case
from stability_detectors import detector_cases
from stability_estimators import estimator_cases
from stability_numerics import numeric_cases, unit_cases
from stability_signal import difference_cases, signal_cases


def all_cases() -> dict[str, Case]:
    made = [
        *estimator_cases(),
        *signal_cases(),
        *numeric_cases(),
        *unit_cases(),
        *difference_cases(),
        *detector_cases(),
    ]
    return {case.name: case for case in made}
