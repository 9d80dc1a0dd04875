# SPDX-License-Identifier: Apache-2.0
"""``mech-twin simulate``: the one-process run, and the bag or table it goes to, as it is or as sensors show it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from mech_twin.cli.console import (
    FOUND,
    CommandError,
    busy_bar,
    numbered,
    print_csv,
    print_json,
    progress,
    report_losses,
    say,
    say_result,
)
from mech_twin.cli.run_summary import digits_note, say_consequences, show_events, show_numbers, show_residuals
from mech_twin.cli.verbs import SimulateVerb
from mech_twin.engine.run import frames, steps_for, warm_up_run
from mech_twin.engine.trajectory import broken_lines, frame_numbers
from mech_twin.files.output_file import written_file
from mech_twin.measurements.sensors import Reading, SensorBench, TableWriter, sensor_table
from mech_twin.measurements.units import machine_columns
from mech_twin.nodes.run.domain import settle_domain
from mech_twin.parameters.description import description_text
from mech_twin.parameters.live_change import ChangingMachine, LiveChange, live_changes
from mech_twin.parameters.load import assignments, catalogue_entry, run_group
from mech_twin.process.interruption import closed_first
from mech_twin.results.opened_runs import given_map, recorded_to, topic_field
from mech_twin.roles import Machine
from mech_twin.samples import Frame
from mech_twin.studies.shorter_steps import RunInShorterSteps, in_shorter_steps
from mech_twin.studies.simulation import Simulation

if TYPE_CHECKING:
    from mech_twin.measurements.measurement_map import MeasurementMap, Source
    from mech_twin.recording.measured_topics import TopicField
    from mech_twin.studies.energy_flow import EnergyBooks


def simulate_machine(request: SimulateVerb) -> None:
    """Simulate and write metrics, worst residuals, events, and the samples if asked; exit with 1 if one broke."""
    if request.bag is not None:
        from mech_twin.recording.bag_metadata import check_recording_directory

        check_recording_directory(request.bag, force=request.force)
    name, machine = request.machine, request.built
    say_consequences(name, request.config, request.settings)
    _check_own_roles(request)
    books = None if request.energy is None else _energy_books(request, machine)
    with busy_bar("compiling kernels, once after an installation or a change"):
        warm_up_run(machine)  # a signal while kernels are compiled ends the process: no recording may be open then
    changes = live_changes(request.change, request.duration_s)
    changing = ChangingMachine(machine, changes)
    beside = None if request.one_step else _beside(machine, request.duration_s, changes)
    simulation = Simulation(machine, changing.at)
    changed = (changing.command, changing.at) if request.change else ()
    run = frames(machine, request.duration_s, *changed)
    with ExitStack() as outputs:
        takers = [simulation.observe, *opened_outputs(outputs, request, machine, changing)]
        takers += [simulation.trajectory.append] if request.samples else []
        takers += [] if books is None else [books.observe]
        takers += [] if beside is None else [beside.follow]
        counted = outputs.enter_context(progress(run, steps_for(machine, request.duration_s) + 1, name))
        for frame in counted:
            for take in takers:
                take(frame)
    if books is not None and request.energy is not None:
        draw_energy(request, books, request.energy)
    document = simulation.document()
    confirmed = {} if beside is None else beside.numbers(simulation.numbers())
    if beside is not None:
        failed = {"failure": beside.failure} if beside.failure else {}
        document["shorter_steps"] = {"step_s": beside.step_s, "summary": confirmed, **failed}
    if request.samples:
        document["samples"] = simulation.trajectory.columns()
    if request.as_json:
        print_json(document)
    elif request.as_csv:
        rows = [(*row, confirmed.get(row[0], "")) for row in numbered(document["summary"])]
        print_csv(("quantity", "value", "unit", "in shorter steps"), rows)
    else:
        title, everything = f"{name}: {request.duration_s:g} s", request.everything
        show_numbers(title, document["summary"], machine.report(), confirmed, everything=everything)
        how = () if beside is None else (beside.step_s, beside.failure)
        say_result(digits_note(machine.coupling_step_s, *how))
        show_residuals(document["residuals"])
        show_events(simulation.events, simulation.event_counts, document["summary"], everything=request.everything)
    say(*(f"warning: {remark}" for remark in simulation.remarks()))
    broken = broken_lines(simulation.residuals(), machine.coupling_step_s)
    if broken:
        say(f"{name}: {'; '.join(broken)}")
        raise SystemExit(FOUND)
    report_losses(request.bag)


def _check_own_roles(request: SimulateVerb) -> None:
    """Refuse classes of a user's own in the place of roles, which only nodes take."""
    group = run_group(request.machine, request.config, assignments(request.settings))
    for role in ("motor", "forces", "body"):
        if group.get(role):
            raise CommandError(f"key 'run.{role}', value {group[role]!r}: `mech-twin run` takes it, simulate does not")


