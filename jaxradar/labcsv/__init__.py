"""The lab's CSV in and out, with NumPy alone: what a device without Arrow, HDF5 or JAX reads and writes.

`reader` and `writer` know the files, `truth` the JSON beside a log, `clock` what goes wrong with times, `table` rows
and their errors, `parse` the numbers: faster where pyarrow is installed, to the same bit where it is not.
"""

from jaxradar.labcsv.clock import odd_times
from jaxradar.labcsv.parse import use_one_thread
from jaxradar.labcsv.reader import MOTION_FILES, looks_like_radar, read_lab_csv, sensor_files
from jaxradar.labcsv.truth import read_truth, truth_path, truth_text

__all__ = [
    "MOTION_FILES",
    "looks_like_radar",
    "odd_times",
    "read_lab_csv",
    "read_truth",
    "sensor_files",
    "truth_path",
    "truth_text",
    "use_one_thread",
]
