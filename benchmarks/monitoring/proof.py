# SPDX-License-Identifier: Apache-2.0
"""Proof of the monitor on simulated machines: false alarms on healthy cycles, and every fault at three sizes.

    python benchmarks/monitoring/proof.py [MACHINE ...] [--only healthy] [--minutes M] [--processes N]

Sensors are those of benchmarks/monitoring/sensors; the supply wanders slowly.  Healthy cycles are counted against the
stated mean run length.  That is a mean over baselines, each of which has errors of its own; so each piece draws a
baseline and judges other cycles by it, each motion seen once: what its supply does would be the same in every view of
it.  A fault is a change of parameters at a random instant of a cycle; each motion is seen through fresh noise in a few
repeats.

The work is cut into pieces with seeds of their own, spread over processes; of several machines the one that has had
the least time comes next.  Results stand in benchmarks/monitoring/results/MACHINE.json after each piece; a later call
goes on from there, ``--anew`` begins anew and ``--faults-anew`` keeps the healthy cycles.  `tables.py` makes the
tables of the page.
"""

from __future__ import annotations

import argparse
import json
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from functools import cache
from multiprocessing import get_context
from os import cpu_count
from pathlib import Path
from typing import Any

import numpy as np
from plants import FAR, SENSORS, faulty_run, healthy_cycles, healthy_run, monitored_machine, seen_vectors, three_sizes

from mech_twin.files.output_file import plain, written_file
from mech_twin.studies.monitoring.cycle_features import FeatureVector
from mech_twin.studies.monitoring.findings import Findings
from mech_twin.studies.monitoring.monitor import NAMED_EVERY, Monitor, MonitorSetup
from mech_twin.studies.monitoring.sensor_design import setup_for_cycles
from mech_twin.studies.monitoring.setup_record import SETUP

RESULTS = Path(__file__).parent / "results"
NOISES = 10  # repeats of one motion with a fault
JUDGED_A_BASELINE = 4  # healthy cycles that are judged by a baseline, over its own
TRIAL_ARL0 = 1e5
NAMES = ("named", "group", "unknown")
Call = tuple[Callable[[dict[str, Any]], None], Callable[..., dict[str, Any]], tuple[Any, ...]]
KINDS = ("right", "group", "wrong_group", "wrong", "unknown", "none")


def drawn_setup(
    name: str, cycles: int, arl0_cycles: float, random: np.random.Generator, *, named: bool = False
) -> MonitorSetup:
    """Return a setup from so many healthy cycles, with signatures if faults are to be named."""
    machine = monitored_machine(name)
    vectors = healthy_cycles(machine, cycles, random)
    return setup_for_cycles(machine, vectors, arl0_cycles, named=named)


def trial_setup(name: str, asked: dict[str, Any], anew: bool) -> dict[str, Any]:
    """Return the setup that faults are looked for with, signatures included, as JSON values; kept in a file."""
    kept = RESULTS / f"{name}.trial.setup.json"
    if kept.exists() and not anew:
        earlier: dict[str, Any] = json.loads(kept.read_text(encoding="utf-8"))
        if earlier["asked"] == asked:
            return earlier
    setup = drawn_setup(name, asked["baseline"], TRIAL_ARL0, np.random.default_rng([asked["seed"], 0]), named=True)
    record = plain(setup) | {"asked": asked}
    _keep(kept, record)
    return record


class LateMonitor(Monitor):
    """Names in the last cycles of a run alone: a name depends on the cycles since the onset, not on names before it.

    Parameters
    ----------
    since : int
        Cycle from which on it names.
    """

    since: int = 0

    def _named(self, episode: Any) -> Any:
        return super()._named(episode) if (self._number or 0) >= self.since else episode.named


