# SPDX-License-Identifier: Apache-2.0
"""What a run came to, for people: numbers in groups, events that matter, worst residuals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from mech_twin.capabilities.shorter_steps import InShorterSteps
from mech_twin.cli.console import numbered, print_csv, print_table, say_result
from mech_twin.cli.metric_groups import CHECKS, group_rows, grouped, headlines
from mech_twin.samples import Event
from mech_twin.studies.shorter_steps import told

SHOWN_EVENTS = 12
NO_NUMBERS: Mapping[str, float] = MappingProxyType({})
HOLDS, BROKEN = "holds", "broken"
AUDIBLE_M_PER_S = 1e-3  # slower impacts are the end of a series that dies out
EVENT_COLUMNS = ("time, s", "kind", "contact", "before, m/s", "after, m/s", "impulse, N s")


def shorter_record(shorter: InShorterSteps | None) -> dict[str, Any]:
    """Return what a JSON document says of shorter steps: nothing where there were none."""
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
    groups = {
        group: values if everything else headlines(values, group) for group, values in grouped(numbers, design).items()
    }
    shown = {
        group: values if group == CHECKS else {name: told(name, value, shorter) for name, value in values.items()}
        for group, values in groups.items()
    }
    show_groups(title, shown)
    left = len(numbers) - sum(map(len, groups.values()))
    if left:
        say_result(f"{left} more numbers with --all; docs/glossary.md says what each is")


def in_common_digits(numbers: Mapping[str, Any], shorter: InShorterSteps | None) -> dict[str, Any]:
    """Return numbers in the digits that they have in shorter steps too, where they come from a run."""
    beside = NO_NUMBERS if shorter is None else shorter.numbers
    return {name: told(name, value, beside) for name, value in numbers.items()}


def how_told(step_s: float, shorter_s: float | None = None, failure: str = "") -> str:
    """Return the line that says how far the numbers of a run depend on its coupling step."""
    if shorter_s is not None and failure:
        checked = f"the check in steps of {shorter_s * 1e3:.3g} ms failed ({failure})"
        return f"one run in steps of {step_s * 1e3:g} ms: {checked}; the last digits depend on the step"
    if shorter_s is None:
        return f"one run in steps of {step_s * 1e3:g} ms: the last digits depend on the step; `simulate` tells how many"
    steps = f"steps of {step_s * 1e3:g} ms and of {shorter_s * 1e3:.3g} ms"
    return f"digits told are those that {steps} have in common, else both numbers; --json has all digits of both"


def show_groups(title: str, groups: Mapping[str, Mapping[str, Any]]) -> None:
    """Write numbers with their units, each group that has any below its name."""
    rows = {group: {row[0]: row for row in numbered(values)} for group, values in groups.items() if values}
    print_table(title, ("quantity", "value", "unit"), group_rows(rows, 3))


def show_residuals(residuals: Mapping[str, Mapping[str, Any]]) -> None:
    """Write the worst of each residual beside its limit, and whether it holds; NaN does not."""
    rows = [(name, r["worst"], r["limit"], _state(r)) for name, r in residuals.items()]
    print_table("worst residuals", ("residual", "worst", "limit", "state"), rows)
    holding = sum(row[-1] == HOLDS for row in rows)
    say_result(f"{holding} of {len(rows)} checks within their limits")


def _state(residual: Mapping[str, Any]) -> str:
    return HOLDS if residual["worst"] <= residual["limit"] else BROKEN


def show_events(events: Sequence[Event], *, everything: bool) -> None:
    """Write how many events of which kind there were, and the last that matter, or all."""
    if not events:
        return
    counts = Counter(event.kind for event in events)
    kinds = ", ".join(f"{count} {kind}" for kind, count in counts.most_common())
    say_result(f"{len(events)} event{'s' if len(events) > 1 else ''}: {kinds}")
    matter = events if everything else [event for event in events if is_notable(event)]
    shown = matter if everything else matter[-SHOWN_EVENTS:]
    left = len(events) - len(shown)
    title = "events" if not left else f"last {len(shown)} events; {left} more with --all, also below 1 mm/s"
    print_table(title, EVENT_COLUMNS, [_row(event) for event in shown])


def is_notable(event: Event) -> bool:
    """Return whether an event is a blow, an impact above 1 mm/s, or a change of state."""
    return event.impulse_ns == 0.0 or abs(event.pre_velocity_m_per_s) > AUDIBLE_M_PER_S


def print_numbers_csv(numbers: Mapping[str, Any], shorter: Mapping[str, float] = NO_NUMBERS) -> None:
    """Write every number with its unit, and its value in shorter steps where it has one, as comma-separated values."""
    rows = [(*row, shorter.get(row[0], "")) for row in numbered(numbers)]
    print_csv(("quantity", "value", "unit", "in shorter steps"), rows)


def _row(event: Event) -> tuple[Any, ...]:
    if event.impulse_ns == 0.0:
        return (f"{event.time_s:.5f}", event.kind, event.contact, "-", "-", "-")
    speeds = (event.pre_velocity_m_per_s, event.post_velocity_m_per_s)
    return (f"{event.time_s:.5f}", event.kind, event.contact, *(f"{speed:.4g}" for speed in speeds), event.impulse_ns)
