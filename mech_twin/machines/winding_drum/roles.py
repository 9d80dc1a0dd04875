"""Roles of the winding drum: the linkage that owns the package, and its force analysis."""

from __future__ import annotations

from dataclasses import dataclass

from mech_twin.machines.winding_drum.wound_package import (
    Package,
    package_inertia,
    package_mass,
    radius_after,
    rate_of_momentum,
    speed_terms,
    tangent_arm,
    time_of_length,
    torque_terms,
    turned,
)
from mech_twin.samples import BodySample, Coordinate, Event, ForceSample, LinkageSample, MotorSample, Named, Wrench

RUNNING, ENDED = 0, 1
JOINTS = ("drum", "yarn", "package_radius")
MEMORY = ("yarn_acceleration_m_per_s2", "drive_work_j", "initial_energy_j")
RESIDUALS = ("rolling_m_per_s", "energy_balance")
QUANTITIES = (
    "acceleration_torque_nm",
    "radius_torque_nm",
    "eccentric_torque_nm",
    "mass_torque_nm",
    "dynamic_torque_nm",
    "package_radius_m",
    "package_inertia_kg_m2",
    "package_mass_kg",
    "tangent_arm_m",
    "angular_acceleration_rad_per_s2",
    "yarn_acceleration_m_per_s2",
    "drive_power_w",
)


@dataclass(frozen=True)
class DrumLinkage:
    """Drum, package and yarn; owner of the package radius.

    When the package is empty (or full) yarn and drive let go: the drum turns on without load.
    """

    package: Package
    step_s: float
    start_radius_m: float
    end_radius_m: float
    start_speed: float
    start_command: float
    end_kind: str
    joints: tuple[str, ...] = JOINTS
    coordinates: tuple[str, ...] = ("drum",)
    regimes: tuple[str, ...] = ("running", "ended")

    @property
    def residual_limits(self) -> dict[str, float]:
        """Limits of the running proofs."""
        return dict.fromkeys(RESIDUALS, 1e-9)

    def start(self, step: int = 0) -> LinkageSample:
        """Return the package at its first radius, the yarn at the configured share of its speed."""
        energy = self._energy(self.start_radius_m, 0.0, self.start_speed)
        return self._sample(
            step, (0.0, 0.0, self.start_radius_m), self.start_speed, self.start_command, (0.0, 0.0, energy), ()
        )

    def advance(self, linkage: LinkageSample, motor: MotorSample, body: BodySample | None) -> LinkageSample:
        """Return the drum one step later; the end of the package is located exactly inside the step."""
        if linkage.regime == ENDED:
            return self._coasted(linkage, linkage.step + 1, self.step_s, motor.command, ())
        phi, length, radius = linkage.position
        theta = linkage.velocity[1]
        a = (motor.velocity[0] - theta) / self.step_s
        run = 0.5 * (theta + motor.velocity[0]) * self.step_s
        left = (radius * radius - self.end_radius_m**2) / (2.0 * self.package.layer_m)
        if run >= left:
            return self._ended(linkage, motor.command, a, left)
        phi, work = turned(self.package, radius, phi, theta, a, self.step_s)
        _, done, energy = linkage.memory.values
        place = (phi, length + run, radius_after(self.package, radius, run))
        return self._sample(linkage.step + 1, place, motor.velocity[0], motor.command, (a, done + work, energy), ())

    def _ended(self, linkage: LinkageSample, command: float, a: float, left: float) -> LinkageSample:
        phi, length, radius = linkage.position
        theta = linkage.velocity[1]
        t = time_of_length(theta, a, left)
        phi, work = turned(self.package, radius, phi, theta, a, t)
        _, done, energy = linkage.memory.values
        speed = theta + a * t
        omega = speed / tangent_arm(self.package, self.end_radius_m, phi)
        torque = torque_terms(self.package, self.end_radius_m, phi, speed, a).total
        event = Event(
            linkage.time_s + t,
            self.end_kind,
            "package",
            speed,
            0.0,
            pre=(Coordinate(phi, omega, torque),),
            post=(Coordinate(phi, omega, 0.0),),
        )
        memory = Named(MEMORY, (0.0, done + work, energy))
        last = linkage._replace(
            position=(phi, length + left, self.end_radius_m), velocity=(omega, 0.0, 0.0), memory=memory
        )
        return self._coasted(last, linkage.step + 1, self.step_s - t, command, (event,))

    def _coasted(
        self, last: LinkageSample, step: int, h: float, command: float, events: tuple[Event, ...]
    ) -> LinkageSample:
        omega = last.velocity[0]
        memory = last.memory.values
        phi, length, radius = last.position
        books = memory[1] - 0.5 * package_inertia(self.package, radius) * omega * omega + memory[2]
        return LinkageSample(
            step,
            step * self.step_s,
            JOINTS,
            (phi + omega * h, length, radius),
            (omega, 0.0, 0.0),
            (0.0, 0.0, 0.0),
            ENDED,
            command,
            last.memory,
            Named(RESIDUALS, (0.0, books / max(1.0, memory[2] + abs(memory[1])))),
            events,
        )

    def _energy(self, radius: float, phi: float, theta: float) -> float:
        omega = theta / tangent_arm(self.package, radius, phi)
        return 0.5 * package_inertia(self.package, radius) * omega * omega

    def _sample(
        self,
        step: int,
        place: tuple[float, float, float],
        theta: float,
        command: float,
        memory: tuple[float, float, float],
        events: tuple[Event, ...],
    ) -> LinkageSample:
        phi, _, radius = place
        rho = tangent_arm(self.package, radius, phi)
        torque = torque_terms(self.package, radius, phi, theta, memory[0]).total
        books = memory[1] - self._energy(radius, phi, theta) + memory[2]
        return LinkageSample(
            step,
            step * self.step_s,
            JOINTS,
            place,
            (theta / rho, theta, -self.package.layer_m * theta / radius),
            (torque, 0.0, 0.0),
            RUNNING,
            command,
            Named(MEMORY, memory),
            Named(RESIDUALS, ((theta / rho) * rho - theta, books / max(1.0, memory[2] + abs(memory[1])))),
            events,
        )


