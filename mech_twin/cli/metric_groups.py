# SPDX-License-Identifier: Apache-2.0
"""The numbers of a run in groups - operation, impacts, bearings, design, checks - and the few that say most of each.

Groups and rank follow from the names (docs/glossary.md), so that a machine added later is shown like the others.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from mech_twin.declarations.captions import unit_of

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
        *(
            "blow_rate",
            "blow_energy_j",
            "blow_efficiency",
            "impact_speed",
            "blow_impulse_ns",
            "gap_at_blow",
            "settled_at",
            "spring_force",
        ),
        *("hardest", "feed", "gap", "stop_force"),
        *("blows", "impacts", "contact_events", "layer_work"),
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
    known = frozenset(design)
    found: dict[str, dict[str, Any]] = {group: {} for group in GROUPS}
    for name, value in numbers.items():
        found[group_of(name, known)][name] = value
    return {group: values for group, values in found.items() if values}


def analysed_groups(numbers: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the numbers of an analysis by group; none of them needs a run, so design and checks follow from names."""
    found: dict[str, dict[str, Any]] = {group: {} for group in GROUPS}
    for name, value in numbers.items():
        found[_analysed_group(name)][name] = value
    return {group: values for group, values in found.items() if values}


def _analysed_group(name: str) -> str:
    words = set(name.split("_"))
    if words & COMPARED_WORDS:
        return "checks"
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
    """Return what a number is of, whatever span it is taken over."""
    first, _, rest = name.partition("_")
    return rest if first in SPANS else name
