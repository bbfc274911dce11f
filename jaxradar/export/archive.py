"""An artefact as a file that Python runs: a zip archive with the program and the modules that run it."""

from __future__ import annotations

import ast
import io
import marshal
import stat
import zipfile
from importlib.util import MAGIC_NUMBER, source_hash
from os import PathLike
from pathlib import Path

import jaxradar
from jaxradar.drivefile import staged
from jaxradar.live.artefact import DAMAGES, HEADER, PROGRAMS, Artefact
from jaxradar.live.options import RUNTIME

__all__ = ["MODULES", "archive_bytes", "write_archive"]

# What the program on the device is made of; all of it needs NumPy alone.
MODULES = (
    *("__init__.py", "_errors.py", "_program.py", "_toml.py", "drive.py", "motion.py", "units.py"),
    *("drivefile", "labcsv", "live"),
)
_NOT_NEEDED = "labcsv/writer.py"  # the device writes drives
_INIT = b'"""The part of jaxradar that runs on a device."""\n'
_FIRST_LINE = b"#!/usr/bin/env python3\n"
# What is missing is said in a sentence, which any Python 3 can read. Ctrl-C outside of the detection, which takes it in
# its own way, ends the process without a traceback. Python compares no checksum of what it imports from an archive: a
# damaged module could decide otherwise without a word.
_MAIN = f"""\
import {", ".join(sorted({one.__module__ for one in DAMAGES}))}
import signal
import sys

if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)

name = __file__.rpartition("__main__.py")[0].rstrip("/\\\\")
if sys.version_info < (3, 11):
    sys.stderr.write("%s: needs Python 3.11 or newer; this is %s.\\n" % (name, sys.version.split()[0]))
    sys.exit(2)
try:
    with zipfile.ZipFile(name) as archive:
        damaged = archive.testzip() is not None
except (OSError, {", ".join(f"{one.__module__}.{one.__qualname__}" for one in DAMAGES)}):
    damaged = True
if damaged:
    sys.stderr.write("%s: is damaged; export it, or copy it, again.\\n" % name)
    sys.exit(2)
try:
    import numpy
except ImportError:
    sys.stderr.write("%s: needs NumPy; install it with `pip install numpy '{RUNTIME}'`.\\n" % name)
    sys.exit(2)

from jaxradar.live.app import main

sys.exit(main(own=name))
"""
_TIME = (1980, 1, 1, 0, 0, 0)  # the first that a zip archive knows: the same content gives the same bytes


def archive_bytes(artefact: Artefact) -> bytes:
    """The file's content."""
    held = {HEADER: artefact.header_text().encode(), PROGRAMS[artefact.header.kind]: artefact.program}
    if artefact.header.kind == "iree":
        held["__main__.py"] = _MAIN.encode()
        held |= _modules()
    made = io.BytesIO()
    made.write(_FIRST_LINE if artefact.header.kind == "iree" else b"")
    with zipfile.ZipFile(made, "a", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, content in held.items():
            archive.writestr(zipfile.ZipInfo(name, _TIME), content, zipfile.ZIP_DEFLATED, 9)
    return made.getvalue()


def write_archive(path: str | PathLike[str], artefact: Artefact) -> int:
    """Write the file, whole or not at all, for its owner to run; returns how many bytes it has.

    Raises `LogError` if it cannot be written.
    """
    content = archive_bytes(artefact)
    with staged(Path(path), overwrite=True) as beside:
        beside.write_bytes(content)
        if artefact.header.kind == "iree":
            beside.chmod(beside.stat().st_mode | stat.S_IXUSR)
    return len(content)


def _modules() -> dict[str, bytes]:
    """Each as source and as compiled for this version of Python: another takes the source, and starts later by that."""
    root = Path(jaxradar.__file__).parent
    files = []
    for name in MODULES:
        found = root / name
        files += sorted(found.rglob("*.py")) if found.is_dir() else [found]
    made: dict[str, bytes] = {}
    for file in files:
        # Tracebacks show no folder of this machine.
        below = file.relative_to(root).as_posix()
        if below == _NOT_NEEDED:
            continue
        name = f"jaxradar/{below}"
        source = _INIT if below == "__init__.py" else file.read_bytes()
        made |= {name: source, f"{name}c": _compiled(source, name)}
    return made


class _Bare(ast.NodeTransformer):
    """Functions without annotations; those of fields, which dataclasses and named tuples go by, stay."""

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.FunctionDef:
        self.generic_visit(node)
        node.returns = None
        given = node.args
        for one in (*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg):
            if one is not None:
                one.annotation = None
        return node


def _compiled(source: bytes, name: str) -> bytes:
    """As `py_compile -OO` makes it, without what only a reader or a type checker wants, and checked against no source
    (PEP 552), as source and code do not part in an archive.

    In marshal's second version: later ones mark what is referred to more than once, by counts that are chance.
    """
    bare = _Bare().visit(ast.parse(source, name))
    code = marshal.dumps(compile(bare, name, "exec", dont_inherit=True, optimize=2), 2)
    unchecked = (1).to_bytes(4, "little")
    return MAGIC_NUMBER + unchecked + source_hash(source) + code
