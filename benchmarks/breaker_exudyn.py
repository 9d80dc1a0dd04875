# SPDX-License-Identifier: Apache-2.0
"""The breaker as Exudyn has it: bodies in the plane, ideal joints, the same motor, gear and laws of contact.

Crank, coupler, rocker and body are rigid bodies with joints that are held by Lagrange multipliers, integrated by the
generalised-alpha method.  Crank and body turn about the origin; the rotor's inertia is added to the crank (the drive
stands on the frame).  The striker's gap is linear in the coordinates: two coordinates without mass carry it, and a
limit stop on it is the contact, the collar is one on the body's angle.  A stop is a spring with a damper that lasts so
many steps, for the mass that the blow sees; the wall is friction on the tool, regularised near rest.

Motor torque (Kloss) and gear losses are set each step; the tool is put back at the rocker's return, as in the machine.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from breaker_mjcf import STRUCK_M_PER_S, Told
from fast_exudyn import exudyn

from mech_twin.machines.mb10_breaker.dynamics import Breaker, masses_at, striker
from mech_twin.parts.contact import damping_ratio_without_pull
from mech_twin.parts.four_bar import Link, offset, position
from mech_twin.parts.friction_and_gear import gear_torque
from mech_twin.parts.induction_motor import MotorConstants, motor_torque

item = exudyn.itemInterface
MASSLESS_KG = 1e-9
SLIDING_M_PER_S = 1e-3  # below it the wall's friction falls to nothing
NEVER = 1e3
TOOL, TRAVEL, GAP = 0, 1, 2  # coordinates beside the bodies': tool, striker's travel, gap between them


class Setting(NamedTuple):
    """A setting of Exudyn: step (s), how many of them a blow takes, spectral radius of the integrator."""

    step_s: float
    contact_steps: float
    spectral_radius: float = 0.5


class Rigid(NamedTuple):
    """A rigid body: its node, the body, and its centroid in its own axes (m)."""

    node: int
    body: int
    along_m: float = 0.0
    across_m: float = 0.0


class Model(NamedTuple):
    """A breaker in Exudyn: the system, its settings, the load on the crank and where the coordinates stand."""

    system: exudyn.MainSystem
    settings: exudyn.SimulationSettings
    load: int
    crank: int
    rocker: int
    body: int
    tool: int
    ends: tuple[int, int]


def struck_mass_kg(b: Breaker) -> float:
    """Return the mass that a blow at the seated tool sees: of tool, body, and the links behind the striker."""
    at = masses_at(b, b.striking_crank_rad, 0.0)
    rate = np.array([striker(b, b.striking_crank_rad)[1], -b.tool_radius_m])
    return float(1.0 / (rate @ np.linalg.solve([[at.m11, at.m12], [at.m12, at.m22]], rate) + 1.0 / b.tool_mass_kg))


def _stop(mass: float, restitution: float, setting: Setting) -> dict[str, object]:
    """Return stiffness and damping of a stop on which a mass bounces in the setting's steps."""
    rate = math.pi / (setting.contact_steps * setting.step_s)
    damping = 2.0 * damping_ratio_without_pull(restitution) * rate * mass
    return {"useLimitStops": True, "limitStopsStiffness": mass * rate * rate, "limitStopsDamping": damping}


