# SPDX-License-Identifier: Apache-2.0
"""What a run came to, for people: numbers in groups, headlines, events, residuals, what --set throws off."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from operator import itemgetter
from pathlib import Path
from types import MappingProxyType
from typing import Any

from mech_twin.capabilities.arguments import is_number
from mech_twin.capabilities.design import InShorterSteps
from mech_twin.cli.console import numbered, print_table, say, say_result
from mech_twin.declarations.captions import caption, unit_of
from mech_twin.parameters.load import assignments
from mech_twin.parameters.load import machine as built_machine
from mech_twin.samples import Event
from mech_twin.studies.shorter_steps import in_common_digits

SHOWN_EVENTS = 12
NO_NUMBERS: Mapping[str, float] = MappingProxyType({})
AUDIBLE_M_PER_S = 1e-3  # slower impacts are the end of a series that dies out
EVENT_COLUMNS = ("time, s", "kind", "contact", "before, m/s", "after, m/s", "impulse, N s")
TURNING = "rad/s", "rad/s", "N m s"  # units of a stop of a turning joint


def shorter_record(shorter: InShorterSteps | None) -> dict[str, Any]:
    """Return the part of a JSON document on shorter steps; empty without them."""
    return {} if shorter is None else {"shorter_steps": {"step_s": shorter.step_s, "summary": dict(shorter.numbers)}}


def show_numbers(
    title: str,
    numbers: Mapping[str, Any],
    design: Iterable[str],
    shorter: Mapping[str, float] = NO_NUMBERS,
    *,
    everything: bool,
) -> None:
    """Write the numbers of a run in groups: the headlines, or all; in the digits they have in shorter steps too."""
    found = grouped(numbers, design)
    shown = {**in_common_digits(numbers, shorter), **found.get(CHECKS, {})}
    chosen = {group: values if everything else headlines(values, group) for group, values in found.items()}
    groups = {group: {name: shown[name] for name in values} for group, values in chosen.items()}
    show_groups(title, groups)
    if left := len(numbers) - sum(map(len, groups.values())):
        say_result(f"{left} more numbers with --all; docs/glossary.md says what each is")


def digits_note(step_s: float, shorter_s: float | None = None, failure: str = "") -> str:
    """Return the line that says how far the numbers of a run depend on its coupling step."""
    if shorter_s is not None and failure:
        checked = f"the check in steps of {shorter_s * 1e3:.3g} ms failed ({failure})"
        return f"one run in steps of {step_s * 1e3:g} ms: {checked}; the last digits depend on the step"
    if shorter_s is None:
        return f"one run in steps of {step_s * 1e3:g} ms: the last digits depend on the step; `simulate` tells how many"
    steps = f"steps of {step_s * 1e3:g} ms and of {shorter_s * 1e3:.3g} ms"
    return f"digits shown are those that {steps} have in common, else both numbers; --json has all digits of both"


def show_groups(title: str, groups: Mapping[str, Mapping[str, Any]]) -> None:
    """Write numbers with their units, each group that has any below its name."""
    rows = {group: {row[0]: row for row in numbered(values)} for group, values in groups.items() if values}
    print_table(title, ("quantity", "value", "unit"), group_rows(rows, 3))


def show_residuals(residuals: Mapping[str, Mapping[str, Any]]) -> None:
    """Write the worst of each residual beside its limit, and whether it holds; NaN does not."""
    states = {name: "holds" if r["worst"] <= r["limit"] else "broken" for name, r in residuals.items()}
    rows = [(name, r["worst"], r["limit"], states[name]) for name, r in residuals.items()]
    print_table("worst residuals", ("residual", "worst", "limit", "state"), rows)
    holding = list(states.values()).count("holds")
    say_result(f"{holding} of {len(rows)} checks within their limits")


def show_events(
    events: Sequence[Event], counts: Counter[str], numbers: Mapping[str, Any] = NO_NUMBERS, *, everything: bool
) -> None:
    """Write how many events of which kind there were, and the last that matter or all kept; units as in the numbers."""
    if not events:
        return
    kinds = ", ".join(f"{count} {kind}" for kind, count in counts.most_common())
    kept = f"; the newest {len(events)} are kept" if counts.total() > len(events) else ""
    say_result(f"{counts.total()} event{'s' if counts.total() > 1 else ''}: {kinds}{kept}")
    matter = events if everything else [event for event in events if is_notable(event)]
    shown = matter if everything else matter[-SHOWN_EVENTS:]
    left = len(events) - len(shown)
    title = "events" if not left else f"last {len(shown)} events; {left} more with --all, also below 1 mm/s"
    turning = {event.contact for event in shown if f"{event.contact}_impact_speed_max_rad_per_s" in numbers}
    print_table(title, EVENT_COLUMNS, [_row(event, turns=event.contact in turning) for event in shown])


def is_notable(event: Event) -> bool:
    """Return whether an event is a blow, an impact above 1 mm/s, or a change of state."""
    return event.impulse_ns == 0.0 or abs(event.pre_velocity_m_per_s) > AUDIBLE_M_PER_S


def _row(event: Event, *, turns: bool) -> tuple[Any, ...]:
    speeds = [f"{speed:.4g}" for speed in (event.pre_velocity_m_per_s, event.post_velocity_m_per_s)]
    impact: tuple[Any, ...] = ("-", "-", "-") if event.impulse_ns == 0.0 else (*speeds, event.impulse_ns)
    if turns and event.impulse_ns != 0.0:
        numbers = (*speeds, f"{event.impulse_ns:.6g}")
        impact = tuple(f"{number} {unit}" for number, unit in zip(numbers, TURNING, strict=True))
    return (f"{event.time_s:.5f}", event.kind, event.contact, *impact)


CHECKS = "checks"
GROUPS = ("operation", "impacts", "bearings", "design", CHECKS)
HEADLINES = {"operation": 5, "impacts": 8, "bearings": 3}
BEARING_FORCES = 2  # of the headlines of bearings; beside them the largest impulse of a blow
IMPULSE = "N s"
FORCES = ("N", "kN", IMPULSE)
BEARING_WORDS = frozenset({"bearing", "pin", "shaft", "guide", "rod", "shaking", "ground", "harmonic", "rotating"})
IMPACT_WORDS = frozenset(
    {"blow", "blows", "impact", "impacts", "striking", "hardest", "chatter", "contact", "stop", "releases"}
    | {"settled", "spring", "gap", "lift", "feed", "body", "return", "press", "layer", "periods", "rests", "period"}
)
CHECK_WORDS = ("worst_", "energy_unbalanced")
# what an analysis compares or judges, and what of it follows from the dimensions and the rating alone
COMPARED_WORDS = frozenset({"routes", "miss", "margin", "published", "print", "hold", "possible", "difference"})
DESIGN_WORDS = frozenset(
    {"extreme", "stroke", "transmission", "slip", "curvature", "multiplier", "inertia", "mass", "flywheel", "volume"}
    | {"gain", "gamma", "alpha", "top", "bottom", "rest", "frequency", "slope", "swing", "travel", "pivot", "period"}
    | {"striking", "stable", "longest"}
)
RATINGS = ("rated_", "breakdown_")
NO_DIMENSION = ("N m", "W", "J")  # torque, power and energy are of the motion
SPANS = ("steady", "turn", "run")  # the span that says most of a machine at work stands first
# words of the numbers that say most, in order; a number takes the place of the first it has
RANKS = {
    "operation": (
        *("blow_rate", "speed_mean", "speed_max", "largest_absolute_crank_speed", "fluctuation", "uniformity"),
        *("power_mean", "motor_power", "torque_max", "torque_peak", "motor_torque", "rotor_loss", "velocity_max"),
        *("radius", "turns", "drive_work"),
    ),
    "impacts": (
        *("blow_rate", "blow_energy_j", "blow_efficiency", "impact_speed", "blow_impulse_ns", "gap_at_blow"),
        *("settled_at", "spring_force", "hardest", "feed", "gap", "stop_force", "blows", "impacts", "contact_events"),
        "layer_work",
    ),
}


def group_of(name: str, design: Iterable[str] = ()) -> str:
    """Return the group of a number; ``design`` names those that follow from the configuration without a run."""
    words = set(name.split("_"))
    if name.startswith(CHECK_WORDS):
        return "checks"
    if name in design:
        return "design"
    if words & BEARING_WORDS and unit_of(name) in FORCES:
        return "bearings"
    return "impacts" if words & IMPACT_WORDS else "operation"


def grouped(numbers: Mapping[str, Any], design: Iterable[str] = ()) -> dict[str, dict[str, Any]]:
    """Return the numbers by group, in the order of `GROUPS`; empty groups are left out."""
    return _by_group(numbers, partial(group_of, design=frozenset(design)))


def analysed_groups(numbers: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the numbers of an analysis by group; none of them needs a run, so design and checks follow from names."""
    return _by_group(numbers, _analysed_group)


