# SPDX-License-Identifier: Apache-2.0
"""Metrics of the breaker in closed form: one cycle at rated speed, and one position of the crank.

A blow as a stress wave gives energies, rebound, penetration, force, stress, contact time and the gauge's strain.
It is recomputed from the state before the event, by the kernel of the run.

A blow finds the tool *seated*, in a run, under the half sine and in both sizings, by two conditions.  The body is at
most ``SEATED_GAP_M`` off its collar at the blow.  It was at rest on the collar for at least ``SEATED_REST`` of the
cycle that the blow ends.  A gap alone has no margin: it is as small just after the body comes to rest as later.

A monitor asks for the features of a turn of the crank, faults, and operating conditions.
"""

import math
from functools import partial
from math import pi
from typing import Any

from mech_twin.capabilities.blow_gauge import BlowGauge, GaugeCurve
from mech_twin.capabilities.cycle import (
    CycleFeatures,
    CycleReference,
    event_ratio,
    event_share,
    event_value,
    gauge_features,
    harmonic,
    mean,
    share_above,
    speed_features,
    upper,
)
from mech_twin.capabilities.faults import (
    EITHER,
    LESS,
    MachineFault,
    OperatingVariable,
    added_to_key,
    beyond_range,
    motor_variables,
    rod_faults,
    share_of_key,
    varying_key,
)
from mech_twin.machines.drives import root_between
from mech_twin.machines.mb10_breaker.dynamics import FLIGHT, HELD, TURN, Breaker, masses_at, striker
from mech_twin.machines.mb10_breaker.dynamics import crank_torque as geared
from mech_twin.machines.mb10_breaker.forces import pin_forces, pin_impulses
from mech_twin.machines.mb10_breaker.impacts import (
    Blow,
    ImpactDirection,
    blow,
    blow_contact,
    fading,
    gap,
    impact_direction,
    push_on_body,
    strike_as_wave,
)
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.roles import PINS
from mech_twin.machines.mb10_breaker.state import EventSide
from mech_twin.parts.four_bar import acute_angles, coefficients, link_angles, position
from mech_twin.parts.induction_motor import motor_constants, motor_torque
from mech_twin.parts.rod_waves.fatigue import StressLine
from mech_twin.parts.rod_waves.struck_tool import (
    NO_CURVE,
    NO_FORCES,
    BlowSimulation,
    blow_and_metrics,
    gauge_curve,
    gauge_numbers,
    rod_blow,
    rod_numbers,
)
from mech_twin.samples import Event


def operating(parameters: BreakerParameters) -> tuple[OperatingVariable, ...]:
    """Return supply, motor temperature, a rigid tool within its tolerance, and the wall."""
    rigid = (
        varying_key("tool_load", "mass that the blow meets", "tool.mass_kg", 0.1, "tool_mass"),
        varying_key("tool_face", "restitution of the tool's face", "tool.restitution", 0.05, "tool_restitution"),
    )
    return (
        *motor_variables(),
        *(rigid if parameters.tool.model == "rigid" else ()),
        varying_key("wall", "force of the wall", "tool.wall_force_n", 0.2, "wall_range"),
    )


RIGID_FAULTS = (
    share_of_key("tool_mass", "a tool of another mass", "tool.mass_kg", EITHER),
    share_of_key("tool_restitution", "the tool's face has changed", "tool.restitution", EITHER),
)


def faults(parameters: BreakerParameters) -> tuple[MachineFault, ...]:
    """Return the faults of springs, collar, tool, bearings and supply."""
    tool = parameters.tool
    return (
        share_of_key("spring_soft", "the body's springs are soft or broken", "body.spring_rate_n_per_m", LESS),
        share_of_key("preload_lost", "the springs have lost preload", "body.preload_deflection_m", LESS),
        share_of_key("collar_restitution", "the collar's seat has changed", "body.restitution", EITHER),
        share_of_key("tool_worn", "the tool is worn: the striker meets it later", "tool.overtravel_m", LESS),
        *(rod_faults(tool.wave, "tool.wave", "tool.wall_force_n") if tool.model == "wave" else RIGID_FAULTS),
        added_to_key(
            "bearing_friction", "the crank's bearing rubs", "friction.coulomb_nm", "N.m", (0.5, 1.0, 2.0, 4.0)
        ),
        beyond_range(motor_variables()[0]),
    )


CRANK, ROTOR, BODY = "linkage.crank.position", "motor.rotor.effort", "body.body.position"
BLOW, PRE, POST, IMPULSE = (f"event.blow.{what}" for what in ("time", "pre_velocity", "post_velocity", "impulse"))
BEGIN_RAD = 0.5 * pi  # between two blows, the body on its collar again or soon
SETTLING_CYCLES = 12  # the motor finds its new speed