def _beside(machine: Machine, duration_s: float, changes: Sequence[LiveChange]) -> RunInShorterSteps | None:
    """Return the run that checks the other; None where the machine cannot be built in shorter steps."""
    try:
        shorter = in_shorter_steps(machine, duration_s)
        return None if shorter is None else RunInShorterSteps(shorter, duration_s, changes)
    except (ArithmeticError, ValueError) as error:
        say(f"warning: no run in shorter steps: {error}")
        return None


Output = Callable[[Frame], None]


def _energy_books(request: SimulateVerb, machine: Machine) -> EnergyBooks:
    from mech_twin.studies.energy_flow import EnergyBooks

    return EnergyBooks(catalogue_entry(request.machine), machine)


def draw_energy(request: SimulateVerb, books: EnergyBooks, picture: Path) -> None:
    """Draw the energy flow of the last cycle."""
    from mech_twin.capabilities.plots import DPI
    from mech_twin.studies.energy_flow import drawn_flow

    figure = drawn_flow(Path(request.machine).stem.replace("_", " "), books.flow())
    with written_file(picture, force=request.force) as file:
        figure.savefig(file, dpi=DPI)


def opened_outputs(
    stack: ExitStack, request: SimulateVerb, machine: Machine, changing: ChangingMachine
) -> list[Output]:
    """Return the outputs that take each frame of the run; the stack closes their files."""
    stack.enter_context(closed_first())
    if request.sensors is not None:
        return [_sensors(stack, request, machine, given_map(request.sensors, machine))]
    outputs: list[Output] = []
    if request.bag is not None:
        outputs.append(_bag(stack, request.bag, machine, changing))
    if request.table is not None:
        file = stack.enter_context(written_file(request.table, force=request.force))
        writer = stack.enter_context(TableWriter(file, list(machine_columns(machine))))
        outputs.append(partial(_write_row, writer))
    return outputs


def _write_row(writer: TableWriter, frame: Frame) -> None:
    (_, time_s), *rest = frame_numbers(frame)
    writer.write(time_s, rest)


def _bag(stack: ExitStack, bag: Path, machine: Machine, changing: ChangingMachine) -> Output:
    recorder = stack.enter_context(closing(recorded_to(bag, machine)))
    changes = list(enumerate(changing.revisions[1:], 2))

    def write(frame: Frame) -> None:
        while changes and changes[0][1][0] <= frame.linkage.step:
            revision, (since, changed) = changes.pop(0)
            recorder.change(changed, description_text(machine.name, changed.parameters, revision, since))
        recorder.write(frame)

    return write


def _sensors(stack: ExitStack, request: SimulateVerb, machine: Machine, sensors: MeasurementMap) -> Output:
    bench = SensorBench(sensors, machine_columns(machine), machine.coupling_step_s, request.seed, machine.gauge)
    takers: list[Callable[[Reading], None]] = []
    if request.table is not None:
        file = stack.enter_context(written_file(request.table, force=request.force))
        takers.append(stack.enter_context(sensor_table(file, sensors)).read)
    if request.bag is not None:
        takers.append(_sensor_bag(stack, request.bag, sensors))

    def take(readings: Iterator[Reading]) -> None:
        for reading in readings:
            for taker in takers:
                taker(reading)

    stack.callback(lambda: take(bench.rest()))
    return lambda frame: take(bench.observe(frame))


def _sensor_bag(stack: ExitStack, bag: Path, sensors: MeasurementMap) -> Callable[[Reading], None]:
    settle_domain()
    from mech_twin.recording.bag_metadata import remove_recording
    from mech_twin.recording.frame_recorder import SensorRecorder

    def field(source: Source) -> TopicField:
        return topic_field(source, "the sensors")

    fields = [field(channel.source) for channel in sensors.channels]
    remove_recording(bag)
    recorder = stack.enter_context(SensorRecorder(bag, fields))
    return lambda reading: recorder.write(reading.time_s, list(map(field, reading.sources)), reading.values)
