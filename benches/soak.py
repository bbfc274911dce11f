"""Live detection as fast as it goes, for long: `python benches/soak.py LOG PYZ PORT DIR SWEEPS`, started by `car`.

A log again and again, its times going on, to a board at PORT and a recorder in DIR. Prints JSON: resident memory in kB
after a tenth of the sweeps and at the last one (what is summed up behind it needs some of its own), and what the run
came to.
"""

from __future__ import annotations

import dataclasses
import json
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

from jaxradar.drivefile import read_drive
from jaxradar.live import LiveSweep, Replay
from jaxradar.live.app import load
from jaxradar.live.detect import LiveDecision, LiveDetector
from jaxradar.live.recording import Recording
from jaxradar.live.run import Listener, Moment, run
from jaxradar.live.telling import Telling
from jaxradar.live.wires import Nucleo

ROTATE_BYTES = 50_000_000
PERIOD_NS = 3_333_333  # between the last sweep and the first again


class Again(Replay):
    """A drive again and again."""

    def __iter__(self) -> Iterator[LiveSweep]:
        offset_ns = 0
        while True:
            last_ns = 0
            for live in super().__iter__():
                last_ns = live.time_ns
                yield live._replace(time_ns=live.time_ns + offset_ns)
            offset_ns += last_ns + PERIOD_NS


class Watching(Listener):
    """Reads the memory after some sweeps, and throws away the drives that are whole: a disk is not the question."""

    def __init__(self, folder: Path, sweeps: int) -> None:
        self.folder, self.sweeps, self.count = folder, sweeps, 0
        self.early_kb = self.late_kb = 0

    def hear(self, live: LiveSweep, decision: LiveDecision, moment: Moment) -> None:
        self.count += 1
        if self.count == self.sweeps // 10:
            self.early_kb = resident_kb()
        if self.count == self.sweeps:
            self.late_kb = resident_kb()
        if self.count % 100_000 == 0:
            for old in sorted(self.folder.glob("*.drive"), key=lambda path: path.stat().st_mtime)[:-2]:
                shutil.rmtree(old)


def resident_kb() -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmRSS")).split()[1])


def main() -> None:
    log, archive, port, folder, sweeps = sys.argv[1:]
    drive = read_drive(log)
    held = dataclasses.replace(drive.sensors[0], sweeps=drive.sensors[0].sweeps.copy())  # not a file's pages
    header, program = load(archive)
    source = Again(dataclasses.replace(drive, sensors=(held,)), None)
    watching = Watching(Path(folder), int(sweeps))
    listeners = [Telling(port, Nucleo()), Recording(Path(folder), rotate_bytes=ROTATE_BYTES), watching]
    with source:
        tally = run(source, LiveDetector(header, program), listeners, most=int(sweeps))
    print(json.dumps({"early_kb": watching.early_kb, "late_kb": watching.late_kb, "tally": tally.record()}))


if __name__ == "__main__":
    main()