def features(parameters: BreakerParameters) -> CycleFeatures:
    """Return the features of a turn: of crank, motor, body and blow."""
    return CycleFeatures(
        CycleReference(CRANK, "turn", BEGIN_RAD),
        (
            *speed_features(CRANK),
            mean("torque_mean_nm", "N.m", ROTOR, "mean motor torque"),
            upper("torque_peak_nm", "N.m", ROTOR, "largest motor torque"),
            harmonic("torque_cos_1_nm", "N.m", ROTOR, 1, "cos", "motor torque, cosine of the turn"),
            mean("body_mean_rad", "rad", BODY, "mean angle of the body off its collar"),
            upper("lift_rad", "rad", BODY, "largest angle of the body off its collar"),
            share_above("lift_share", BODY, 0.5, "share of the turn in which the body is above half of its lift"),
            harmonic("body_cos_1_rad", "rad", BODY, 1, "cos", "body angle, cosine of the turn"),
            harmonic("body_sin_1_rad", "rad", BODY, 1, "sin", "body angle, sine of the turn"),
            harmonic("body_cos_2_rad", "rad", BODY, 2, "cos", "body angle, cosine of half a turn"),
            harmonic("body_sin_2_rad", "rad", BODY, 2, "sin", "body angle, sine of half a turn"),
            event_share("blow_share", BLOW, "when in the turn the blow comes"),
            event_ratio("blow_speed_ratio", POST, PRE, "speed of the striker after the blow over that before"),
            event_value("blow_impulse_ns", "N.s", IMPULSE, "impulse of the blow", "sum"),
            *(gauge_features("blow", "tool") if parameters.tool.model == "wave" else ()),
        ),
        SETTLING_CYCLES,
    )


def striking_angle(b: Breaker) -> float:
    """Return the crank angle (rad, 0 to 2 pi) at which the striker meets the seated tool, the body at rest."""
    start = b.striking_crank_rad - (b.striking_crank_rad - b.retreating_crank_rad) % TURN
    return root_between(lambda q: striker(b, q)[0], start, b.striking_crank_rad) % TURN


def rated_crank_speed(p: BreakerParameters) -> float:
    """Return the crank's speed at the motor's rated speed (rad/s)."""
    return motor_constants(p.motor).rated_speed_rad_per_s / p.gear.ratio


def rated_blow(b: Breaker, q: float, u: float) -> Blow:
    """Return the blow on the seated tool at a crank angle and speed, the body at rest."""
    if b.waves:
        return strike_as_wave(b, q, u, 0.0, 0.0, 0.0, True, True)
    return blow(b, q, u, 0.0, 0.0, True)


def energy_given(b: Breaker, q: float, u: float, hit: Blow) -> float:
    """Return the energy of the tool after the rated blow (J); of a wave what the striker gave, as in a run."""
    if not b.waves:
        return hit.tool_energy
    _, slope, _ = striker(b, q)
    return 0.5 * hit.impulse * (slope * u + slope * hit.u - b.tool_radius_m * hit.p)


def rated_wave_numbers(b: Breaker, q: float, closing: float) -> dict[str, float]:
    """Return the numbers of the rated blow as a wave, with the body at rest."""
    mass = impact_direction(b, q, 0.0, True, b.held).effective_kg
    found = rod_blow(b.wave, mass, closing, 0.0, True, NO_CURVE, NO_FORCES)
    rod = rod_numbers(b.wave, found)
    parting = found.tool_momentum_ns / b.tool_mass_kg - closing + found.impulse_ns / mass
    return {
        "striker_mass_kg": mass,
        "tool_mass_kg": b.tool_mass_kg,
        "striker_energy_j": found.striker_energy_j,
        **{name: rod[name] for name in ("incident_energy_j", "transmitted_energy_j", "blow_efficiency")},
        "restitution_effective": parting / closing,
        **{name: rod[name] for name in ("peak_force_n", "peak_stress_pa", "peak_tension_pa", "blow_contact_time_s")},
    }


