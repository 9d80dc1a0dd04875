# SPDX-License-Identifier: Apache-2.0
"""The blow of the striker as a wave in tool, foot and wall: what it gives crank, body and tool in place of `strike`.

The striker is rigid, with the effective mass m_e of crank and body at its face; it strikes at the closing speed.  The
impulse P of the whole blow acts as a rigid one does, -M^-1 j P.  Springs, motor and gravity give none within it.
A tool that goes on into the wall keeps its mean momentum.  One that the wall throws back is taken to come to rest in
its seat, at the permanent penetration: its energy is lost, its push on the collar left out.
"""

from __future__ import annotations

import numpy as np

from mech_twin.kernel import kernel
from mech_twin.machines.mb10_breaker.dynamics import Breaker, striker
from mech_twin.machines.mb10_breaker.impacts import Blow, impact_direction
from mech_twin.parts.rod_waves.struck_tool import rod_blow


@kernel
def strike_as_wave(
    b: Breaker, q: float, u: float, phi: float, p: float, tool_speed: float, rests: bool, seated: bool
) -> Blow:
    """Return what a blow of finite duration gives crank, body and tool; symbols as in `impacts.strike`.

    Where the window ends before striker and tool have parted, the rest is a plastic impact of rigid bodies.
    """
    along = impact_direction(b, q, phi, rests, False)
    _, slope, _ = striker(b, q)
    v = slope * u - b.tool_radius_m * p - tool_speed
    none = np.empty((0, 2))
    found = rod_blow(b.wave, along.effective_kg, v, tool_speed, seated, none, none)
    impulse, after = found.impulse_ns, found.tool_momentum_ns / b.tool_mass_kg
    travel, plastic = found.tool_travel_m, False
    if after <= 0.0:
        after, travel = 0.0, found.penetration_m
    left = tool_speed + v - impulse / along.effective_kg - after
    if left > 0.0:
        rest = left * along.effective_kg * b.tool_mass_kg / (along.effective_kg + b.tool_mass_kg)
        impulse, after, left, plastic = impulse + rest, after + rest / b.tool_mass_kg, 0.0, True
    gained = 0.5 * b.tool_mass_kg * (after - tool_speed) * (after + tool_speed)
    loss = impulse * (tool_speed + v - 0.5 * impulse / along.effective_kg) - gained
    pressed = along.pressed and not b.held
    collar = -along.m12 * along.x * impulse - b.tool_radius_m * impulse if pressed else 0.0
    return Blow(
        u - along.x * impulse, p - along.y * impulse, impulse, gained, loss, collar, after, travel, left, plastic
    )
