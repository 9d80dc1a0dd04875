# SPDX-License-Identifier: Apache-2.0
"""A measured run: its forces computed (`replay --analyse --map`), the mechanism drawn (`view --map`)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from mech_twin.cli.console import print_json, print_numbers, print_table, progress, say
from mech_twin.cli.failure import FOUND, CommandError
from mech_twin.cli.map import checked_run
from mech_twin.cli.verbs import ReplayVerb
from mech_twin.measurements.crank_motion import CrankMotion, crank_motion
from mech_twin.measurements.model_turn import ModelTurn, model_turn
from mech_twin.measurements.runs import MeasuredRun
from mech_twin.parameters.load import machine as built_machine
from mech_twin.results.opened_runs import configured_map, opened_run
from mech_twin.roles import Machine
from mech_twin.samples import Drawing, ForceSample, LinkageSample
from mech_twin.studies.measured_forces import guided_samples, measured_forces

if TYPE_CHECKING:
    from mech_twin.process.stop_signal import StopSignal
    from mech_twin.view.bench.scene import BenchScene
    from mech_twin.view.rerun_scene import RerunScene


class Read(NamedTuple):
    """A measured run, the machine it is of, and the motion of its crank."""

    run: MeasuredRun
    machine: Machine
    turn: ModelTurn
    motion: CrankMotion


def read_measured(measurement: Path, map_file: Path, config: Path | None) -> Read:
    """Return a measured run by its map; what contradicts the machine is said on standard error.

    Raises
    ------
    CommandError
        The machine has no crank that could be followed.
    """
    given = configured_map(map_file, config)
    machine = built_machine(given.machine, config)
    turn = model_turn(machine)
    if turn is None:
        raise CommandError(f"{map_file}: {given.machine} has no crank; expected a machine whose state follows from one")
    with opened_run(measurement) as reader:
        run, problems = checked_run(reader, given, turn, machine)
    for problem in problems:
        say(f"{measurement}: {problem}")
    return Read(run, machine, turn, crank_motion(run, turn))


def analyse_measured(asked: ReplayVerb, map_file: Path) -> None:
    """Print the largest forces of a measured motion, and every other channel beside the model in the same motion.

    With a tolerance, exit code 1 where a channel is off by more than that share of its own size.
    """
    measurement, tolerance = asked.bag, asked.tolerance
    read = read_measured(measurement, map_file, asked.config)
    samples = guided_samples(read.machine, read.motion, read.run)
    with progress(samples, len(read.motion.times_s), "analysing") as counted:
        found = measured_forces(iter(counted), read.run, read.turn.crank)
    document = {
        "measurement": measurement,
        "machine": read.machine.name,
        "samples": found.samples,
        "crank_zero_rad": read.motion.zero_rad,
        "largest": found.largest,
        "compared": [{**asdict(each), "share": each.share} for each in found.compared],
    }
    if asked.as_json:
        print_json(document)
    else:
        print_numbers(f"{measurement}: largest forces in {found.samples} samples", found.largest)
        rows = [(each.name, each.samples, each.rms, each.share, each.correlation) for each in found.compared]
        print_table(
            "measured, beside the model in the same motion",
            ("channel", "samples", "rms off", "share", "correlation"),
            rows,
        )
    outside = [each for each in found.compared if tolerance is not None and not each.share <= tolerance]
    for each in outside:
        say(f"{measurement}: {each.name} is off by {each.share:.3g} of its size, expected at most {tolerance:g}")
    if outside:
        raise SystemExit(FOUND)


def shown_samples(read: Read) -> Iterator[tuple[LinkageSample, ForceSample, Drawing]]:
    """Yield each sample with the drawing of the mechanism."""
    for linkage, forces in guided_samples(read.machine, read.motion, read.run):
        yield linkage, forces, Drawing(linkage.step, linkage.time_s, read.machine.draw(linkage, None))


def show_measured(scene: BenchScene | RerunScene, read: Read, stop: StopSignal) -> None:
    """Draw the mechanism in the measured motion, with its forces."""
    if read.machine.mechanism is not None:
        scene.know(read.machine.mechanism, read.machine.blow_energy)
    with progress(shown_samples(read), len(read.motion.times_s), "showing") as shown:
        for linkage, forces, drawing in shown:
            if stop.asked:
                return
            scene.frame(linkage=linkage, forces=forces)
            if scene.drawing_due(linkage.time_s):
                scene.drawing(drawing)
