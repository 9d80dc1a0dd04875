# SPDX-License-Identifier: Apache-2.0
"""What a shadow's sigma is worth: share of true values inside two sigma, on machines with wrong parameters and noise.

    python benchmarks/shadow_coverage.py [--draws 10] [--rate-hz 1000] [MACHINE ...]

Every mass, force, stiffness and friction of the machine is wrong by a normally distributed 2 %, as the shadow assumes.
Printed a machine: share over all joints and forces that move, the column with the least share, time a sample.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mech_twin.engine.rollout import RollOut, roll_out
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import catalogue_entry, machine_parameters
from mech_twin.studies.observer.estimate import SeenSample, SensedChannel
from mech_twin.studies.observer.model_run import without_turns
from mech_twin.studies.observer.observer import PhaseLockedObserver

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))
from wrong_machines import wrong_machine

SENSORS: dict[str, tuple[tuple[str, float], ...]] = {
    "mb10_breaker": (("linkage.crank.position", 1e-3), ("body.body.position", 5e-4)),
    "compaction_press": (("linkage.crank.position", 1e-3),),
    "vibration_crank": (("linkage.crank.position", 1e-3),),
    "impact_mass": (("linkage.mass.position", 1e-4), ("linkage.mass.velocity", 1e-2)),
    "roller_former": (("linkage.drive.position", 1e-3), ("linkage.crank.position", 1e-3)),
    "winding_drum": (
        ("linkage.drum.position", 1e-3),
        ("linkage.yarn.position", 1e-4),
        ("linkage.package_radius.position", 1e-4),
    ),
}
RUN_S, FROM_S = 4.0, 2.0
LEFT_OUT = ("memory", "residual", "regime", "command", "gain", "time_s", "period", "_1", "_work_j")


class Draw(NamedTuple):
    """One wrong machine followed: share inside two sigma by column, samples with an estimate, time a sample (s)."""

    inside: dict[str, float]
    estimates: int
    samples: int
    seconds: float


def followed(
    observer: PhaseLockedObserver, run: RollOut, channels: tuple[tuple[str, float], ...], every: int, seed: int
) -> Draw:
    """Return how well a run was followed, the first fifth of the estimates left out."""
    random, rows = np.random.default_rng(seed), np.column_stack(list(run.columns.values()))
    first = round(FROM_S / observer.step_s) + int(random.integers(200))
    told, true, samples, begin = [], [], 0, time.perf_counter()
    for i in range(first, len(rows), every):
        values = tuple(float(run[name][i] + sigma * random.standard_normal()) for name, sigma in channels)
        estimate = observer.take(SeenSample(1e3 + float(rows[i, 0]), tuple(range(len(channels))), values))
        samples += 1
        if estimate is not None:
            told.append(estimate)
            true.append(rows[i])
    seconds = (time.perf_counter() - begin) / samples
    tail = len(told) // 5
    if len(told) < 20:
        return Draw({}, len(told), samples, seconds)
    x = np.array(true)[tail:]
    difference = np.array([estimate.row for estimate in told])[tail:] - x
    difference[:, observer.run.angles] = without_turns(difference[:, observer.run.angles])
    sigma = np.array([estimate.sigma for estimate in told])[tail:]
    inside = np.mean(np.abs(difference) <= 2.0 * sigma + 1e-9 * np.abs(x).max(axis=0), axis=0)
    unknown = set(observer.undetermined.tolist())
    names = {n: i for n, i in observer.columns.items() if i not in unknown and np.ptp(x[:, i]) > 0.0}
    named = {n: float(inside[i]) for n, i in names.items() if not any(word in n for word in LEFT_OUT)}
    return Draw(named, len(told), samples, seconds)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("machines", nargs="*", default=list(CATALOGUE))
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--rate-hz", type=float, default=1000.0)
    parser.add_argument("--columns", action="store_true", help="share of each column")
    asked = parser.parse_args()
    print(f"| machine | followed | inside two sigma | least | column | us a sample |\n|{'---|' * 6}")
    for name in asked.machines:
        entry, channels = catalogue_entry(name), SENSORS[name]
        draws = []
        for seed in range(asked.draws):
            true = wrong_machine(machine_parameters(name), entry.build, seed)
            observer = PhaseLockedObserver(
                entry.build(machine_parameters(name)), entry.build, [SensedChannel(*channel) for channel in channels]
            )
            every = max(1, round(1.0 / asked.rate_hz / true.coupling_step_s))
            draws.append(followed(observer, roll_out(true, RUN_S), channels, every, seed))
        told = sum(draw.estimates for draw in draws) / sum(draw.samples for draw in draws)
        columns = {n: float(np.mean([d.inside[n] for d in draws if n in d.inside])) for d in draws for n in d.inside}
        least = min(columns, key=lambda n: columns[n], default="-")
        mean = float(np.mean(list(columns.values()))) if columns else float("nan")
        took = 1e6 * float(np.mean([draw.seconds for draw in draws]))
        print(
            f"| {name} | {told:.3f} | {mean:.3f} | {columns.get(least, float('nan')):.3f} | {least} | {took:.0f} |",
            flush=True,
        )
        if asked.columns:
            for column, share in columns.items():
                print(f"    {column} {share:.3f}")


if __name__ == "__main__":
    main()
