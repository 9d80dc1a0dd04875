# SPDX-License-Identifier: Apache-2.0
"""What a monitor judges by: a run's features of each cycle, its setup of healthy runs, and the file that keeps it."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from pydantic import ValidationError

from mech_twin.capabilities.blow_gauge import GAUGE_UNITS
from mech_twin.capabilities.cycle import TURN
from mech_twin.cli.console import CommandError, say, write_text
from mech_twin.cli.measurement_verbs import FleetVerb, MonitorVerb
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.rollout import roll_out
from mech_twin.files.input_file import opened_input
from mech_twin.files.output_file import plain
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.measurements.blocks import RunReader
from mech_twin.measurements.measurement_map import Channel, MeasurementMap, Source
from mech_twin.measurements.proposal import EXACT, map_of, proposed_channels
from mech_twin.measurements.runs import MeasuredRun, read_parts
from mech_twin.measurements.units import is_event, machine_columns
from mech_twin.parameters.errors import refusal
from mech_twin.parameters.load import catalogue_entry, kind_of
from mech_twin.results.opened_runs import given_map, opened_run
from mech_twin.roles import Machine
from mech_twin.studies.monitoring.baseline import (
    OLD_DAYS,
    BaselineRun,
    configuration_hash,
    joined_runs,
    new_origin,
    sensors_hash,
)
from mech_twin.studies.monitoring.cycle_features import FeatureFeed, FeatureVector
from mech_twin.studies.monitoring.monitor import MonitorSetup
from mech_twin.studies.monitoring.report import known_sensors, seen_of_run, vectors_of_parts
from mech_twin.studies.monitoring.sensing import MonitoredMachine
from mech_twin.studies.monitoring.sensor_design import fitted_setup, sister_setup
from mech_twin.studies.monitoring.setup_record import LARGEST_BYTES, SETUP

SETUP_SUFFIX = ".json"


def baseline_file(baseline: Sequence[Path]) -> Path | None:
    """Return the file that `--save-baseline` wrote; None where runs were given, or nothing."""
    files = [path for path in baseline if path.suffix == SETUP_SUFFIX]
    if files and len(baseline) > 1:
        raise CommandError(f"--baseline {files[0]}: expected it alone, or runs; --renew takes runs into it")
    return files[0] if files else None


def read_setup(path: Path, machine: str, parameters: Parameters, given: MeasurementMap) -> MonitorSetup:
    """Return the reference of a monitor, as `--save-baseline` writes it, made for these numbers and sensors."""
    try:
        with opened_input(path) as stream:
            data = stream.read(LARGEST_BYTES + 1)
    except OSError as error:
        raise CommandError(f"{path}: cannot be read: {error.strerror}") from error
    if len(data) > LARGEST_BYTES:
        raise CommandError(f"{path}: larger than {LARGEST_BYTES} bytes; expected a baseline of --save-baseline")
    try:
        setup = SETUP.validate_json(data)
    except ValidationError as error:
        raise refusal(f"{path}: expected a baseline as --save-baseline writes it", error) from error
    if setup.machine != kind_of(machine):
        raise CommandError(f"{path}: key 'machine', value {setup.machine!r}: expected {kind_of(machine)!r}")
    _check_origin(path, setup, parameters, given)
    return setup


def write_setup(path: Path, setup: MonitorSetup, *, force: bool) -> None:
    """Write the reference of a monitor, as `read_setup` reads it."""
    write_text(path, json.dumps(plain(setup)) + "\n", force=force)


def _check_origin(path: Path, setup: MonitorSetup, parameters: Parameters, given: MeasurementMap) -> None:
    """Raise where a baseline was made for other numbers or sensors; say how old it is."""
    origin = setup.origin
    if origin is None:
        say(f"{path}: does not tell its runs, configuration and age; expected a newer file of --save-baseline")
        return
    made_for = {"configuration": origin.configuration, "map": origin.sensors}
    here = {"configuration": configuration_hash(parameters), "map": sensors_hash(given)}
    for what, made in made_for.items():
        if made != here[what]:
            expected = f"expected that of this run ({here[what][:12]}), or a baseline made anew"
            raise CommandError(f"{path}: made with another {what} ({made[:12]}); {expected}")
    days = origin.age_days(datetime.now(UTC))
    old = f", older than {OLD_DAYS:g}: --renew takes healthy runs into it" if days > OLD_DAYS else ""
    say(f"{path}: of {len(origin.runs)} runs, {days:.0f} days old{old}")


def earlier_runs(path: Path, setup: MonitorSetup, new: Sequence[Path]) -> tuple[BaselineRun, ...]:
    """Return the runs that a baseline was made of, which are read again."""
    if setup.origin is None:
        raise CommandError(f"--renew: {path} does not tell its runs; expected a newer file of --save-baseline")
    known = [run.path for run in setup.origin.runs]
    for run in known:
        if not run.exists():
            gone = f"{path} was made of {run}, which is gone"
            raise CommandError(f"--renew: {gone}; expected it, or a baseline made anew")
    for run in new:
        if run.absolute() in known:
            raise CommandError(f"--renew: {run} is in {path} already; expected another day")
    return setup.origin.runs


ARL0_H = 24.0
EVENTS_OF_S = 2.0  # of the model's own run, that tell which contacts its events have
IMPACTS, BLOW_GAUGE = "impacts", "blow/gauge"  # topics of the twin, below its namespace
EVENT_FIELDS = {"time": "stamp", "pre_velocity": "vector.x", "post_velocity": "vector.y", "impulse": "vector.z"}


class RunFeatures(NamedTuple):
    """The features of a run, and what it was measured with."""

    path: Path
    vectors: list[FeatureVector]
    skipped: int
    monitored: MonitoredMachine
    units: Mapping[str, str]
    given: MeasurementMap
    until_s: float


def setup_of_runs(
    runs: Sequence[RunFeatures], parameters: Parameters, arl0_h: float, seed: int, sister: MonitorSetup | None = None
) -> MonitorSetup:
    """Return the setup of the healthy cycles of several runs; those of the first are the sensors.

    A machine of a fleet has a ``sister`` whose thresholds and signatures serve it too.
    """
    for run in runs:
        if sensors_hash(run.given) != sensors_hash(runs[0].given):
            raise CommandError(f"{run.path}: has other channels than {runs[0].path}; expected the same in each day")
    vectors, monitored = joined_runs([run.vectors for run in runs]), runs[0].monitored
    found = fitted_setup(monitored, vectors, arl0_h, seed) if sister is None else sister_setup(sister, vectors)
    for run in runs:
        far = () if found.operating is None else found.operating.out_of_reach(run.vectors)
        for name, _, allowed in far:
            expected = f"expected runs within +-{100.0 * allowed:.3g} % of their mean"
            raise CommandError(f"{run.path}: {name} is far from that of the other healthy runs; {expected}")
    baseline_runs = [BaselineRun(str(run.path.absolute()), len(run.vectors)) for run in runs]
    return replace(found, origin=new_origin(datetime.now(UTC), parameters, runs[0].given, baseline_runs))


def featured_run(request: MonitorVerb | FleetVerb, path: Path) -> RunFeatures:
    """Return the features of a run, its map proposed from the twin's own names where none is given."""
    with opened_run(path) as reader:
        built = catalogue_entry(request.machine).build(request.parameters)
        given = _own_map(built, reader) if request.map_file is None else given_map(request.map_file, built)
        parts = read_parts(reader, given)
    monitored = MonitoredMachine(request.machine, request.parameters, known_sensors(given, parts[0]))
    feed = monitored.feed()
    feed.run_up_s = monitored.declared.run_up_s if request.skip_s is None else request.skip_s
    feed, vectors = vectors_of_parts(feed, parts)
    if not vectors:
        raise CommandError(f"{path}: {_no_cycle(feed, parts)}")
    units = {feature.name: feature.unit for feature in feed.features}
    until_s = max(float(channel.times_s[-1]) for channel in parts[-1].channels if len(channel.times_s))
    return RunFeatures(path, vectors, feed.skipped, monitored, units, given, until_s)