def _by_group(numbers: Mapping[str, Any], group: Callable[[str], str]) -> dict[str, dict[str, Any]]:
    named = {name: group(name) for name in numbers}
    found = {each: {name: numbers[name] for name in named if named[name] == each} for each in GROUPS}
    return {each: values for each, values in found.items() if values}


def _analysed_group(name: str) -> str:
    words = set(name.split("_"))
    if words & COMPARED_WORDS:
        return CHECKS
    if name.startswith(RATINGS):
        return "design"
    group, unit = group_of(name), unit_of(name)
    return "design" if group != "bearings" and words & DESIGN_WORDS and unit not in NO_DIMENSION else group


def group_rows(groups: Mapping[str, Mapping[str, Sequence[Any]]], columns: int) -> list[tuple[Any, ...]]:
    """Return the rows of all groups, each group below a line with its name."""
    rows: list[tuple[Any, ...]] = []
    for group, of_group in groups.items():
        rows += [(f"-- {group}", *[""] * (columns - 1)), *map(tuple, of_group.values())]
    return rows


def headlines(numbers: Mapping[str, Any], group: str) -> dict[str, Any]:
    """Return the few numbers of a group that say most: one of each kind, over the span that says most."""
    if group not in HEADLINES:
        return {}
    order = sorted(numbers, key=lambda name: (_rank(name, numbers[name], group), _span(name)))
    order = [name for name in order if group != "bearings" or not set(name.split("_")) & {"min", "smallest"}]
    if group in RANKS:
        ranks = [_rank(name, numbers[name], group)[0] for name in order]
        order = [name for i, name in enumerate(order) if ranks[i] < len(RANKS[group]) and ranks[i] not in ranks[:i]]
    first = dict.fromkeys(_stem(name) for name in order)
    chosen = [next(name for name in order if _stem(name) == stem) for stem in first]
    if group == "bearings":
        impulses = [name for name in chosen if unit_of(name) == IMPULSE]
        chosen = [name for name in chosen if name not in impulses][:BEARING_FORCES] + impulses
    chosen = chosen[: HEADLINES[group]]
    return {name: numbers[name] for name in chosen}


