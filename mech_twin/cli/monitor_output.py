# SPDX-License-Identifier: Apache-2.0
"""What `mech-twin monitor` prints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any, NamedTuple

from mech_twin.capabilities.cycle import CycleFeature
from mech_twin.cli.console import print_json, print_table, say
from mech_twin.studies.monitoring.charts import CHARTS
from mech_twin.studies.monitoring.design import SensorDesign
from mech_twin.studies.monitoring.explanation import Explanation
from mech_twin.studies.monitoring.monitor import MonitorSetup
from mech_twin.studies.monitoring.report import Alarm, JudgedRun


class Judged(NamedTuple):
    """A run by its name, what was found in it, and what speaks for and against a fault that was asked for."""

    run: str
    found: JudgedRun
    why: tuple[Explanation, ...] = ()


def show_runs(setup: MonitorSetup, units: Mapping[str, str], runs: Sequence[Judged], *, as_json: bool) -> None:
    """Print the baseline, and each run's alarms with the faults that explain them."""
    if as_json:
        print_json({**_setup_record(setup, units), "runs": [_run_record(run) for run in runs]})
        return
    _say_setup(setup)
    for run in runs:
        for value in run.found.operating:
            say(
                f"{run.run}: operating_point: {value.name} {_percent(value.share)} "
                f"({_percent(value.low_95)} to {_percent(value.high_95)}) of the baseline's, fair within "
                f"+-{100.0 * value.range:.3g} %"
            )
        if not run.found.alarms:
            say(f"{run.run}: {run.found.cycles} cycles, no alarm")
            continue
        heads = ("alarm at, s", "began at, s", "cycles", "finding", "size", "95 % from", "to", "unit")
        rows = [row for alarm in run.found.alarms for row in _alarm_rows(alarm)]
        print_table(f"{run.run}: {run.found.cycles} cycles, {len(run.found.alarms)} alarms", heads, rows)
    for run in runs:
        for explained in run.why:
            _show_explanation(run.run, explained)
    for run in runs:
        for event in run.found.events:
            say(f"{run.run}: {event.text}")


def _show_explanation(run: str, found: Explanation) -> None:
    fault = found.fault
    verdict = "explains the change" if found.explains else "does not explain the change"
    heads = ("feature", "unit", "healthy", "change", "+-95 %", "fault would", "moved, sigma", "left, sigma")
    rows = [
        (each.name, each.unit, *map(_rounded, (each.healthy, each.change, each.half_95, each.expected)),
         f"{each.moved_sigma:.1f}", f"{each.left_sigma:.1f}")
        for each in found.features
    ]  # fmt: skip
    print_table(
        f"{run}: {fault.name} of {_rounded(fault.size)} {fault.unit} {verdict} since {found.onset_s:.3f} s "
        f"({found.finding}), leaves {100.0 * fault.open_share:.1f} % of it open",
        heads,
        rows,
    )


def show_design(setup: MonitorSetup, design: SensorDesign, features: Sequence[CycleFeature], *, as_json: bool) -> None:
    """Print what a sensor set would find: each fault's effect, the delay to expect, and what looks like it."""
    units = {feature.name: feature.unit for feature in features}
    if as_json:
        names = [fault.name for fault in design.faults]
        matrix = {
            name: dict(zip(names, row, strict=True))
            for name, row in zip(names, design.isolability.tolist(), strict=True)
        }
        faults = [{**fault._asdict(), "delay_cycles": _finite(fault.delay_cycles)} for fault in design.faults]
        faults = [{**fault, "smallest": _finite(fault["smallest"])} for fault in faults]
        print_json({**_setup_record(setup, units), "faults": faults, "isolability": matrix})
        return
    _say_setup(setup)
    heads = ("fault", "size", "unit", "sigma a cycle", "delay, cycles", "found in 50", "looks like")
    rows = [
        (
            fault.name,
            fault.size,
            fault.unit,
            _rounded(fault.effect_sigma),
            _rounded(fault.delay_cycles),
            _rounded(fault.smallest),
            ", ".join(fault.alike) or "none",
        )
        for fault in design.faults
    ]
    print_table(f"{setup.machine}: what these sensors would find", heads, rows)


def _alarm_rows(alarm: Alarm) -> list[tuple[Any, ...]]:
    place = (_rounded(alarm.alarm_s), _rounded(alarm.onset_s), alarm.delay_cycles)
    if not alarm.candidates:
        return [(*place, alarm.verdict, "", "", "", "")]
    return [(*place, candidate.name, *map(_rounded, candidate[1:4]), candidate.unit) for candidate in alarm.candidates]


def _say_setup(setup: MonitorSetup) -> None:
    baseline, limits = setup.baseline, setup.limits
    short = ", extrapolated: the baseline is shorter than three of them" if limits.extrapolated else ""
    say(
        f"baseline: {baseline.cycles} cycles, {len(baseline.names)} features, autoregression of order {baseline.order}"
        f"; one false alarm in {setup.arl0_h:.4g} h{short}"
    )


def _setup_record(setup: MonitorSetup, units: Mapping[str, str]) -> dict[str, Any]:
    baseline, limits = setup.baseline, setup.limits
    numbers = zip(baseline.names, baseline.mean.tolist(), baseline.sigma.tolist(), strict=True)
    return {
        "machine": setup.machine,
        "features": [
            {"name": n, "unit": units.get(n, "1"), "mean": mean, "sigma": sigma} for n, mean, sigma in numbers
        ],
        "baseline": {"cycles": baseline.cycles, "order": baseline.order, "period_s": baseline.period_s},
        "arl0_h": setup.arl0_h,
        "arl0_cycles": limits.arl0_cycles,
        "extrapolated": limits.extrapolated,
        "thresholds": dict(zip(CHARTS, limits.alarm, strict=True)),
    }


def _run_record(run: Judged) -> dict[str, Any]:
    alarms = [{**alarm.record(), "ended_s": _finite(alarm.ended_s)} for alarm in run.found.alarms]
    faults = [life._asdict() | {"shelved_until_s": _finite(life.shelved_until_s)} for life in run.found.faults]
    return {
        "run": run.run,
        "cycles": run.found.cycles,
        "skipped": run.found.skipped,
        "alarms": alarms,
        "faults": faults,
        "events": [event._asdict() for event in run.found.events],
        "operating_point": [value._asdict() for value in run.found.operating],
        **({"explained": [each.record() for each in run.why]} if run.why else {}),
    }


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None


def _percent(share: float) -> str:
    return f"{100.0 * share:+.3g} %"


def _rounded(value: float) -> str:
    return f"{value:.4g}"
