"""Work in parts on other processes and machines, through Dask distributed (`pip install 'jaxradar[cluster]'`).

A part is a function's argument; functions and results are pickled, so the machines need the same package, and paths
mean the same there. A worker that dies costs its parts another try elsewhere. Results come in the order of the parts,
so that sums are made in one order, whoever made the terms.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from jaxradar._cache import keep_compiled_programs
from jaxradar._errors import ConfigError

__all__ = ["Cluster", "Here", "LostError", "cluster_of"]

Part = TypeVar("Part")
Result = TypeVar("Result")

AHEAD = 4  # parts under way for each worker
CONNECT_SECONDS = 10


class LostError(RuntimeError):
    """A part that brought down every worker it was given to; the message says so."""


class Here:
    """This process, as a cluster: what works on one works without."""

    @property
    def workers(self) -> int:
        """How many there are now."""
        return 1

    def map(self, function: Callable[[Part], Result], parts: Iterable[Part]) -> Iterator[Result | LostError]:
        """The result of each part, in their order."""
        return map(function, parts)

    def total(
        self, function: Callable[[Part], Any], parts: Sequence[Part], add: Callable[[Any, Any], Any] | None = None
    ) -> Any:
        """The sum over parts of what `function` gives, a tree of arrays such as a gradient; added in their order.

        `add`: of two of them, leaf by leaf if None. Raises `LostError` if no worker survived a part, `ValueError` if
        there is none.
        """
        return _total(self.map(function, parts), add)


class Cluster(Here):
    """Workers of a Dask scheduler; `cluster_of` makes it."""

    def __init__(self, client: Any) -> None:
        self._client = client

    @property
    def workers(self) -> int:
        """How many there are now."""
        return len(self._client.scheduler_info(n_workers=-1)["workers"])

    def map(self, function: Callable[[Part], Result], parts: Iterable[Part]) -> Iterator[Result | LostError]:
        """The result of each part, in their order; a `LostError` for one that no worker survived.

        `function` is sent by its name: one of a module, and not a closure, or each worker traces it anew for each
        part. What it raises is raised here. No more parts are under way, and no more results wait, than a few for
        each worker.
        """
        from distributed import KilledWorker

        waiting: list[Any] = []
        source = iter(parts)
        try:
            while True:
                while len(waiting) < AHEAD * max(1, self.workers) and (part := next(source, source)) is not source:
                    # Never taken for an equal call of before: files change.
                    waiting.append(self._client.submit(function, part, pure=False))
                if not waiting:
                    return
                first = waiting.pop(0)
                try:
                    yield first.result()
                except KilledWorker as error:
                    yield LostError(
                        f"its worker died, and so did those that tried again ({str(error).splitlines()[0]})."
                    )
                finally:
                    first.release()
        finally:
            for future in waiting:
                future.cancel()


def _total(terms: Iterable[Any], add: Callable[[Any, Any], Any] | None = None) -> Any:
    """The sum of trees, first to last. Raises `LostError` for a term that is one, `ValueError` for none."""

    def both(one: Any, other: Any) -> Any:
        if isinstance(other, LostError):
            raise other
        if add is not None:
            return add(one, other)
        import jax

        return jax.tree.map(lambda a, b: a + b, one, other)

    held = iter(terms)
    first = next(held, None)
    if first is None:
        raise ValueError("a sum needs at least one part.")
    if isinstance(first, LostError):
        raise first
    return functools.reduce(both, held, first)


@contextmanager
def cluster_of(given: str | Here | None) -> Iterator[Here]:
    """Workers by name: the address of a scheduler (`tcp://host:8786`, `tls://...`), or `local:N` for N processes on
    this machine, which share its cores out among them. None gives `Here`, a `Cluster` itself.

    Raises `ConfigError` for another name, for an address where nobody answers, and where Dask is not installed.
    """
    if given is None or isinstance(given, Here):
        yield given or Here()
        return
    kind, _, rest = given.partition(":")
    if kind not in ("local", "tcp", "tls") or (kind == "local" and not (rest.isdecimal() and int(rest) > 0)):
        raise ConfigError(f"unknown cluster {given!r}; expected tcp://HOST:PORT, tls://HOST:PORT or local:N.")
    try:
        from distributed import Client, LocalCluster

        from jaxradar._worker import Ready
    except ImportError:
        raise ConfigError("a cluster needs Dask: pip install 'jaxradar[cluster]'.") from None
    if kind != "local":
        try:
            client = Client(given, timeout=CONNECT_SECONDS)
        except (OSError, TimeoutError, TypeError, ValueError) as error:  # a `TypeError` for missing certificates
            raise ConfigError(f"no scheduler answers at {given} ({error}).") from None
        with client:
            client.register_plugin(Ready())
            yield Cluster(client)
        return
    keep_compiled_programs()
    with (
        LocalCluster(
            int(rest),
            threads_per_worker=1,
            processes=True,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            memory_limit=0,
        ) as made,
        Client(made, timeout=CONNECT_SECONDS) as client,
    ):
        client.register_plugin(Ready(int(rest)))
        client.wait_for_workers(int(rest))
        yield Cluster(client)
