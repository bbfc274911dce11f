"""Numbers on one axis: pulses, peaks, cells, floors, shifts, and slopes of a track on uneven times. Nothing here knows
of a sensor or of metres."""
