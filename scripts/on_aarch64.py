"""A compiled detector on 64-bit ARM, held against the same detector compiled for this machine.

    sudo apt install qemu-user-static debootstrap        # once; nothing below needs to be root
    python scripts/on_aarch64.py arm                     # a simulated drive over a step on a wet road
    python scripts/on_aarch64.py arm LOG                 # or a log of your own
    python scripts/on_aarch64.py arm --cpu cortex-a76    # Raspberry Pi 5, -a72: 4 (default: cortex-a53, 3)

Makes, in the folder `arm`:

- `root`, kept for the next time: Debian 12 (bookworm, the base of 64-bit Raspberry Pi OS of that name) for arm64 as far
  as Python needs it, with NumPy and IREE's runtime. Packages are unpacked, not installed: nothing of them is run.
- the log in the package's binary form, and `host.pyz` and `step.pyz`: what `jaxradar export` makes of the detector for
  this machine and for the ARM.

Runs `python3 step.pyz --source replay LOG --fast --json` with the root's own Python in QEMU, which refuses instructions
that the processor has not, and `host.pyz` here in a process that cannot import JAX. Their detections have to be of the
same sweeps and agree within `TOLERANCE`. Then the same of every single sweep's decision, detection or not: its flags
equal, its numbers within `TOLERANCE` of the largest in the log.

QEMU computes what the processor computes, but not at its pace: durations under it say nothing of a Raspberry Pi.
Exit status: 0 where all agree, 1 where not or where something failed, 3 where it cannot be tried (a tool is missing,
the downloads fail).
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

from jaxradar.cli import main as jaxradar

SCENE = "wet-road"
TOLERANCE = 1e-5
DEBIAN, PYTHON = "bookworm", "3.11"
SITE = "usr/lib/python3/dist-packages"  # where Debian's Python looks for packages, in the root
PLATFORMS = ("manylinux_2_28_aarch64", "manylinux2014_aarch64")
LONGEST_S = 900
CPUS = ("cortex-a53", "cortex-a72", "cortex-a76")
AGREE, DIFFER, NOT_TRIED = 0, 1, 3

# `python3 FILE.pyz ...` where there is no JAX.
WITHOUT_JAX = """\
import runpy, sys
sys.modules.update(jax=None, jaxlib=None)
del sys.argv[0]
runpy.run_path(sys.argv[0], run_name="__main__")
"""
# FILE.pyz LOG: the decision of every sweep as a line of JSON.
EVERY_SWEEP = """\
import json, pathlib, sys
sys.modules.update(jax=None, jaxlib=None)
sys.path.insert(0, sys.argv[1])
from jaxradar.live.app import load
from jaxradar.live.detect import LiveDetector
from jaxradar.live.replay import Replay
from jaxradar.live.sources import read_device_log
detector = LiveDetector(*load(sys.argv[1]))
with Replay(read_device_log(pathlib.Path(sys.argv[2])), None) as source:
    for live in source:
        print(json.dumps({"sweep": detector.take(live)._asdict()}))
"""


class NotTriedError(Exception):
    """This machine lacks something; says what."""


class FailedError(Exception):
    """A program failed; says which and what it said."""


def tool(names: tuple[str, ...], package: str) -> str:
    """The path of a program that is known under some of these names. Raises `NotTriedError` where it is missing."""
    path = os.pathsep.join([os.environ.get("PATH", os.defpath), "/usr/sbin", "/sbin"])
    for name in names:
        if found := shutil.which(name, path=path):
            return found
    raise NotTriedError(f"{names[0]} is missing; on Debian and Ubuntu `sudo apt install {package}` has it.")


def ready_root(folder: Path, mirror: str | None) -> Path:
    """The folder's Debian root, made if it is not there, with the packages that a compiled detector needs."""
    root = folder / "root"
    if not root.exists():
        begin = time.monotonic()
        debootstrap, unpack = tool(("debootstrap",), "debootstrap"), tool(("dpkg-deb",), "dpkg")
        downloads, part = folder / "downloads", folder / "root.part"
        options = ("--download-only", "--arch=arm64", "--variant=minbase", "--include=python3")
        chosen, place = ([], "") if mirror is None else ([mirror], f" from {mirror}")
        fetched([debootstrap, *options, DEBIAN, str(downloads), *chosen], f"Debian's packages{place}")
        shutil.rmtree(part, ignore_errors=True)
        packages = sorted(downloads.glob("var/cache/apt/archives/*.deb"))
        for package in packages:
            ran([unpack, "--extract", str(package), str(part)])
        part.rename(root)
        shutil.rmtree(downloads)
        print(f"{root}: {len(packages)} packages of Debian {DEBIAN} in {time.monotonic() - begin:.0f} s.")
    iree = version("iree-base-runtime")  # a program and what runs it are of one version
    if not (root / SITE / f"iree_base_runtime-{iree}.dist-info").exists():
        begin = time.monotonic()
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--upgrade", "--target", str(root / SITE)]
        pip += [part for platform in PLATFORMS for part in ("--platform", platform)]
        pip += ["--only-binary=:all:", "--python-version", PYTHON, "--implementation", "cp"]
        fetched([*pip, f"iree-base-runtime=={iree}", "numpy"], "the wheels of numpy and iree-base-runtime for aarch64")
        print(f"{root}: NumPy and IREE's runtime {iree} in {time.monotonic() - begin:.0f} s.")
    return root


def fetched(command: list[str], what: str) -> None:
    """Run what downloads. Raises `NotTriedError` where it fails."""
    try:
        ran(command)
    except FailedError as error:
        raise NotTriedError(f"{what} could not be had: {error}") from None