def _no_cycle(feed: FeatureFeed, parts: Sequence[MeasuredRun]) -> str:
    """Return the reason why no cycle is complete: the range of the reference after the run-up."""
    column, kind, begin, _ = feed.declared.reference
    values = max((seen_of_run(part, feed.run_up_s)[column][1] for part in parts), key=len)
    head = f"no complete cycle of {column} after {feed.run_up_s:g} s"
    if feed.skipped:
        return f"{head}: {feed.skipped} have a gap or are a standstill; expected whole ones"
    if not len(values):
        return f"{head}: the run is shorter; expected a shorter --skip"
    first, last, low, high = (float(each) for each in (values[0], values[-1], values.min(), values.max()))
    if kind == "rise":
        return f"{head}: it is {low:.4g} to {high:.4g}; expected two rises through {begin:g} (--skip)"
    hint = "sign: -1 in the map?" if last - first < -TURN else "--skip"
    return f"{head}: it goes from {first:.4g} to {last:.4g} rad; expected it to rise by more than a turn ({hint})"


def _own_map(built: Machine, reader: RunReader) -> MeasurementMap:
    """Return the map of a run under the twin's own names: the columns that the machine's features are made of."""
    machine, needed, offered = built.name, set[str](), reader.offered()
    words = {word for each in offered for word in (each.source.topic or "").split("/")}
    if machine not in words and (others := sorted(words & set(CATALOGUE))):
        raise CommandError(f"{reader.path}: a run of {' and '.join(others)}; expected one of {machine}, or --map FILE")
    if (ask := catalogue_entry(machine).capabilities.features) is not None:
        declared = ask(built.parameters)
        needed = {declared.reference.column, *(name for feature in declared.features for name in feature.needs)}
    columns = machine_columns(built)
    known = [each for each in proposed_channels(offered, columns) if each.surety == EXACT]
    proposed = map_of(machine, reader.proposed_time(), [each for each in known if each.column in needed])
    if proposed is None:
        raise CommandError(f"{reader.path}: none of its channels has a name of {machine}; expected --map FILE")
    return proposed.model_copy(update={"channels": (*proposed.channels, *_own_events(built, reader, needed))})


def _own_events(built: Machine, reader: RunReader, needed: set[str]) -> list[Channel]:
    """Return the channels of the twin's own impacts that features need; contacts are those of the model's own run."""
    topics = [each.source.topic or "" for each in reader.offered()]
    topic = next((each for each in topics if each.endswith(IMPACTS)), None)
    kinds = {column: column.split(".")[1:] for column in sorted(needed) if is_event(column)}
    if topic is None or not kinds:
        return []
    contacts = {event.kind: event.contact for event in roll_out(built, EVENTS_OF_S, ()).events}
    return [
        Channel.model_validate({"source": _event_source(topic, contacts[kind], kind, what), "is": column})
        for column, (kind, what) in kinds.items()
        if kind in contacts
    ]


def _event_source(topic: str, contact: str, kind: str, what: str) -> Source:
    if what in GAUGE_UNITS:
        return Source(topic=f"{topic.removesuffix(IMPACTS)}{BLOW_GAUGE}", joint=what, field="effort")
    return Source(topic=topic, joint=f"{contact}/{kind}", field=EVENT_FIELDS[what])
