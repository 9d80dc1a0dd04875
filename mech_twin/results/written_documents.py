# SPDX-License-Identifier: Apache-2.0
"""Converts a document printed with ``--json`` to the object that the Python function returns."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import is_dataclass
from functools import partial
from itertools import repeat
from math import inf, nan
from pathlib import Path
from types import UnionType
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import TypeAdapter, ValidationError

from mech_twin.capabilities.design import Design, InShorterSteps
from mech_twin.capabilities.long_run import (
    CycleAnswer,
    RegimeAnswer,
    RegimeQuestion,
    SynthesisAnswer,
    SynthesisQuestion,
)
from mech_twin.capabilities.published import PublishedRow
from mech_twin.capabilities.sizing import Constraint
from mech_twin.declarations.configuration_tree import tree_from_json
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.trajectory import Residual
from mech_twin.errors import StudyError
from mech_twin.measurements.columns import Columns, Numbers
from mech_twin.measurements.units import shown_units
from mech_twin.parameters.errors import refusal
from mech_twin.parameters.load import catalogue_entry, validated
from mech_twin.results import printed_documents
from mech_twin.results.objects import Analysis, Run, RunComparison, SizingResult
from mech_twin.roles import own_name
from mech_twin.samples import Event
from mech_twin.studies.declared_studies import asked_of
from mech_twin.studies.design_scan import DesignScan, read_scan
from mech_twin.studies.identification.fit_quality import ChannelFit, ChannelScore, Score
from mech_twin.studies.identification.identification import Identification
from mech_twin.studies.identification.keyed_configuration import IdentificationQuestion
from mech_twin.studies.identification.staged_fit import Search
from mech_twin.studies.identification.verdicts import Combination, KeyVerdict
from mech_twin.studies.identification.written_identification import SavedIdentification
from mech_twin.studies.monitoring.fleet import Fleet
from mech_twin.studies.run_comparison import Comparison, Differing

if TYPE_CHECKING:
    from mech_twin.recording.recovery import RecoveryReport


Read = TypeVar("Read")


def read_as(kind: type[Read], document: Any) -> Read:
    """Return a document as a dataclass or named tuple, nested ones included.

    Raises
    ------
    ValidationError
        If keys do not match the type; the message names each.
    """
    return TypeAdapter(kind).validate_python(_filled(kind, document))


def _filled(kind: Any, value: Any, absent: float = nan) -> Any:
    """Return a value with ``absent``, or the number of an annotation, for null; without keys unknown to the type."""
    if get_origin(kind) is Annotated:
        kind, *marks = get_args(kind)
        absent = next((mark for mark in marks if isinstance(mark, float)), absent)
    inside = get_args(kind)
    if kind is float:
        return absent if value is None else value
    if get_origin(kind) in (Union, UnionType):
        return value if value is None else _filled(inside[0], value)
    if isinstance(value, list) and inside:
        kinds = inside if len(inside) == len(value) and ... not in inside else repeat(inside[0])
        return [_filled(each, one) for each, one in zip(kinds, value, strict=False)]
    if not isinstance(value, Mapping):
        return value
    if inside:
        return {key: _filled(inside[-1], one) for key, one in value.items()}
    hints, defaults = {}, getattr(kind, "_field_defaults", {})
    if hasattr(kind, "model_fields"):  # rejects unknown keys itself
        hints = {name: field.annotation for name, field in kind.model_fields.items()}
    elif is_dataclass(kind) or hasattr(kind, "_fields"):
        hints = get_type_hints(kind, include_extras=True)
        value = {key: one for key, one in value.items() if key in hints}
    return {key: _filled(hints.get(key), one, defaults.get(key, nan)) for key, one in value.items()}


Document = Mapping[str, Any]


class KnownDocument(NamedTuple):
    """A kind of document: its verb, the keys that identify it, and the function that converts it."""

    verb: str
    keys: frozenset[str]
    read: Callable[[Document], Any]


def _printed() -> Iterator[KnownDocument]:
    """Yield the kinds of document that have a class of their own, identified by its required keys."""
    for model in vars(printed_documents).values():
        if verb := getattr(model, "verb", ""):
            keys = frozenset(name for name, field in model.model_fields.items() if field.is_required())
            yield KnownDocument(verb, keys, partial(read_as, model))


def from_document(text: str, source: str) -> Any:
    """Return the Python object for the text of a document.

    Raises
    ------
    StudyError
        The text is not JSON, or the document is of no known kind.
    ConfigurationError
        Its configuration is invalid.
    """
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise StudyError(f"{source}: not JSON ({error}); expected what a verb printed with --json") from error
    held = set(document) if isinstance(document, dict) else set()
    kind = max((kind for kind in KINDS if kind.keys <= held), key=lambda kind: len(kind.keys), default=None)
    if kind is None:
        verbs = ", ".join(dict.fromkeys(kind.verb for kind in KINDS))
        raise StudyError(f"{source}: expected what one of these printed with --json: {verbs}")
    try:
        return kind.read(document)
    except ValidationError as error:
        raise refusal(f"{source}: not as `{kind.verb}` prints it", error) from error
    except (KeyError, TypeError, AttributeError) as error:
        raise StudyError(f"{source}: not as `{kind.verb}` prints it ({type(error).__name__}: {error})") from error


def _parameters(machine: str, config: Any, source: str = "config") -> Parameters:
    return validated(catalogue_entry(machine), tree_from_json(config), source)


def _run(document: Document) -> Run:
    name = document["machine"]
    parameters = _parameters(name, document["config"])
    samples = document.get("samples", {"time_s": []})
    built, title = catalogue_entry(name).build(parameters), own_name(name, parameters)
    numbers = Numbers(title, _filled(dict[str, float], document["summary"]))
    units = shown_units(built)
    return Run(
        name,
        parameters,
        numbers,
        Columns(title, "time_s", samples, units),
        read_as(tuple[Event, ...], document["events"]),
        {key: Residual(**residual) for key, residual in document["residuals"].items()},
        tuple(built.remarks(numbers)),
    )


def _analysis(document: Document) -> Analysis:
    name, parameters = document["machine"], _parameters(document["machine"], document["config"])
    title = own_name(name, parameters)
    cycle = Columns(title, "crank_rad", document.get("cycle", {"crank_rad": []}))
    return Analysis(name, parameters, Numbers(title, _filled(dict[str, float], document["summary"])), cycle)


def _sizes(document: Document) -> SizingResult:
    machine, constraints = document["machine"], read_as(tuple[Constraint, ...], document["constraints"])
    parameters = _parameters(machine, document["config"])
    return SizingResult(
        machine, document["objective"], document["sizes"], parameters, document["metrics"],
        constraints, document["binding"], tuple(document["trade_off"]), document["tolerance"],
        tuple(document.get("uncertain", ())), _shorter(document, parameters),
    )  # fmt: skip


def _shorter(document: Document, parameters: Any) -> InShorterSteps | None:
    found = document.get("shorter_steps")
    return found and InShorterSteps(
        found["step_s"], parameters.coupling.step_s, _filled(dict[str, float], found["summary"])
    )


def _points(document: Document) -> Columns:
    rows = document["rows"]
    names = dict.fromkeys(name for row in rows for name in row)
    columns = {name: [nan if row.get(name) is None else row[name] for row in rows] for name in names}
    name = document.get("config", {}).get("name", document["machine"])  # of a page its own
    return Columns(f"{name}: sweep", next(iter(names)), columns)


def _designs(document: Document) -> list[Design]:
    return [_design(document["machine"], set(document["objectives"]), dict(row)) for row in document["designs"]]


def _design(machine: str, named: set[str], row: dict[str, Any]) -> Design:
    margins, parameters = row.pop("margins"), _parameters(machine, row.pop("config"))
    shorter = _shorter(row, parameters)
    row.pop("shorter_steps", None)
    objectives, variables = ({name: row[name] for name in row if (name in named) == asked} for asked in (True, False))
    return Design(variables, objectives, margins, parameters, shorter)


def _comparison(document: Document) -> RunComparison:
    settings = tuple(_differing(row, inf) for row in document["settings"])
    numbers = tuple(_differing(row, nan) for row in document["numbers"])
    labels = (document["first"], document["second"])
    return RunComparison(Comparison(document["machine"], labels, settings, numbers, document["tolerance"]))


def _differing(row: Document, absent: float) -> Differing:
    first, second = (tree_from_json(row[side], absent) if side in row else None for side in ("first", "second"))
    return Differing(row["name"], first, second, inf if row["relative"] is None else row["relative"])


def _identified(document: Document) -> SavedIdentification:
    runs, held_out = (tuple(map(Path, document[name])) for name in ("runs", "held_out_runs"))
    map_file = None if document["map"] is None else Path(document["map"])
    machine, held, correlation = document["machine"], document["held_out"], document["correlation"]
    parameters, base = (_parameters(machine, document[name], name) for name in ("config", "before"))
    asked = {"base": base, "machine": machine, "seed": document["seed"], **document["asked"]}
    found = Identification(
        read_as(IdentificationQuestion, asked),
        parameters,
        read_as(tuple[KeyVerdict, ...], document["parameters"]),
        read_as(tuple[Combination, ...], document["combinations"]),
        read_as(tuple[ChannelFit, ...], [{"channel": row["is"], **row} for row in document["channels"]]),
        read_as(Search, document["search"]),
        held and _score(held), held and _score(held["before"]), document["begins_s"], tuple(correlation["keys"]),
        np.array(correlation["matrix"], dtype=float), document["model_runs"], document["seconds"],
    )  # fmt: skip
    return SavedIdentification(found, runs, held_out, map_file)


def _score(record: Document) -> Score:
    channels = []
    for name, rms in record["rms"].items():  # without a fit: a run that failed has no rms either, one that stands has
        row = {"fit_percent": record["fit_percent"][name], "rms": rms, "white_p": record["white_p"][name]}
        row |= {"fit_percent": -inf, "rms": inf} if rms is None else {}
        channels.append(read_as(ChannelScore, {"channel": name, **row}))
    missed, false, off = record["missed_events"], record["false_events"], record["event_time_rms_s"]
    return Score(tuple(channels), nan if off is None and missed + false else off, missed, false)


def _salvaged(document: Document) -> RecoveryReport:
    from mech_twin.recording.recovery import RecoveryReport

    return read_as(RecoveryReport, document)


def _fleet(document: Document) -> Fleet:
    own = ("feature", "apart", "verdict")
    sisters = [
        {"member": {key: value for key, value in row.items() if key not in own}, **{key: row[key] for key in own}}
        for row in document["machines"]
    ]
    refused = [{"name": name, "refused": reason} for name, reason in document["refused"].items()]
    return read_as(Fleet, {**document, "sisters": sisters, "refused": refused})


def _scan(document: Document) -> DesignScan:
    if document["table"] is None:
        raise StudyError("study designs: holds no designs; expected --out FILE.parquet beside --json")
    return read_scan(document["machine"], document["designs"], Path(document["table"]))


def _synthesis(document: Document) -> SynthesisAnswer:
    machine, rest = document["machine"], {"machine", "chosen", "configuration"}
    question: SynthesisQuestion = asked_of(machine, "synthesis", "no cycle to synthesise")
    parts = {name: part for name, part in document.items() if name not in rest}
    records = {name: part for name, part in parts.items() if "config" in part}
    cycles = tuple(
        CycleAnswer(name, _parameters(machine, record["config"]), record, question.lines(record))
        for name, record in records.items()
    )
    return SynthesisAnswer({name: parts[name] for name in parts.keys() - records.keys()}, cycles, document["chosen"])


def _regimes(document: Document) -> RegimeAnswer:
    question: RegimeQuestion = asked_of(document["machine"], "regimes", "no regimes to map")
    return question.read(document["key"], document["regimes"])


KINDS = (
    KnownDocument("simulate", frozenset({"machine", "config", "summary", "residuals", "events"}), _run),
    KnownDocument("study size", frozenset({"machine", "config", "sizes", "constraints"}), _sizes),
    KnownDocument("study sweep", frozenset({"machine", "points", "rows"}), _points),
    KnownDocument("study search", frozenset({"machine", "objectives", "designs", "configuration"}), _designs),
    KnownDocument("compare", frozenset({"machine", "first", "second", "settings", "numbers"}), _comparison),
    KnownDocument(
        "reproduce", frozenset({"all_gated_hold", "rows"}), lambda read: read_as(tuple[PublishedRow, ...], read["rows"])
    ),
    KnownDocument("identify", frozenset({"machine", "config", "before", "asked", "search"}), _identified),
    KnownDocument("analyse", frozenset({"machine", "config", "summary"}), _analysis),
    KnownDocument("study designs", frozenset({"machine", "designs", "feasible_share", "table"}), _scan),
    KnownDocument("study synthesise", frozenset({"machine", "chosen", "configuration"}), _synthesis),
    KnownDocument("study regimes", frozenset({"machine", "key", "regimes"}), _regimes),
    KnownDocument("list", frozenset({"machines"}), lambda read: tuple(each["name"] for each in read["machines"])),
    KnownDocument("recover", frozenset({"bag", "out", "damages", "messages_of_lost_topics"}), _salvaged),
    KnownDocument("fleet", frozenset({"machine", "limit", "common", "machines"}), _fleet),
    *_printed(),
)
