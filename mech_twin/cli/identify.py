# SPDX-License-Identifier: Apache-2.0
"""``mech-twin identify``: keys from runs by a fit; lengths from positions and restitution from bounces without one."""

import math
import time
from collections.abc import Iterable, Sequence
from importlib.util import find_spec
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from mech_twin.cli.console import FOUND, CommandError, bar, print_json, print_table, say, write_text
from mech_twin.cli.measured import NoNameError, proposal, runs_of_map
from mech_twin.cli.measurement_verbs import IdentifyVerb
from mech_twin.cli.option_values import assigned, two_numbers
from mech_twin.declarations.configuration_tree import configuration_tree, value_in
from mech_twin.declarations.quantity import Parameters
from mech_twin.errors import MeasurementError
from mech_twin.files.output_file import check_output_file
from mech_twin.measurements.blocks import Array
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.measurements.model_turn import TURNING, ModelTurn, model_turn
from mech_twin.measurements.runs import MeasuredRun
from mech_twin.measurements.units import is_event, joint_column
from mech_twin.parameters.description import description_text
from mech_twin.parameters.load import kind_of
from mech_twin.process.dependencies import FIT_BYTES, check_address_space, extra_needed
from mech_twin.results.opened_runs import checked_run, given_map, opened_run
from mech_twin.roles import GuidedLinkage
from mech_twin.studies.identification.bounces import Bounces, bounces, restitution
from mech_twin.studies.identification.fit_runs import FitRun, fit_run
from mech_twin.studies.identification.geometry_fit import (
    FittedAssembly,
    GeometryModel,
    GeometryReport,
    geometry_data,
    geometry_report,
    lengths,
)
from mech_twin.studies.identification.identification import HOLD_OUT_SHARE, Identification, identified
from mech_twin.studies.identification.keyed_configuration import (
    AUTO,
    IdentificationQuestion,
    KeyedConfiguration,
    assumed_keys,
    declared_bounds,
    machine_keys,
)
from mech_twin.studies.identification.sensor_plan import sensor_plan
from mech_twin.studies.identification.verdicts import IDENTIFIED, NOT_EXCITED, WIDEST, Combination, KeyVerdict
from mech_twin.studies.identification.written_identification import SavedIdentification, check_out, is_file

MOST_SHOWN = 12  # of what would help
FEWEST_RUNS_TO_HOLD_OUT = 3
LARGEST_SHARE = 0.8  # of each run, that may be held out
BOUNCE_KEY = "restitution"  # of a machine whose runs may be bounces without a name


def bounded_keys(texts: Sequence[str]) -> tuple[tuple[str, ...], dict[str, tuple[float, float]]]:
    """Return the keys written as ``KEY`` or ``KEY=LOW:HIGH``, and the bounds of those that have some."""
    bounded, rising = [text for text in texts if "=" in text], ("LOW below HIGH", lambda ends: ends[0] < ends[1])
    bounds = assigned("--free", bounded, "KEY=LOW:HIGH, with numbers", lambda text: two_numbers(text, ":"), rising)
    return tuple(dict.fromkeys(text.partition("=")[0].strip() for text in texts)), bounds


def identify_machine(request: IdentifyVerb) -> None:
    """Find what is asked for: by a plan without runs, from bounces, from the measured motion, or by a fit."""
    check_address_space(FIT_BYTES, "a fit takes")
    if request.plan:
        _plan(request)
        return
    if not request.runs:
        request = request.model_copy(update={"runs": runs_of_map(request.map_file, request.built)})
    given = _map(request)
    if given is None:
        identify_bounces(request)
        return
    turn = model_turn(request.built)
    if _motion(request, given, turn) == "measured":
        identify_lengths(request, given, turn)
    else:
        identify_keys(request, given, turn)


def identify_keys(request: IdentifyVerb, given: MeasurementMap, turn: ModelTurn | None) -> None:
    """Fit the free keys to the runs; write what was found, unless what was held out is predicted no better with it."""
    if request.out is not None:
        check_out(request.out, force=request.force)
    question = _question(request)
    fitted, held, share = split_runs(request)

    def run(path: Path) -> FitRun:
        return fit_run(_checked(path, request, given, turn), begin_known=request.latest_begin_s is None)

    runs = list(map(run, fitted))
    with bar("identifying", "SpinnerColumn", "{task.description}") as update:

        def notice(line: str) -> None:
            if update is not None and not request.as_json:
                update(description=f"identifying: {line}")

        found = identified(question, runs, list(map(run, held)), share, notice)
    saved = SavedIdentification(found, tuple(fitted), tuple(held), request.map_file)
    if request.as_json:
        print_json(saved.document)
    else:
        _show_found(found)
    if not found.better:
        say(f"{found.lack}; no configuration is written")
        if request.latest_begin_s is None and {key.verdict for key in found.keys} & {"model_error", "not_converged"}:
            say("the runs were taken to begin at the start of the machine; --latest-begin searches the beginning")
        raise SystemExit(FOUND)
    if request.out is not None:
        say(*(f"wrote {path}" for path in saved.save(request.out, force=request.force)))
        if not is_file(request.out) and find_spec("matplotlib") is None:
            say(f"no report: {extra_needed('plots')}")


