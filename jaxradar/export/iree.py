"""A one-sweep program compiled by IREE, for this machine or another.

IREE cuts a program into *dispatches*, one for each loop that its compiler can fuse, and starting one costs about a
microsecond: that is far more than the 128 numbers in it take. So the whole sweep is made one dispatch, by hand: the
compiler is stopped once it has turned the program into loops over tensors, all of which are put into one region, and
again when it has chosen how to tile that region, which is untiled, as its tiling is for a single loop and its
neighbours. What it makes of the default detector is seven times as fast and half as large (`benches/run.py live`).
It is not a way in which others use that compiler: so the program is held against JAX sweep by sweep before it is given
out (`jaxradar.export.check`), and compiled the usual way where the two differ or the compiler does not take it.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
from pathlib import Path

from jaxradar._errors import ConfigError

__all__ = ["TARGETS", "CompilerError", "check_target", "compile_program", "compiler_version"]

_ARM = "--iree-llvmcpu-target-triple=aarch64-linux-gnu"
TARGETS: dict[str, tuple[str, ...]] = {
    "host": ("--iree-llvmcpu-target-cpu=host",),
    "aarch64-cortex-a53": (_ARM, "--iree-llvmcpu-target-cpu=cortex-a53"),  # Raspberry Pi 3
    "aarch64-cortex-a72": (_ARM, "--iree-llvmcpu-target-cpu=cortex-a72"),  # Raspberry Pi 4
    "aarch64-cortex-a76": (_ARM, "--iree-llvmcpu-target-cpu=cortex-a76"),  # Raspberry Pi 5
}
_COMMON = (
    "--iree-input-type=stablehlo",
    "--iree-input-demote-f64-to-f32=false",
    "--iree-hal-target-device=local",
    "--iree-hal-local-target-device-backends=llvm-cpu",
    "--iree-llvmcpu-debug-symbols=false",
    "--iree-vm-bytecode-module-strip-source-map=true",
    # All that one dispatch keeps beside its inputs lies on the stack.
    "--iree-llvmcpu-stack-allocation-limit=1048576",
)
_SINGLE = ("--iree-llvmcpu-disable-distribution",)
_LOOPS, _TILED = "global-optimization", "executable-configurations"


class CompilerError(Exception):
    """IREE's compiler did not take a program; says why in its own words."""


def compiler_version() -> str:
    """Of IREE's compiler. Raises `ConfigError` where it is not installed."""
    try:
        from iree.compiler import version
    except ImportError:
        raise ConfigError(
            "compiling for the device needs IREE's compiler; install it with `pip install 'jaxradar[export]'`."
        ) from None
    return str(version.VERSION)


def check_target(target: str) -> None:
    """Raises `ConfigError` unless it is one of `TARGETS`."""
    if target not in TARGETS:
        raise ConfigError(f"unknown target `{target}`; expected {', '.join(TARGETS)}.")


def compile_program(text: str, target: str, *, single: bool) -> bytes:
    """StableHLO as IREE's byte code for one of `TARGETS`; `single`: as one dispatch.

    Raises `CompilerError` where the compiler does not take it, and `ConfigError` for an unknown target and where there
    is no compiler.
    """
    check_target(target)
    options = (*_COMMON, *TARGETS[target])
    if not single:
        return _compiled(text.encode(), *options)
    loops = _compiled(text.encode(), *options, f"--compile-to={_LOOPS}").decode()
    options += _SINGLE
    tiled = _compiled(_one_region(loops).encode(), *options, f"--compile-from={_LOOPS}", f"--compile-to={_TILED}")
    return _compiled(_untiled(tiled.decode()).encode(), *options, f"--compile-from={_TILED}")


def _compiled(program: bytes, *options: str) -> bytes:
    compiler_version()
    from iree.compiler.tools.binaries import find_tool

    with tempfile.TemporaryDirectory(prefix="jaxradar-export-") as folder:
        source, made = Path(folder, "program.mlir"), Path(folder, "program.out")
        source.write_bytes(program)
        ran = subprocess.run(
            [find_tool("iree-compile"), str(source), *options, "-o", str(made)], capture_output=True, check=False
        )
        if ran.returncode or not made.exists():
            raise CompilerError(ran.stderr.decode("utf-8", "backslashreplace")[:2000])
        return made.read_bytes()


_FUNCTION = "  util.func public @main("
_OUTSIDE = re.compile(r"hal\.tensor\.import|compute_barrier\.start|util\.global\.load")
_END = re.compile(r"    (%\S+) = iree_tensor_ext\.compute_barrier\.end (%\S+) : (\S+) -> \S+")
_LEAVES = re.compile(r"hal\.tensor\.export|util\.return")


def _one_region(text: str) -> str:
    """All loops of the function `main` in one dispatch region. Raises `CompilerError` where they do not look as known
    from IREE 3.13."""
    lines = text.split("\n")
    first = next((place for place, line in enumerate(lines) if line.startswith(_FUNCTION)), None)
    if first is None:
        raise CompilerError("found no function `main` to put into one region.")
    last = next(place for place in range(first, len(lines)) if lines[place] == "  }")
    outside, inside, ends, leaving = [], [], [], []
    for line in lines[first + 1 : last]:
        if _OUTSIDE.search(line):
            outside.append(line)
        elif found := _END.fullmatch(line):
            ends.append(found)
        elif _LEAVES.search(line):
            leaving.append(line)
        else:
            inside.append(line)
    if not ends or not inside:
        raise CompilerError("found no results to take out of one region.")
    types = ", ".join(one[3] for one in ends)
    region = [
        f"    %all:{len(ends)} = flow.dispatch.region -> ({types}) {{",
        *inside,
        f"      flow.return {', '.join(one[2] for one in ends)} : {types}",
        "    }",
        *(one[0].replace(f"{one[2]} :", f"%all#{place} :") for place, one in enumerate(ends)),
    ]
    return "\n".join([*lines[: first + 1], *outside, *region, *leaving, *lines[last:]])


def _untiled(text: str) -> str:
    """Every loop as it is written. Raises `CompilerError` where there is no tiling to take away."""
    text, pipelines = re.subn(r"#iree_cpu\.pipeline<\w+>", "#iree_cpu.pipeline<Default>", text)
    if not pipelines:
        raise CompilerError("found no tiling to take away.")
    return re.sub(r"lowering_config = #iree_cpu\.lowering_config<[^>]*>,? ?", "", text)
