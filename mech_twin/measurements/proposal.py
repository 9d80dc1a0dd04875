# SPDX-License-Identifier: Apache-2.0
"""Proposes a map for a measurement: by names, by units in headers, by correlation with the model's own run."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import SequenceMatcher
from pathlib import Path
from statistics import fmean
from textwrap import wrap

from mech_twin.measurements.blocks import SourceColumn
from mech_twin.measurements.measurement_map import Channel, MeasurementMap, Source, TimeSource
from mech_twin.measurements.units import SCALED_BY_GAIN, UNITS, joint_column, time_unit_in, unread_unit

EXACT, NEAR, UNSURE = 3, 2, 1
ALIKE = 0.8  # least similarity of two words
MOST_LEFT_OUT = 12  # channels named as left out
ROLES = {"body": 0.02, "linkage": 0.01}  # likeness added: a body of its own before the linkage's, that before the motor
WIDTH = 80  # of lines in the text of a map
FIELD_WORDS: Mapping[str, tuple[str, ...]] = {
    "position": ("position", "pos", "angle", "travel", "displacement", "stroke", "deg", "rad", "mm", "phi", "theta"),
    "velocity": ("velocity", "speed", "rate", "vel", "rpm", "omega"),
    "effort": ("effort", "torque", "moment", "current", "force"),
}
JOINT_WORDS: Mapping[str, tuple[str, ...]] = {
    "crank": ("crank", "wheel", "shaft", "crankshaft", "flywheel", "main", "encoder"),
    "slider": ("slider", "slide", "piston", "ram", "follower", "stroke", "tree"),
    "rod": ("rod", "conrod", "coupler"),
    "coupler": ("coupler", "rod", "conrod"),
    "rocker": ("rocker", "lever", "hammer"),
    "motor": ("motor", "drive", "current"),
    "rotor": ("rotor", "motor", "drive", "current"),
    "generator": ("generator", "actuator", "drive", "force"),
    "cart": ("cart", "carriage", "trolley"),
    "mass": ("mass", "ball", "hammer", "striker", "ram"),
    "drum": ("drum", "spool", "package", "bobbin"),
    "yarn": ("yarn", "thread"),
    "package_radius": ("radius",),
    "plate": ("plate", "ram"),
    "pendulum": ("pendulum", "rocker", "lever"),
    "body": ("body", "housing", "handle"),
}
_TWIN_TOPICS = {"linkage": "joint_states", "motor": "motor/joint_states", "body": "body/joint_states"}
_WRENCH = {"wrench.force.x": "force_x_n", "wrench.force.y": "force_y_n", "wrench.torque.z": "moment_nm"}
_SI_OF_MESSAGE = {  # of every message with such a field, by the definition of its type
    "wrench.force": "N", "wrench.torque": "N.m", "angular_velocity": "rad/s", "linear_acceleration": "m/s2",
}  # fmt: skip
_FIELD_OF_SI = {
    "rad": "position", "m": "position", "rad/s": "velocity", "m/s": "velocity", "N.m": "effort", "N": "effort",
    "A": "effort",
}  # fmt: skip


@dataclass(frozen=True)
class ProposedChannel:
    """A channel of the measurement with its proposed column, the certainty and the reason."""

    source: Source
    column: str
    unit: str | None
    surety: int
    reason: str
    sign: int = 1


def proposed_channels(offered: Sequence[SourceColumn], columns: Mapping[str, str]) -> list[ProposedChannel]:
    """Return the proposed column of each channel; if several fit one column, all but the best are marked unsure."""
    found = [best for each in offered if (best := _best(each, columns)) is not None]
    taken: dict[str, ProposedChannel] = {}
    for each in sorted(found, key=lambda item: -item.surety):
        taken.setdefault(each.column, each)
    kept = []
    for each in found:
        if (first := taken[each.column]) is each:
            kept.append(each)
        elif first.surety < EXACT:
            kept.append(replace(each, surety=UNSURE, reason=f"{each.column} is already {first.source.label!r}"))
    return kept


def _best(offered: SourceColumn, columns: Mapping[str, str]) -> ProposedChannel | None:
    rated = [(*_rated(offered, column, si), column) for column, si in columns.items()]
    surety, likeness, reason, column = max(rated, key=lambda item: (item[0], item[1]), default=(0, 0.0, "", ""))
    if surety == 0:
        return None
    if surety == NEAR and sum(1 for each in rated if each[:2] == (surety, likeness)) > 1:
        surety, reason = UNSURE, f"{reason}; other columns fit as well"
    return ProposedChannel(offered.source, column, offered.unit, surety, reason)


def _rated(offered: SourceColumn, column: str, si: str) -> tuple[int, float, str]:  # noqa: PLR0911
    """Return the certainty that a channel is a column, the similarity of their names, and the reason."""
    source, parts = offered.source, joint_column(column)
    told = None if offered.unit is None else UNITS[offered.unit].si
    told = told or _SI_OF_MESSAGE.get((source.field or "").rpartition(".")[0])
    if told is not None and told not in SCALED_BY_GAIN and told != si:
        return 0, 0.0, ""
    if source.column == column:
        return EXACT, 1.0, "the very name"
    if parts is None:
        return _rated_wrench(source, column)
    if source.topic is not None and (source.joint, source.field) == (parts.joint, parts.field):
        if source.topic.strip("/").endswith(f"step/{parts.role}"):  # has every step; joint states are decimated
            return EXACT, 2.0, "the twin's own topic"
        if source.topic.strip("/").endswith(_TWIN_TOPICS[parts.role]):
            fits = len(_TWIN_TOPICS[parts.role]) / 100.0  # motor/joint_states before joint_states
            return EXACT, 1.0 + fits, "the twin's own topic"
        return NEAR, 1.0, "joint and field have the very names"
    words = re.findall(r"[a-z]+", source.label.lower())
    field = source.field if source.joint is not None else _field(words, offered.unit)
    if field != parts.field:
        return 0, 0.0, ""
    kind, _, number = parts.joint.partition("_")
    known = JOINT_WORDS.get(kind if number.isdigit() else parts.joint, (parts.joint,))
    joint = _likeness(words, known) + (0.1 if number.isdigit() and number in re.findall(r"\d+", source.label) else 0.0)
    role = ROLES.get(parts.role, 0.0)
    if joint >= ALIKE:
        return NEAR, joint + role, "a near name"
    if source.field is None or joint <= 0.5:
        return 0, 0.0, ""
    return UNSURE, joint + role, "only the kind of quantity fits"


def _rated_wrench(source: Source, column: str) -> tuple[int, float, str]:
    pin, _, component = column.removeprefix("forces.").rpartition(".")
    if source.topic is None or _WRENCH.get(source.field or "") != component or not pin:
        return 0, 0.0, ""
    topic = source.topic.strip("/")
    if topic.endswith(f"forces/{pin}"):
        return EXACT, 1.0, "the twin's own topic"
    return (NEAR, 2.0, "the topic has the name of the pin") if topic.rpartition("/")[2] == pin else (0, 0.0, "")


def _field(words: Sequence[str], unit: str | None) -> str | None:
    if unit is not None:
        return _FIELD_OF_SI.get(UNITS[unit].si)
    return next((field for field, known in FIELD_WORDS.items() if set(words) & set(known)), None)


def _likeness(words: Sequence[str], known: Sequence[str]) -> float:
    """Return the largest similarity of the words with a known name; earlier ones have a slightly higher weight."""

    def nearest(part: str) -> float:
        return max((SequenceMatcher(None, word, part).ratio() for word in words), default=0.0)

    alike = (fmean(map(nearest, name.split("_"))) - 0.002 * place for place, name in enumerate(known))
    return max(0.0, *alike)


def map_of(machine: str, time: TimeSource, channels: Sequence[ProposedChannel]) -> MeasurementMap | None:
    """Return the map of the channels with sufficient certainty; None without any."""
    sure = [each for each in channels if each.surety > UNSURE]
    if not sure:
        return None
    return MeasurementMap(machine=machine, time=time, channels=tuple(_channel(each) for each in sure))


def _channel(proposed: ProposedChannel) -> Channel:
    known = {"source": proposed.source, "is": proposed.column, "unit": proposed.unit, "sign": proposed.sign}
    return Channel.model_validate({**known, **_unknowns(proposed)})


def _unknowns(proposed: ProposedChannel) -> dict[str, object]:
    """Return zero, gain and lag that must be estimated; none for a channel with the twin's own name."""
    if proposed.surety == EXACT:
        return {}
    parts = joint_column(proposed.column)
    unknowns: dict[str, object] = {}
    if parts is not None and parts.field == "position":
        unknowns["zero"] = "per_run" if parts.joint in ("crank", "drum", "motor", "rotor") else "free"
    if proposed.unit in SCALED_BY_GAIN:
        unknowns["gain"] = "free"
    if parts is not None and (parts.joint not in ("crank", "drum") or parts.field != "position"):
        unknowns["lag_s"] = "free"
    return unknowns


