# SPDX-License-Identifier: Apache-2.0
"""Onset of a change: the monitor beside an offline change-point library, ruptures, on the same runs.

    python benchmarks/monitoring/offline_peer.py [MACHINE ...] [--repeats N] [--write]

The peer sees the whole run at once, whitened by the same baseline, and is told that there is one change (dynamic
programming, least squares); the monitor sees cycle after cycle and is told nothing.  The error of the onset, in cycles.
"""

from __future__ import annotations

import argparse
from typing import NamedTuple

import numpy as np
import ruptures
from plants import SENSORS, faulty_run, healthy_cycles, monitored_machine, three_sizes
from tables import RESULTS

from mech_twin.capabilities.faults import MachineFault
from mech_twin.studies.monitoring.baseline import fitted_baseline
from mech_twin.studies.monitoring.charts import chart_limits
from mech_twin.studies.monitoring.cycle_features import feed_channels
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup
from mech_twin.studies.monitoring.report import judged_run
from mech_twin.studies.monitoring.sensing import MonitoredMachine, seen_roll_out

TABLE = RESULTS / "offline_peer.csv"
COLUMNS = "machine,fault,size,runs,no_alarm,monitor_median,monitor_90,ruptures_median,ruptures_90"
HEAD = (
    "| machine | fault | size | runs | no alarm | monitor, median | 90 % | ruptures, median | 90 % |",
    f"|{'---|' * 9}",
)
NOISES = 5  # repeats of one motion


class Errors(NamedTuple):
    """Errors of the onset in cycles, of the monitor where it gave alarm and of the peer; runs."""

    own: list[float]
    peer: list[float]
    runs: int


def onset_errors(machine: MonitoredMachine, setup: MonitorSetup, fault: MachineFault, size: float, runs: int) -> Errors:
    """Return the errors of the onset of a fault in so many runs."""
    baseline, found = setup.baseline, Errors([], [], runs)
    step_s, begin_s = machine.entry.build(machine.parameters).coupling_step_s, machine.declared.run_up_s
    random = np.random.default_rng([7, round(1e6 * abs(size))])
    for repeat in range(runs):
        if repeat % NOISES == 0:
            rolled = faulty_run(machine, fault, size, baseline.period_s, random)
        if rolled is None:
            return Errors([], [], 0)
        run, change_s = rolled
        vectors = feed_channels(machine.feed(), seen_roll_out(run, machine.sensors, step_s, random, begin_s))
        told = judged_run(Monitor(setup), vectors)
        if told.alarms:
            found.own.append(abs(told.alarms[0].onset_s - change_s) / baseline.period_s)
        rows = np.array([v.values[[v.names.index(name) for name in baseline.names]] for v in vectors])
        white = baseline.whitened(baseline.innovations(rows))
        place = ruptures.Dynp(model="l2", min_size=3, jump=1).fit(white).predict(n_bkps=1)[0] + baseline.order
        begun_s = vectors[min(place, len(vectors) - 1)].begin_s
        found.peer.append(abs(begun_s - change_s) / baseline.period_s)
    return found


def _shown(errors: list[float]) -> str:
    return f"{np.median(errors):.1f} | {np.quantile(errors, 0.9):.1f}" if errors else " | "


def machine_rows(name: str, runs: int, baseline_cycles: int) -> list[str]:
    """Return the rows of a machine."""
    machine = monitored_machine(name)
    baseline, innovations = fitted_baseline(healthy_cycles(machine, baseline_cycles, np.random.default_rng(1)))
    setup = MonitorSetup(name, baseline, chart_limits(baseline, innovations, 1e5))
    rows = []
    for fault in machine.faults:
        for size in three_sizes(fault):
            found = onset_errors(machine, setup, fault, size, runs)
            if not found.runs:
                continue
            told = f"{100.0 * size:.3g} %" if fault.unit == "1" else f"{size:.3g} {fault.unit}"
            missed = found.runs - len(found.own)
            rows.append(
                f"| {name} | {fault.name} | {told} | {found.runs} | {missed} "
                f"| {_shown(found.own)} | {_shown(found.peer)} |"
            )
            print(rows[-1], flush=True)
    return rows


def main() -> None:
    """Print the table, or write it as CSV as well."""
    asked = argparse.ArgumentParser(description="onset of a change, beside an offline library")
    asked.add_argument("machines", nargs="*", default=sorted(path.stem for path in SENSORS.glob("*.yaml")))
    asked.add_argument("--repeats", type=int, default=20)
    asked.add_argument("--baseline", type=int, default=2000)
    asked.add_argument("--write", action="store_true", help="into results/offline_peer.csv")
    given = asked.parse_args()
    print("\n".join(HEAD))
    rows = [row for name in given.machines for row in machine_rows(name, given.repeats, given.baseline)]
    if given.write:
        cells = [",".join(cell.strip() for cell in row.strip("| ").split("|")) for row in rows]
        TABLE.write_text("\n".join([COLUMNS, *cells, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
