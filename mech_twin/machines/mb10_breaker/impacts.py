# SPDX-License-Identifier: Apache-2.0
r"""Impacts of the breaker: the striker on the tool, the body on its collar; crank and body respond together.

Symbols as in ``dynamics``.

The blow as a stress wave in tool, foot and wall (`strike` is the rigid impact).  The striker is rigid, with the
effective mass m_e of crank and body at its face; it strikes at the closing speed.  The impulse P of the whole blow
acts as that of a rigid impact, -M^-1 j P; impulses of springs, motor and gravity during the blow are neglected.
A tool that goes on into the wall keeps its mean momentum.  A tool thrown back by the wall strikes the collar of the
body with the collar's restitution, unless the body leaves faster.  It then rests in its seat, at the permanent
penetration, and its remaining energy is lost.

A blow through a contact of finite stiffness: peak force, contact time and loss of energy beside the impulse.

The closing motion y(q) - r_tool phi - (tool) is reduced to one mass and one deceleration, both taken at first contact.
The mass is the reduced mass of the tool and of m_e = 1/(j' M^-1 j), the effective mass of crank and body.  The
deceleration of the closing motion without contact is a = -(j . (u', p') + j' . (u, p)): the striker slows down near
the end of its travel.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from mech_twin.engine.sample_vectors import Array
from mech_twin.kernels.dispatcher import on_processor, overload
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.dynamics import Breaker, accelerations, masses_at, striker
from mech_twin.machines.mb10_breaker.state import BODY, BODY_RATE, CRANK, CRANK_RATE, TOOL_RATE
from mech_twin.parts.contact import contact_pulse, damping_ratio, damping_ratio_without_pull
from mech_twin.parts.rod_waves.struck_tool import rod_blow


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
    """Return the changes per unit impulse on the striker: u falls by x, phi' by y.

    j = (dy/dq, -r_tool), 1/m_e = j' M^-1 j.  A body that is held, or that the impact would press onto its collar, does
    not take part: m_e = M11/(dy/dq)^2.  With ``stays`` a resting body never takes part.
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


class Push(NamedTuple):
    """Effect of a push: change of u and phi' (rad/s), angular impulse on the body (N m s), work on both (J)."""

    du: float
    dp: float
    impulse_nms: float
    work: float


@kernel
def push_on_body(b: Breaker, q: float, phi: float, p: float, back: float) -> Push:
    """Return the push of a tool that rebounds at a speed (m/s) onto the collar of the body, if it reaches it.

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
    """Return speeds and impulse of a blow of finite duration (stress wave); symbols as in `impacts.strike`.

    If the time window ends before striker and tool have parted, the rest is a plastic impact of rigid bodies.
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


def wave_blow(b: Breaker, y: Array, rests: bool) -> Blow:
    """Return `strike_as_wave` in a state of the motion; on a graphics processor, which makes no cells of rods, nan."""
    w = y[TOOL_RATE]
    return strike_as_wave(b, y[CRANK], y[CRANK_RATE], y[BODY], y[BODY_RATE], w, rests, rests or w > 0.0)


@overload(wave_blow)
def _wave_blow(b: Breaker, y: Array, rests: bool) -> Any:
    def unknown(b: Breaker, y: Array, rests: bool) -> Blow:
        nan = math.nan
        return Blow(nan, nan, nan, nan, nan, nan, nan, nan, nan, False)

    return wave_blow if on_processor() else unknown


@kernel
def struck_tool(b: Breaker, y: Array, rests: bool, wave: bool) -> Blow:
    """Return an impact on the tool computed outside the loop: a stress wave, or with a body kept on its collar.

    A plastic impact would lift that body so slowly that collar and tool would be struck in turns, ever slower.
    """
    if wave:
        return wave_blow(b, y, rests)
    return strike(b, y[CRANK], y[CRANK_RATE], y[BODY], y[BODY_RATE], y[TOOL_RATE], True, 0.0, True)


@kernel
def fading(b: Breaker, q: float, u: float, phi: float, p: float, drive: float, rests: bool) -> float:
    """Return the deceleration (m/s^2) of the closing motion at first contact, without contact force."""
    _, slope, bend = striker(b, q)
    crank_nm = -b.crank_coulomb_nm if u >= 0.0 else b.crank_coulomb_nm
    body_nm = 0.0 if rests else -b.body_coulomb_nm if p >= 0.0 else b.body_coulomb_nm
    du, dp, _ = accelerations(b, masses_at(b, q, phi), q, u, phi, p, drive, rests, 0.0, crank_nm, body_nm)
    return -(slope * du + bend * u * u - b.tool_radius_m * dp)


def blow_contact(
    b: Breaker, stiffness_n_per_m: float, closing: float, impulse: float, fading_m_per_s2: float
) -> dict[str, float]:
    """Return the numbers of a blow through a contact stiffness; if its contact does not end, the peak force alone.

    The energy changes are relative to the rigid blow, negative for a loss: with the textbook damping of e_t (which
    parts somewhat faster than e_t v), and with the damping that keeps e_t exactly.

    Parameters
    ----------
    b : Breaker
        Constants.
    stiffness_n_per_m : float
        Contact stiffness of striking face and tool, N/m.
    closing, impulse : float
        Closing speed (m/s) and impulse (N s) of the rigid blow; its reduced mass is P/((1 + e_t) v).
    fading_m_per_s2 : float
        Rate at which the closing speed falls by itself, as `fading` gives it.
    """
    e = b.tool_restitution
    mass = impulse / ((1.0 + e) * closing)
    ratios = damping_ratio(e), damping_ratio_without_pull(e)
    usual, kept = (contact_pulse(mass, stiffness_n_per_m, ratio, closing, fading_m_per_s2) for ratio in ratios)
    found = {
        "contact_peak_force_n": usual.peak_force_n,
        "contact_time_s": usual.duration_s,
        "contact_blow_energy_change": (usual.impulse_ns / impulse) ** 2 - 1.0,
        "contact_blow_energy_change_restitution_kept": (kept.impulse_ns / impulse) ** 2 - 1.0,
    }
    ends = all(map(math.isfinite, found.values()))
    return found if ends else {"contact_peak_force_n": usual.peak_force_n}
