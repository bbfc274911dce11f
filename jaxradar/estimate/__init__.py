"""Physical quantities out of signals, and how well that can be done."""