class _Builder:
    """What is added to a system, in short."""

    def __init__(self) -> None:
        self.system = exudyn.SystemContainer().AddSystem()
        self.ground = Rigid(-1, self.system.AddObject(item.ObjectGround()))
        self.still = self.coordinate(self.system.AddNode(item.NodePointGround()), 0)

    def body(self, mass: float, inertia: float, angle: float) -> Rigid:
        """Add a body whose centroid is the origin."""
        node = self.system.AddNode(item.NodeRigidBody2D(referenceCoordinates=[0.0, 0.0, angle]))
        return Rigid(node, self.system.AddObject(item.ObjectRigidBody2D(mass=mass, inertia=inertia, nodeNumber=node)))

    def link(self, link: Link, pin: tuple[float, float], reach: tuple[float, float]) -> Rigid:
        """Add a link that reaches from a pin as a vector."""
        x, y = offset(link, *reach, math.hypot(*reach))
        place = [pin[0] + x, pin[1] + y, math.atan2(reach[1], reach[0])]
        node = self.system.AddNode(item.NodeRigidBody2D(referenceCoordinates=place))
        mass = {"mass": link.mass_kg, "inertia": link.inertia_kg_m2}
        body = self.system.AddObject(item.ObjectRigidBody2D(nodeNumber=node, **mass))
        return Rigid(node, body, link.along_m, link.across_m)

    def point(self, of: Rigid, x: float = 0.0, y: float = 0.0) -> int:
        """Add a point of a body, in its axes from its first pin."""
        place = [x - of.along_m, y - of.across_m, 0.0]
        return int(self.system.AddMarker(item.MarkerBodyPosition(bodyNumber=of.body, localPosition=place)))

    def pin(self, one: int, other: int) -> None:
        """Add an ideal joint of two points."""
        self.system.AddObject(item.ObjectJointRevolute2D(markerNumbers=[one, other]))

    def coordinate(self, node: int, number: int) -> int:
        """Add a marker of one coordinate of a node."""
        return int(self.system.AddMarker(item.MarkerNodeCoordinate(nodeNumber=node, coordinate=number)))

    def coordinates(self, node: int) -> int:
        """Add a marker of all coordinates of a node."""
        return int(self.system.AddMarker(item.MarkerNodeCoordinates(nodeNumber=node)))

    def hold(self, marker: int, **law: object) -> None:
        """Add a spring, stop or friction between a coordinate and the ground."""
        data = {}
        if "useLimitStops" in law:
            remembered = item.NodeGenericData(numberOfDataCoordinates=3, initialCoordinates=[0.0] * 3)
            data["nodeNumber"] = self.system.AddNode(remembered)
        markers = [self.still, marker]
        self.system.AddObject(item.ObjectConnectorCoordinateSpringDamperExt(markerNumbers=markers, **data, **law))

    def gap(self, b: Breaker, rocker: Rigid, rocker_rad: float, body: Rigid) -> int:
        """Add tool x, travel y = arm psi and gap z = x - y - (radius - arm) theta; theta is -phi of the body."""
        started = {"initialCoordinates": [0.0] * 3, "initialCoordinates_t": [0.0] * 3}
        tools = item.NodeGenericODE2(referenceCoordinates=[0.0] * 3, numberOfODE2Coordinates=3, **started)
        node = int(self.system.AddNode(tools))
        mass = np.diag([b.tool_mass_kg, MASSLESS_KG, MASSLESS_KG])
        self.system.AddObject(item.ObjectGenericODE2(nodeNumbers=[node], massMatrix=mass))
        arm, known = b.striker_arm_m, self.coordinates(node)
        for turned, scale, row, reference_rad in (
            (rocker, arm, [0.0, 1.0, 0.0], rocker_rad),
            (body, arm - b.tool_radius_m, [-1.0, 1.0, 1.0], 0.0),
        ):
            self.system.AddObject(
                item.ObjectConnectorCoordinateVector(
                    markerNumbers=[known, self.coordinates(turned.node)],
                    scalingMarker0=np.array([row]),
                    scalingMarker1=np.array([[0.0, 0.0, scale]]),
                    offset=[scale * reference_rad],
                )
            )
        return node


