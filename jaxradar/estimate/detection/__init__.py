"""Thresholds from theory: from noise, sweep rate and window to false alarms and detections, and back.

The noise is Gaussian, of standard deviation `sd` in each sample (metres, for ranges), independent from sample to sample
unless a correlation is given; `fit_noise` finds that of a record, and whitens it. All in float64 on the host.

Rates of false alarms are per hour, at `rate_hz` samples a second. `…_false_alarms_per_hour` counts every sample above
the threshold (a difference), or alarms with a pause between them (the other tests), `…_onsets_per_hour` each rise above
it. `…_threshold` and `…_onset_threshold` are their inverses: `per_hour` for the threshold, all other arguments the
same; a rate that no threshold answers raises `ValueError`. `…_least_step` is the inverse of `…_detection` at such a
threshold, and `rayleigh_multiplier` that of `rayleigh_false_alarm`.

A CUSUM, a window-limited test and a GLR take innovations in units of their standard deviation, so their steps are in
such units too; the level before a step is taken as known.
"""

from jaxradar.estimate.detection.cfar import (
    effective_cells,
    envelope_correlation,
    rayleigh_false_alarm,
    rayleigh_multiplier,
)
from jaxradar.estimate.detection.cusum import (
    CUSUM_OVERSHOOT,
    cusum_false_alarms_per_hour,
    cusum_run_length,
    cusum_threshold,
)
from jaxradar.estimate.detection.difference import (
    difference_detection,
    difference_detection_within,
    difference_false_alarms_per_hour,
    difference_onset_threshold,
    difference_onsets_per_hour,
    difference_threshold,
)
from jaxradar.estimate.detection.glr import glr_detection, glr_false_alarms_per_hour, glr_least_step, glr_threshold
from jaxradar.estimate.detection.moving_sum import (
    moving_sum_detection,
    moving_sum_detection_within,
    moving_sum_false_alarms_per_hour,
    moving_sum_least_step,
    moving_sum_least_window,
    moving_sum_onset_threshold,
    moving_sum_onsets_per_hour,
    moving_sum_sd,
    moving_sum_threshold,
)
from jaxradar.estimate.detection.noise import NoiseModel, fit_noise, sample_autocorrelation

__all__ = [
    "CUSUM_OVERSHOOT",
    "NoiseModel",
    "cusum_false_alarms_per_hour",
    "cusum_run_length",
    "cusum_threshold",
    "difference_detection",
    "difference_detection_within",
    "difference_false_alarms_per_hour",
    "difference_onset_threshold",
    "difference_onsets_per_hour",
    "difference_threshold",
    "effective_cells",
    "envelope_correlation",
    "fit_noise",
    "glr_detection",
    "glr_false_alarms_per_hour",
    "glr_least_step",
    "glr_threshold",
    "moving_sum_detection",
    "moving_sum_detection_within",
    "moving_sum_false_alarms_per_hour",
    "moving_sum_least_step",
    "moving_sum_least_window",
    "moving_sum_onset_threshold",
    "moving_sum_onsets_per_hour",
    "moving_sum_sd",
    "moving_sum_threshold",
    "rayleigh_false_alarm",
    "rayleigh_multiplier",
    "sample_autocorrelation",
]
