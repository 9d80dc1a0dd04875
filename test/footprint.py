# SPDX-License-Identifier: Apache-2.0
"""What processes hold while they run: memory, threads, open files."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import psutil

MEBIBYTE = 2.0**20


class Footprint(NamedTuple):
    """One look at one process."""

    at_s: float
    memory_mib: float
    threads: int
    files: int


class FootprintLog:
    """Looks at processes, by role."""

    def __init__(self) -> None:
        self.rows: dict[str, list[Footprint]] = {}

    def look(self, at_s: float, processes: dict[str, int]) -> None:
        """Note what each process holds now."""
        for role, pid in processes.items():
            process = psutil.Process(pid)
            memory = process.memory_info().rss / MEBIBYTE
            row = Footprint(at_s, memory, process.num_threads(), process.num_fds())
            self.rows.setdefault(role, []).append(row)

    def settled(self, role: str) -> list[Footprint]:
        """Return the looks of the last three quarters of the run."""
        rows = self.rows[role]
        return rows[len(rows) // 4 :]

    def growth_mib(self, role: str) -> float:
        """Return what the line through the settled memory gains over the settled time."""
        rows = self.settled(role)
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
        return (
            f"{first.memory_mib:6.1f} -> {last.memory_mib:6.1f} MiB (line {self.growth_mib(role):+.2f}), "
            f"threads {last.threads} (changed by {threads}), files {last.files} (changed by {files})"
        )
