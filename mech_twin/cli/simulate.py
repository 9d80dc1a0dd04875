# SPDX-License-Identifier: Apache-2.0
"""``mech-twin simulate``: the one-process run."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack

from mech_twin.cli.consequences import say_consequences
from mech_twin.cli.console import busy, print_json, progress, say, say_result
from mech_twin.cli.failure import report_losses
from mech_twin.cli.run_summary import how_told, print_numbers_csv, show_events, show_numbers, show_residuals
from mech_twin.cli.simulate_outputs import check_outputs, draw_energy, energy_books, opened_outputs
from mech_twin.cli.verbs import SimulateVerb
from mech_twin.engine.invariants import broken_lines
from mech_twin.engine.run import frames, steps_for, warm_up_run
from mech_twin.parameters.live_change import ChangingMachine, LiveChange, live_changes
from mech_twin.parameters.load import assignments
from mech_twin.parameters.load import machine as built_machine
from mech_twin.roles import Machine
from mech_twin.studies.shorter_steps import RunInShorterSteps, in_shorter_steps
from mech_twin.studies.simulation import Simulation

BROKEN_EXIT_CODE = 1


def simulate_machine(asked: SimulateVerb) -> None:
    """Simulate and write metrics, worst residuals, events, and the samples if asked; exit with 1 if one broke."""
    check_outputs(asked.bag, asked.table, asked.sensors, force=asked.force)
    name = asked.machine
    machine = built_machine(name, asked.config, assignments(asked.settings))
    say_consequences(name, asked.config, asked.settings)
    books = energy_books(asked, machine)
    with busy("compiling kernels, once after an installation or a change"):
        warm_up_run(machine)  # a signal while kernels are compiled ends the process: no recording may be open then
    changes = live_changes(asked.change)
    changing = ChangingMachine(machine, changes)
    beside = None if asked.one_step else _beside(machine, asked.duration_s, changes)
    simulation = Simulation(machine)
    if asked.change:
        run = frames(machine, asked.duration_s, changing.command, changing.at)
    else:
        run = frames(machine, asked.duration_s)
    with ExitStack() as outputs:
        opened = opened_outputs(outputs, asked, machine, changing)
        opened += [each.observe for each in books]
        opened += [] if beside is None else [beside.follow]
        counted = outputs.enter_context(progress(run, steps_for(machine, asked.duration_s) + 1, name))
        for frame in counted:
            simulation.observe(frame)
            if asked.samples:
                simulation.trajectory.append(frame)
            for output in opened:
                output(frame)
    draw_energy(asked, books)
    document = simulation.document()
    confirmed = {} if beside is None else beside.numbers(simulation.numbers())
    if beside is not None:
        failed = {"failure": beside.failure} if beside.failure else {}
        document["shorter_steps"] = {"step_s": beside.step_s, "summary": confirmed, **failed}
    if asked.samples:
        document["samples"] = simulation.trajectory.columns()
    if asked.as_json:
        print_json(document)
    elif asked.as_csv:
        print_numbers_csv(document["summary"], confirmed)
    else:
        title, everything = f"{name}: {asked.duration_s:g} s", asked.everything
        show_numbers(title, document["summary"], machine.report(), confirmed, everything=everything)
        how = () if beside is None else (beside.step_s, beside.failure)
        say_result(how_told(machine.coupling_step_s, *how))
        show_residuals(document["residuals"])
        show_events(simulation.events, everything=asked.everything)
    for remark in simulation.remarks():
        say(f"warning: {remark}")
    broken = broken_lines(simulation.residuals(), machine.coupling_step_s)
    if broken:
        say(f"{name}: {'; '.join(broken)}")
        raise SystemExit(BROKEN_EXIT_CODE)
    report_losses(asked.bag)


def _beside(machine: Machine, duration_s: float, changes: Sequence[LiveChange]) -> RunInShorterSteps | None:
    """Return the run that checks the other; None where the machine cannot be built in shorter steps."""
    try:
        shorter = in_shorter_steps(machine, duration_s)
        return None if shorter is None else RunInShorterSteps(shorter, duration_s, changes)
    except (ArithmeticError, ValueError) as error:
        say(f"warning: no run in shorter steps: {error}")
        return None
