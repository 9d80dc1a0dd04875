"""``mech-twin simulate``: the one-process run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import closing, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mech_twin.cli.console import print_json, print_numbers, print_table, progress, say
from mech_twin.cli.failure import CommandError
from mech_twin.engine.invariants import broken_lines
from mech_twin.engine.run import frames, steps_for
from mech_twin.parameters.load import assignments, description_text
from mech_twin.parameters.load import machine as built_machine
from mech_twin.roles import Machine
from mech_twin.samples import Event
from mech_twin.studies.simulation import Simulation, event_record

if TYPE_CHECKING:
    from mech_twin.recording.frame_recorder import FrameRecorder

SHOWN_EVENTS = 12
BROKEN_EXIT_CODE = 1


def simulate_machine(
    name: str,
    duration_s: float,
    bag: Path | None,
    config: Path | None,
    settings: list[str],
    *,
    as_json: bool,
    with_samples: bool,
    force: bool,
) -> None:
    """Simulate and write metrics, worst residuals, events, and the samples if asked; exit with 1 if one broke."""
    if not math.isfinite(duration_s):
        raise CommandError(f"--duration {duration_s}: expected a finite number of seconds")
    if bag is not None:
        from mech_twin.recording.output_directory import check_recording_directory

        check_recording_directory(bag, force=force)
    machine = built_machine(name, config, assignments(settings))
    simulation = Simulation(machine)
    recording = nullcontext() if bag is None else closing(_recorder(machine, bag))
    with recording as recorder, progress(frames(machine, duration_s), steps_for(machine, duration_s) + 1, name) as run:
        for frame in run:
            simulation.observe(frame)
            if with_samples:
                simulation.trajectory.append(frame)
            if recorder is not None:
                recorder.write(frame)
    document = simulation.document()
    if with_samples:
        document["samples"] = simulation.trajectory.columns()
    if as_json:
        print_json(document)
    else:
        _show(f"{name}: {duration_s:g} s", document, simulation.events)
    broken = broken_lines(simulation.residuals())
    if broken:
        say(f"{name}: {'; '.join(broken)}")
        raise SystemExit(BROKEN_EXIT_CODE)


def _recorder(machine: Machine, bag: Path) -> FrameRecorder:
    from mech_twin.nodes.domain import settle_domain

    settle_domain()
    from mech_twin.recording.frame_recorder import FrameRecorder
    from mech_twin.recording.output_directory import remove_recording

    remove_recording(bag)
    return FrameRecorder(machine, bag, description_text(machine.name, machine.parameters, revision=1))


def _show(title: str, document: Mapping[str, Any], events: list[Event]) -> None:
    print_numbers(title, document["summary"])
    rows = [(name, residual["worst"], residual["limit"]) for name, residual in document["residuals"].items()]
    print_table("worst residuals", ("residual", "worst", "limit"), rows)
    if events:
        shown = [tuple(event_record(event).values()) for event in events[-SHOWN_EVENTS:]]
        print_table(f"last {len(shown)} of {len(events)} events", tuple(event_record(events[0])), shown)