def _plan(request: IdentifyVerb) -> None:
    """Print what the sensors of a file would find in a run of this length."""
    assert request.sensors is not None and request.duration_s is not None
    question = _question(request)
    sensors = given_map(request.sensors, request.built)
    opened = None if request.map_file is None else given_map(request.map_file, request.built)
    names = [channel.quantity for channel in sensors.channels]
    if opened is not None and [channel.quantity for channel in opened.channels] != names:
        raise CommandError(f"{request.map_file}: expected the channels of {request.sensors}, in their order")
    plan = sensor_plan(question, sensors, request.duration_s, opened)
    if request.as_json:
        found = {"parameters": plan.keys, "combinations": plan.combinations, "helps": plan.helps}
        print_json({"machine": question.machine, **found})
        return
    rows = [(k.key, k.estimate, 0.5 * (k.high_95 - k.low_95), k.verdict) for k in plan.keys]
    print_table(f"{question.machine}: {request.duration_s:g} s", ("key", "value", "+- (95 %)", "verdict"), rows)
    say_open(plan.keys)
    _show_combinations(plan.combinations)
    helped = [(h.what, ", ".join(h.identified) or "-", h.narrowed) for h in plan.helps[:MOST_SHOWN]]
    print_table("what would help most", ("sensor or manoeuvre", "would also find", "intervals narrower by"), helped)


def _map(request: IdentifyVerb) -> MeasurementMap | None:
    """Return the map of the runs, given or proposed; None where they are taken as bounces, which need none."""
    if request.motion == "bounces":
        return None
    if request.map_file is not None:
        return given_map(request.map_file, request.built)
    try:
        proposed = proposal(request.runs, request.built)
    except NoNameError:
        if request.motion != "auto" or value_in(configuration_tree(request.built.parameters), BOUNCE_KEY) is None:
            raise
        return None
    say(f"map, as `mech-twin map` proposes it:\n{proposed.text.rstrip()}")
    return proposed.known


def _motion(request: IdentifyVerb, given: MeasurementMap, turn: ModelTurn | None) -> str:
    """Return what drives the model: the measured crank if it leads all measured joints, else the simulation."""
    if request.motion != "auto":
        return request.motion
    names = [channel.quantity for channel in given.channels]
    guided = isinstance(request.built.linkage, GuidedLinkage)
    if turn is None or not guided or not set(names) & set(TURNING):
        return "simulated"
    led = {name.rpartition(".")[0] for name in {*turn.led, *TURNING} if joint_column(name) is not None}
    moving = all(
        (parts := joint_column(name)) is not None and parts.field != "effort" and name.rpartition(".")[0] in led
        for name in names
    )
    return "measured" if moving else "simulated"


def _question(request: IdentifyVerb) -> IdentificationQuestion:
    (keys, bounds), base = bounded_keys(request.free), request.parameters
    if AUTO in keys:
        keys = tuple(dict.fromkeys((*(key for key in keys if key != AUTO), *machine_keys(request.machine, base))))
    keys = keys or assumed_keys(request.machine, base, request.config)
    keys = tuple(key for key in keys if key not in request.fixed)
    if not keys:
        raise CommandError(f"{request.machine}: no key is free; expected --free KEY")
    spread = ("a standard deviation above 0", lambda prior: prior[1] > 0.0)
    form = "KEY=MEAN,SD, with numbers"
    priors = assigned("--prior", request.priors, form, lambda text: two_numbers(text, ","), spread)
    searched = (request.latest_begin_s or 0.0, request.seed, request.cores, request.scheduler)
    return IdentificationQuestion(request.machine, base, keys, bounds, priors, *searched)


def _checked(path: Path, request: IdentifyVerb, given: MeasurementMap, turn: ModelTurn | None) -> MeasuredRun:
    """Return one run; what contradicts the machine is said on standard error."""
    run, problems = checked_run(path, given, request.built, turn)
    say(*problems)
    return run


