"""How far the coupled run of the breaker lies from the motion solved as one, and the order in the coupling step.

The judge is `mech_twin.studies.breaker_reference`, which shares no code with the machine.

    python -m mech_twin.studies.coupling_error
"""

from __future__ import annotations

import argparse
from typing import NamedTuple

import numpy as np

from mech_twin.engine.run import frames
from mech_twin.machines.mb10_breaker import build
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.state import BreakerMemory
from mech_twin.parameters.load import machine_parameters
from mech_twin.studies.breaker_reference import BreakerReference


class CouplingError(NamedTuple):
    """Worst differences between a coupled run and the reference."""

    step_s: float
    crank_angle_rad: float
    body_angle_rad: float
    blow_time_s: float
    blow_impulse_relative: float


def coupling_error(parameters: BreakerParameters, step_s: float, duration_s: float) -> CouplingError:
    """Return the worst differences from standstill to ``duration_s`` with a coupling step of ``step_s``."""
    coupling = parameters.coupling.model_copy(update={"step_s": step_s})
    p = parameters.model_copy(update={"coupling": coupling})
    run = list(frames(build(p), duration_s))
    samples, blows = BreakerReference(p).run(np.array([frame.linkage.time_s for frame in run]))
    turned = np.array(
        [f.linkage.position[0] + 2.0 * np.pi * BreakerMemory(*f.linkage.memory.values).turns for f in run]
    )
    body = np.array([f.linkage.position[3] for f in run])
    met = np.array([(e.time_s, e.impulse_ns) for f in run for e in f.linkage.events if e.kind == "blow"])
    if met.shape != blows.shape:
        raise RuntimeError(f"the coupled run has {len(met)} blows, the reference {len(blows)}")
    return CouplingError(
        step_s,
        float(np.abs(turned - samples[:, 0]).max()),
        float(np.abs(body - samples[:, 2]).max()),
        float(np.abs(met[:, 0] - blows[:, 0]).max()),
        float(np.abs(met[:, 1] / blows[:, 1] - 1.0).max()),
    )


def coupling_table(parameters: BreakerParameters, steps_s: tuple[float, ...], duration_s: float) -> list[CouplingError]:
    """Return the errors of each coupling step."""
    return [coupling_error(parameters, step_s, duration_s) for step_s in steps_s]


def main() -> None:
    """Print the table of the machine's page."""
    asked = argparse.ArgumentParser(description="coupling error of the breaker against the motion solved as one")
    asked.add_argument("--duration", type=float, default=5.0, help="simulated seconds from standstill")
    asked.add_argument("--steps", type=float, nargs="+", default=[2e-3, 1e-3, 5e-4, 2.5e-4], help="coupling steps, s")
    asked.add_argument("--order", type=int, default=1, choices=(0, 1), help="order of the torque's extrapolation")
    given = asked.parse_args()
    p = machine_parameters("mb10_breaker", overrides={"coupling.extrapolation_order": given.order})
    if not isinstance(p, BreakerParameters):
        raise TypeError("expected the breaker's parameters")
    print("step_s    crank_angle_rad  body_angle_rad  blow_time_s  blow_impulse")  # noqa: T201
    for row in coupling_table(p, tuple(given.steps), given.duration):
        print("{:<9g} {:<16.3g} {:<15.3g} {:<12.3g} {:.3g}".format(*row))  # noqa: T201


if __name__ == "__main__":
    main()
