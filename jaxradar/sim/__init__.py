"""Drives that nobody drove. A simulator knows nothing of the detectors that it tests."""

from jaxradar.sim.demo import DemoScene, demo_drive

__all__ = ["DemoScene", "demo_drive"]