def map_text(
    machine: str,
    time: TimeSource,
    channels: Sequence[ProposedChannel],
    notes: Mapping[str, str],
    columns: Mapping[str, str],
    runs: Sequence[Path] = (),
    offered: Sequence[Source] = (),
) -> str:
    """Return the proposed map as YAML; unsure channels are comments in it, and names of those that it leaves out.

    Parameters
    ----------
    notes : mapping
        Further remarks by the label of a channel's source, such as the correlation.
    columns : mapping
        SI unit of each column of the machine.
    """
    clock = ", ".join(f"{key}: {_quoted(value)}" for key, value in time.model_dump(exclude_none=True).items() if value)
    lines = [f"machine: {machine}", f"time: {{{clock}}}"]
    if time.column and time_unit_in(time.column) is None:
        word = unread_unit(time.column)
        said = f"{word!r} is no unit of a map; {time.unit} is assumed" if word else f"{time.unit}, not told by the name"
        lines += _comment("  ", f"unit: {said}")
    lines.append("channels:")
    for each in channels:
        lead = "  # " if each.surety == UNSURE else "  "
        remark = "; ".join(word for word in (each.reason, notes.get(each.source.label, "")) if word)
        lines += [*_source(lead, each.source), *_comment(f"{lead}  ", remark), f"{lead}  is: {each.column}"]
        assumed = f"unit: {unknown_unit(each) or 'none in the name'}; {columns[each.column]} is assumed"
        lines += [f"{lead}  unit: {each.unit}"] if each.unit else _comment(f"{lead}  ", assumed)
        lines += [f"{lead}  sign: -1"] if each.sign < 0 else []
        lines += [f"{lead}  {key}: {value}" for key, value in _unknowns(each).items()]
        lines += [line for remark in _remarks(each) for line in _comment(f"{lead}  ", remark)]
    lines += _left_out(machine, channels, offered)
    if runs:
        lines.append(f"runs: [{', '.join(_quoted(str(run)) for run in runs)}]")
    return "\n".join(lines) + "\n"


