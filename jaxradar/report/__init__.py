"""An evaluation as one page to look at: it needs nothing beside it, no network and no server.

- `write_report`: the page of an `Evaluation`.
"""

from jaxradar.report.page import write_report

__all__ = ["write_report"]
