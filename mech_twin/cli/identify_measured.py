# SPDX-License-Identifier: Apache-2.0
"""``mech-twin identify`` without a simulated run: lengths from measured positions, restitution from bounces."""

from __future__ import annotations

import time
from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from mech_twin.cli.console import print_json, print_table, say, write_text
from mech_twin.cli.failure import FOUND, CommandError
from mech_twin.cli.measurement_verbs import IdentifyVerb
from mech_twin.errors import MeasurementError
from mech_twin.files.output_file import check_output_file
from mech_twin.measurements.blocks import Array
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.measurements.model_turn import TURNING, model_turn
from mech_twin.measurements.runs import read_run
from mech_twin.parameters.load import description_text
from mech_twin.results.opened_runs import opened_run
from mech_twin.studies.identification.bounces import Bounces, bounces, restitution
from mech_twin.studies.identification.geometry_fit import GeometryData, GeometryModel, geometry_data, lengths
from mech_twin.studies.identification.geometry_report import FittedAssembly, GeometryReport, geometry_report
from mech_twin.studies.identification.keyed_configuration import AUTO, KeyedConfiguration
from mech_twin.studies.identification.verdicts import IDENTIFIED, NOT_EXCITED, WIDEST, KeyVerdict

FEWEST_RUNS_TO_HOLD_OUT = 3


def split_runs(runs: Sequence[Path], held_out: Path | None) -> tuple[list[Path], Path | None]:
    """Return the runs that are fitted, and the one held out: as asked, else the last of three or more."""
    every = list(runs)
    if held_out is None:
        return (every[:-1], every[-1]) if len(every) >= FEWEST_RUNS_TO_HOLD_OUT else (every, None)
    if held_out not in every or len(every) < 2:
        raise CommandError(f"--hold-out {held_out}: expected one of at least two runs")
    return [run for run in every if run != held_out], held_out


def show_keys(title: str, keys: Sequence[Any]) -> None:
    """Print the keys with their intervals and verdicts."""
    heads = ("key", "before", "estimate", "95 % from", "to", "verdict")
    print_table(title, heads, map(attrgetter("key", "before", "estimate", "low_95", "high_95", "verdict"), keys))


def say_open(keys: Sequence[Any]) -> None:
    """Say why keys are not identified."""
    say(*(f"{key.key}: {key.verdict}, {key.reason}" for key in keys if key.verdict != IDENTIFIED))


def identify_lengths(request: IdentifyVerb) -> None:
    """Fit the free keys to the runs; write the configuration found, unless the run held out fits no better with it."""
    began = time.monotonic()
    if request.out is not None:
        check_output_file(request.out, force=request.force)
    unused: dict[str, object] = {"--fix": request.fixed, "--prior": request.priors, "--scheduler": request.scheduler}
    unused[f"--hold-out {request.hold_out}"] = request.held_out_share is not None
    for option, given in unused.items():
        if given:
            raise CommandError(f"{option}: not used in the measured motion of the crank; expected --motion simulated")
    given, base = request.given_map, request.parameters
    columns = _led_columns(request, given)
    keys = tuple(key for key in request.free if key != AUTO)
    if AUTO in request.free or not request.free:
        keys = tuple(dict.fromkeys((*keys, *lengths(request.machine, base, columns))))
        say(f"free, since the measured positions depend on them: {', '.join(keys) or 'no key'}")
    if not keys:
        raise CommandError(f"{request.machine}: no length moves {', '.join(columns)}; expected --free KEY")
    model = GeometryModel(request.machine, base, keys, columns)
    model.values()  # a key that is wrong is named before the runs are read
    fitted, held_out = split_runs(request.runs, request.held_out_run)
    runs = [_data(path, given, model) for path in fitted]
    chosen = [text.partition("=")[0].strip() for text in request.settings]
    report, model = geometry_report(model, runs, None if held_out is None else _data(held_out, given, model), chosen)
    _show_lengths(request, report, held_out, time.monotonic() - began)
    if not report.better:
        found = any(key.verdict == IDENTIFIED for key in report.keys)
        say(f"{f'{held_out}: fits no better than before' if found else 'no key is identified'}; nothing is written")
        raise SystemExit(FOUND)
    if request.out is not None:
        _write_lengths(request, model, report, [str(path) for path in fitted])


def _led_columns(request: IdentifyVerb, given: MeasurementMap) -> tuple[str, ...]:
    """Return the positions that the crank leads; channels that tell nothing of lengths are named."""
    turn = model_turn(request.built)
    if turn is None:
        raise CommandError(f"{request.machine}: expected a machine whose joints follow from a crank")
    names = [channel.quantity for channel in given.channels]
    used = tuple(name for name in names if name in turn.led and name.endswith(".position") and name not in TURNING)
    left = [name for name in dict.fromkeys(names) if name not in used and name not in TURNING]
    say(*(f"{name}: left out, it is no position that the crank leads" for name in left))
    if not used:
        raise CommandError(f"{request.map_file}: expected a position that the crank leads, beside the crank's")
    return used


def _data(path: Path, given: MeasurementMap, model: GeometryModel) -> GeometryData:
    with opened_run(path) as reader:
        return geometry_data(read_run(reader, given), model.columns)


