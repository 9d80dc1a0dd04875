# SPDX-License-Identifier: Apache-2.0
"""What processes hold while they run: memory of their own, threads, open files."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import psutil

MEBIBYTE = 2.0**20
FEWEST_LOOKS = 3  # through which a line is drawn
SETTLES_IN_S = 600.0  # at most; a shorter run settles in its first quarter


class Footprint(NamedTuple):
    """One look at one process."""

    at_s: float
    memory_mib: float
    threads: int
    files: int
    processor_s: float


class FootprintLog:
    """Looks at processes, by role."""

    def __init__(self) -> None:
        self.rows: dict[str, list[Footprint]] = {}

    def look(self, at_s: float, processes: dict[str, int]) -> None:
        """Note what each process holds now."""
        for role, pid in processes.items():
            process = psutil.Process(pid)
            held = process.memory_info()
            memory = (held.rss - held.shared) / MEBIBYTE  # pages of files come and go as the kernel likes
            spent = process.cpu_times()
            row = Footprint(at_s, memory, process.num_threads(), process.num_fds(), spent.user + spent.system)
            self.rows.setdefault(role, []).append(row)

    def settled(self, role: str) -> list[Footprint]:
        """Return the looks since everything has settled, the last one at least."""
        from_s = self.settled_from_s()
        return [row for row in self.rows[role] if row.at_s >= from_s] or self.rows[role][-1:]

    def settled_from_s(self) -> float:
        """Return the time from which on a run counts as settled: a quarter of it, ten minutes at most."""
        first = min((rows[0].at_s for rows in self.rows.values()), default=0.0)
        return first + min(0.25 * self.duration_s(), SETTLES_IN_S)

    def duration_s(self) -> float:
        """Return the time from the first look to the last."""
        times = [row.at_s for rows in self.rows.values() for row in rows]
        return max(times, default=0.0) - min(times, default=0.0)

    def growth_mib(self, role: str) -> float:
        """Return what the line through the settled memory gains over the settled time."""
        rows = self.settled(role)
        if len(rows) < FEWEST_LOOKS:
            return 0.0
        times = np.array([row.at_s for row in rows])
        slope = np.polyfit(times - times[0], [row.memory_mib for row in rows], 1)[0]
        return float(slope * (times[-1] - times[0]))

    def changes(self, role: str) -> tuple[int, int]:
        """Return by how much threads and open files differ between the least and the most of the settled time."""
        rows = self.settled(role)
        threads, files = [row.threads for row in rows], [row.files for row in rows]
        return max(threads) - min(threads), max(files) - min(files)

    def told(self, role: str) -> str:
        """Return one line about a process."""
        first, last = self.settled(role)[0], self.settled(role)[-1]
        threads, files = self.changes(role)
        share = (last.processor_s - first.processor_s) / max(last.at_s - first.at_s, 1e-9)
        return (
            f"{first.memory_mib:6.1f} -> {last.memory_mib:6.1f} MiB (line {self.growth_mib(role):+.2f}), "
            f"threads {last.threads} (changed by {threads}), files {last.files} (changed by {files}), "
            f"{share:.0%} of a core"
        )
