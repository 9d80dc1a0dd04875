# SPDX-License-Identifier: Apache-2.0
"""Many machines side by side on a graphics processor, and on all cores, by turns; needs a graphics processor with CUDA.

python benchmarks/graphics_run.py [--members 10000] [--seconds 1]
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import Literal

from comparison import this_machine

import mech_twin
from mech_twin.engine.graphics_run import cuda
from mech_twin.errors import StudyError
from mech_twin.machines.catalog import CATALOGUE

ROUNDS = 3


def seconds(machine: str, members: int, duration_s: float, device: Literal["cpu", "cuda"]) -> float:
    """Return the wall time of a batch (s)."""
    begun = time.perf_counter()
    mech_twin.rollouts(machine, duration_s, [{}] * members, columns=[], device=device)
    return time.perf_counter() - begun


def main() -> None:
    """Measure and print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--members", type=int, default=10_000)
    options.add_argument("--seconds", type=float, default=1.0)
    asked = options.parse_args()
    cuda()
    print(f"{asked.members} machines for {asked.seconds} s, {this_machine()}, best of {ROUNDS} by turns.\n")
    print("| machine | first call, s | graphics processor, s | cores, s | ratio |\n| --- | --- | --- | --- | --- |")
    for machine in CATALOGUE:
        first = seconds(machine, asked.members, asked.seconds, "cuda")
        card = cores = float("inf")
        for _ in range(ROUNDS):
            card = min(card, seconds(machine, asked.members, asked.seconds, "cuda"))
            cores = min(cores, seconds(machine, asked.members, asked.seconds, "cpu"))
        print(f"| {machine} | {first:.1f} | {card:.2f} | {cores:.2f} | {cores / card:.2f} |", flush=True)


if __name__ == "__main__":
    try:
        main()
    except StudyError as error:
        sys.exit(str(error))
