# SPDX-License-Identifier: Apache-2.0
"""The breaker's configuration: its parameter model, and the conditions that tie its numbers together.

The percussion mechanism has lengths and masses with constraints, and angles in given positions.
"""

from __future__ import annotations

import cmath
import math
from typing import Literal

from pydantic import model_validator

from mech_twin.declarations.quantity import Parameters, choice, keep_at_most, lower, quantity, upper
from mech_twin.engine.coupling import Coupling, coupling_step
from mech_twin.machines.drives import MOST_STIFFNESS
from mech_twin.machines.mb10_breaker.impacts import impact_direction
from mech_twin.machines.mb10_breaker.pressed_body.parameters import BodyParameters, ExcitationParameters, motion_refusal
from mech_twin.machines.mb10_breaker.state import breaker
from mech_twin.parts.four_bar import OPEN, FourBar, failing_inequality, smallest_transmission_angle
from mech_twin.parts.friction_and_gear import Friction, Gear
from mech_twin.parts.induction_motor import InductionMotorParameters, SupplyParameters, motor_constants
from mech_twin.parts.rod_waves.parameters import WaveTool, wave_grid
from mech_twin.parts.rod_waves.struck_tool import LARGEST_HEAD

LEAST_TRANSMISSION_DEG = 5.0
LINKS = ("crank", "coupler", "rocker")
MOST_REACH = 10.0  # of centroids and striker, in lengths of the longest link
STIFFEST_N_PER_M = 1e8  # of the springs, where the body follows the forces of the linkage
LONGEST_STEP_S = 0.005
LONGEST_TURN_RAD = 0.135  # of the crank in a step: peaks of the forces are told of samples and events
FASTEST_DECAY_PER_S = 100.0  # of the crank by the friction of its bearing: slow against the integrator's step
FASTEST_TOOL_STOP_M_PER_S2 = 1e9  # by the wall: it costs energy and momentum a tenth of their limits, in proportion
FASTEST_WALL_RAD_PER_S2 = 1e7  # of the crank by the wall: it stops within less than a substep can be halved to
FASTEST_STOP_RAD_PER_S2 = 1e5  # of crank and body by Coulomb friction: a stop is told from the blow before it
MOST_MOVED = 100.0  # masses of coupler and rocker at the crank pin over the inertia of crank and rotor
MOST_SWING_RAD = 500.0  # of the body on its spring in one coupling step
HEAD_ANGLES = 180  # of the crank, at which the striker's least effective mass is looked for
LARGEST_OVERTRAVEL = 0.5  # of the striker's stroke: the tool stands in its way in the first half of its way back