def unknown_unit(each: ProposedChannel) -> str | None:
    """Return the remark on a unit in the channel's name that no map has; None without one."""
    word = None if each.unit else unread_unit(each.source.column or "")
    return word and f"{word!r} is no unit of a map"


def _left_out(machine: str, channels: Sequence[ProposedChannel], offered: Sequence[Source]) -> list[str]:
    """Return comment lines with the channels that are not in the map."""
    mapped = {each.source.label for each in channels}
    labels = [source.label for source in offered if source.label not in mapped]
    named = [_quoted(label) for label in labels[:MOST_LEFT_OUT]]
    more = [f"and {len(labels) - MOST_LEFT_OUT} more"] if len(labels) > MOST_LEFT_OUT else []
    words = f"left out, no other column of {machine} fits by its name: {', '.join(named + more)}"
    return _comment("", words) if labels else []


def _source(lead: str, source: Source) -> list[str]:
    """Return the lines of a source: a single one if it is short enough."""
    parts = [f"{key}: {_quoted(value)}" for key, value in source.model_dump(exclude_none=True).items()]
    line = f"{lead}- source: {{{', '.join(parts)}}}"
    return [line] if len(line) <= WIDTH else [f"{lead}- source:", *(f"{lead}    {part}" for part in parts)]


def _comment(lead: str, words: str) -> list[str]:
    """Return text as comment lines; they remain comments if the user uncomments the entry."""
    return wrap(words, WIDTH, initial_indent=f"{lead}# ", subsequent_indent=f"{lead}# ", break_long_words=False)


def _remarks(each: ProposedChannel) -> list[str]:
    parts = joint_column(each.column)
    if each.surety == EXACT or parts is None:
        return []
    if parts.field == "velocity" and each.source.joint is None:
        return ["a speed that was differentiated has the lag of that filter, and is not independent of its position"]
    if parts.field == "effort" and each.unit is None:
        return ["torque or current? a current has unit: A, and gain: N m per A, or free"]
    return []


def _quoted(value: str) -> str:
    plain = re.fullmatch(r"[A-Za-z_/][\w/.~-]*", value) is not None
    return value if plain else '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