def healthy_piece(name: str, asked: dict[str, Any], piece: int) -> dict[str, Any]:
    """Return how many healthy cycles were watched with a baseline of their own, and the alarms in them."""
    begun_s, random = time.process_time(), np.random.default_rng([asked["seed"], 1, piece])
    known, machine = drawn_setup(name, asked["baseline"], asked["arl0"], random), monitored_machine(name)
    monitor, first = Monitor(known), 0
    told: dict[str, Any] = {
        "features": len(known.baseline.names), "order": known.baseline.order, "baseline_cycles": known.baseline.cycles,
        "motions": 0, "cycles": 0, "alarms": 0,
    }  # fmt: skip
    while told["cycles"] < JUDGED_A_BASELINE * asked["baseline"]:
        vectors = seen_vectors(machine, healthy_run(machine, random), random)
        for vector in vectors:
            found = monitor.observe(vector._replace(number=first + vector.number))
            told["alarms"] += found.alarm_begins
            told["cycles"] += found.charts is not None and (found.alarm_begins or not found.alarm)
        first += vectors[-1].number + FAR  # apart from the motion before
        told["motions"] += 1
    return told | {"spent_s": time.process_time() - begun_s}


def faulty_piece(name: str, setup: dict[str, Any], seed: int, fault: str, size: float, piece: int) -> dict[str, Any]:
    """Return how often a fault was found in a few repeats of one motion, how soon, and how it was named."""
    known, machine = _known(json.dumps(setup)), monitored_machine(name)
    declared = next(each for each in machine.faults if each.name == fault)
    place = [each.name for each in machine.faults].index(fault)
    random = np.random.default_rng([seed, 2, place, round(1e6 * abs(size)), piece])
    begun_s = time.process_time()
    told: dict[str, Any] = {"early": 0, "delays": [], "kinds": Counter(), "wrong_names": Counter(), "spent_s": 0.0}
    run = faulty_run(machine, declared, size, known.baseline.period_s, random)
    if run is None:
        return told
    for _ in range(NOISES):
        vectors = seen_vectors(machine, run[0], random)
        late = LateMonitor(known)
        late.since = vectors[-1].number - 2 * NAMED_EVERY
        last, alarm_s = watched(late, vectors)
        if last.verdict not in NAMES:
            last, alarm_s = watched(Monitor(known), vectors)
        if alarm_s is not None and alarm_s < run[1]:
            told["early"] += 1
            continue
        if alarm_s is None:
            told["kinds"]["none"] += 1
            continue
        told["delays"].append(round((alarm_s - run[1]) / known.baseline.period_s, 2))
        kind = judgement(last.verdict, fault, [candidate.name for candidate in last.candidates])
        told["kinds"][kind] += 1
        if kind.startswith("wrong"):
            told["wrong_names"][last.finding] += 1
    return told | {"spent_s": time.process_time() - begun_s}


def watched(monitor: Monitor, vectors: Sequence[FeatureVector]) -> tuple[Findings, float | None]:
    """Return what is said after the last cycle, and the stamp of the first alarm."""
    alarm_s: float | None = None
    for vector in vectors:
        last = monitor.observe(vector)
        if last.alarm_begins and alarm_s is None:
            alarm_s = last.time_s
    return last, alarm_s


def judgement(verdict: str, fault: str, names: list[str]) -> str:
    """Return whether the fault was named alone, in a group, wrongly, called unknown, or not named at all."""
    if fault in names:
        return "right" if len(names) == 1 else "group"
    return {"named": "wrong", "group": "wrong_group", "unknown": "unknown"}.get(verdict, "none")


@cache
def _known(setup: str) -> MonitorSetup:
    return SETUP.validate_json(setup)


