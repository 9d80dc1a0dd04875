# SPDX-License-Identifier: Apache-2.0
"""Onset of a change: the monitor beside an offline change-point library, ruptures, on the same runs.

    python benchmarks/monitoring/offline_peer.py [--machine NAME] [--repeats N]

The peer sees the whole run at once, whitened by the same baseline, and is told that there is one change (dynamic
programming, least squares); the monitor sees cycle after cycle and is told nothing.  The error of the onset, in cycles.
"""

from __future__ import annotations

import argparse

import numpy as np
import ruptures
from proof import BEFORE, monitored_machine, motions, numbered, three_sizes
from proof import healthy_cycles as healthy_runs

from mech_twin.studies.monitoring.baseline import fitted_baseline
from mech_twin.studies.monitoring.cycle_features import feed_channels
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup
from mech_twin.studies.monitoring.report import judged
from mech_twin.studies.monitoring.sensing import seen_roll_out
from mech_twin.studies.monitoring.thresholds import chart_limits


def _shown(errors: list[float]) -> str:
    return f"{np.median(errors):6.2f} {np.quantile(errors, 0.9):8.2f}" if errors else "     -        -"


def main() -> None:
    asked = argparse.ArgumentParser(description="onset of a change, beside an offline library")
    asked.add_argument("--machine", default="impact_mass")
    asked.add_argument("--repeats", type=int, default=30)
    asked.add_argument("--baseline", type=int, default=2000)
    given = asked.parse_args()
    machine = monitored_machine(given.machine)
    runs = list(healthy_runs(machine, given.baseline, np.random.default_rng(1)))
    baseline, innovations = fitted_baseline(numbered(runs))
    setup = MonitorSetup(machine.name, baseline, chart_limits(baseline, innovations, 1e5), ())
    step_s = machine.entry.build(machine.parameters).coupling_step_s
    print("fault                 size      missed  monitor: median error, 90 %   ruptures: median error, 90 %")
    for fault in machine.faults:
        for size in three_sizes(fault):
            own, peer = [], []
            rolled = motions(machine, fault, size, baseline.period_s, 7)
            for repeat in range(given.repeats):
                run, change_s = rolled[repeat % len(rolled)]
                random, begin_s = np.random.default_rng(repeat), machine.declared.run_up_s
                seen = seen_roll_out(run, machine.sensors, step_s, random, begin_s)
                vectors = feed_channels(machine.feed(), seen)
                found = judged(Monitor(setup), vectors)
                if found.alarms:
                    own.append(abs(found.alarms[0].onset_s - change_s) / baseline.period_s)
                rows = np.array([v.values[[v.names.index(name) for name in baseline.names]] for v in vectors])
                white = baseline.whitened(baseline.innovations(rows))
                place = ruptures.Dynp(model="l2", min_size=3).fit(white).predict(n_bkps=1)[0]
                begun_s = vectors[place + baseline.order].begin_s if place + baseline.order < len(vectors) else np.nan
                peer.append(abs(begun_s - change_s) / baseline.period_s)
            told = [_shown(errors) for errors in (own, peer)]
            print(f"{fault.name:20s} {size:8.3g} {given.repeats - len(own):8d}  {told[0]:28s}  {told[1]}", flush=True)
    print(f"{BEFORE} healthy cycles before each change")


if __name__ == "__main__":
    main()
