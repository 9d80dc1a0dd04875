# SPDX-License-Identifier: Apache-2.0
"""``mech-twin identify``: keys of a configuration from measured runs, with intervals, verdicts and a held-out score."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

from mech_twin.cli.console import print_json, print_table, say
from mech_twin.cli.failure import CommandError
from mech_twin.cli.identify_request import (
    DEFAULT_SHARE,
    NOT_BETTER,
    IdentifyRequest,
    bounded_keys,
    prior_keys,
    split_runs,
)
from mech_twin.cli.map import checked_run
from mech_twin.cli.measurement_verbs import IdentifyVerb
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.declarations.quantity import Parameters
from mech_twin.measurements.machine_columns import joint_column
from mech_twin.measurements.model_turn import TURNING, ModelTurn, model_turn
from mech_twin.parameters.load import assignments, machine_parameters
from mech_twin.process.dependencies import extra_needed
from mech_twin.results.opened_runs import opened_run
from mech_twin.roles import GuidedLinkage
from mech_twin.studies.identification.acting_keys import number_in
from mech_twin.studies.identification.fit_runs import FitRun, fit_run
from mech_twin.studies.identification.free_keys import AUTO, assumed_keys, machine_keys
from mech_twin.studies.identification.identification import Identification, identified
from mech_twin.studies.identification.question import IdentificationQuestion
from mech_twin.studies.identification.saved_identification import SavedIdentification, check_out, is_file

BOUNCE_KEY = "restitution"  # of a machine whose runs may be bounces without a name


def identify_machine(verb: IdentifyVerb) -> None:
    """Fit the free keys to the runs; write what was found, unless what was held out is foretold no better with it."""
    asked = IdentifyRequest(**dict(verb))
    if asked.latest_begin_s is not None and asked.begin != "unknown":
        raise CommandError(f"--latest-begin {asked.latest_begin_s:g}: expected --begin unknown beside it")
    if asked.plan:
        _plan(asked)
        return
    if not asked.runs:
        raise CommandError("expected at least one run, a bag or a table")
    if _bouncing(asked):
        from mech_twin.cli.identify_bounces import identify_bounces

        identify_bounces(asked)
        return
    machine = asked.configured
    turn = model_turn(machine)
    if _motion(asked, turn, guided=isinstance(machine.linkage, GuidedLinkage)) == "measured":
        from mech_twin.cli.identify_lengths import identify_lengths

        identify_lengths(asked)
        return
    if asked.out is not None:
        check_out(asked.out, force=asked.force)
    base = machine_parameters(asked.machine, asked.config, assignments(asked.settings))
    question = _question(asked, base)
    fitted, held_out = split_runs(asked.runs, asked.held_out_run)
    share = asked.held_out_share if asked.held_out_share is not None else 0.0 if held_out else DEFAULT_SHARE
    held = [] if held_out is None or asked.held_out_share is not None else [held_out]
    fitted = fitted if held or held_out is None else [*fitted, held_out]
    runs = [_run(path, asked, turn) for path in fitted]
    with _telling(asked) as told:
        found = identified(question, runs, [_run(path, asked, turn) for path in held], share, told)
    saved = SavedIdentification(found, tuple(fitted), tuple(held), asked.map_file)
    if asked.as_json:
        print_json(saved.document)
    else:
        _show(found)
    if not found.better:
        say("what was held out is foretold no better than before; no configuration is written")
        raise SystemExit(NOT_BETTER)
    if asked.out is not None:
        for path in saved.save(asked.out, force=asked.force):
            say(f"written to {path}")
        if not is_file(asked.out) and find_spec("matplotlib") is None:
            say(f"no report: {extra_needed('plots')}")


def _plan(asked: IdentifyRequest) -> None:
    from mech_twin.cli.identify_plan import show_plan

    if asked.sensors is None or asked.duration_s is None:
        raise CommandError("--plan: expected --sensors FILE and --duration TIME beside it, as for `simulate`")
    if asked.runs:
        raise CommandError(f"--plan: expected no run, got {asked.runs[0]}; it asks what a run would tell")
    base = machine_parameters(asked.machine, asked.config, assignments(asked.settings))
    show_plan(_question(asked, base), asked.sensors, asked.map_file, asked.duration_s, as_json=asked.as_json)


def _bouncing(asked: IdentifyRequest) -> bool:
    """Return whether the runs are positions of something that bounces, without a name of the machine."""
    if asked.motion != "auto" or asked.map_file is not None:
        return asked.motion == "bounces"
    from mech_twin.cli.map import NoNameError

    try:
        asked.given_map  # noqa: B018
    except NoNameError:
        if number_in(configuration_tree(asked.configured.parameters), BOUNCE_KEY) is None:
            raise
        return True
    return False


def _motion(asked: IdentifyRequest, turn: ModelTurn | None, *, guided: bool) -> str:
    """Return what moves the model: the measured crank, if lengths are asked for and nothing but positions tell them."""
    if asked.motion != "auto":
        return asked.motion
    names = [channel.quantity for channel in asked.given_map.channels]
    if turn is None or not guided or AUTO in asked.free or not asked.free or not set(names) & set(TURNING):
        return "simulated"
    led = {name.rpartition(".")[0] for name in {*turn.led, *TURNING} if joint_column(name) is not None}
    moving = all(
        (parts := joint_column(name)) is not None and parts.field != "effort" and name.rpartition(".")[0] in led
        for name in names
    )
    return "measured" if moving else "simulated"


def _question(asked: IdentifyRequest, base: Parameters) -> IdentificationQuestion:
    keys, bounds = bounded_keys(asked.free)
    if AUTO in keys:
        keys = tuple(dict.fromkeys((*(key for key in keys if key != AUTO), *machine_keys(asked.machine, base))))
    keys = keys or assumed_keys(asked.machine, base, asked.config)
    keys = tuple(key for key in keys if key not in asked.fixed)
    if not keys:
        raise CommandError(f"{asked.machine}: no key is free; expected --free KEY")
    return IdentificationQuestion(
        asked.machine,
        base,
        keys,
        bounds,
        prior_keys(asked.priors),
        asked.begin_bound_s,
        asked.seed,
        asked.cores,
        asked.scheduler,
    )


def _run(path: Path, asked: IdentifyRequest, turn: ModelTurn | None) -> FitRun:
    """Return one run; what contradicts the machine is said on standard error."""
    with opened_run(path) as reader:
        run, problems = checked_run(reader, asked.given_map, turn, asked.configured)
    for problem in problems:
        say(f"{path}: {problem}")
    return fit_run(run, begin_known=asked.begin == "start")


@contextmanager
def _telling(asked: IdentifyRequest) -> Iterator[Callable[[str], None]]:
    """Provide what takes lines on the progress: a line that is written over on a terminal, none elsewhere."""
    if not sys.stderr.isatty() or asked.as_json:
        yield lambda _: None
        return
    from rich.console import Console

    with Console(stderr=True).status("identifying") as status:
        yield lambda line: status.update(f"identifying: {line}")


def _show(found: Identification) -> None:
    heads = ("key", "before", "estimate", "95 % from", "to", "verdict")
    rows = [(k.key, k.before, k.estimate, k.low_95, k.high_95, k.verdict) for k in found.keys]
    print_table(f"{found.question.machine}: identified in {found.seconds:.1f} s", heads, rows)
    if found.search.starts > 1:
        ahead = f", the second best {found.search.margin:.3g} times as far off" if found.search.valleys > 1 else ""
        say(f"{found.search.starts} starts ended in {found.search.valleys} valleys{ahead}")
    for key in found.keys:
        if key.verdict != "identified":
            say(f"{key.key}: {key.verdict}, {key.reason}")
    if found.combinations:
        from mech_twin.cli.identify_plan import show_combinations

        show_combinations(found.combinations)
    heads = ("channel", "fit, %", "rms", "zero", "gain", "lag, s")
    fits = [(c.channel, c.fit_percent, c.rms, *map(_numbers, (c.zero, c.gain, c.lag_s))) for c in found.channels]
    print_table("channels of the fitted runs", heads, fits)
    if found.held_out is not None and found.before is not None:
        pairs = zip(found.held_out.channels, found.before.channels, strict=True)
        scores = [(one.channel, one.fit_percent, other.fit_percent, 0.0) for one, other in pairs]
        print_table("fit of what was held out, percent", ("channel", "identified", "before", "constant"), scores)
        if found.held_out.event_time_rms_s is not None:
            say(
                f"held out: event times off by {1e3 * found.held_out.event_time_rms_s:.3g} ms in the rms, "
                f"{found.held_out.missed} missed, {found.held_out.false} false"
            )


def _numbers(values: dict[str, float]) -> str:
    return " ".join(f"{value:.5g}" for value in values.values())
