"""Where something was measured: a time means nothing without it."""

from __future__ import annotations

import datetime
import importlib.metadata
import platform
from collections.abc import Sequence
from pathlib import Path

import jax

from jaxradar._machine import cores

__all__ = ["machine"]


def machine(packages: Sequence[str] = ("jaxradar", "jax", "jaxlib", "numpy", "scipy")) -> dict[str, str]:
    """Date, processor and cores that this process may use, JAX's devices, versions."""
    return {
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "cpu": f"{_cpu()}, {cores()} cores",
        "device": ", ".join(f"{device.platform}: {device.device_kind}" for device in jax.devices()),
        "versions": f"python {platform.python_version()}, "
        + ", ".join(f"{name} {_version(name)}" for name in packages),
    }


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "absent"


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
