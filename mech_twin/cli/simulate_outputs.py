# SPDX-License-Identifier: Apache-2.0
"""Where a simulated run goes besides the screen: a bag or a table, as it is or as sensors would show it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING

from mech_twin.cli.failure import CommandError
from mech_twin.engine.trajectory import frame_numbers
from mech_twin.files.output_file import check_output_file, written_file
from mech_twin.measurements.machine_columns import machine_columns
from mech_twin.measurements.sensors import Reading, SensorBench
from mech_twin.measurements.table_writer import WRITTEN_SUFFIXES, TableWriter, sensor_table
from mech_twin.parameters.live_change import ChangingMachine
from mech_twin.parameters.load import catalogue_entry, description_text
from mech_twin.process.dependencies import require_extra
from mech_twin.process.stop_signal import closed_first
from mech_twin.results.opened_runs import given_map, topic_field
from mech_twin.roles import Machine
from mech_twin.samples import Frame

if TYPE_CHECKING:
    from mech_twin.cli.verbs import SimulateVerb
    from mech_twin.measurements.measurement_map import MeasurementMap
    from mech_twin.studies.energy_flow import EnergyBooks

Output = Callable[[Frame], None]


def check_outputs(bag: Path | None, table: Path | None, sensors: Path | None, *, force: bool) -> None:
    """Raise before the run begins where its outputs could not be written."""
    if sensors is not None and bag is None and table is None:
        raise CommandError(f"--sensors {sensors}: expected --bag or --table beside it, for what the sensors show")
    if bag is not None:
        from mech_twin.recording.output_directory import check_recording_directory

        check_recording_directory(bag, force=force)
    if table is not None:
        if table.suffix not in WRITTEN_SUFFIXES:
            raise CommandError(f"--table {table}: expected a file that ends in {', '.join(WRITTEN_SUFFIXES)}")
        check_output_file(table, force=force)


def energy_books(asked: SimulateVerb, machine: Machine) -> list[EnergyBooks]:
    """Return what takes the books of the run, where their picture is asked for; refuse one that cannot be written."""
    if asked.energy is None:
        return []
    require_extra("plots")
    check_output_file(asked.energy, force=asked.force, suffixes=(".png", ".svg"))
    from mech_twin.studies.energy_flow import EnergyBooks

    return [EnergyBooks(catalogue_entry(asked.machine), machine)]


def draw_energy(asked: SimulateVerb, books: Sequence[EnergyBooks]) -> None:
    """Draw the energy flow of the last cycle, where that is asked for."""
    for each in books:
        from mech_twin.capabilities.plots import DPI
        from mech_twin.studies.energy_flow import drawn_flow

        assert asked.energy is not None
        figure = drawn_flow(Path(asked.machine).stem.replace("_", " "), each.flow())
        with written_file(asked.energy, force=asked.force) as file:
            figure.savefig(file, dpi=DPI)


def opened_outputs(stack: ExitStack, asked: SimulateVerb, machine: Machine, changing: ChangingMachine) -> list[Output]:
    """Return what takes each frame of the run; the stack closes it."""
    stack.enter_context(closed_first())
    if asked.sensors is not None:
        return [_sensors(stack, asked, machine, given_map(asked.sensors, machine))]
    outputs: list[Output] = []
    if asked.bag is not None:
        outputs.append(_bag(stack, asked.bag, machine, changing))
    if asked.table is not None:
        outputs.append(_table(stack, asked.table, machine, asked.force))
    return outputs


def _bag(stack: ExitStack, bag: Path, machine: Machine, changing: ChangingMachine) -> Output:
    from mech_twin.nodes.run.domain import settle_domain

    settle_domain()
    from mech_twin.recording.frame_recorder import FrameRecorder
    from mech_twin.recording.output_directory import remove_recording

    remove_recording(bag)
    recorder = FrameRecorder(machine, bag, description_text(machine.name, machine.parameters, revision=1))
    stack.enter_context(closing(recorder))
    changes = list(enumerate(changing.revisions[1:], 2))

    def write(frame: Frame) -> None:
        while changes and changes[0][1][0] <= frame.linkage.step:
            revision, (since, changed) = changes.pop(0)
            recorder.change(changed, description_text(machine.name, changed.parameters, revision, since))
        recorder.write(frame)

    return write


def _table(stack: ExitStack, table: Path, machine: Machine, force: bool) -> Output:
    columns = list(machine_columns(machine))
    writer = stack.enter_context(TableWriter(stack.enter_context(written_file(table, force=force)), columns))

    def write(frame: Frame) -> None:
        (_, time_s), *rest = frame_numbers(frame)
        writer.write(time_s, rest)

    return write


def _sensors(stack: ExitStack, asked: SimulateVerb, machine: Machine, sensors: MeasurementMap) -> Output:
    if sensors.machine != machine.name:
        raise CommandError(f"{asked.sensors}: key 'machine', value {sensors.machine!r}: expected {machine.name!r}")
    bench = SensorBench(sensors, machine_columns(machine), machine.coupling_step_s, asked.seed, machine.gauge)
    takers: list[Callable[[Reading], None]] = []
    if asked.table is not None:
        file = stack.enter_context(written_file(asked.table, force=asked.force))
        takers.append(stack.enter_context(sensor_table(file, sensors)).read)
    if asked.bag is not None:
        takers.append(_sensor_bag(stack, asked.bag, sensors))

    def take(readings: Iterator[Reading]) -> None:
        for reading in readings:
            for taker in takers:
                taker(reading)

    stack.callback(lambda: take(bench.rest()))
    return lambda frame: take(bench.observe(frame))


def _sensor_bag(stack: ExitStack, bag: Path, sensors: MeasurementMap) -> Callable[[Reading], None]:
    from mech_twin.nodes.run.domain import settle_domain

    settle_domain()
    from mech_twin.recording.output_directory import remove_recording
    from mech_twin.recording.sensor_recorder import SensorRecorder

    fields = [topic_field(channel.source, "the sensors") for channel in sensors.channels]
    remove_recording(bag)
    recorder = stack.enter_context(SensorRecorder(bag, fields))

    def take(reading: Reading) -> None:
        recorder.write(
            reading.time_s, [topic_field(source, "the sensors") for source in reading.sources], reading.values
        )

    return take
