"""The breaker drawn, and its figures at one position and over one turn."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from mech_twin.machines.mb10_breaker_dynamics import REST, Breaker
from mech_twin.machines.mb10_breaker_forces import in_frame, pin_forces
from mech_twin.machines.mb10_breaker_parameters import BreakerParameters
from mech_twin.parts.four_bar import acute_angles, closure_error, coefficients, link_angles, position
from mech_twin.parts.induction_motor import motor_constants
from mech_twin.samples import BodySample, LinkageSample, Shape

Point = tuple[float, float]

BODY, FRAME, SPRING = (140, 146, 158), (110, 110, 110), (92, 160, 88)
CRANK, COUPLER, ROCKER, TOOL = (214, 96, 60), (58, 124, 196), (196, 150, 40), (150, 84, 178)
TOOL_LENGTH_M = 0.18
COILS = 7


def drawing(b: Breaker, striker_angle_deg: float) -> Callable[[LinkageSample, BodySample | None], tuple[Shape, ...]]:
    """Return the function that draws the breaker: body, springs, crank, coupler, rocker with striker, tool, wall.

    The body's frame turns clockwise by phi about the crank axis; tool, wall and the springs' seat stand still.
    """
    lean = math.radians(striker_angle_deg)
    ground = b.bar.pivot_x_m
    outline = (
        (-0.07, 0.09),
        (ground + 0.05, 0.09),
        (ground + 0.05, -0.13),
        (0.14, -0.27),
        (-0.07, -0.27),
        (-0.07, 0.09),
    )
    face = _seated_face(b, lean)

    def draw(linkage: LinkageSample, body: BodySample | None) -> tuple[Shape, ...]:
        phi = linkage.position[3] if body is None else body.position[0]
        at = position(b.bar, linkage.position[0])
        arm = linkage.position[2] + lean

        def turned(x: float, y: float) -> Point:
            return in_frame(phi, x, y)

        d, pin_a, pin_b = turned(ground, 0.0), turned(at.a_x, at.a_y), turned(at.b_x, at.b_y)
        striker = turned(ground + b.striker * math.cos(arm), b.striker * math.sin(arm))
        return (
            Shape("body", "line", tuple(turned(x, y) for x, y in outline), BODY, 0.006),
            Shape("springs", "line", _spring(turned(-0.07, -b.arm)), SPRING, 0.004),
            Shape("wall", "line", _wall(b, face), FRAME, 0.010),
            Shape("tool", "line", (face, _along(b, face, TOOL_LENGTH_M)), TOOL, 0.022),
            Shape("rocker", "line", (pin_b, d, striker), ROCKER, 0.012),
            Shape("coupler", "line", (pin_a, pin_b), COUPLER, 0.008),
            Shape("crank", "line", ((0.0, 0.0), pin_a), CRANK, 0.010),
            Shape("striker", "points", (striker,), ROCKER, 0.024),
            Shape("pins", "points", ((0.0, 0.0), pin_a, pin_b, d), FRAME, 0.014),
        )

    return draw


def _along(b: Breaker, point: Point, distance: float) -> Point:
    return point[0] + distance * b.n_x, point[1] + distance * b.n_y


def _seated_face(b: Breaker, lean: float) -> Point:
    """Return where the seated tool meets the striker: the overtravel short of the striker's extreme."""
    arm = link_angles(position(b.bar, b.extreme))[1] + lean
    extreme = (b.bar.pivot_x_m + b.striker * math.cos(arm), b.striker * math.sin(arm))
    return _along(b, extreme, -b.overtravel)


def _wall(b: Breaker, face: Point) -> tuple[Point, ...]:
    x, y = _along(b, face, TOOL_LENGTH_M)
    return (x - 0.12 * b.n_y, y + 0.12 * b.n_x), (x + 0.12 * b.n_y, y - 0.12 * b.n_x)


def _spring(end: Point, seat_m: float = -0.26) -> tuple[Point, ...]:
    """Return a zigzag from the seat on the frame to the body."""
    length = end[0] - seat_m
    coils = ((seat_m + length * (i + 0.5) / COILS, end[1] + 0.018 * (-1) ** i) for i in range(COILS))
    return (seat_m, end[1] + 0.05), (seat_m, end[1] - 0.05), (seat_m, end[1]), *coils, end


def static_report(p: BreakerParameters, b: Breaker) -> dict[str, float]:
    """Return what follows from the configuration alone: motor, linkage, body and spring, units in the names."""
    motor = motor_constants(p.motor)
    rated_crank = motor.rated_speed_rad_per_s / p.gear.ratio
    transmission = [_transmission_deg(b, math.radians(degree)) for degree in range(360)]
    rest_force = p.body.spring_rate_n_per_m * p.body.preload_deflection_m
    return {
        "rated_torque_nm": motor.rated_torque_nm,
        "breakdown_torque_nm": motor.breakdown_torque_nm,
        "rated_slip": motor.rated_slip,
        "breakdown_slip": motor.breakdown_slip,
        "rated_blow_rate_hz": rated_crank / (2.0 * math.pi),
        "striking_extreme_crank_deg": math.degrees(b.extreme),
        "transmission_angle_min_deg": min(transmission),
        "body_frequency_rad_per_s": p.body.spring_arm_m * math.sqrt(p.body.spring_rate_n_per_m / p.body.inertia_kg_m2),
        "rest_spring_force_n": rest_force,
        "rest_force_on_tool_n": rest_force * p.body.spring_arm_m / p.body.tool_radius_m,
    }


def _transmission_deg(b: Breaker, crank_rad: float) -> float:
    at = position(b.bar, crank_rad)
    return math.degrees(acute_angles(at)[1])


def position_figures(p: BreakerParameters, b: Breaker, crank_rad: float) -> dict[str, Any]:
    """Return every angle, coefficient and force at one crank position, at rated speed, the body on its collar."""
    motor = motor_constants(p.motor)
    speed = motor.rated_speed_rad_per_s / p.gear.ratio
    at = position(b.bar, crank_rad)
    by = coefficients(at)
    coupler, rocker = link_angles(at)
    drive = p.gear.efficiency * p.gear.ratio * motor.rated_torque_nm
    forces = pin_forces(b, crank_rad, speed, 0.0, 0.0, drive, REST)
    return {
        "crank_rad": crank_rad,
        "crank_speed_rad_per_s": speed,
        "pin_a_m": (at.a_x, at.a_y),
        "pin_b_m": (at.b_x, at.b_y),
        "coupler_rad": coupler,
        "rocker_rad": rocker,
        "coupler_speed_rad_per_s": by.g2 * speed,
        "rocker_speed_rad_per_s": by.g3 * speed,
        "striker_speed_m_per_s": by.g3 * speed * b.striker,
        "transmission_angle_deg": _transmission_deg(b, crank_rad),
        "crank_bearing_n": (forces.o_x, forces.o_y),
        "crank_pin_n": (forces.a_x, forces.a_y),
        "rocker_pin_n": (forces.b_x, forces.b_y),
        "rocker_bearing_n": (forces.c_x, forces.c_y),
        "drive_torque_nm": forces.drive,
        "body_moment_nm": forces.moment,
        "crank_acceleration_rad_per_s2": forces.crank_acceleration,
        "loop_closure_m": closure_error(b.bar, at),
    }
