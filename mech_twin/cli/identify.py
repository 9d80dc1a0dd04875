# SPDX-License-Identifier: Apache-2.0
"""``mech-twin identify``: keys of a configuration from measured runs, with intervals, verdicts and a held-out score."""

from __future__ import annotations

import math
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from mech_twin.cli.console import bar, print_json, print_table, say
from mech_twin.cli.failure import FOUND, CommandError
from mech_twin.cli.identify_measured import identify_bounces, identify_lengths, say_open, show_keys, split_runs
from mech_twin.cli.measured import NoNameError, checked_run
from mech_twin.cli.measurement_verbs import IdentifyVerb
from mech_twin.cli.option_values import assigned, two_numbers
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.declarations.quantity import Parameters
from mech_twin.measurements.model_turn import TURNING, ModelTurn, model_turn
from mech_twin.measurements.units import is_event, joint_column
from mech_twin.process.dependencies import FIT_BYTES, check_address_space, extra_needed
from mech_twin.results.opened_runs import given_map
from mech_twin.roles import GuidedLinkage
from mech_twin.studies.identification.combinations import Combination
from mech_twin.studies.identification.fit_runs import FitRun, fit_run
from mech_twin.studies.identification.identification import Identification, identified
from mech_twin.studies.identification.keyed_configuration import AUTO, assumed_keys, machine_keys, number_in
from mech_twin.studies.identification.sensor_plan import sensor_plan
from mech_twin.studies.identification.unknowns import IdentificationQuestion
from mech_twin.studies.identification.written_identification import SavedIdentification, check_out, is_file

DEFAULT_SHARE = 0.2
MOST_SHOWN = 12  # of what would help


def bounded_keys(texts: Sequence[str]) -> tuple[tuple[str, ...], dict[str, tuple[float, float]]]:
    """Return the keys written as ``KEY`` or ``KEY=LOW:HIGH``, and the bounds of those that have some."""
    bounded, rising = [text for text in texts if "=" in text], ("LOW below HIGH", lambda ends: ends[0] < ends[1])
    bounds = assigned("--free", bounded, "KEY=LOW:HIGH, with numbers", lambda text: two_numbers(text, ":"), rising)
    return tuple(dict.fromkeys(text.partition("=")[0].strip() for text in texts)), bounds


BOUNCE_KEY = "restitution"  # of a machine whose runs may be bounces without a name


def identify_machine(request: IdentifyVerb) -> None:
    """Fit the free keys to the runs; write what was found, unless what was held out is predicted no better with it."""
    check_address_space(FIT_BYTES, "a fit takes")
    if request.latest_begin_s is not None and request.begin != "unknown":
        raise CommandError(f"--latest-begin {request.latest_begin_s:g}: expected --begin unknown beside it")
    if request.plan:
        _plan(request)
        return
    if not request.runs:
        raise CommandError("expected at least one run, a bag or a table")
    if _bouncing(request):
        identify_bounces(request)
        return
    machine = request.built
    turn = model_turn(machine)
    if _motion(request, turn, guided=isinstance(machine.linkage, GuidedLinkage)) == "measured":
        identify_lengths(request)
        return
    if request.out is not None:
        check_out(request.out, force=request.force)
    base = request.parameters
    question = _question(request, base)
    fitted, held_out = split_runs(request.runs, request.held_out_run)
    share = request.held_out_share if request.held_out_share is not None else 0.0 if held_out else DEFAULT_SHARE
    held = [] if held_out is None or request.held_out_share is not None else [held_out]
    fitted = fitted if held or held_out is None else [*fitted, held_out]
    runs = [_run(path, request, turn) for path in fitted]
    with bar("identifying", "SpinnerColumn", "{task.description}") as update:

        def notice(line: str) -> None:
            if update is not None and not request.as_json:
                update(description=f"identifying: {line}")

        found = identified(question, runs, [_run(path, request, turn) for path in held], share, notice)
    saved = SavedIdentification(found, tuple(fitted), tuple(held), request.map_file)
    if request.as_json:
        print_json(saved.document)
    else:
        _show_found(found)
    if not found.better:
        say(f"{found.lack}; no configuration is written")
        if request.begin == "start" and any(key.verdict == "model_error" for key in found.keys):
            say("the runs were taken to begin at the start of the machine; else --begin unknown searches the beginning")
        raise SystemExit(FOUND)
    if request.out is not None:
        say(*(f"written to {path}" for path in saved.save(request.out, force=request.force)))
        if not is_file(request.out) and find_spec("matplotlib") is None:
            say(f"no report: {extra_needed('plots')}")


