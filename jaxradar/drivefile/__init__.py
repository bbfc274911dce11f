"""The binary form of a drive: a folder `NAME.drive` of raw little-endian columns. NumPy alone reads and writes it.

    header.json     what is said once: see below
    3.sweeps        sensor 3: its sweeps one after the other, `bins` numbers of `dtype` each, from byte 0
    3.index         sensor 3: one record of 16 bytes for each sweep
                        time_ns int64 | flags uint16 (`SweepFlag`) | reserved uint16 = 0 | crc32 uint32
    speed_m_s.motion  a channel of `Motion`, under its name there: one record of 24 bytes for each sample
                        time_ns int64 | value float64 | reserved uint32 = 0 | crc32 uint32

All numbers are little-endian. `crc32` (zlib's) runs over the record's bytes before it and then over the bytes of its
sweep. It commits the sweep, which is written first: whatever a crash leaves at the end, half a sweep, half a record,
zeros or garbage, does not carry a right checksum and is cut off. A file of sweeps starts at byte 0, so that a memory
map of it is page aligned and a device takes it without a copy.

`header.json` is one JSON object, a line for each key, written under another name and then renamed, so it is whole or
absent:

    format          "jaxradar.drive"
    version         1
    sensors         a list of {sensor, bins, dtype: "uint16" | "float32" | "float64", range_m: [metres], spec: {}}
    motion          the names of the channels that have a file
    mounting        null or {height_m, angle_deg, front_wheel_m}
    truth           null or [{impact_s, height_m}]
    started_at_ns   null or the Unix time of the first sweep
    clock_start_ns  what the recorder's clock showed at the first sweep; times in the files then count from that
                    sweep. null: times in the files are the recorder's clock, and the reader lets them count from
                    the first sweep
    problems        a list of sentences
    sealed          null while the drive is being written; once it is closed {file name: {bytes, crc32}} of every column
    checksum        crc32 over the bytes of all lines above its own, which is the last but the closing brace

Numbers stand as Python's `repr` gives them, which is exact for float64.
"""

from jaxradar.drivefile.layout import HEADER, SensorLayout
from jaxradar.drivefile.reader import read_drive
from jaxradar.drivefile.staged import staged
from jaxradar.drivefile.writer import DriveWriter, is_drive_folder, write_drive

__all__ = ["HEADER", "DriveWriter", "SensorLayout", "is_drive_folder", "read_drive", "staged", "write_drive"]