def static_metrics(p: BreakerParameters, b: Breaker) -> dict[str, float]:
    """Return the closed-form metrics of one cycle at rated speed, the body on its collar."""
    motor, u = motor_constants(p.motor), rated_crank_speed(p)
    q = striking_angle(b)
    _, slope, bend = striker(b, q)
    held, free = (rated_blow(b._replace(held=held), q, u) for held in (True, False))
    energy, held_energy = energy_given(b, q, u, free), energy_given(b, q, u, held)
    jump = pin_impulses(b, q, 0.0, free.u - u, free.p, free.impulse)
    held_jump = pin_impulses(b, q, 0.0, held.u - u, 0.0, held.impulse)
    k = b.spring_arm_m * math.sqrt(b.spring_rate_n_per_m / b.body_inertia_kg_m2)
    inertias = [masses_at(b, TURN * i / 360, 0.0) for i in range(360)]
    here, there = (link_angles(position(b.bar, end))[1] for end in (b.striking_crank_rad, b.retreating_crank_rad))
    arm_angle = link_angles(position(b.bar, q))[1] + math.radians(p.linkage.striker_angle_deg)
    contact: dict[str, float] = {}
    if p.tool.model == "rigid" and p.tool.contact_stiffness_n_per_m is not None:
        fades = fading(b, q, u, 0.0, 0.0, 0.0, b.held)
        struck = held if b.held else free
        contact = blow_contact(b, p.tool.contact_stiffness_n_per_m, slope * u, struck.impulse, fades)
    if b.waves:
        contact = rated_wave_numbers(b, q, slope * u)
    return {
        "rated_torque_nm": motor.rated_torque_nm,
        "rated_slip": motor.rated_slip,
        "breakdown_slip": motor.breakdown_slip,
        "breakdown_torque_nm": motor.breakdown_torque_nm,
        "rated_crank_speed_rad_per_s": u,
        "rated_blow_rate_hz": u / TURN,
        "striking_extreme_deg": math.degrees(b.striking_crank_rad),
        "retreating_extreme_deg": math.degrees(b.retreating_crank_rad),
        "striking_angle_deg": math.degrees(q),
        "before_extreme_deg": math.degrees(b.striking_crank_rad - q),
        "rocker_stroke_deg": math.degrees(abs(math.remainder(here - there, TURN))),
        "smallest_transmission_deg": min(
            math.degrees(acute_angles(position(b.bar, TURN * i / 360))[1]) for i in range(360)
        ),
        "tool_line_miss_m": b.striker_arm_m + b.bar.pivot_x_m * math.cos(arm_angle) - b.tool_radius_m,
        "striker_speed_m_per_s": slope * u,
        "striker_curvature_m_per_rad2": bend,
        "crank_inertia_smallest_kg_m2": min(m.m11 for m in inertias),
        "crank_inertia_largest_kg_m2": max(m.m11 for m in inertias),
        "body_inertia_smallest_kg_m2": min(m.m22 for m in inertias),
        "body_inertia_largest_kg_m2": max(m.m22 for m in inertias),
        "blow_impulse_ns": free.impulse,
        "blow_energy_j": energy,
        "blow_loss_j": free.loss,
        "blow_energy_over_overtravel_n": energy / b.overtravel_m,
        "body_leaves_at_rad_per_s": free.p,
        "blow_impulse_on_body_nms": jump.moment,
        "blow_impulse_body_held_ns": held.impulse,
        "blow_energy_body_held_j": held_energy,
        "blow_impulse_on_body_held_nms": held_jump.moment,
        "rocker_bearing_impulse_body_held_ns": math.hypot(held_jump.c_x, held_jump.c_y),
        "crank_bearing_impulse_body_held_ns": math.hypot(held_jump.o_x, held_jump.o_y),
        "rest_force_n": b.spring_rate_n_per_m * b.preload_m,
        "rest_force_on_tool_n": b.spring_rate_n_per_m * b.preload_m * b.spring_arm_m / b.tool_radius_m,
        "body_frequency_rad_per_s": k,
        "body_frequency_over_blow_frequency": k / u,
        **contact,
    }


