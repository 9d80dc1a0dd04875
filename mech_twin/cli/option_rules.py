# SPDX-License-Identifier: Apache-2.0
"""Options that mean nothing together, or nothing alone: a verb refuses them instead of leaving one out silently."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from mech_twin.cli.failure import CommandError

ON_TOPICS = ("rate", "start", "duration", "loop", "clock", "topics", "listeners", "namespace")
RECOMPUTING = "the recording is read at once, nothing is published"


class Apart(NamedTuple):
    """Two options that exclude each other, and why."""

    first: str
    second: str
    why: str


class Beside(NamedTuple):
    """An option that needs one of others beside it, and why."""

    option: str
    others: tuple[str, ...]
    why: str


ONE_FORM = Apart("json", "csv", "one form of output")
APART = {
    "run": (Apart("record", "no_record", "a recording or none"),),
    "simulate": (Apart("csv", "everything", "CSV has every number; events are in --json"),),
    "analyse": (Apart("crank_deg", "cycle", "one position or one cycle"),),
    "replay": (
        Apart("analyse", "resimulate", "forces alone, or the whole run"),
        *(Apart(mode, option, RECOMPUTING) for mode in ("analyse", "resimulate") for option in ON_TOPICS),
    ),
    "view": (Apart("save", "port", "a file has no page"),),
    "info": (
        Apart("given_map", "csv", "the quality of channels is a table for people, or --json"),
        Apart("given_map", "wide", "the quality of channels has one table"),
    ),
    "identify": tuple(
        Apart("plan", option, "a plan computes no fit")
        for option in ("hold_out", "motion", "begin", "latest_begin", "seed", "scheduler", "out")
    ),
    "monitor": tuple(
        Apart("design", option, "a sensor set is judged without runs")
        for option in ("given_map", "baseline", "save_baseline", "skip")
    ),
    "sweep": (Apart("cores", "scheduler", "processes here, or workers of a cluster"),),
    "designs": (Apart("cores", "scheduler", "processes here, or workers of a cluster"),),
}
BESIDE = {
    "simulate": (
        Beside("samples", ("json",), "samples are printed as JSON; --table FILE writes them"),
        Beside("seed", ("sensors",), "a run without sensors draws nothing at random"),
    ),
    "replay": (
        Beside("tolerance", ("analyse",), "a run computed again from its start keeps no small error"),
        Beside("config", ("analyse", "resimulate"), "a replay needs no configuration"),
        Beside("json", ("analyse", "resimulate"), "a replay has no result to print"),
    ),
    "view": (Beside("config", ("given_map",), "a recording holds its own configuration"),),
    "info": (Beside("config", ("given_map",), "a recording holds its own configuration"),),
    "identify": (
        Beside("sensors", ("plan",), "runs have their --map"),
        Beside("duration", ("plan",), "runs have their own length"),
        Beside("latest_begin", ("begin",), "it bounds --begin unknown"),
    ),
}


def check_options(context: Any) -> None:
    """Raise where options were given of which one would be left out.

    Parameters
    ----------
    context : Context
        Of the verb, its words parsed.

    Raises
    ------
    CommandError
        Naming both options and the reason.
    """
    given, names = _given(context), _names(context)
    for line in _broken(context.info_name, given, names):
        raise CommandError(line)


def _broken(verb: str, given: frozenset[str], names: dict[str, str]) -> Iterator[str]:
    for rule in (ONE_FORM, *APART.get(verb, ())):
        if {rule.first, rule.second} <= given:
            yield f"{names[rule.first]} and {names[rule.second]} exclude each other: {rule.why}"
    for needing in BESIDE.get(verb, ()):
        if needing.option in given and not given & set(needing.others):
            others = " or ".join(names[other] for other in needing.others)
            yield f"{names[needing.option]} goes with {others}: {needing.why}"


def _given(context: Any) -> frozenset[str]:
    """Return the parameters that were typed, whatever their value."""
    sources = {name: context.get_parameter_source(name) for name in context.params}
    return frozenset(name for name, source in sources.items() if source is not None and source.name == "COMMANDLINE")


def _names(context: Any) -> dict[str, str]:
    return {each.name: each.opts[0] for each in context.command.params}
