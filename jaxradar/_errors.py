"""What a user can get wrong, said in one sentence.

Every message names what was found, where, and what was expected. The command line prints it as it is and exits
with a non-zero status; it never shows a traceback for one of these.
"""

from __future__ import annotations

from os import PathLike, fspath

__all__ = ["ConfigError", "JaxradarError", "LogError", "SourceError"]


class JaxradarError(Exception):
    """Base of all errors that a user can mend."""


class LogError(JaxradarError):
    """A recorded log, or a file beside it, that cannot be read as what it claims to be.

    Attributes: `path`, `line` and `column` (both counted from 1, or None where they have no meaning), `problem`.
    """

    def __init__(
        self, path: str | PathLike[str], problem: str, *, line: int | None = None, column: int | None = None
    ) -> None:
        self.path = fspath(path)
        self.line = line
        self.column = column
        self.problem = problem
        place = self.path
        if line is not None:
            place += f", line {line}"
        if column is not None:
            place += f", column {column}"
        super().__init__(f"{place}: {problem}")

    def __reduce__(self) -> tuple[object, ...]:
        # Keyword-only arguments would be lost on the way back from a worker process.
        return _log_error, (self.path, self.problem, self.line, self.column)


def _log_error(path: str, problem: str, line: int | None, column: int | None) -> LogError:
    return LogError(path, problem, line=line, column=column)


class ConfigError(JaxradarError):
    """A setting, in a file or an argument, that is unknown or outside its bounds."""


class SourceError(JaxradarError):
    """A source of live sweeps that cannot be reached, refuses, falls silent or says what cannot be read."""
