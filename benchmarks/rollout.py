# SPDX-License-Identifier: Apache-2.0
"""How fast is a roll-out?  ``python benchmarks/rollout.py [--write]`` measures each machine on one core.

Simulated seconds per second of processor time, of a roll-out and of the roles called one by one in Python, in turn, and
the first call in a fresh process with compiled kernels on disk.
"""

from __future__ import annotations

import subprocess
import sys

from comparison import Table, in_turn, measure, ratio

from mech_twin.engine.coupling import complete_frame, next_frame
from mech_twin.engine.rollout import roll_out
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import machine
from mech_twin.roles import Machine

SIMULATED_S, ENGINE_S, ROUNDS = 2.0, 0.2, 7
FIRST_CALL = """
import time
from mech_twin.engine.rollout import roll_out
from mech_twin.parameters.load import machine
built = machine({name!r})
begun = time.process_time()
roll_out(built, 1.0, columns=["time_s"])
print(time.process_time() - begun)
"""
COLUMNS = (
    "machine",
    "coupling step",
    "roll-out, times real time",
    "us a step",
    "roles one by one, times real time",
    "ratio (spread)",
    "first call, s",
    "aim",
)
AIMS = {
    "mb10_breaker": 500,
    "compaction_press": 2000,
    "vibration_crank": 2000,
    "roller_former": 1500,
    "winding_drum": 2000,
}


def stepped(built: Machine) -> None:
    """Run a machine by its roles, one call after the other."""
    frame = complete_frame(built, built.linkage.start(), None, 1.0)
    for _ in range(round(ENGINE_S / built.coupling_step_s)):
        frame = next_frame(built, frame, 1.0)


def row(name: str) -> tuple[object, ...]:
    """Return the measurements of a machine."""
    built = machine(name)
    ran = subprocess.run(
        [sys.executable, "-c", FIRST_CALL.format(name=name)], capture_output=True, text=True, check=True
    )
    tasks = {"rolled": lambda: roll_out(built, SIMULATED_S, columns=["time_s"]), "stepped": lambda: stepped(built)}
    times = in_turn(tasks, ROUNDS)
    part = ENGINE_S / SIMULATED_S
    alike = {"rolled": [part * spent for spent in times["rolled"]], "stepped": times["stepped"]}
    rolled, one_by_one = (SIMULATED_S / min(times["rolled"]), ENGINE_S / min(times["stepped"]))
    return (
        name,
        f"{built.coupling_step_s * 1e3:g} ms",
        f"{rolled:.0f}",
        f"{built.coupling_step_s / rolled * 1e6:.2f}",
        f"{one_by_one:.1f}",
        ratio(alike, "stepped", "rolled"),
        f"{float(ran.stdout):.2f}",
        AIMS.get(name, "-"),
    )


def measured() -> list[Table]:
    """Return the table."""
    how = (
        f"One core, processor time, {SIMULATED_S:g} s ({ENGINE_S:g} s one by one) of each default configuration from "
        f"its start, best of {ROUNDS} rounds in turn."
    )
    return [Table(how, COLUMNS, [row(name) for name in CATALOGUE])]


if __name__ == "__main__":
    measure("rollout", measured)