def breaker_model(b: Breaker, crank_rad: float, setting: Setting) -> Model:
    """Return the breaker, assembled at a crank angle, the body on its collar."""
    at, end = position(b.bar, float(crank_rad)), position(b.bar, b.striking_crank_rad)
    rocker_rad, pivot = math.atan2(at.v_y, at.v_x), (b.bar.pivot_x_m, b.bar.pivot_y_m)
    reach = math.remainder(math.atan2(end.v_y, end.v_x) - rocker_rad, 2.0 * math.pi)
    add = _Builder()
    crank = add.body(b.crank.mass_kg, b.crank.inertia_kg_m2 + b.rotor_11_kg_m2, crank_rad)
    body = add.body(1.0, b.body_inertia_kg_m2, 0.0)
    coupler = add.link(b.coupler, (at.a_x, at.a_y), (at.u_x, at.u_y))
    rocker = add.link(b.rocker, pivot, (at.v_x, at.v_y))
    ends = add.point(coupler, b.bar.coupler_m), add.point(rocker, b.bar.rocker_m)
    add.pin(add.point(add.ground), add.point(crank))
    add.pin(add.point(add.ground), add.point(body))
    add.pin(add.point(crank, b.bar.crank_m), add.point(coupler))
    add.pin(*ends)
    add.pin(add.point(body, *pivot), add.point(rocker))
    tools = add.gap(b, rocker, rocker_rad, body)
    add.hold(
        add.coordinate(body.node, 2),
        stiffness=b.spring_rate_n_per_m * b.spring_arm_m**2,
        damping=b.body_damping_nms_per_rad,
        offset=b.preload_m / b.spring_arm_m,
        limitStopsUpper=0.0,
        limitStopsLower=-NEVER,
        **_stop(masses_at(b, crank_rad, 0.0).m22, b.collar_restitution, setting),
    )
    add.hold(
        add.coordinate(tools, GAP),
        limitStopsUpper=NEVER,
        limitStopsLower=b.overtravel_m - b.striker_arm_m * reach,
        **_stop(struck_mass_kg(b), b.tool_restitution, setting),
    )
    add.hold(add.coordinate(tools, TOOL), dynamicFrictionForce=b.wall_force_n, frictionProportionalZone=SLIDING_M_PER_S)
    turning = add.coordinate(crank.node, 2)
    load = add.system.AddLoad(item.LoadCoordinate(markerNumber=turning, load=0.0))
    add.system.Assemble()
    first = [add.system.GetNodeODE2Index(node) for node in (crank.node, rocker.node, body.node, tools)]
    angles = [place + 2 for place in first[:3]]
    return Model(add.system, _settings(setting), load, *angles, first[3], ends)


def _settings(setting: Setting) -> exudyn.SimulationSettings:
    """Return settings without output."""
    settings = exudyn.SimulationSettings()
    settings.timeIntegration.generalizedAlpha.spectralRadius = setting.spectral_radius
    settings.timeIntegration.verboseMode = 0
    settings.solutionSettings.writeSolutionToFile = False
    settings.solutionSettings.sensorsWritePeriod = NEVER
    settings.displayStatistics = settings.displayComputationTime = False
    return settings


def run_from_start(model: Model, setting: Setting, duration_s: float) -> None:
    """Run from the state that the model starts in, without Python between the steps unless a rule is set."""
    run = model.settings.timeIntegration
    run.endTime, run.numberOfSteps = duration_s, round(duration_s / setting.step_s)
    exudyn.SolveDynamic(model.system, model.settings)


def followed(b: Breaker, motor: MotorConstants, model: Model, setting: Setting, duration_s: float) -> Told:
    """Run from standstill with all of its rules; return what was seen.

    After it the model starts where this run ended, without rules, the last torque on its crank.
    """
    opening, quickest, struck_s, before = 0.0, 0.0, 0.0, 0.0
    blows: list[tuple[float, float]] = []

    def rules(system: exudyn.MainSystem, time_s: float) -> bool:
        nonlocal opening, quickest, struck_s, before
        data = system.systemData
        speeds = data.GetODE2Coordinates_t()
        one, other = (np.array(system.GetMarkerOutput(end, exudyn.OutputVariableType.Position)) for end in model.ends)
        opening = max(opening, float(np.hypot(*(one - other)[:2])))
        if speeds[model.tool] > quickest:
            quickest, struck_s = float(speeds[model.tool]), time_s
        now = float(speeds[model.rocker] - speeds[model.body])
        if before < 0.0 <= now:  # the rocker returns: the tool is put back
            if quickest > STRUCK_M_PER_S:
                blows.append((struck_s, 0.5 * b.tool_mass_kg * quickest**2))
            places = data.GetODE2Coordinates()
            for values in (places, speeds):
                values[model.tool + GAP] -= values[model.tool + TOOL]
                values[model.tool + TOOL] = 0.0
            quickest = 0.0
            data.SetODE2Coordinates(places)
            data.SetODE2Coordinates_t(speeds)
        before = now
        speed = float(speeds[model.crank])
        torque = gear_torque(b.ratio, b.efficiency, motor_torque(motor, speed * b.ratio, 1.0), speed)
        system.SetLoadParameter(model.load, "load", torque)
        return True

    model.system.SetPreStepUserFunction(rules)
    run_from_start(model, setting, duration_s)
    model.system.SetPreStepUserFunction(0)
    data = model.system.systemData
    data.SetSystemState(data.GetSystemState(), exudyn.ConfigurationType.Initial)
    return Told(opening, np.array(blows).reshape(-1, 2))