def _rank(name: str, value: Any, group: str) -> tuple[float, float]:
    """Return the place of a number: forces by their size, others by the words in their names."""
    if group not in RANKS:
        return (0.0 if unit_of(name) in ("N", "kN") else 1.0, -abs(float(value)))
    ranks = RANKS[group]
    return (float(next((i for i, word in enumerate(ranks) if word in name), len(ranks))), 0.0)


def _span(name: str) -> int:
    first = name.partition("_")[0]
    return SPANS.index(first) if first in SPANS else len(SPANS)


def _stem(name: str) -> str:
    """Return the quantity of a number, without the span it is taken over."""
    first, _, rest = name.partition("_")
    return rest if first in SPANS else name


OUT_OF_PROPORTION = 30.0  # times the figure without --set
ROUNDING = 1e-12  # of the largest figure in the same unit: a smaller one is a zero, and no measure of another


def say_consequences(machine: str, config: Path | None, settings: Sequence[str]) -> None:
    """Say the figure that ``--set`` changes most, where that is out of proportion."""
    if not settings:
        return
    before, after = (built_machine(machine, config, changes).report() for changes in ({}, assignments(settings)))
    past = {name: abs(value) for name, value in before.items() if is_number(value) and math.isfinite(value)}
    largest: dict[str, float] = {}
    for name, size in past.items():
        largest[unit_of(name)] = max(size, largest.get(unit_of(name), 0.0))
    known = [name for name in past if past[name] > ROUNDING * largest[unit_of(name)] and is_number(after.get(name))]
    ratios = [(abs(after[name]) / past[name], name) for name in known]
    ratio, name = max((row for row in ratios if math.isfinite(row[0])), key=itemgetter(0), default=(0.0, ""))
    if ratio >= OUT_OF_PROPORTION:
        label, unit = caption(name)
        figure = f"{label} {after[name]:.4g} {unit}"
        say(f"warning: --set {' '.join(settings)}: {figure}, {ratio:.0f} times that without --set")