@dataclass(frozen=True)
class DrumForces:
    """Torque of the package term by term, and the reaction of the shaft (weight of the bare drum left out)."""

    package: Package
    gravity: float = 9.80665
    pins: tuple[str, ...] = ("shaft",)
    acts_on: tuple[str, ...] = ("package",)

    @property
    def residual_limits(self) -> dict[str, float]:
        """Limits of the running proofs."""
        return {"drive_torque_routes": 1e-10}

    def analyse(self, linkage: LinkageSample) -> ForceSample:
        """Return each torque term by itself; the yarn's acceleration follows from the torque on the drum joint.

        The two routes are the sum of the page's terms and the chain rule on J0 omega.
        """
        p = self.package
        phi, _, radius = linkage.position
        omega, theta, _ = linkage.velocity
        rho = tangent_arm(p, radius, phi)
        inertia = package_inertia(p, radius)
        mass = package_mass(p, radius)
        a = 0.0
        if linkage.regime == RUNNING:
            a = (linkage.effort[0] - torque_terms(p, radius, phi, theta, 0.0).total) * rho / inertia
        terms = torque_terms(p, radius, phi, theta, a)
        scale = max(abs(terms.acceleration), abs(terms.radius), abs(terms.eccentric), abs(terms.mass), 1e-9)
        difference = (terms.total - rate_of_momentum(p, radius, phi, theta, a)) / scale
        alpha = sum(speed_terms(p, radius, phi, theta, a))
        values = (*terms, radius, inertia, mass, rho, alpha, a, terms.total * omega)
        return ForceSample(
            linkage.step,
            linkage.time_s,
            self.pins,
            (Wrench(0.0, mass * self.gravity, terms.total),),
            Named(QUANTITIES, values),
            0.0,
            Named(("drive_torque_routes",), (difference,)),
        )
