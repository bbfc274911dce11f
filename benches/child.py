"""One measurement that needs a fresh process: `python child.py TASK '{"rows": [...], "logs": 32}'` prints JSON."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from data import UnavailableError, make_batch
from memory import anonymous_bytes, growth_bytes

__all__ = ["ask"]


def ask(task: str, environment: Mapping[str, str] | None = None, **arguments: Any) -> dict[str, Any]:
    """Run a task in a child process and return what it printed. Raises `UnavailableError` if it fails."""
    command = [sys.executable, str(Path(__file__).resolve()), task, json.dumps(arguments)]
    done = subprocess.run(
        command, env={**os.environ, **(environment or {})}, capture_output=True, text=True, check=False
    )
    if done.returncode:
        last = (done.stderr.strip() or f"exit {done.returncode}").splitlines()[-1]
        raise UnavailableError(f"the child process failed: {last}")
    answer: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return answer


def memory(rows: list[str], logs: int) -> dict[str, Any]:
    """Of each row: `peak`, the growth during a call, and `temp`, what the compiled program sets aside, in bytes."""
    import subject

    batch, answer = make_batch(logs), {}
    for row in rows:
        detector = subject.build(row, batch.range_m)
        peak = growth_bytes(subject.runner(detector, batch, subject.place(detector, batch)))
        answer[row] = {"peak": peak, "temp": subject.temp_bytes(detector, batch), "input": batch.sweeps.nbytes}
    return answer


def gradient(rows: list[str], logs: int) -> dict[str, Any]:
    import subject

    batch = make_batch(logs)
    return {row: {"peak": growth_bytes(subject.gradient(row, batch)[0])} for row in rows}


def _yardstick(values: Any) -> Any:
    """Some of everything; never to be changed, or runs before and after are not comparable."""
    import jax
    import jax.numpy as jnp

    def step(state: Any, value: Any) -> tuple[Any, Any]:
        after = jnp.where(value > state, jnp.exp(-value) + state, jnp.sqrt(jnp.abs(state)) * value)
        return after, jnp.stack([after, jnp.sin(after), jnp.tanh(after * value)])

    def one(row: Any) -> Any:
        last, rest = jax.lax.scan(step, row[0], row)
        return last + jnp.sum(jnp.sort(rest, axis=0)[jnp.argmax(rest, axis=0), 0])

    return jax.vmap(one)(values), jax.grad(lambda v: jnp.sum(jax.vmap(one)(v)))(values)


def compiling(rows: list[str], gradients: list[str], logs: int) -> dict[str, Any]:
    """Seconds that the first call of each takes beyond the second, in the order given."""
    import jax
    import subject

    batch = make_batch(logs)
    jax.block_until_ready(jax.jit(lambda x: x + 1)(batch.dt32))  # the backend starts here and not in the first row
    calls: dict[str, Callable[[], Any]] = {"yardstick": lambda: jax.block_until_ready(jax.jit(_yardstick)(batch.dt32))}
    for row in rows:
        detector = subject.build(row, batch.range_m)
        calls[row] = subject.runner(detector, batch, subject.place(detector, batch))
    for row in gradients:
        calls[f"gradient, {row}"] = subject.gradient(row, batch)[0]
    answer = {}
    for name, call in calls.items():
        seconds = []
        for _ in range(3):
            begin = time.perf_counter()
            call()
            seconds.append(time.perf_counter() - begin)
        answer[name] = seconds[0] - min(seconds[1:])
    return answer


def scenes(durations_s: list[float]) -> dict[str, Any]:
    """Of bare scenes of these lengths: what a process grows by beyond the sweeps that come out."""
    from sections.scenes import bare_scene, renderer

    grown = []
    for seconds in durations_s:
        scene = bare_scene(seconds)
        call = renderer(scene)
        sweeps = round(seconds * scene.radar.rate_hz)
        output = 4 * sweeps * scene.radar.bins
        peak = growth_bytes(lambda call=call: call(1))  # type: ignore[misc]
        grown.append({"sweeps": sweeps, "output": output, "beyond": peak - output})
    return {"grown": grown}


def store(path: str, detector: str) -> dict[str, Any]:
    """Evaluating a store: `anonymous`, the most memory that is not a file's, in bytes."""
    from jaxradar.evaluation import Settings, evaluate_each
    from jaxradar.logs import find_logs
    from jaxradar.systems.step import load_detector

    most, ended = 0, threading.Event()

    def look() -> None:
        nonlocal most
        while not ended.wait(0.02):
            most = max(most, anonymous_bytes())

    watcher = threading.Thread(target=look)
    watcher.start()
    try:
        paths = [str(one) for one in find_logs([path])]
        for _ in evaluate_each(paths, Settings(load_detector(detector).detector)):
            pass
    finally:
        ended.set()
        watcher.join()
    return {"anonymous": most}


def workers(path: str, count: int, workers: int, cores: int) -> dict[str, Any]:
    """The first drives of a store on so many pinned workers (0: in this process), which were started before."""
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])
    from jaxradar._cache import keep_compiled_programs
    from jaxradar.cluster import cluster_of

    keep_compiled_programs()
    from jaxradar.evaluation import Settings, evaluate_parts
    from jaxradar.logs import find_logs
    from jaxradar.systems.step import load_detector

    paths = [str(one) for one in find_logs([path])][:count]
    settings = Settings(load_detector("default").detector)
    with cluster_of(f"local:{workers}" if workers else None) as cluster:
        for _ in evaluate_parts(paths, settings, cluster):  # every worker compiles, and every page is read
            pass
        seconds = []
        for _ in range(3):
            start = time.perf_counter()
            sweeps = sum(one.sweeps for one in evaluate_parts(paths, settings, cluster))
            seconds.append(time.perf_counter() - start)
    return {"seconds": sorted(seconds)[1], "sweeps": sweeps}


def tuning(path: str, method: str, seed: int, most: int) -> dict[str, Any]:
    from fits import fit

    return fit(path, method, seed, most)


if __name__ == "__main__":
    tasks: dict[str, Callable[..., dict[str, Any]]] = {
        "memory": memory,
        "gradient": gradient,
        "compiling": compiling,
        "scenes": scenes,
        "store": store,
        "workers": workers,
        "tuning": tuning,
    }
    print(json.dumps(tasks[sys.argv[1]](**json.loads(sys.argv[2]))))