def position_metrics(p: BreakerParameters, b: Breaker, crank_rad: float) -> dict[str, Any]:
    """Return every angle, speed, force and constant at one crank angle: rated speed, the body on its collar."""
    motor, u = motor_constants(p.motor), rated_crank_speed(p)
    at = position(b.bar, crank_rad)
    by = coefficients(at)
    m = masses_at(b, crank_rad, 0.0)
    torque = motor_torque(motor, b.ratio * u, 1.0)
    drive = geared(b, torque, u, 0.0)
    found = pin_forces(b, crank_rad, u, 0.0, 0.0, drive, HELD if b.held else FLIGHT)
    coupler, rocker = link_angles(at)
    alpha, transmission, gamma = acute_angles(at)
    travel, slope, bend = striker(b, crank_rad)
    e1 = found.crank_acceleration
    return {
        "crank_rad": crank_rad,
        "coupler_rad": coupler,
        "rocker_rad": rocker,
        "crank_to_coupler_rad": alpha,
        "transmission_rad": transmission,
        "coupler_to_ground_rad": gamma,
        "crank_pin_x_m": at.a_x,
        "crank_pin_y_m": at.a_y,
        "rocker_pin_x_m": at.b_x,
        "rocker_pin_y_m": at.b_y,
        "crank_speed_rad_per_s": u,
        "coupler_speed_rad_per_s": by.g2 * u,
        "rocker_speed_rad_per_s": by.g3 * u,
        "crank_acceleration_rad_per_s2": e1,
        "coupler_acceleration_rad_per_s2": by.g2 * e1 + by.g2_1 * u * u,
        "rocker_acceleration_rad_per_s2": by.g3 * e1 + by.g3_1 * u * u,
        "body_acceleration_rad_per_s2": found.body_acceleration,
        "striker_travel_m": travel,
        "striker_speed_m_per_s": slope * u,
        "striker_slope_m_per_rad": slope,
        "striker_curvature_m_per_rad2": bend,
        "striker_gap_m": gap(b, crank_rad, u, 0.0, 0.0)[0],
        "m11_kg_m2": m.m11,
        "m12_kg_m2": m.m12,
        "m22_kg_m2": m.m22,
        "m11_slope_kg_m2_per_rad": m.m11_q,
        "m12_slope_kg_m2_per_rad": m.m12_q,
        "m22_slope_kg_m2_per_rad": m.m22_q,
        "motor_torque_nm": torque,
        "drive_torque_nm": found.drive,
        "drive_torque_routes_nm": found.drive_error,
        **{
            f"{pin}_{axis}_n": getattr(found, f"{letter}_{axis}")
            for pin, letter in zip(PINS, "oabc", strict=True)
            for axis in "xy"
        },
        "body_moment_nm": found.moment,
        "collar_force_n": found.collar_moment / b.tool_radius_m,
        "spring_force_n": b.spring_rate_n_per_m * b.preload_m,
    }


def tool_gauge(b: Breaker, sends_curve: bool) -> BlowGauge | None:
    """Return the strain gauge on the tool; None where the blow is no wave."""
    if not b.waves:
        return None

    def numbers(event: Event) -> tuple[float, ...]:
        return gauge_numbers(b.wave, blow_of(b, event)[0](NO_CURVE, NO_FORCES))

    def curve(event: Event) -> GaugeCurve:
        return GaugeCurve(*gauge_curve(b.wave, blow_of(b, event)[0]))

    return BlowGauge("blow", ("tool",), numbers, curve, ("tool",) if sends_curve else ())


def blow_of(b: Breaker, event: Event) -> tuple[BlowSimulation, ImpactDirection]:
    """Return the inputs to recompute the blow of an event on the tool, and its direction."""
    before = EventSide(*event.pre)
    rests = b.held or before.body.position == before.body.velocity == 0.0
    along = impact_direction(b, before.crank.position, before.body.position, rests, False)
    tool, closing = before.tool.velocity, event.pre_velocity_m_per_s
    return partial(rod_blow, b.wave, along.effective_kg, closing, tool, rests or tool > 0.0), along


def blow_metrics(b: Breaker, event: Event, line: StressLine | None = None) -> dict[str, float]:
    """Return the metrics of one blow on the tool; of its life where an S-N line is given."""
    simulate, along = blow_of(b, event)
    found, metrics = blow_and_metrics(b.wave, line, simulate)
    v, before = event.pre_velocity_m_per_s, EventSide(*event.pre)
    rebound = v - found.impulse_ns / along.effective_kg
    tool = found.tool_momentum_ns / b.tool_mass_kg
    body, thrown_back = before.body, max(0.0, -tool)
    p = body.velocity - along.y * found.impulse_ns
    push = push_on_body(b, before.crank.position, body.position, p, thrown_back)
    return {
        **metrics,
        "striker_rebound_m_per_s": -rebound,
        "restitution_effective": (tool - rebound) / v,
        "tool_thrown_back_m_per_s": thrown_back,
        "collar_push_ns": push.impulse_nms / b.tool_radius_m,
        "crank_turn_in_window_rad": abs(before.crank.velocity) * found.duration_s,
    }


SEATED_GAP_M = 2e-5
SEATED_REST = 0.05  # part of the cycle


def is_seated(gap_m: float, contact_share: float) -> bool:
    """Return whether a blow finds the tool seated.

    Parameters
    ----------
    gap_m : float
        Lift of the body off its collar at the blow, at the tool (m).
    contact_share : float
        Share of the cycle before the blow in which the body is at rest on its collar.
    """
    return gap_m <= SEATED_GAP_M and contact_share >= SEATED_REST
