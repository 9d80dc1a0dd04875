"""``mech-twin simulate``: the one-process run."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from mech_twin.cli.console import print_json, print_numbers, print_table, progress
from mech_twin.cli.event_record import event_record
from mech_twin.cli.failure import CommandError
from mech_twin.engine.run import frames, steps_for
from mech_twin.engine.trajectory import Trajectory, frame_events
from mech_twin.parameters.load import assignments, configuration_tree, description_text
from mech_twin.parameters.load import machine as built_machine
from mech_twin.samples import Event

SHOWN_EVENTS = 12


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
    """Simulate and write the figures, the events, and the samples if asked; record them if asked."""
    if not math.isfinite(duration_s):
        raise CommandError(f"--duration {duration_s}: expected a finite number of seconds")
    if bag is not None:
        from mech_twin.recording.output_directory import check_recording_directory, remove_recording

        check_recording_directory(bag, force=force)
    machine = built_machine(name, config, assignments(settings))
    observer, trajectory, events = machine.observer(), Trajectory(), list[Event]()
    recorder = None
    if bag is not None:
        from mech_twin.nodes.domain import settle_domain

        settle_domain()
        from mech_twin.recording.frame_recorder import FrameRecorder

        remove_recording(bag)
        recorder = FrameRecorder(machine, bag, description_text(name, machine.parameters, revision=1))
    try:
        with progress(frames(machine, duration_s), steps_for(machine, duration_s) + 1, "simulating") as counted:
            for frame in counted:
                observer.observe(frame)
                events.extend(frame_events(frame))
                if with_samples:
                    trajectory.append(frame)
                if recorder is not None:
                    recorder.write(frame)
    finally:
        if recorder is not None:
            recorder.close()
    document: dict[str, Any] = {
        "machine": name,
        "config": configuration_tree(machine.parameters),
        "summary": {**machine.report(), **observer.numbers()},
        "events": [event_record(event) for event in events],
    }
    if with_samples:
        document["samples"] = trajectory.columns()
    if as_json:
        print_json(document)
        return
    print_numbers(f"{name}: {duration_s:g} s", document["summary"])
    if events:
        rows = [tuple(event_record(event).values()) for event in events[-SHOWN_EVENTS:]]
        print_table(f"last {len(rows)} of {len(events)} events", tuple(event_record(events[0])), rows)