def _show_found(found: Identification) -> None:
    show_keys(f"{found.question.machine}: fitted in {found.seconds:.1f} s", found.keys)
    if found.search.starts > 1:
        ahead = f", the second best {found.search.margin:.3g} times as far off" if found.search.valleys > 1 else ""
        say(f"{found.search.starts} starts ended in {found.search.valleys} local minima{ahead}")
    say_open(found.keys)
    _show_combinations(found.combinations)
    heads = ("channel", "fit, %", "rms, SI", "zero", "gain", "lag, s")
    fits: list[tuple[Any, ...]] = []
    for c in found.channels:
        corrections = (" ".join(f"{value:.5g}" for value in each.values()) for each in (c.zero, c.gain, c.lag_s))
        fits.append((c.channel, "-" if is_event(c.channel) else c.fit_percent, c.rms, *corrections))
    print_table("channels of the fitted runs", heads, fits)
    still = [c.channel for c in found.channels if math.isnan(c.fit_percent) and not is_event(c.channel)]
    say(*(f"{name}: left out of fit and score in percent, it stands still" for name in still))
    if found.held_out is not None and found.before is not None:
        scores = [(*fits, 0.0) for fits in found.held_out_fits]
        print_table("fit of what was held out, percent", ("channel", "identified", "before", "constant"), scores)
        if found.held_out.event_time_rms_s is not None:
            say(
                f"held out: event times off by {1e3 * found.held_out.event_time_rms_s:.3g} ms in the rms, "
                f"{found.held_out.missed} missed, {found.held_out.false} false"
            )


def _show_combinations(combinations: Sequence[Combination]) -> None:
    """Print what is seen of keys that are not seen alone, and for which values of fixed keys that is so."""
    if not combinations:
        return
    heads = ("combination", "estimate", "95 % from", "to", "holds for")
    rows = [(each.formula, each.estimate, each.low_95, each.high_95, each.condition) for each in combinations]
    print_table("identifiable in combination", heads, rows)


def split_runs(request: IdentifyVerb) -> tuple[list[Path], list[Path], float]:
    """Return the runs that are fitted, the one held out, and the share of each held out instead.

    As asked, else the last of three or more runs, else a share.
    """
    runs, asked = request.runs, request.hold_out
    if asked is None:
        return (runs[:-1], runs[-1:], 0.0) if len(runs) >= FEWEST_RUNS_TO_HOLD_OUT else (runs, [], HOLD_OUT_SHARE)
    try:
        share = float(asked)
    except ValueError:
        held_out = Path(asked)
        if held_out not in runs or len(runs) < 2:
            raise CommandError(f"--hold-out {held_out}: expected one of at least two runs") from None
        return [run for run in runs if run != held_out], [held_out], 0.0
    if not 0.0 <= share <= LARGEST_SHARE:
        raise CommandError(f"--hold-out {asked}: expected a run, or a share from 0 to {LARGEST_SHARE:g}")
    return runs, [], share


def show_keys(title: str, keys: Sequence[Any]) -> None:
    """Print the keys with their intervals and verdicts."""
    heads = ("key", "before", "estimate", "95 % from", "to", "verdict")
    print_table(title, heads, map(attrgetter("key", "before", "estimate", "low_95", "high_95", "verdict"), keys))


def say_open(keys: Sequence[Any]) -> None:
    """Say why keys are not identified, and what is doubtful of those that are."""
    say(*(f"{key.key}: {key.verdict}, {key.reason}" for key in keys if key.verdict != IDENTIFIED or ";" in key.reason))


def identify_lengths(request: IdentifyVerb, given: MeasurementMap, turn: ModelTurn | None) -> None:
    """Fit the free keys to the runs; write the configuration found, unless the run held out fits no better with it."""
    began = time.monotonic()
    if request.out is not None:
        check_output_file(request.out, force=request.force)
    unused: dict[str, object] = {"--fix": request.fixed, "--prior": request.priors, "--scheduler": request.scheduler}
    fitted, held, _ = split_runs(request)
    unused[f"--hold-out {request.hold_out}"] = request.hold_out is not None and not held
    unused |= {f"--free {text}": "=" in text for text in request.free}
    for option in filter(unused.get, unused):
        raise CommandError(f"{option}: not used in the measured motion of the crank; expected --motion simulated")
    base = request.parameters
    columns = _led_columns(request, given, turn)
    keys = tuple(key for key in request.free if key != AUTO)
    if AUTO in request.free or not request.free:
        keys = tuple(dict.fromkeys((*keys, *lengths(request.machine, base, columns))))
        say(f"free, since the measured positions depend on them: {', '.join(keys) or 'no key'}")
    if not keys:
        raise CommandError(f"{request.machine}: no length moves {', '.join(columns)}; expected --free KEY")
    model = GeometryModel(request.machine, base, keys, columns=columns)
    model.values()  # a key that is wrong is named before the runs are read
    runs, kept = (
        [geometry_data(_checked(p, request, given, turn), columns) for p in paths] for paths in (fitted, held)
    )
    chosen = [text.partition("=")[0].strip() for text in request.settings]
    report, model = geometry_report(model, runs, next(iter(kept), None), chosen)
    _show_lengths(request, report, next(iter(held), None), time.monotonic() - began)
    if not report.better:
        found = any(key.verdict == IDENTIFIED for key in report.keys)
        say(f"{f'{held[0]}: fits no better than before' if found else 'no key is identified'}; nothing is written")
        raise SystemExit(FOUND)
    values = [key.estimate if key.verdict == IDENTIFIED else key.before for key in report.keys]
    _write_found(request, model.parameters(values), report.keys, fitted)


