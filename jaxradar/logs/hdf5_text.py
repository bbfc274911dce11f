"""Texts of variable length in an HDF5 file, read without the HDF5 library.

The library walks a damaged global heap for ever, and nothing inside a process can stop it. Such a text is
16 bytes in the file: its length, the address of a heap collection and its number there; a collection is a
row of objects with their sizes ("HDF5 File Format Specification", sections III.E and IV.B). Addresses and sizes
take 8 bytes here, as in every file that h5py writes.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

__all__ = ["heap_text"]

_REFERENCE = struct.Struct("<IQI")  # length, address of the collection, number of the object
_COLLECTION = struct.Struct("<4sB3xQ")  # "GCOL", version, size of all of it
_OBJECT = struct.Struct("<HH4xQ")  # number, references, size


def heap_text(path: Path, offset: int) -> bytes:
    """The text whose reference stands at byte `offset` of a file. Raises `ValueError` if there is none."""
    with path.open("rb") as file:
        file.seek(offset)
        length, address, wanted = _unpack(_REFERENCE, file.read(_REFERENCE.size))
        if not length:
            return b""
        if address >= path.stat().st_size:
            raise ValueError(f"its heap lies at byte {address}, behind the end of the file")
        file.seek(address)
        magic, version, size = _unpack(_COLLECTION, file.read(_COLLECTION.size))
        if magic != b"GCOL" or version != 1:
            raise ValueError(f"its heap begins with {magic!r}, version {version}; expected b'GCOL', version 1")
        heap = file.read(max(0, min(size, path.stat().st_size) - _COLLECTION.size))
    place = 0
    while place + _OBJECT.size <= len(heap):
        number, _, size = _OBJECT.unpack_from(heap, place)
        if not number:
            break  # free space
        place += _OBJECT.size
        if number == wanted:
            if not length <= size <= len(heap) - place:
                raise ValueError(f"it has {length} bytes in a place of {size}")
            return heap[place : place + length]
        place += (size + 7) // 8 * 8
    raise ValueError(f"its heap holds no object {wanted}")


def _unpack(form: struct.Struct, content: bytes) -> tuple[Any, ...]:
    if len(content) < form.size:
        raise ValueError("the file ends inside it")
    return form.unpack(content)