def ran(command: list[str]) -> str:
    """What a program prints, run where no setting of this Python's counts. Raises `FailedError` with its last line."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    try:
        done = subprocess.run(command, env=clean, capture_output=True, text=True, check=False, timeout=LONGEST_S)
    except subprocess.TimeoutExpired:
        raise FailedError(f"{Path(command[0]).name} took more than {LONGEST_S} s.") from None
    if done.returncode:
        lines = [*done.stdout.splitlines(), *done.stderr.splitlines()] or ["it did not say why."]
        raise FailedError(f"{Path(command[0]).name} ended with status {done.returncode}: {lines[-1]}")
    return done.stdout


def make(*command: str) -> None:
    """One command of `jaxradar`. Raises `FailedError` where it fails; it has said why."""
    if jaxradar(command):
        raise FailedError(f"jaxradar {command[0]} failed.")


def lines(text: str, kind: str) -> list[dict[str, Any]]:
    """The records of one kind in lines of JSON."""
    return [record[kind] for record in map(json.loads, text.splitlines()) if kind in record]


def largest(records: list[dict[str, Any]]) -> dict[str, float]:
    """Of each number in the records, without its sign."""
    scale: dict[str, float] = {}
    for record in records:
        for name, value in record.items():
            if isinstance(value, float):
                scale[name] = max(scale.get(name, 0.0), abs(value))
    return scale


def differences(here: list[dict[str, Any]], there: list[dict[str, Any]], scale: dict[str, float]) -> list[str]:
    """What two lists of records do not have in common, a sentence each. Whole numbers, flags and absent values are the
    same or not; others may differ by `TOLERANCE` relative, or by as much of their name's `scale`."""
    found = [] if len(here) == len(there) else [f"{len(here)} here and {len(there)} on the ARM."]
    for place, (one, other) in enumerate(zip(here, there, strict=False)):
        for name in one.keys() | other.keys():
            a, b = one.get(name), other.get(name)
            near = TOLERANCE * scale.get(name, 0.0)
            if isinstance(a, float) and isinstance(b, float):
                same = math.isclose(a, b, rel_tol=TOLERANCE, abs_tol=near)
            else:
                same = a == b
            if not same:
                found.append(f"number {place}: {name} is {a} here and {b} on the ARM.")
    return found


def compare(folder: Path, log: Path | None, cpu: str, mirror: str | None) -> int:
    """All of it; prints what comes out and returns the exit status."""
    qemu = tool(("qemu-aarch64-static", "qemu-aarch64"), "qemu-user-static")
    folder.mkdir(parents=True, exist_ok=True)
    root = ready_root(folder, mirror)
    if log is None:
        make("simulate", SCENE, "--form", "drive", "-o", str(folder), "--overwrite")
        drive = folder / f"{SCENE}-000.drive"
    else:
        drive = folder / "log.drive"
        make("convert", str(log), str(drive), "--overwrite")
    host, step = str(folder / "host.pyz"), str(folder / "step.pyz")
    make("export", "default", "--like", str(drive), "-o", host)
    make("export", "default", "--like", str(drive), "-o", step, "--target", f"aarch64-{cpu}")

    arm = [qemu, "-cpu", cpu, "-L", str(root), str(root / "usr/bin/python3")]
    print(
        "On the ARM:",
        ran([*arm, "-c", "import platform; print(platform.machine(), platform.python_version())"]),
        end="",
    )
    replay = ["--source", "replay", str(drive), "--fast", "--json"]
    here, there = ran([sys.executable, "-c", WITHOUT_JAX, host, *replay]), ran([*arm, step, *replay])
    found = differences(lines(here, "event"), lines(there, "event"), {})
    print(f"Detections: {len(lines(here, 'event'))} here, {len(lines(there, 'event'))} on the ARM, {said(found)}")

    here = ran([sys.executable, "-c", EVERY_SWEEP, host, str(drive)])
    there = ran([*arm, "-c", EVERY_SWEEP, step, str(drive)])
    sweeps = lines(here, "sweep")
    if not sweeps:
        raise FailedError(f"{drive} has no sweeps; nothing can be compared.")
    others = differences(sweeps, lines(there, "sweep"), largest(sweeps))
    same = ", bit by bit" if here == there else ""
    print(
        f"Decisions on single sweeps: {len(sweeps)} here, {len(lines(there, 'sweep'))} on the ARM, {said(others)}{same}"
    )
    for sentence in [*found, *others][:20]:
        print(" ", sentence)
    return DIFFER if found or others else AGREE


def said(found: list[str]) -> str:
    """In words."""
    return f"{len(found)} differences" if found else "equal"


def main() -> int:
    """From the command line."""
    about, _, more = (__doc__ or "").partition("\n")
    parser = argparse.ArgumentParser(
        description=about, epilog=more, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("folder", metavar="FOLDER", type=Path, help="where the Debian root and the programs are kept")
    parser.add_argument("log", metavar="LOG", type=Path, nargs="?", help=f"a log (default: the scene {SCENE})")
    parser.add_argument("--cpu", choices=CPUS, default=CPUS[0], help="the processor (default: %(default)s)")
    parser.add_argument("--mirror", metavar="URL", help="of Debian (default: the one that debootstrap knows)")
    args = parser.parse_args()
    try:
        return compare(args.folder, args.log, args.cpu, args.mirror)
    except NotTriedError as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return NOT_TRIED
    except FailedError as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return DIFFER


if __name__ == "__main__":
    sys.exit(main())
