# SPDX-License-Identifier: Apache-2.0
"""Spring and preload of the breaker, or its tool and striker: which question is asked, and what the answers share.

The limits hold in the worst case over a box of tolerances: every number that is assumed, not published, off by up to
the tolerance.  The spring's rate is the soft one, k = 0.3 of the blow frequency.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, pi

from mech_twin.capabilities.sizing import Sizing, Table
from mech_twin.capabilities.variation import varied
from mech_twin.machines.mb10_breaker import tool_sizing
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.seat import SEATED_GAP_M, SEATED_REST

# gap at the blow (m), part of the cycle not at rest on the collar, return speed (m/s), largest spring force (N)
OF_SPRING: dict[str, float] = {
    "gap_at_blow_m": SEATED_GAP_M,
    "flight_share": 1.0 - SEATED_REST,
    "return_speed_m_per_s": inf,
    "largest_force_n": inf,
}
LIMITS: dict[str, float] = {**OF_SPRING, **tool_sizing.LIMITS}
OBJECTIVES = ("largest_force_n", "return_speed_m_per_s", "gap_at_blow_m", "flight_share", tool_sizing.OBJECTIVE)
USUAL_TOLERANCE = 0.05
SOFTNESS = 0.3  # k over the blow frequency: soft, so that the spring's force hardly changes over the lift


def sizing(
    parameters: BreakerParameters, limits: Mapping[str, float], objective: str, table: Table, tolerance: float
) -> Sizing:
    """Return spring rate and preload in the rational range, the tool seated before every blow.

    With the objective `tool_sizing.OBJECTIVE`: tool and striker for most energy in the wall.

    Parameters
    ----------
    parameters : BreakerParameters
        Configuration; spring rate and preload are replaced.
    limits : mapping
        Every limit of ``LIMITS``.
    objective : str
        What to make small in the worst case, or large: one of ``OBJECTIVES``.
    table : callable
        Not needed here.
    tolerance : float
        Part of its value by which each assumed number may be off.
    """
    from mech_twin.machines.mb10_breaker.half_sine_sizing import half_sine_sizing
    from mech_twin.machines.mb10_breaker.running_sizing import running_sizing

    if objective == tool_sizing.OBJECTIVE:
        return tool_sizing.tool_sizing(parameters, {name: limits[name] for name in tool_sizing.LIMITS}, tolerance)
    limits = {name: limits[name] for name in OF_SPRING}
    omega = 2.0 * pi * parameters.excitation.blow_rate_hz
    rate = parameters.body.inertia_kg_m2 * (SOFTNESS * omega / parameters.body.spring_arm_m) ** 2
    soft = varied(parameters, {"body.spring_rate_n_per_m": rate})
    answer = running_sizing if parameters.excitation.kind == "from_forces" else half_sine_sizing
    return answer(soft, limits, objective, tolerance)