def _plan(request: IdentifyVerb) -> None:
    """Print what the sensors of a file would find in a run of this length."""
    if request.sensors is None or request.duration_s is None:
        raise CommandError("--plan: expected --sensors FILE and --duration TIME beside it, as for `simulate`")
    if request.runs:
        raise CommandError(f"--plan: expected no run, got {request.runs[0]}; it asks what a run would tell")
    question = _question(request, request.parameters)
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


def _bouncing(request: IdentifyVerb) -> bool:
    """Return whether the runs are positions of something that bounces, without a name of the machine."""
    if request.motion != "auto" or request.map_file is not None:
        return request.motion == "bounces"
    try:
        request.given_map  # noqa: B018
    except NoNameError:
        if number_in(configuration_tree(request.built.parameters), BOUNCE_KEY) is None:
            raise
        return True
    return False


def _motion(request: IdentifyVerb, turn: ModelTurn | None, *, guided: bool) -> str:
    """Return what moves the model: the measured crank, where it leads all that is measured and that is no effort."""
    if request.motion != "auto":
        return request.motion
    names = [channel.quantity for channel in request.given_map.channels]
    if turn is None or not guided or not set(names) & set(TURNING):
        return "simulated"
    led = {name.rpartition(".")[0] for name in {*turn.led, *TURNING} if joint_column(name) is not None}
    moving = all(
        (parts := joint_column(name)) is not None and parts.field != "effort" and name.rpartition(".")[0] in led
        for name in names
    )
    return "measured" if moving else "simulated"


def _question(request: IdentifyVerb, base: Parameters) -> IdentificationQuestion:
    keys, bounds = bounded_keys(request.free)
    if AUTO in keys:
        keys = tuple(dict.fromkeys((*(key for key in keys if key != AUTO), *machine_keys(request.machine, base))))
    keys = keys or assumed_keys(request.machine, base, request.config)
    keys = tuple(key for key in keys if key not in request.fixed)
    if not keys:
        raise CommandError(f"{request.machine}: no key is free; expected --free KEY")
    spread = ("a standard deviation above 0", lambda prior: prior[1] > 0.0)
    form = "KEY=MEAN,SD, with numbers"
    priors = assigned("--prior", request.priors, form, lambda text: two_numbers(text, ","), spread)
    searched = (request.begin_bound_s, request.seed, request.cores, request.scheduler)
    return IdentificationQuestion(request.machine, base, keys, bounds, priors, *searched)


def _run(path: Path, request: IdentifyVerb, turn: ModelTurn | None) -> FitRun:
    """Return one run; what contradicts the machine is said on standard error."""
    run, problems = checked_run(path, request.given_map, request.built, turn)
    say(*problems)
    return fit_run(run, begin_known=request.begin == "start")


def _show_found(found: Identification) -> None:
    show_keys(f"{found.question.machine}: identified in {found.seconds:.1f} s", found.keys)
    if found.search.starts > 1:
        ahead = f", the second best {found.search.margin:.3g} times as far off" if found.search.valleys > 1 else ""
        say(f"{found.search.starts} starts ended in {found.search.valleys} local minima{ahead}")
    say_open(found.keys)
    _show_combinations(found.combinations)
    heads = ("channel", "fit, %", "rms", "zero", "gain", "lag, s")
    fits: list[tuple[Any, ...]] = []
    for c in found.channels:
        told = (" ".join(f"{value:.5g}" for value in each.values()) for each in (c.zero, c.gain, c.lag_s))
        fits.append((c.channel, c.fit_percent, c.rms, *told))
    print_table("channels of the fitted runs", heads, fits)
    still = [c.channel for c in found.channels if math.isnan(c.fit_percent) and not is_event(c.channel)]
    say(*(f"{name}: left out of fit and score in percent, it stands still" for name in still))
    if found.held_out is not None and found.before is not None:
        pairs = zip(found.held_out.channels, found.before.channels, strict=True)
        scores = [(one.channel, one.fit_percent, other.fit_percent, 0.0) for one, other in pairs]
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
