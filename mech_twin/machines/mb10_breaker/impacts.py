# SPDX-License-Identifier: Apache-2.0
r"""Impacts of the breaker: the striker on the tool, the body on its collar; crank and body respond together.

Symbols as in ``dynamics``.
"""

from __future__ import annotations

from typing import NamedTuple

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.dynamics import Breaker, masses_at, striker


@kernel
def gap(b: Breaker, q: float, u: float, phi: float, p: float) -> tuple[float, float]:
    """Return the gap between striker and tool (m) and the closing speed v = (dy/dq) u - r_tool p (m/s)."""
    travel, slope, _ = striker(b, q)
    return b.tool_radius_m * phi - travel, slope * u - b.tool_radius_m * p


class Blow(NamedTuple):
    """An impact of the striker on the tool: speeds after it, impulse, the tool's energy from it, the energy lost (SI).

    ``collar_nms`` is the collar's angular impulse on a resting body that the impact presses on it.  ``tool_speed`` is
    the tool's after the impact, ``tool_travel`` its way in it, ``closing`` the speed at which striker and tool still
    close (negative: part), ``together`` whether they stay in contact.
    """

    u: float
    p: float
    impulse: float
    tool_energy: float
    loss: float
    collar_nms: float
    tool_speed: float
    tool_travel: float
    closing: float
    together: bool


class ImpactDirection(NamedTuple):
    """M^-1 j of an impact on the striker, its effective mass, and whether it presses a body onto its collar."""

    x: float
    y: float
    effective_kg: float
    m12: float
    pressed: bool


@kernel
def impact_direction(b: Breaker, q: float, phi: float, rests: bool, stays: bool) -> ImpactDirection:
    """Return what an impulse on the striker does to crank and body: u falls by x, phi' by y for each unit of it.

    j = (dy/dq, -r_tool), 1/m_e = j' M^-1 j; a body that is held, or that the impact would press onto its collar, does
    not take part: m_e = M11/(dy/dq)^2.  ``stays``: nor does a resting body, whichever way the impact throws it.
    """
    m = masses_at(b, q, phi)
    _, slope, _ = striker(b, q)
    det = m.m11 * m.m22 - m.m12 * m.m12
    x = (m.m22 * slope + m.m12 * b.tool_radius_m) / det
    y = (-m.m12 * slope - m.m11 * b.tool_radius_m) / det
    pressed = rests and (stays or y > 0.0)
    if b.held or pressed:
        x, y = slope / m.m11, 0.0
    return ImpactDirection(x, y, 1.0 / (slope * x - b.tool_radius_m * y), m.m12, pressed)


@kernel
def strike(
    b: Breaker,
    q: float,
    u: float,
    phi: float,
    p: float,
    tool_speed: float,
    rests: bool,
    restitution: float,
    stays: bool = False,
) -> Blow:
    """Return the impact of the striker on a tool that moves into the wall with a speed (m/s), crank and body together.

    v = j.(u, p) - w, P = (1 + e_t) v m_e m_t/(m_e + m_t), jump = -M^-1 j P; see `impact_direction`.
    """
    along = impact_direction(b, q, phi, rests, stays)
    _, slope, _ = striker(b, q)
    v = slope * u - b.tool_radius_m * p - tool_speed
    x, y, effective = along.x, along.y, along.effective_kg
    both = effective * b.tool_mass_kg / (effective + b.tool_mass_kg)
    impulse = (1.0 + restitution) * v * both
    loss = 0.5 * (1.0 - restitution * restitution) * both * v * v
    after = tool_speed + impulse / b.tool_mass_kg
    gained = 0.5 * b.tool_mass_kg * (after - tool_speed) * (after + tool_speed)
    collar = -along.m12 * x * impulse - b.tool_radius_m * impulse if along.pressed and not b.held else 0.0
    return Blow(
        u - x * impulse,
        p - y * impulse,
        impulse,
        gained,
        loss,
        collar,
        after,
        0.0,
        -restitution * v,
        restitution == 0.0,
    )


@kernel
def blow(b: Breaker, q: float, u: float, phi: float, p: float, rests: bool) -> Blow:
    """Return the blow of the striker on the seated tool."""
    return strike(b, q, u, phi, p, 0.0, rests, b.tool_restitution)


@kernel
def touchdown(b: Breaker, q: float, u: float, phi: float, p: float, e: float) -> tuple[float, float, float, float]:
    """Return u and p after the body meets its collar, the collar's angular impulse (N m s) and the loss (J).

    du = -(M12/M11)(1 + e)|p|, dp = (1 + e)|p|.
    """
    m = masses_at(b, q, phi)
    jump = -(1.0 + e) * p
    seen = m.m22 - m.m12 * m.m12 / m.m11
    return u - m.m12 / m.m11 * jump, p + jump, seen * jump, 0.5 * (1.0 - e * e) * seen * p * p
