"""Numbers on one axis: pulses, peaks, floors and shifts. Nothing here knows of a sensor or of metres."""
