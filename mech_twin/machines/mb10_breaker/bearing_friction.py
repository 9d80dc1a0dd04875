# SPDX-License-Identifier: Apache-2.0
"""Coulomb friction of the breaker's two bearings at rest: what holds crank and body, and in which sense they set off.

::

    crank's bearing, in the body    |T_q| <= c_q      speed u      and the gear, between eta tau and tau/eta,
    body's pivot, in the frame      |T_phi| <= c_phi  speed p      while its shaft stands

What moves rubs against its sense (`accelerations.sliding_forces`); here is only what happens at zero speed.  The body
on its collar: what presses it down is the collar's, what would lift it is the pivot's, until c_phi is not enough.
Of the senses that joints at rest may take, the one is sought that its own accelerations bear out: held where the
torque that holds stays within the friction, sliding where the joint then speeds up in that sense.  The mass matrix
being positive definite there is one, but for rounding: friction holds to a part in 1e12 beyond its torque.
"""

from __future__ import annotations

from typing import NamedTuple

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.accelerations import (
    Accelerations,
    contact_accelerations,
    generalised_forces,
)
from mech_twin.machines.mb10_breaker.dynamics import (
    BLOCKED,
    Breaker,
    Masses,
    Senses,
    masses_at,
    spring_moment,
    striker,
)

HOLDS_BEYOND = 1e-12  # of the torques in balance: more than their rounding, so that what is let go does speed up
AT_EXTREME = 1e-9  # of body turn to crank turn, below which the rocker is at its extreme
ALWAYS = 1.0  # margin of a joint that this friction does not hold


class Instant(NamedTuple):
    """State and torque on the crank at one instant; the gear can hold ``gear_low_nm`` more forward, or high backward.

    ``drive_nm`` is the crank torque of a gear that drives; the other two are 0 unless its shaft stands.
    """

    q: float
    u: float
    phi: float
    p: float
    drive_nm: float
    gear_low_nm: float
    gear_high_nm: float
    rests: bool
    tool: int


class BearingTorques(NamedTuple):
    """Torques (N m): of the drive on the crank, of friction on crank and body; the striker's force on the tool (N).

    The margins are what more would be needed to make crank and body set off (N m).
    """

    drive_nm: float
    crank_nm: float
    body_nm: float
    tool_force_n: float
    crank_margin_nm: float
    body_margin_nm: float


@kernel
def rubs(b: Breaker) -> bool:
    """Return whether there is Coulomb friction at all."""
    return b.crank_coulomb_nm > 0.0 or b.body_coulomb_nm > 0.0


@kernel
def acting(b: Breaker, m: Masses, at: Instant, drive: float, senses: Senses) -> Accelerations:
    """Return the accelerations, and what holds what is at rest."""
    return contact_accelerations(b, m, at.q, at.u, at.phi, at.p, drive, at.rests, at.tool, senses)


@kernel
def rounding(b: Breaker, m: Masses, at: Instant, now: Accelerations) -> tuple[float, float]:
    """Return the torques (N m) by which friction of crank and body holds beyond its own."""
    quadratic = (abs(m.m11_q) + abs(m.m12_q)) * at.u * at.u + abs(m.m22_q) * (at.p * at.p + abs(at.u * at.p))
    inertia = abs(m.m12) * (abs(now.crank) + abs(now.body))
    push = (abs(striker(b, at.q)[1]) + b.tool_radius_m) * (abs(now.tool_force_n) + b.wall_force_n)
    weight = abs(m.g_q) + abs(m.g_phi) + abs(spring_moment(b, at.phi))
    common = HOLDS_BEYOND * (abs(at.drive_nm) + quadratic + inertia + push + weight)
    crank = common + HOLDS_BEYOND * b.crank_coulomb_nm if b.crank_coulomb_nm > 0.0 else 0.0
    return crank, common + HOLDS_BEYOND * b.body_coulomb_nm if b.body_coulomb_nm > 0.0 else 0.0


@kernel
def blocked_margin(b: Breaker, m: Masses, at: Instant) -> float:
    """Return how much more turns crank and body together, the tool held by the wall under the striker (N m)."""
    lean = striker(b, at.q)[1] / b.tool_radius_m
    first, second = generalised_forces(b, m, at.u, at.phi, at.p, at.drive_nm, 0.0, 0.0)
    return b.crank_coulomb_nm + abs(lean) * b.body_coulomb_nm - abs(first + lean * second)


