"""A detector compiled for the device: from its one-sweep program to a file that runs there without JAX."""

from jaxradar.export.archive import archive_bytes, write_archive
from jaxradar.export.iree import TARGETS
from jaxradar.export.jaxed import JaxStep
from jaxradar.export.make import export_detector

__all__ = ["TARGETS", "JaxStep", "archive_bytes", "export_detector", "write_archive"]