def _led_columns(request: IdentifyVerb, given: MeasurementMap, turn: ModelTurn | None) -> tuple[str, ...]:
    """Return the positions that the crank leads; channels that tell nothing of lengths are named."""
    if turn is None:
        raise CommandError(f"{request.machine}: expected a machine whose joints follow from a crank")
    names = [channel.quantity for channel in given.channels]
    used = tuple(name for name in names if name in turn.led and name.endswith(".position") and name not in TURNING)
    left = [name for name in dict.fromkeys(names) if name not in used and name not in TURNING]
    say(*(f"{name}: left out, it is no position that the crank leads" for name in left))
    if not used:
        where = request.map_file or "the proposed map"
        raise CommandError(f"{where}: expected a position that the crank leads, beside the crank's")
    return used


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


def _write_found(request: IdentifyVerb, parameters: Parameters, keys: Sequence[Any], runs: Iterable[Any]) -> None:
    """Write the configuration if asked, above it what was found of each key in which runs, or why it is kept."""
    if request.out is None:
        return
    found = ", ".join(map(str, runs))
    notes = [
        f"# {key.key}: identified {key.estimate:.6g} +- {key.high_95 - key.estimate:.2g} (95 %) from {found}\n"
        if key.verdict == IDENTIFIED
        else f"# {key.key}: kept, {key.verdict}: {key.reason}\n"
        for key in keys
    ]
    write_text(
        request.out, "".join(notes) + description_text(kind_of(request.machine), parameters), force=request.force
    )
    say(f"wrote {request.out}")


def identify_bounces(request: IdentifyVerb) -> None:
    """Find the restitution from the bounces that the runs show; write the configuration with it."""
    began = time.monotonic()
    if request.out is not None:
        check_output_file(request.out, force=request.force)
    keyed = KeyedConfiguration(request.machine, request.parameters, (BOUNCE_KEY,))
    runs = []
    for path in request.runs:
        try:
            runs.append(bounces(path, *_columns(path)))
        except MeasurementError as error:
            say(f"{error}; left out")
    if not runs:
        raise CommandError(f"{request.machine}: none of the runs shows bounces; expected positions, or --map FILE")
    found = restitution(runs)
    ends = np.array([-1.0, 1.0]) * found.half_width + found.value
    low, high = ends.clip(*declared_bounds(type(request.parameters), BOUNCE_KEY)).tolist()
    narrow = found.half_width <= WIDEST * found.value
    reason = "flights between bounces shorten by it" if narrow else "the runs leave it open by more than half of itself"
    verdict, before = IDENTIFIED if narrow else NOT_EXCITED, float(keyed.values()[0])
    key = KeyVerdict(BOUNCE_KEY, before, found.value, found.standard_error, low, high, verdict, reason)
    _show_bounces(request, key, runs, found.used, time.monotonic() - began)
    if not narrow:
        say(f"{reason}; nothing is written")
        raise SystemExit(FOUND)
    _write_found(request, keyed.parameters([found.value]), [key], (path.name for path in found.used))


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
    rows = [
        {
            "run": run.path, "column": run.column, "restitution": run.found.value,
            "standard_deviation": run.found.standard_deviation, "bounces": len(run.times_s), "flaws": run.flaws,
        }
        for run in runs
    ]  # fmt: skip
    if request.as_json:
        head = {"machine": request.machine, "parameters": [key], "used": used}
        print_json({**head, "runs": rows, "seconds": seconds})
        return
    heads = ("run", "column", BOUNCE_KEY, "s.d.", "bounces", "missed or false")
    print_table("bounces", heads, [tuple(row.values()) for row in rows])
    show_keys(f"{request.machine}: from {len(used)} of {len(request.runs)} runs", [key])
