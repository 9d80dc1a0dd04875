# SPDX-License-Identifier: Apache-2.0
"""The blow of the striker as a wave in tool, foot and wall: what it gives crank, body and tool in place of `strike`.

The striker is rigid, with the effective mass m_e of crank and body at its face; it strikes at the closing speed.  The
impulse P of the whole blow acts as a rigid one does, -M^-1 j P.  Springs, motor and gravity give none within it.
A tool that goes on into the wall keeps its mean momentum.  One that the wall throws back strikes the collar of the
body, with the collar's restitution, where the body does not leave faster; then it rests in its seat, at the permanent
penetration, and what it has left is lost.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mech_twin.engine.sample_vectors import Array
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.dynamics import Breaker, masses_at, striker
from mech_twin.machines.mb10_breaker.impacts import Blow, impact_direction, strike
from mech_twin.machines.mb10_breaker.state import BODY, BODY_RATE, CRANK, CRANK_RATE, TOOL_RATE
from mech_twin.parts.rod_waves.struck_tool import rod_blow


class Push(NamedTuple):
    """What a push does: change of u and phi', angular impulse on the body (N m s), work on crank and body (J)."""

    du: float
    dp: float
    impulse_nms: float
    work: float


@kernel
def push_on_body(b: Breaker, q: float, phi: float, p: float, back: float) -> Push:
    """Return the push of a tool that comes back at a speed (m/s) on the collar of the body, if it reaches it.

    Dp = (1 + e) m_t (w - r p) r/(m_t r^2 + M22 - M12^2/M11), Du = -(M12/M11) Dp; a body that is held takes none.
    """
    closing, r = back - b.tool_radius_m * p, b.tool_radius_m
    if b.held or closing <= 0.0:
        return Push(0.0, 0.0, 0.0, 0.0)
    m = masses_at(b, q, phi)
    seen = m.m22 - m.m12 * m.m12 / m.m11
    dp = (1.0 + b.collar_restitution) * b.tool_mass_kg * closing * r / (b.tool_mass_kg * r * r + seen)
    return Push(-m.m12 / m.m11 * dp, dp, seen * dp, seen * dp * (p + 0.5 * dp))


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
    u, p = u - along.x * impulse, p - along.y * impulse
    loss = impulse * (tool_speed + v - 0.5 * impulse / along.effective_kg)
    pressed = along.pressed and not b.held
    collar = -along.m12 * along.x * impulse - b.tool_radius_m * impulse if pressed else 0.0
    if after <= 0.0:
        pushed = push_on_body(b, q, phi, p, -after)
        loss -= pushed.work
        u, p, collar = u + pushed.du, p + pushed.dp, collar + pushed.impulse_nms
        after, travel = 0.0, found.penetration_m
    left = slope * u - b.tool_radius_m * p - after
    if left > 0.0:
        rest = left * along.effective_kg * b.tool_mass_kg / (along.effective_kg + b.tool_mass_kg)
        loss += rest * (after + left - 0.5 * rest / along.effective_kg)
        u, p, impulse = u - along.x * rest, p - along.y * rest, impulse + rest
        collar -= (along.m12 * along.x + b.tool_radius_m) * rest if pressed else 0.0
        after, left, plastic = after + rest / b.tool_mass_kg, 0.0, True
    gained = 0.5 * b.tool_mass_kg * (after - tool_speed) * (after + tool_speed)
    return Blow(u, p, impulse, gained, loss - gained, collar, after, travel, left, plastic)


@kernel
def struck_tool(b: Breaker, y: Array, rests: bool, wave: bool) -> Blow:
    """Return an impact on the tool that is an event of its own: of a wave, or of a body that stays on its collar.

    A plastic one would throw that body off so slowly that body and striker met collar and tool by turns, ever slower.
    """
    q, u, phi, p, w = y[CRANK], y[CRANK_RATE], y[BODY], y[BODY_RATE], y[TOOL_RATE]
    if wave:
        return strike_as_wave(b, q, u, phi, p, w, rests, rests or w > 0.0)
    return strike(b, q, u, phi, p, w, True, 0.0, True)