class Proof:
    """Results of one machine, on disk after each piece.

    Parameters
    ----------
    name : str
        The machine.
    asked : dict
        Cycles of a baseline, stated run length of the healthy count, seed.
    """

    def __init__(self, name: str, asked: dict[str, Any]) -> None:
        self.path = RESULTS / f"{name}.json"
        self.spent_s = {"healthy": 0.0, "faults": 0.0}
        self.record: dict[str, Any] = {
            "machine": name, "asked": asked, "trial_arl0_cycles": TRIAL_ARL0, "healthy": [], "faults": {}
        }  # fmt: skip

    def go_on(self, keep_faults: bool) -> None:
        """Take what an earlier call found with the same setup."""
        if not self.path.exists():
            return
        earlier = json.loads(self.path.read_text(encoding="utf-8"))
        if earlier["asked"] != self.record["asked"]:
            return
        self.record["healthy"] = earlier["healthy"]
        self.record["faults"] = earlier["faults"] if keep_faults else {}

    def healthy_calls(self, healthy: int) -> Iterator[Call]:
        """Yield what to do with an answer, what to call and its arguments, for healthy cycles."""
        name, asked = self.record["machine"], self.record["asked"]
        piece, a_piece = len(self.record["healthy"]), JUDGED_A_BASELINE * asked["baseline"]
        while piece * a_piece < healthy:
            yield self._add_healthy, healthy_piece, (name, asked, piece)
            piece += 1

    def fault_calls(self, repeats: int, anew: bool) -> Iterator[Call]:
        """Yield the same for every fault in turn."""
        name, asked, rows = self.record["machine"], self.record["asked"], self._rows()
        setup = trial_setup(name, asked, anew)
        for piece in range(-(-repeats // NOISES)):
            for row in rows:
                if row["pieces"] <= piece:
                    place = (row["fault"], row["size"], piece)
                    yield self._row_adder(row), faulty_piece, (name, setup, asked["seed"], *place)

    def _rows(self) -> list[dict[str, Any]]:
        rows = self.record["faults"]
        for fault in monitored_machine(self.record["machine"]).faults:
            for size in three_sizes(fault):
                empty = {"pieces": 0, "early": 0, "delays": [], "kinds": dict.fromkeys(KINDS, 0), "wrong_names": {}}
                told = {"fault": fault.name, "size": size, "unit": fault.unit}
                rows.setdefault(f"{fault.name} {size:.6g}", told | empty)
        return list(rows.values())

    def _add_healthy(self, found: dict[str, Any]) -> None:
        self.record["healthy"].append({key: value for key, value in found.items() if key != "spent_s"})
        self._keep("healthy", found)

    def _row_adder(self, row: dict[str, Any]) -> Callable[[dict[str, Any]], None]:
        """Return what adds a piece to a row."""

        def add(found: dict[str, Any]) -> None:
            row["pieces"] += 1
            row["early"] += found["early"]
            row["delays"] += found["delays"]
            for key in ("kinds", "wrong_names"):
                row[key] = dict(Counter(row[key]) + Counter(found[key]))
            self._keep("faults", found)

        return add

    def _keep(self, part: str, found: dict[str, Any]) -> None:
        self.spent_s[part] += found["spent_s"]
        _keep(self.path, self.record)


def _keep(path: Path, record: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with written_file(path, force=True) as temporary:
        temporary.write_text(json.dumps(record) + "\n", encoding="utf-8")


def in_turn(calls: Mapping[tuple[Proof, str], Iterator[Call]]) -> Iterator[Call]:
    """Yield calls, always for the machine and the part of its proof that has had the least time."""
    left = dict(calls)
    while left:
        proof, part = min(left, key=lambda each: each[0].spent_s[each[1]])
        call = next(left[proof, part], None)
        if call is None:
            del left[proof, part]
        else:
            yield call


def worked_off(calls: Iterator[Call], processes: int, until: float) -> None:
    """Compute piece after piece until all is done or the time is over; pieces are added in the order they were given.

    Only a prefix of the pieces counts, so the time that a piece takes does not choose which ones do.
    """
    waiting: list[tuple[Callable[[dict[str, Any]], None], Future[Any]]] = []
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


def main() -> None:
    """Go on with the proof of one machine or more."""
    asked = argparse.ArgumentParser(description="proof of the monitor on simulated machines")
    asked.add_argument("machines", nargs="*", default=sorted(path.stem for path in SENSORS.glob("*.yaml")))
    asked.add_argument("--only", choices=("healthy", "faults"))
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
    setting = {"baseline": given.baseline, "arl0": given.arl0, "seed": given.seed}
    proofs = [Proof(name, setting) for name in given.machines]
    if not given.anew:
        for proof in proofs:
            proof.go_on(not given.faults_anew)
    anew = given.anew or given.faults_anew
    parts: dict[str, Callable[[Proof], Iterator[Call]]] = {
        "faults": lambda proof: proof.fault_calls(given.repeats, anew),
        "healthy": lambda proof: proof.healthy_calls(given.healthy),
    }
    chosen = [part for part in parts if given.only in (None, part)]
    worked_off(
        in_turn({(proof, part): parts[part](proof) for proof in proofs for part in chosen}), given.processes, until
    )
    for proof in proofs:
        cycles, alarms = (sum(piece[key] for piece in proof.record["healthy"]) for key in ("cycles", "alarms"))
        print(f"{proof.record['machine']}: {cycles} healthy cycles, {alarms} alarms")


if __name__ == "__main__":
    main()
