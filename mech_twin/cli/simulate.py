# SPDX-License-Identifier: Apache-2.0
"""``mech-twin simulate``: the one-process run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from mech_twin.cli.console import busy, print_json, progress, say
from mech_twin.cli.failure import CommandError
from mech_twin.cli.run_summary import print_numbers_csv, show_events, show_numbers, show_residuals
from mech_twin.cli.simulate_outputs import check_outputs, opened_outputs
from mech_twin.engine.invariants import broken_lines
from mech_twin.engine.run import frames, steps_for, warm_up_run
from mech_twin.parameters.live_change import ChangingMachine, live_changes
from mech_twin.parameters.load import assignments
from mech_twin.parameters.load import machine as built_machine
from mech_twin.studies.simulation import Simulation

BROKEN_EXIT_CODE = 1


class SimulateRequest(NamedTuple):
    """What `mech-twin simulate` was asked for."""

    machine: str
    duration_s: float
    bag: Path | None = None
    config: Path | None = None
    settings: Sequence[str] = ()
    as_json: bool = False
    with_samples: bool = False
    force: bool = False
    table: Path | None = None
    sensors: Path | None = None
    changes: Sequence[str] = ()
    seed: int = 0
    everything: bool = False
    as_csv: bool = False


def simulate_machine(asked: SimulateRequest) -> None:
    """Simulate and write metrics, worst residuals, events, and the samples if asked; exit with 1 if one broke."""
    if not math.isfinite(asked.duration_s):
        raise CommandError(f"--duration {asked.duration_s}: expected a finite number of seconds")
    check_outputs(asked.bag, asked.table, asked.sensors, force=asked.force)
    name = asked.machine
    machine = built_machine(name, asked.config, assignments(asked.settings))
    with busy("compiling kernels, once after an installation or a change"):
        warm_up_run(machine)  # a signal while kernels are compiled ends the process: no recording may be open then
    changing = ChangingMachine(machine, live_changes(asked.changes))
    simulation = Simulation(machine)
    run = frames(machine, asked.duration_s, machine_at=changing.at if asked.changes else None)
    with ExitStack() as outputs:
        opened = opened_outputs(outputs, asked, machine, changing)
        counted = outputs.enter_context(progress(run, steps_for(machine, asked.duration_s) + 1, name))
        for frame in counted:
            simulation.observe(frame)
            if asked.with_samples:
                simulation.trajectory.append(frame)
            for output in opened:
                output(frame)
    document = simulation.document()
    if asked.with_samples:
        document["samples"] = simulation.trajectory.columns()
    if asked.as_json:
        print_json(document)
    elif asked.as_csv:
        print_numbers_csv(document["summary"])
    else:
        show_numbers(
            f"{name}: {asked.duration_s:g} s", document["summary"], machine.report(), everything=asked.everything
        )
        show_residuals(document["residuals"])
        show_events(simulation.events, everything=asked.everything)
    broken = broken_lines(simulation.residuals(), machine.coupling_step_s)
    if broken:
        say(f"{name}: {'; '.join(broken)}")
        raise SystemExit(BROKEN_EXIT_CODE)
