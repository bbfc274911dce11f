"""A store: thousands of drives in the package's own form, with a catalogue of what is in them and where it came from.

    store.json          {"format": "jaxradar.store", "version": 1}
    catalogue.sqlite    a row for each source: path, size, hash, what was found in it or why it cannot be read
    drives/NAME.drive   the drives (`jaxradar.drivefile`), under the names of their sources

An archive is one ZIP file of the same names. Its drives are compressed: each file `F` of one stands as `F.zst`, whose
bytes are taken apart (the first of each item of its dtype, then the second, ...) and then compressed by Zstandard, and
can be read alone; `header.json` and the catalogue stand as they are, deflated.

`jaxradar import` (`jaxradar.ingest`) makes both.
"""

from jaxradar.store.archive import archived_members, is_archive, pack, read_archived
from jaxradar.store.catalogue import Catalogue, Entry, SensorEntry, entry_of
from jaxradar.store.folder import Store, is_store, make_store, open_store
from jaxradar.store.marker import CATALOGUE, DRIVES, MARKER, alone

__all__ = [
    "CATALOGUE",
    "DRIVES",
    "MARKER",
    "Catalogue",
    "Entry",
    "SensorEntry",
    "Store",
    "alone",
    "archived_members",
    "entry_of",
    "is_archive",
    "is_store",
    "make_store",
    "open_store",
    "pack",
    "read_archived",
]