@kernel
def bearing_torques(b: Breaker, m: Masses, at: Instant, senses: Senses) -> BearingTorques:
    """Return drive and friction on crank and body, sliding or held, and how far both are from setting off."""
    now = acting(b, m, at, at.drive_nm, senses)
    crank_more, body_more = rounding(b, m, at, now)
    drive, crank, crank_margin = at.drive_nm, -b.crank_coulomb_nm * senses.crank, ALWAYS
    body, body_margin = -b.body_coulomb_nm * senses.body, ALWAYS
    if at.tool == BLOCKED and (at.rests or senses.crank == 0.0):
        crank = now.hold_nm
        if not at.rests:
            return BearingTorques(
                drive, crank, now.collar_nm, now.tool_force_n, blocked_margin(b, m, at) + crank_more + body_more, ALWAYS
            )
    elif senses.crank == 0.0:
        crank = min(max(now.hold_nm, -b.crank_coulomb_nm), b.crank_coulomb_nm)
        drive += now.hold_nm - crank  # the bearing first, then the gear
        crank_margin = min(at.gear_low_nm + now.hold_nm, at.gear_high_nm - now.hold_nm)
        crank_margin += b.crank_coulomb_nm + crank_more
    holding = now.collar_nm + b.frame_drive * (drive - at.drive_nm)
    if at.rests:
        body = max(min(holding, 0.0), -b.body_coulomb_nm)
        body_margin = holding + b.body_coulomb_nm + body_more
    elif senses.body == 0.0:
        body, body_margin = holding, b.body_coulomb_nm - abs(holding) + body_more
    return BearingTorques(drive, crank, body, now.tool_force_n, crank_margin, body_margin)


@kernel
def driven(at: Instant, crank: float) -> float:
    """Return the crank torque (N m) with which a crank that stands sets off in a sense."""
    if crank > 0.0:
        return at.drive_nm - at.gear_low_nm
    return at.drive_nm + at.gear_high_nm if crank < 0.0 else at.drive_nm


@kernel
def borne_out(b: Breaker, m: Masses, at: Instant, senses: Senses) -> bool:
    """Return whether joints at rest go on as these senses say."""
    now = acting(b, m, at, driven(at, senses.crank), senses)
    held = bearing_torques(b, m, at, senses)
    crank = held.crank_margin_nm > 0.0 if senses.crank == 0.0 else senses.crank * now.crank > 0.0
    body = held.body_margin_nm > 0.0 if senses.body == 0.0 else senses.body * now.body > 0.0
    return (crank_goes_on(b, at) or crank) and (body_goes_on(b, at) or body)


@kernel
def crank_goes_on(b: Breaker, at: Instant) -> bool:
    """Return whether the crank's sense is no question: it moves, or nothing holds it."""
    return at.u != 0.0 or b.crank_coulomb_nm == 0.0


@kernel
def body_goes_on(b: Breaker, at: Instant) -> bool:
    """Return whether the body's sense is no question: it moves or rests on its collar, or nothing holds it."""
    return at.rests or at.p != 0.0 or b.body_coulomb_nm == 0.0


@kernel
def sign(value: float) -> float:
    """Return +1 or -1, 0 of 0."""
    return 1.0 if value > 0.0 else -1.0 if value < 0.0 else 0.0


@kernel
def candidate(number: int) -> float:
    """Return the senses a joint may take, in the order in which they are tried: held, forward, backward."""
    return 1.0 if number == 1 else -1.0 if number == 2 else 0.0


@kernel
def senses_on_blocked_tool(b: Breaker, m: Masses, at: Instant) -> Senses:
    """Return the senses with the striker on a tool that the wall holds: crank and body turn together, or not at all."""
    if at.rests:
        return Senses(0.0 if b.crank_coulomb_nm > 0.0 else 1.0, 0.0)
    _, slope, bend = striker(b, at.q)
    lean = slope / b.tool_radius_m
    if abs(lean) <= AT_EXTREME and at.u != 0.0:  # the body turns back with the rocker
        return Senses(sign(at.u), sign(bend))
    if at.u != 0.0:
        return Senses(sign(at.u), sign(at.u * lean))
    still = Senses(0.0, 0.0)
    if rubs(b) and bearing_torques(b, m, at, still).crank_margin_nm > 0.0:
        return still
    first, second = generalised_forces(b, m, at.u, at.phi, at.p, at.drive_nm, 0.0, 0.0)
    along = 1.0 if first + lean * second >= 0.0 else -1.0
    return Senses(along, along * sign(lean))


@kernel
def senses_at(b: Breaker, at: Instant) -> Senses:
    """Return the senses in which crank and body go on: of what moves its own, of what stands the one borne out.

    A joint without Coulomb friction counts as sliding forward, a body at rest on its collar as held.
    """
    m = masses_at(b, at.q, at.phi)
    if at.tool == BLOCKED:
        return senses_on_blocked_tool(b, m, at)
    crank_known, body_known = crank_goes_on(b, at), body_goes_on(b, at)
    crank = sign(at.u) if b.crank_coulomb_nm > 0.0 else 1.0
    body = 0.0 if at.rests else sign(at.p) if b.body_coulomb_nm > 0.0 else 1.0
    for i in range(1 if crank_known else 3):
        for j in range(1 if body_known else 3):
            tried = Senses(crank if crank_known else candidate(i), body if body_known else candidate(j))
            if borne_out(b, m, at, tried):
                return tried
    return Senses(crank, body)
