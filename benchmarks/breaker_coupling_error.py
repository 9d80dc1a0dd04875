# SPDX-License-Identifier: Apache-2.0
"""Table of the breaker's coupling error over the coupling step, against the motion solved as one.

python benchmarks/breaker_coupling_error.py
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.parameters.load import machine_parameters

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))
from machines.mb10_breaker.coupling_error import coupling_table


def main() -> None:
    """Print the table of the machine's page."""
    asked = argparse.ArgumentParser(description="coupling error of the breaker against the motion solved as one")
    asked.add_argument("--duration", type=float, default=5.0, help="simulated seconds from standstill")
    asked.add_argument("--steps", type=float, nargs="+", default=[2e-3, 1e-3, 5e-4, 2.5e-4], help="coupling steps, s")
    given = asked.parse_args()
    p = machine_parameters("mb10_breaker")
    if not isinstance(p, BreakerParameters):
        raise TypeError("expected the breaker's parameters")
    print("step_s    crank_angle_rad  body_angle_rad  blow_time_s  blow_impulse")
    for row in coupling_table(p, tuple(given.steps), given.duration):
        print("{:<9g} {:<16.3g} {:<15.3g} {:<12.3g} {:.3g}".format(*row))


if __name__ == "__main__":
    main()
