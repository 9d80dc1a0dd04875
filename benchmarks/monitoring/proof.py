# SPDX-License-Identifier: Apache-2.0
"""Proof of the monitor on simulated machines: false alarms on healthy cycles, and every fault at three sizes.

    python benchmarks/monitoring/proof.py MACHINE [--healthy CYCLES] [--repeats N] [--minutes M] [--processes N]

Sensors are those of benchmarks/monitoring/sensors; the supply wanders slowly.  Healthy cycles are counted against the
Poisson interval of the stated mean run length.  A fault is a change of parameters at a random instant of a cycle; each
motion is seen through fresh noise in a few repeats.

The work is cut into pieces with seeds of their own, spread over processes.  Results stand in
benchmarks/monitoring/results/MACHINE.json after each piece; a later call goes on from there, ``--anew`` begins anew and
``--faults-anew`` keeps the healthy cycles.  `tables.py` makes the tables of the page.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from functools import cache
from multiprocessing import get_context
from os import cpu_count
from pathlib import Path
from typing import Any

import numpy as np
from plants import faulty_run, healthy_cycles, monitored_machine, three_sizes

from mech_twin.output_file import written_file
from mech_twin.studies.monitoring.baseline import fitted_baseline
from mech_twin.studies.monitoring.cycle_features import feed_channels
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup, setup_of_record
from mech_twin.studies.monitoring.sensing import seen_roll_out
from mech_twin.studies.monitoring.signatures import machine_signatures
from mech_twin.studies.monitoring.thresholds import chart_limits

RESULTS = Path(__file__).parent / "results"
PIECE_CYCLES = 4000  # healthy cycles watched without beginning anew
NOISES = 5  # repeats of one motion
TRIAL_ARL0 = 1e5
KINDS = ("right", "group", "wrong_group", "wrong", "unknown", "none")


def setups(name: str, baseline_cycles: int, arl0_cycles: float, seed: int, anew: bool) -> dict[str, Any]:
    """Return the frozen setups, of the healthy count and of the faults, as JSON values; kept in a file."""
    kept, asked = RESULTS / f"{name}.setup.json", {"baseline": baseline_cycles, "arl0": arl0_cycles, "seed": seed}
    if kept.exists() and not anew:
        record: dict[str, Any] = json.loads(kept.read_text(encoding="utf-8"))
        if record["asked"] == asked:
            return record
    machine = monitored_machine(name)
    vectors = healthy_cycles(machine, baseline_cycles, np.random.default_rng([seed, 0]))
    baseline, innovations = fitted_baseline(vectors)
    signatures = machine_signatures(machine, baseline.names)

    def setup(arl0: float) -> dict[str, Any]:
        limits = chart_limits(baseline, innovations, arl0)
        return MonitorSetup(name, baseline, limits, signatures, machine.declared.settling_cycles).record()

    record = {"asked": asked, "healthy": setup(arl0_cycles), "trial": setup(TRIAL_ARL0)}
    _keep(kept, record)
    return record


def healthy_piece(name: str, setup: dict[str, Any], seed: int, piece: int) -> dict[str, Any]:
    """Return how many healthy cycles of a piece were watched, and the alarms in them."""
    monitor, alarms, watched = Monitor(_known(json.dumps(setup))), 0, 0
    random = np.random.default_rng([seed, 1, piece])
    for vector in healthy_cycles(monitored_machine(name), PIECE_CYCLES, random):
        found = monitor.observe(vector)
        alarms += found.alarm_begins
        watched += found.charts is not None and (found.alarm_begins or not found.alarm)
    return {"cycles": watched, "alarms": alarms}


def faulty_piece(name: str, setup: dict[str, Any], seed: int, fault: str, size: float, piece: int) -> dict[str, Any]:
    """Return how often a fault was found in a few repeats of one motion, how soon, and how it was named."""
    known, machine = _known(json.dumps(setup)), monitored_machine(name)
    declared = next(each for each in machine.faults if each.name == fault)
    place = [each.name for each in machine.faults].index(fault)
    random = np.random.default_rng([seed, 2, place, round(1e6 * abs(size)), piece])
    run = faulty_run(machine, declared, size, known.baseline.period_s, random)
    told: dict[str, Any] = {"early": 0, "delays": [], "kinds": Counter(), "wrong_names": Counter()}
    if run is None:
        return told
    step_s, begin_s = machine.entry.build(machine.parameters).coupling_step_s, machine.declared.run_up_s
    for _ in range(NOISES):
        monitor, alarm_s, last = Monitor(known), None, None
        for vector in feed_channels(machine.feed(), seen_roll_out(run[0], machine.sensors, step_s, random, begin_s)):
            last = monitor.observe(vector)
            if last.alarm_begins and alarm_s is None:
                alarm_s = last.time_s
        if alarm_s is not None and alarm_s < run[1]:
            told["early"] += 1
            continue
        if alarm_s is None or last is None:
            told["kinds"]["none"] += 1
            continue
        told["delays"].append(round((alarm_s - run[1]) / known.baseline.period_s, 2))
        kind = judgement(last.verdict, fault, [candidate.name for candidate in last.candidates])
        told["kinds"][kind] += 1
        if kind.startswith("wrong"):
            told["wrong_names"][last.finding] += 1
    return told


def judgement(verdict: str, fault: str, names: list[str]) -> str:
    """Return whether the fault was named alone, in a group, wrongly, called unknown, or not named at all."""
    if fault in names:
        return "right" if len(names) == 1 else "group"
    return {"named": "wrong", "group": "wrong_group", "unknown": "unknown"}.get(verdict, "none")


@cache
def _known(setup: str) -> MonitorSetup:
    return setup_of_record(json.loads(setup))


class Proof:
    """Results of one machine, on disk after each piece.

    Parameters
    ----------
    name : str
        The machine.
    setup : dict
        What `setups` returned.
    """

    def __init__(self, name: str, setup: dict[str, Any]) -> None:
        self.path, self.setup = RESULTS / f"{name}.json", setup
        baseline = setup["trial"]["baseline"]
        self.record: dict[str, Any] = {
            "machine": name, "asked": setup["asked"], "period_s": baseline["period_s"],
            "features": len(baseline["names"]), "order": len(baseline["coefficients"]),
            "baseline_cycles": baseline["cycles"], "trial_arl0_cycles": TRIAL_ARL0,
            "healthy": {"pieces": 0, "cycles": 0, "alarms": 0}, "faults": {},
        }  # fmt: skip

    def go_on(self, keep_faults: bool) -> None:
        """Take what an earlier call found with the same setup."""
        if not self.path.exists():
            return
        earlier = json.loads(self.path.read_text(encoding="utf-8"))
        if earlier["asked"] == self.record["asked"]:
            self.record["healthy"] = earlier["healthy"]
            self.record["faults"] = earlier["faults"] if keep_faults else {}

    def calls(self, healthy: int, repeats: int) -> Iterator[tuple[Callable[..., None], Callable[..., Any], tuple]]:
        """Yield what to do with an answer, what to call and its arguments; faults first, every one in turn."""
        name, seed = self.record["machine"], self.record["asked"]["seed"]
        rows = self._rows()
        for piece in range(-(-repeats // NOISES)):
            for row in rows:
                if row["pieces"] <= piece:
                    given = (name, self.setup["trial"], seed, row["fault"], row["size"], piece)
                    yield row_adder(row), faulty_piece, given
        piece = self.record["healthy"]["pieces"]
        while self.record["healthy"]["cycles"] < healthy:
            yield self._add_healthy, healthy_piece, (name, self.setup["healthy"], seed, piece)
            piece += 1

    def _rows(self) -> list[dict[str, Any]]:
        rows = self.record["faults"]
        for fault in monitored_machine(self.record["machine"]).faults:
            for size in three_sizes(fault):
                empty = {"pieces": 0, "early": 0, "delays": [], "kinds": dict.fromkeys(KINDS, 0), "wrong_names": {}}
                told = {"fault": fault.name, "size": size, "unit": fault.unit}
                rows.setdefault(f"{fault.name} {size:.6g}", told | empty)
        return list(rows.values())

    def _add_healthy(self, found: dict[str, Any]) -> None:
        healthy = self.record["healthy"]
        healthy["pieces"] += 1
        for key in ("cycles", "alarms"):
            healthy[key] += found[key]

    def keep(self) -> None:
        """Write the results."""
        _keep(self.path, self.record)


def row_adder(row: dict[str, Any]) -> Callable[[dict[str, Any]], None]:
    """Return what adds a piece to a row."""

    def add(found: dict[str, Any]) -> None:
        row["pieces"] += 1
        row["early"] += found["early"]
        row["delays"] += found["delays"]
        for key in ("kinds", "wrong_names"):
            row[key] = dict(Counter(row[key]) + Counter(found[key]))

    return add


def _keep(path: Path, record: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with written_file(path, force=True) as temporary:
        temporary.write_text(json.dumps(record) + "\n", encoding="utf-8")


def worked_off(proof: Proof, healthy: int, repeats: int, processes: int, until: float) -> None:
    """Compute piece after piece until all is done or the time is over; pieces are added in the order they were given.

    Only a prefix of the pieces counts, so the time that a piece takes does not choose which ones do.
    """
    calls, waiting = proof.calls(healthy, repeats), list[tuple[Callable[..., None], Future[Any]]]()
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        while True:
            while len(waiting) < 2 * processes and time.monotonic() < until:
                call = next(calls, None)
                if call is None:
                    break
                waiting.append((call[0], pool.submit(call[1], *call[2])))
            if not waiting:
                return
            wait([waiting[0][1]], return_when=FIRST_COMPLETED)
            add, future = waiting.pop(0)
            add(future.result())
            proof.keep()


def main() -> None:
    """Go on with the proof of a machine."""
    asked = argparse.ArgumentParser(description="proof of the monitor on a simulated machine")
    asked.add_argument("machine")
    asked.add_argument("--baseline", type=int, default=10_000, help="healthy cycles of the baseline")
    asked.add_argument("--healthy", type=int, default=1_000_000, help="healthy cycles that are judged")
    asked.add_argument("--arl0", type=float, default=1000.0, help="stated cycles between false alarms, of those")
    asked.add_argument("--repeats", type=int, default=200, help="of each fault and size")
    asked.add_argument("--seed", type=int, default=1)
    asked.add_argument("--minutes", type=float, default=float("inf"), help="time after which no piece is begun")
    asked.add_argument("--processes", type=int, default=cpu_count() or 1)
    asked.add_argument("--anew", action="store_true", help="forget what was found before")
    asked.add_argument("--faults-anew", action="store_true", help="forget what was found about faults")
    given = asked.parse_args()
    until = time.monotonic() + 60.0 * given.minutes
    proof = Proof(given.machine, setups(given.machine, given.baseline, given.arl0, given.seed, given.anew))
    if not given.anew:
        proof.go_on(not given.faults_anew)
    worked_off(proof, given.healthy, given.repeats, given.processes, until)
    healthy = proof.record["healthy"]
    print(f"{given.machine}: {healthy['cycles']} healthy cycles, {healthy['alarms']} alarms")


if __name__ == "__main__":
    main()