class LinkageParameters(Parameters):
    """The crank-rocker MO-10: lengths, masses and the arm that strikes."""

    crank_m: float = quantity("m", "crank length", gt=0.0)
    coupler_m: float = quantity("m", "coupler length", gt=0.0)
    rocker_m: float = quantity("m", "rocker length, bearing to coupler pin", gt=0.0)
    ground_m: float = quantity("m", "distance of the crank and rocker bearings on the body", gt=0.0)
    striker_arm_m: float = quantity("m", "arm of the striking face about the rocker bearing", gt=0.0)
    striker_angle_deg: float = quantity("deg", "angle from the rocker to the striker arm", ge=-180.0, le=180.0)
    crank_mass_kg: float = quantity("kg", "mass of crank and flywheel", gt=0.0)
    crank_inertia_kg_m2: float = quantity("kg m^2", "inertia of crank and flywheel about the crank axis", gt=0.0)
    crank_centroid_along_m: float = quantity("m", "crank centroid from its axis along the crank", default=0.0)
    crank_centroid_across_m: float = quantity("m", "crank centroid across the crank", default=0.0)
    coupler_mass_kg: float = quantity("kg", "mass of the coupler", gt=0.0)
    coupler_inertia_kg_m2: float = quantity("kg m^2", "inertia of the coupler about its centroid", ge=0.0)
    coupler_centroid_along_m: float = quantity("m", "coupler centroid from the crank pin along the coupler")
    coupler_centroid_across_m: float = quantity("m", "coupler centroid across the coupler", default=0.0)
    rocker_mass_kg: float = quantity("kg", "mass of rocker and striker", gt=0.0)
    rocker_inertia_kg_m2: float = quantity("kg m^2", "inertia of rocker and striker about the rocker bearing", gt=0.0)
    rocker_centroid_along_m: float = quantity("m", "rocker centroid from its bearing along the rocker")
    rocker_centroid_across_m: float = quantity("m", "rocker centroid across the rocker", default=0.0)
    initial_crank_deg: float = quantity("deg", "crank angle at the start, from the line of the bearings", default=0.0)

    @property
    def four_bar(self) -> FourBar:
        """The linkage in the body's frame: origin on the crank axis, x towards the rocker bearing."""
        return FourBar(self.crank_m, self.coupler_m, self.rocker_m, self.ground_m, 0.0, OPEN)

    @model_validator(mode="after")
    def _turns_fully(self) -> LinkageParameters:
        failing = failing_inequality(self.four_bar, crank_rocker=True)
        if failing:
            raise ValueError(failing)
        sharpest = math.degrees(smallest_transmission_angle(self.four_bar))
        if sharpest < LEAST_TRANSMISSION_DEG:
            raise ValueError(
                f"the transmission angle between coupler_m and rocker_m falls to {sharpest:.3g} deg with ground_m "
                f"{self.ground_m:g}: at least {LEAST_TRANSMISSION_DEG:g} deg keep the linkage from a change point"
            )
        return self

    @model_validator(mode="after")
    def _masses_are_within_reach(self) -> LinkageParameters:
        reach = MOST_REACH * max(self.ground_m, self.coupler_m, self.rocker_m)
        why = f"{MOST_REACH:g} times the longest link"
        keep_at_most("striker_arm_m", self.striker_arm_m, reach, why, " m")
        for link in LINKS:
            inertia, most = f"{link}_inertia_kg_m2", getattr(self, f"{link}_mass_kg") * reach * reach
            keep_at_most(inertia, getattr(self, inertia), most, f"{link}_mass_kg at {why}")
            for way in ("along", "across"):
                centroid = f"{link}_centroid_{way}_m"
                keep_at_most(centroid, getattr(self, centroid), reach, why, " m either way")
        return self

    @model_validator(mode="after")
    def _inertias_are_about_their_axes(self) -> LinkageParameters:
        own = self.crank_mass_kg * (self.crank_centroid_along_m**2 + self.crank_centroid_across_m**2)
        if self.crank_inertia_kg_m2 < own:
            raise ValueError(
                f"crank_inertia_kg_m2 is about the crank axis and must be at least mass x centroid distance squared = "
                f"{lower(own)} kg m^2; got {self.crank_inertia_kg_m2:g}"
            )
        own = self.rocker_mass_kg * (self.rocker_centroid_along_m**2 + self.rocker_centroid_across_m**2)
        if self.rocker_inertia_kg_m2 <= own:
            raise ValueError(
                f"rocker_inertia_kg_m2 is about the bearing and must exceed mass x centroid distance squared = "
                f"{lower(own)} kg m^2; got {self.rocker_inertia_kg_m2:g}"
            )
        return self


def _angle_between(first_m: float, second_m: float, across_m: float) -> float:
    """Return the angle (rad) between two sides of a triangle from the length of the third."""
    cosine = (first_m**2 + second_m**2 - across_m**2) / (2.0 * first_m * second_m)
    return math.acos(min(max(cosine, -1.0), 1.0))


def rocker_angle(link: LinkageParameters, reach_m: float) -> float:
    """Return the angle (rad) between rocker and ground link, the rocker pin this far (m) from the crank axis."""
    return _angle_between(link.rocker_m, link.ground_m, reach_m)


def start_angle(link: LinkageParameters) -> float:
    """Return the angle (rad) between rocker and ground link at the start."""
    pin = cmath.rect(link.crank_m, math.radians(link.initial_crank_deg))
    span = link.ground_m - pin
    joint = pin + cmath.rect(
        link.coupler_m, cmath.phase(span) - _angle_between(abs(span), link.coupler_m, link.rocker_m)
    )
    return rocker_angle(link, abs(joint))


class ToolParameters(Parameters):
    """The free tool the striker meets, seated in the collar of the body."""

    model: Literal["rigid", "wave"] = choice("the blow: of rigid bodies, or a wave in the tool", default="rigid")
    mass_kg: float = quantity("kg", "mass of the tool; with model wave that of its rods counts", gt=0.0)
    restitution: float = quantity("1", "restitution of striker on tool, e_t", ge=0.0, le=1.0, live=True)
    overtravel_m: float = quantity("m", "travel of the striker past the seated tool, h", gt=0.0)
    wall_force_n: float = quantity("N", "mean force of the wall on the advancing tool", ge=0.0, le=1e7, live=True)
    contact_stiffness_n_per_m: float | None = quantity(
        "N/m",
        "stiffness of the contact of striker and tool, for each blow's peak force and contact time",
        ge=1e4,
        le=1e12,
        default=None,
    )
    wave: WaveTool = choice("the blow as a wave, with model wave", default=WaveTool())

    @property
    def moved_kg(self) -> float:
        """Mass of the tool, or of its rods."""
        return self.mass_kg if self.model == "rigid" else wave_grid(self.wave, self.wall_force_n).tool_mass_kg