def _show_lengths(request: IdentifyVerb, report: GeometryReport, held_out: Path | None, seconds: float) -> None:
    if request.as_json:
        channels = [{"is": name, "fit_percent": fit} for name, fit in report.fit_percent.items()]
        scored = None if held_out is None else {"run": held_out, "scores": report.held_out}
        head = {"machine": request.machine, "parameters": report.keys, "channels": channels, "lags_s": report.lags_s}
        print_json({**head, "assembly": report.assembly, "held_out": scored, "seconds": seconds})
        return
    show_keys(f"{request.machine}: lengths from measured positions", report.keys)
    say(_assembly_words(report.assembly))
    say_open(report.keys)
    scores = [(s.channel, s.fit_percent, s.before_percent, s.constant_percent) for s in report.held_out]
    if scores:
        print_table(f"fit of {held_out}, held out, percent", ("channel", "estimated", "before", "constant"), scores)


def _assembly_words(found: FittedAssembly) -> str:
    """Return which assembly and which sense of the crank fit best, and by how much."""
    taken = " and ".join(f"{key}: {value}" for key, value in found.configured.items()) or "as configured"
    words = [f"assembly {taken}"]
    words += [f"the other one leaves a residual {found.margin:.3g} times as large"] * bool(np.isfinite(found.margin))
    sense = "as in the map" if found.sense > 0 else "against the map (sign: -1 for the crank)"
    return "; ".join([*words, f"crank turns {sense}, the other sense {found.sense_margin:.3g} times"])


def _write_lengths(request: IdentifyVerb, model: GeometryModel, report: GeometryReport, runs: Sequence[str]) -> None:
    """Write the configuration with the keys that were identified; the others are kept as they were."""
    assert request.out is not None
    values = [key.estimate if key.verdict == IDENTIFIED else key.before for key in report.keys]
    found = ", ".join(runs)
    notes = [
        f"# {key.key}: identified {key.estimate:.6g} +- {key.high_95 - key.estimate:.2g} (95 %) from {found}"
        if key.verdict == IDENTIFIED
        else f"# {key.key}: kept, {key.verdict}: {key.reason}"
        for key in report.keys
    ]
    text = description_text(request.machine, model.parameters(values))
    write_text(request.out, "\n".join(notes) + "\n" + text, force=request.force)


KEY = "restitution"


def identify_bounces(request: IdentifyVerb) -> None:
    """Find the restitution from the bounces that the runs show; write the configuration with it."""
    began = time.monotonic()
    if request.out is not None:
        check_output_file(request.out, force=request.force)
    keyed = KeyedConfiguration(request.machine, request.parameters, (KEY,))
    (before,) = keyed.values().tolist()
    runs = []
    for path in request.runs:
        try:
            runs.append(bounces(path, *_columns(path)))
        except MeasurementError as error:
            say(f"{error}; left out")
    if not runs:
        raise CommandError(f"{request.machine}: none of the runs shows bounces; expected positions, or --map FILE")
    found = restitution(runs)
    low, high = found.value - found.half_width, found.value + found.half_width
    narrow = found.half_width <= WIDEST * found.value
    reason = "flights between bounces shorten by it" if narrow else "the runs leave it open by more than half of itself"
    verdict = IDENTIFIED if narrow else NOT_EXCITED
    key = KeyVerdict(KEY, before, found.value, found.standard_error, low, high, verdict, reason)
    _show_bounces(request, key, runs, found.used, time.monotonic() - began)
    if request.out is not None and narrow:
        names = ", ".join(path.name for path in found.used)
        note = f"# {KEY}: identified {found.value:.6g} +- {found.half_width:.2g} (95 %) from {names}\n"
        text = note + description_text(request.machine, keyed.parameters([found.value]))
        write_text(request.out, text, force=request.force)


def _columns(path: Path) -> tuple[Array, dict[str, Array]]:
    """Return the times of a run, and its columns at all of them."""
    found: dict[str, list[tuple[Array, Array]]] = {}
    with opened_run(path) as reader:
        sources = [each.source for each in reader.offered()]
        for place, stamps, shown, _ in reader.blocks(sources, reader.proposed_time()):
            found.setdefault(sources[place].label, []).append((stamps, shown))
    labels = [source.label for source in sources if source.label in found]
    whole = {label: [np.concatenate(each) for each in zip(*found[label], strict=True)] for label in labels}
    if not whole:
        raise MeasurementError(path, "has no column beside its time")
    clock = max((stamps for stamps, _ in whole.values()), key=len)
    order = np.argsort(clock, kind="stable")
    return clock[order], {
        name: shown[order]
        for name, (stamps, shown) in whole.items()
        if len(stamps) == len(clock) and np.isfinite(shown).all()
    }


def _show_bounces(
    request: IdentifyVerb, key: KeyVerdict, runs: list[Bounces], used: tuple[Path, ...], seconds: float
) -> None:
    rows = []
    for run in runs:
        found = (run.found.value, run.found.standard_deviation)
        rows.append((str(run.path), run.column, *found, len(run.times_s), run.flaws))
    if request.as_json:
        names = ("run", "column", "restitution", "standard_deviation", "bounces", "flaws")
        record = {"machine": request.machine, "parameters": [key], "used": used}
        print_json({**record, "runs": [dict(zip(names, row, strict=True)) for row in rows], "seconds": seconds})
        return
    print_table("bounces", ("run", "column", KEY, "s.d.", "bounces", "missed or false"), rows)
    show_keys(f"{request.machine}: from {len(used)} of {len(request.runs)} runs", [key])
