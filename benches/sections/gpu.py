"""The batch on a GPU, the data being there already, beside its memory's bandwidth: `python benches/run.py gpu`."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from data import ESTIMATORS, make_batch
from measure import rounds, say
from peers import numpy_peers
from report import Section
from settings import Settings

from sections.batch import COLUMNS, fill, ours

__all__ = ["measure"]

READ = "read"


def measure(settings: Settings) -> Section:
    device = jax.devices()[0]
    if device.platform != "gpu":
        return Section("gpu", f"there is none; JAX's device is {device.platform}", ())
    logs = 32 if settings.quick else 512
    say(f"making {logs} logs")
    batch = make_batch(logs)
    section = Section("gpu", f"{device.device_kind}, {logs} logs; {settings.rounds} rounds", COLUMNS, words=2)
    mine, _ = ours(batch, section, device)
    numpy = numpy_peers.candidates(batch)[numpy_peers.BY_LOG]
    # Eight times the batch: a kernel over the batch alone would end before the clock has started in earnest.
    words = jax.device_put(jnp.ones((8 * batch.sweeps.nbytes // 4,), jnp.int32), device)
    total = jax.jit(lambda values: jnp.sum(values))
    calls = {"\n".join(key): call for key, call in mine.items()}
    calls |= {f"{estimator}\n{numpy_peers.BY_LOG}": numpy[estimator] for estimator in ESTIMATORS}
    calls[READ] = lambda: jax.block_until_ready(total(words))
    found = rounds(calls, settings.rounds, "gpu")
    read_gb_s = words.nbytes / float(np.median(found.pop(READ))) / 1e9
    fill(
        section, batch, {(key.split("\n")[0], key.split("\n")[1]): seconds for key, seconds in found.items()}, read_gb_s
    )
    section.notes.append(f"The sum of {words.nbytes / 1e9:.1f} GB on the device: {read_gb_s:.0f} GB/s.")
    return section