class BreakerCoupling(Coupling):
    """The coupling of the roles through time."""

    step_s: float = coupling_step(LONGEST_STEP_S)


class BreakerParameters(Parameters):
    """MB-10 breaker."""

    motor: InductionMotorParameters = choice("the induction motor")
    gear: Gear = choice("the gear pair")
    linkage: LinkageParameters = choice("the percussion mechanism")
    tool: ToolParameters = choice("the tool")
    drive_mount: Literal["frame", "body"] = choice(
        "what carries motor and gear; on the body the gear torque and the rotor's reaction act on it too"
    )
    gravity_m_per_s2: float = quantity(
        "m/s^2", "gravity on the links, along -y; the body's own weight is in its preload", ge=0.0, le=100.0, live=True
    )
    body: BodyParameters = choice("the body, its spring and collar")
    excitation: ExcitationParameters = choice("what moves the body")
    coupling: BreakerCoupling = choice("the coupling of the roles")
    supply: SupplyParameters = choice("the supply of the motor")
    friction: Friction = choice("friction of the crank's bearing in the body", default=Friction())

    @model_validator(mode="after")
    def _striker_meets_the_tool(self) -> BreakerParameters:
        link, h = self.linkage, self.tool.overtravel_m
        swing = rocker_angle(link, link.coupler_m + link.crank_m) - rocker_angle(link, link.coupler_m - link.crank_m)
        stroke = link.striker_arm_m * swing
        if not h < LARGEST_OVERTRAVEL * stroke:
            raise ValueError(
                f"tool.overtravel_m must be less than {LARGEST_OVERTRAVEL:g} of the striker's stroke, "
                f"{upper(LARGEST_OVERTRAVEL * stroke, 4)} m with this linkage; got {h:g}"
            )
        short = link.striker_arm_m * (swing + rocker_angle(link, link.coupler_m - link.crank_m) - start_angle(link))
        if short < h:
            raise ValueError(
                f"linkage.initial_crank_deg {link.initial_crank_deg:g} starts the striker {h - short:.4g} m inside the "
                f"tool: start where it is at least tool.overtravel_m = {h:g} m from its extreme, as at 0 or 180 deg"
            )
        return self

    @model_validator(mode="after")
    def _step_is_short_enough(self) -> BreakerParameters:
        synchronous = self.motor.synchronous_speed_rpm * math.pi / 30.0 / self.gear.ratio
        bounds = [
            (LONGEST_TURN_RAD / synchronous, f"{LONGEST_TURN_RAD:g} rad of the crank at synchronous speed"),
            (
                MOST_STIFFNESS * shaft_time_s(self),
                f"{MOST_STIFFNESS:g} times inertia of rotor and crank over the steepest slope of the motor",
            ),
        ]
        if self.excitation.kind == "from_forces":
            k = self.body.spring_arm_m * math.sqrt(self.body.spring_rate_n_per_m / self.body.inertia_kg_m2)
            swing = f"{MOST_SWING_RAD:g} rad of the body's swing on body.spring_rate_n_per_m"
            bounds.append((MOST_SWING_RAD / k, swing))
        longest, why = min(bounds)
        if self.coupling.step_s > longest:
            raise ValueError(
                f"coupling.step_s = {self.coupling.step_s:g} s must be at most {upper(longest, 4)} s: {why}"
            )
        return self

    @model_validator(mode="after")
    def _motion_can_be_followed(self) -> BreakerParameters:
        link, wall, shaft = self.linkage, self.tool.wall_force_n, self.shaft_inertia_kg_m2
        keep_at_most(
            "linkage.coupler_mass_kg + linkage.rocker_mass_kg",
            link.coupler_mass_kg + link.rocker_mass_kg,
            MOST_MOVED * shaft / link.crank_m**2,
            f"{MOST_MOVED:g} times the inertia of crank and rotor over crank_m squared: the crank's speed would jump "
            "at the dead centres",
            " kg",
        )
        most = FASTEST_DECAY_PER_S * link.crank_inertia_kg_m2
        why = f"{FASTEST_DECAY_PER_S:g}/s times linkage.crank_inertia_kg_m2"
        keep_at_most("friction.viscous_nms_per_rad", self.friction.viscous_nms_per_rad, most, why, digits=4)
        why = f"{FASTEST_STOP_RAD_PER_S2:g} rad/s2 of the inertia it stops"
        for key, torque, inertia in (
            ("friction.coulomb_nm", self.friction.coulomb_nm, shaft),
            ("body.friction.coulomb_nm", self.body.friction.coulomb_nm, self.body.inertia_kg_m2),
        ):
            keep_at_most(key, torque, FASTEST_STOP_RAD_PER_S2 * inertia, why, " N m")
        most = FASTEST_WALL_RAD_PER_S2 * shaft * link.rocker_m / (link.striker_arm_m * link.crank_m)
        why = f"{FASTEST_WALL_RAD_PER_S2:g} rad/s2 of crank and rotor by way of the striker"
        keep_at_most("tool.wall_force_n", wall, most, why, " N")
        why = (
            f"{FASTEST_TOOL_STOP_M_PER_S2:g} m/s2 of the tool's mass: what a lighter tool does in its wall is lost in "
            "rounding"
        )
        keep_at_most("tool.wall_force_n", wall, FASTEST_TOOL_STOP_M_PER_S2 * self.tool.moved_kg, why, " N")
        return self

    @model_validator(mode="after")
    def _body_can_be_followed(self) -> BreakerParameters:
        body, refusal = self.body, ""
        if self.excitation.kind == "from_forces":
            if body.contact != "one_sided":
                raise ValueError(
                    f"excitation.kind from_forces needs body.contact one_sided, got '{body.contact}': without a "
                    "collar nothing seats the tool"
                )
            why = "with excitation.kind from_forces: the body would bounce too often in a step"
            keep_at_most("body.spring_rate_n_per_m", body.spring_rate_n_per_m, STIFFEST_N_PER_M, why, " N/m")
        elif body.friction.coulomb_nm > 0.0:
            refusal = (
                "body.friction.coulomb_nm must be 0 under excitation.kind approximated: its closed form knows viscous "
                f"friction only; got {body.friction.coulomb_nm:g}"
            )
        else:
            refusal = motion_refusal(body, self.excitation)
        if refusal:
            raise ValueError(refusal)
        return self

    @model_validator(mode="after")
    def _tool_line_exists(self) -> BreakerParameters:
        lever = self.body.tool_radius_m - self.linkage.striker_arm_m
        if abs(lever) >= self.linkage.ground_m:
            raise ValueError(
                f"|tool_radius_m - striker_arm_m| < ground_m fails: no line lies {self.body.tool_radius_m:g} m from "
                f"the crank axis and {self.linkage.striker_arm_m:g} m from the rocker bearing, "
                f"{self.linkage.ground_m:g} m apart"
            )
        return self

    @model_validator(mode="after")
    def _head_is_part_of_the_striker(self) -> BreakerParameters:
        if self.tool.model == "rigid" or self.tool.wave.head.length_m == 0.0:
            return self
        constants = breaker(self)
        head = constants.wave.head_mass_kg
        angles = [2.0 * math.pi * i / HEAD_ANGLES for i in range(HEAD_ANGLES)]
        least = min(impact_direction(constants, q, 0.0, False, False).effective_kg for q in angles)
        if head > LARGEST_HEAD * least:
            raise ValueError(
                f"tool.wave.head must have at most {upper(LARGEST_HEAD * least)} kg, {LARGEST_HEAD:g} of the striker's "
                f"least effective mass; got {head:.6g}"
            )
        return self

    @property
    def shaft_inertia_kg_m2(self) -> float:
        """Inertia of crank and flywheel, and of the rotor as the gear's output carries it."""
        return self.linkage.crank_inertia_kg_m2 + self.gear.ratio**2 * self.motor.rotor_inertia_kg_m2


def shaft_time_s(p: BreakerParameters) -> float:
    """Return the smallest time constant (s) of speed differences on the motor's stable branch.

    tau = eta J/(i^2 dM/dw), dM/dw = 2 M_max/(s_kr w_0).  J is the least inertia at the gear's output: crank and
    i^2 J_rotor, reduced by the body's compliance where the drive is on the body.
    """
    i, rotor, crank = p.gear.ratio, p.motor.rotor_inertia_kg_m2, p.linkage.crank_inertia_kg_m2
    inertia = crank + i * i * rotor
    if p.drive_mount == "body":
        inertia -= (i * rotor - crank) ** 2 / (p.body.inertia_kg_m2 + crank + rotor)
    motor = motor_constants(p.motor)
    slope = 2.0 * motor.breakdown_torque_nm / (motor.breakdown_slip * motor.synchronous_speed_rad_per_s)
    return p.gear.efficiency * inertia / (i * i * slope)
