# SPDX-License-Identifier: Apache-2.0
"""Motion of the linkage: its state, equations of motion at a prescribed speed and behind a motor."""

from __future__ import annotations

from typing import NamedTuple

from mech_twin.engine.compiled_steps import step_of
from mech_twin.engine.crank_motion import DRIVE_POWER, ShaftDrive, crank_rates, shaft_state
from mech_twin.engine.crank_state import (
    driven_system,
    led_system,
    mechanism_load_speed,
    mechanism_load_work,
    mechanism_state,
    under_load_share,
)
from mech_twin.engine.integration import rates_of
from mech_twin.engine.tableaus import DORMAND_PRINCE_8
from mech_twin.machines.planar_linkage.chain import CRANK, Array, chain_motion, closure_error
from mech_twin.machines.planar_linkage.linkage import (
    PlanarLinkage,
    WorkingStroke,
    continued,
    is_working,
    potential_at,
    reduced,
    reduced_at,
    stroke_point,
    stroke_work,
)
from mech_twin.machines.planar_linkage.pins import pin_forces


class TurnedLinkage(NamedTuple):
    """The mechanism of the linkage role."""

    chain: PlanarLinkage


@step_of(mechanism_state, TurnedLinkage)
def linkage_state(
    mechanism: TurnedLinkage, f: float, w: float, e: float, regime: int
) -> tuple[Array, Array, float, float, float]:
    """Return coordinates and rates of the links, crank torque (N m), energy (J), worst miss of a link's end (m)."""
    p = mechanism.chain
    m, travel = chain_motion(p.dyads, f)
    now = reduced_at(p, m, regime)
    torque = now.inertia * e + 0.5 * w * w * now.slope - now.moment
    energy = 0.5 * now.inertia * w * w + potential_at(p, m)
    return continued(p, f, travel), travel.rate[CRANK:] * w, torque, energy, closure_error(p.dyads, m, travel)


@step_of(mechanism_load_work, TurnedLinkage)
def linkage_load_work(mechanism: TurnedLinkage, before: float, after: float, regime: int) -> float:
    """Return the work (J) of the working stroke's force on the way from one crank angle (rad) to another."""
    return stroke_work(mechanism.chain, before, after) if is_working(regime) else 0.0


@step_of(mechanism_load_speed, TurnedLinkage)
def linkage_load_speed(mechanism: TurnedLinkage, f: float, w: float) -> float:
    """Return the speed of the tool along its stroke (m/s)."""
    p = mechanism.chain
    return stroke_point(p, chain_motion(p.dyads, f)[0])[1] * w


class LedLinkage(NamedTuple):
    """The linkage at a prescribed speed: angle (rad), speed (rad/s) at time 0, acceleration (rad/s2), regime."""

    chain: PlanarLinkage
    f: float
    w: float
    e: float
    regime: int


@rates_of(LedLinkage, DORMAND_PRINCE_8)
def led_linkage_power(led: LedLinkage, t: float, y: Array, out: Array) -> None:
    """Fill in the power of the drive (W), from the moment that the pin forces give."""
    w, f = led.w + led.e * t, led.f + (led.w + 0.5 * led.e * t) * t
    out[DRIVE_POWER] = pin_forces(led.chain, f, w, led.e, led.regime).drive_nm * w


class DrivenLinkage(NamedTuple):
    """The linkage behind a motor, and its regime."""

    chain: PlanarLinkage
    drive: ShaftDrive
    regime: int


@rates_of(DrivenLinkage, DORMAND_PRINCE_8)
def driven_linkage_rates(driven: DrivenLinkage, t: float, y: Array, out: Array) -> None:
    """Fill in the rates of crank angle, speed, drive work, gear loss and friction loss."""
    now = reduced(driven.chain, shaft_state(y).angle_rad, driven.regime)
    crank_rates(driven.drive, t, y, now.inertia, now.slope, now.moment, out)


@step_of(led_system, TurnedLinkage)
def led_linkage(mechanism: TurnedLinkage, f: float, w: float, e: float, regime: int) -> LedLinkage:
    """Return the linkage at a prescribed speed."""
    return LedLinkage(mechanism.chain, f, w, e, regime)


@step_of(driven_system, TurnedLinkage)
def driven_linkage(mechanism: TurnedLinkage, drive: ShaftDrive, regime: int) -> DrivenLinkage:
    """Return the linkage behind a motor."""
    return DrivenLinkage(mechanism.chain, drive, regime)


@step_of(under_load_share, TurnedLinkage)
def with_load_share(mechanism: TurnedLinkage, share: float) -> TurnedLinkage:
    """Return the linkage under this share of the working stroke's force."""
    p = mechanism.chain
    s = p.stroke
    stroke = WorkingStroke(s.link, s.along_m, s.across_m, s.direction_x, s.direction_y, share * s.force_n)
    return TurnedLinkage(PlanarLinkage(p.dyads, p.masses, p.loads, p.springs, stroke, p.turning, p.gravity))
