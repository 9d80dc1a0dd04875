# SPDX-License-Identifier: Apache-2.0
"""How far the coupled run of the breaker lies from the motion solved as one, and the order in the coupling step.

The judge is `breaker_reference`, which shares no code with the motion of the machine.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from machines.mb10_breaker.breaker_reference import BreakerReference

from mech_twin.engine.run import frames
from mech_twin.machines.mb10_breaker import build
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.state import BreakerMemory


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
        [f.linkage.joint("crank").position + 2.0 * np.pi * BreakerMemory(*f.linkage.memory.values).turns for f in run]
    )
    body = np.array([f.linkage.joint("body").position for f in run])
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
