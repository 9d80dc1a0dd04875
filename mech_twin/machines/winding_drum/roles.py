"""Roles of the winding drum: the linkage that owns the package, and its force analysis."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin
from typing import NamedTuple

from mech_twin.machines.winding_drum.dynamics import coasted, drive_torque, driven, start_sense
from mech_twin.machines.winding_drum.wound_package import (
    Package,
    gravity_moment,
    package_inertia,
    package_mass,
    radius_after,
    rate_of_momentum,
    speed_terms,
    tangent_arm,
    time_of_length,
    torque_terms,
)
from mech_twin.parts.friction import sliding_torque
from mech_twin.samples import BodySample, Coordinate, Event, ForceSample, LinkageSample, MotorSample, Named, Wrench

RUNNING, ENDED, STUCK = 0, 1, 2
REGIMES = ("running", "ended", "stuck")
JOINTS = ("drum", "yarn", "package_radius")
RESIDUALS = ("area_balance", "energy_balance")
QUANTITIES = (
    "acceleration_torque_nm",
    "radius_torque_nm",
    "eccentric_torque_nm",
    "mass_torque_nm",
    "dynamic_torque_nm",
    "gravity_moment_nm",
    "friction_torque_nm",
    "package_radius_m",
    "package_inertia_kg_m2",
    "package_mass_kg",
    "tangent_arm_m",
    "angular_acceleration_rad_per_s2",
    "yarn_acceleration_m_per_s2",
    "drive_power_w",
)


class DrumMemory(NamedTuple):
    """What the linkage carries beside its joints."""

    yarn_acceleration_m_per_s2: float
    drive_work_j: float
    gravity_work_j: float
    friction_loss_j: float
    initial_energy_j: float
    largest_energy_j: float


class Place(NamedTuple):
    """Joints of the drum: angle, yarn that has run, radius of the package; and their rates."""

    drum_rad: float
    yarn_m: float
    package_radius_m: float
    drum_rad_per_s: float
    yarn_m_per_s: float


def place_of(sample: LinkageSample) -> Place:
    """Return the joints of a sample by name."""
    drum_rad, yarn_m, radius_m = sample.position
    drum_rad_per_s, yarn_m_per_s, _ = sample.velocity
    return Place(drum_rad, yarn_m, radius_m, drum_rad_per_s, yarn_m_per_s)


@dataclass(frozen=True)
class DrumLinkage:
    """Drum, package and yarn; owner of the package radius.

    When the package is empty (or full) yarn and drive let go: the drum turns on under its weight and friction.
    """

    package: Package
    step_s: float
    start_radius_m: float
    end_radius_m: float
    start_speed_m_per_s: float
    start_command: float
    end_kind: str
    joints: tuple[str, ...] = JOINTS
    coordinates: tuple[str, ...] = ("drum",)
    regimes: tuple[str, ...] = REGIMES

    @property
    def residual_limits(self) -> dict[str, float]:
        """Limits of the residuals."""
        return dict.fromkeys(RESIDUALS, 1e-9)

    def start(self, step: int = 0) -> LinkageSample:
        """Return the package at its first radius, the yarn at the configured share of its speed."""
        theta = self.start_speed_m_per_s
        omega = theta / float(tangent_arm(self.package, self.start_radius_m, 0.0))
        place = Place(0.0, 0.0, self.start_radius_m, omega, theta)
        memory = DrumMemory(0.0, 0.0, 0.0, 0.0, self._energy(place), 0.0)
        return self._sample(step, place, RUNNING, self.start_command, memory, ())

    def advance(self, linkage: LinkageSample, motor: MotorSample, body: BodySample | None) -> LinkageSample:
        """Return the drum one step later; the end of the package is located exactly inside the step."""
        place, memory, step = place_of(linkage), DrumMemory(*linkage.memory.values), linkage.step + 1
        if linkage.regime != RUNNING:
            return self._coasting(step, place, linkage.regime, motor.command, memory, 0.0, ())
        (speed,) = motor.velocity
        a = (speed - place.yarn_m_per_s) / self.step_s
        run = 0.5 * (place.yarn_m_per_s + speed) * self.step_s
        left = (place.package_radius_m**2 - self.end_radius_m**2) / (2.0 * self.package.layer_m)
        if run < left:
            place, memory = self._driven(place, memory, a, self.step_s, run, speed)
            return self._sample(step, place, RUNNING, motor.command, memory, ())
        time = time_of_length(place.yarn_m_per_s, a, left)
        place, memory = self._driven(place, memory, a, time, left, place.yarn_m_per_s + a * time)
        place = place._replace(package_radius_m=self.end_radius_m)
        event = self._end_event(linkage.time_s + time, place, a)
        place, memory = place._replace(yarn_m_per_s=0.0), memory._replace(yarn_acceleration_m_per_s2=0.0)
        return self._coasting(step, place, ENDED, motor.command, memory, time, (event,))

    def _driven(
        self, place: Place, memory: DrumMemory, a: float, h: float, run: float, speed: float
    ) -> tuple[Place, DrumMemory]:
        p, radius = self.package, place.package_radius_m
        phi, drive, gravity, loss = driven(p, radius, place.drum_rad, place.yarn_m_per_s, a, h)
        radius = float(radius_after(p, radius, run))
        after = Place(phi, place.yarn_m + run, radius, speed / float(tangent_arm(p, radius, phi)), speed)
        return after, DrumMemory(
            a,
            memory.drive_work_j + drive,
            memory.gravity_work_j + gravity,
            memory.friction_loss_j + loss,
            memory.initial_energy_j,
            memory.largest_energy_j,
        )

    def _coasting(
        self,
        step: int,
        place: Place,
        regime: int,
        command: float,
        memory: DrumMemory,
        done: float,
        events: tuple[Event, ...],
    ) -> LinkageSample:
        """Return the drum at the end of the step, having coasted from ``done`` (s) of it on."""
        begin, logged = (step - 1) * self.step_s, list(events)
        radius = place.package_radius_m
        while self.step_s - done > 1e-15 * self.step_s:
            if place.drum_rad_per_s == 0.0:
                sense = start_sense(self.package, radius, place.drum_rad)
                if (regime == STUCK) == (sense != 0.0):
                    regime = ENDED if sense else STUCK
                    logged.append(self._rest_event(begin + done, place, "release" if sense else "stick"))
                if sense == 0.0:
                    break
            piece = coasted(self.package, radius, place.drum_rad, place.drum_rad_per_s, self.step_s - done)
            done += piece.time_s
            place = place._replace(drum_rad=piece.phi_rad, drum_rad_per_s=piece.omega_rad_per_s)
            memory = memory._replace(
                gravity_work_j=memory.gravity_work_j + piece.gravity_work_j,
                friction_loss_j=memory.friction_loss_j + piece.friction_loss_j,
            )
        return self._sample(step, place, regime, command, memory, tuple(logged))

    def _end_event(self, time_s: float, at: Place, a: float) -> Event:
        torque = drive_torque(self.package, at.package_radius_m, at.drum_rad, at.yarn_m_per_s, a)
        before = Coordinate(at.drum_rad, at.drum_rad_per_s, float(torque))
        after = before._replace(effort=0.0)
        return Event(time_s, self.end_kind, "package", at.yarn_m_per_s, 0.0, pre=(before,), post=(after,))

    def _rest_event(self, time_s: float, at: Place, kind: str) -> Event:
        coordinate = (Coordinate(at.drum_rad, 0.0, 0.0),)
        return Event(time_s, kind, "drum", pre=coordinate, post=coordinate)

    def _energy(self, at: Place) -> float:
        return 0.5 * float(package_inertia(self.package, at.package_radius_m)) * at.drum_rad_per_s**2

    def _sample(
        self, step: int, at: Place, regime: int, command: float, memory: DrumMemory, events: tuple[Event, ...]
    ) -> LinkageSample:
        p, radius, radius_rate, torque = self.package, at.package_radius_m, 0.0, 0.0
        memory = memory._replace(largest_energy_j=max(memory.largest_energy_j, self._energy(at)))
        if regime == RUNNING:
            radius_rate = -p.layer_m * at.yarn_m_per_s / radius
            a = memory.yarn_acceleration_m_per_s2
            torque = float(drive_torque(p, radius, at.drum_rad, at.yarn_m_per_s, a))
        return LinkageSample(
            step=step,
            time_s=step * self.step_s,
            joints=JOINTS,
            position=(at.drum_rad, at.yarn_m, radius),
            velocity=(at.drum_rad_per_s, at.yarn_m_per_s, radius_rate),
            effort=(torque, 0.0, 0.0),
            regime=regime,
            command=command,
            memory=Named(DrumMemory._fields, memory),
            residuals=Named(RESIDUALS, (self._area_balance(at), self._energy_balance(at, memory))),
            events=events,
        )

    def _area_balance(self, at: Place) -> float:
        """Return the yarn that the radius has lost less the yarn that has run, over the yarn of the package."""
        lost = self.start_radius_m**2 - at.package_radius_m**2
        whole = abs(self.start_radius_m**2 - self.end_radius_m**2)
        return (lost - 2.0 * self.package.layer_m * at.yarn_m) / whole

    def _energy_balance(self, at: Place, memory: DrumMemory) -> float:
        work = memory.drive_work_j + memory.gravity_work_j - memory.friction_loss_j
        turned_over = memory.initial_energy_j + abs(memory.drive_work_j) + memory.friction_loss_j
        turned_over = max(turned_over, memory.largest_energy_j)  # a stop gives the drive back what it gave
        return (memory.initial_energy_j + work - self._energy(at)) / max(1.0, turned_over)


@dataclass(frozen=True)
class DrumForces:
    """Torque of the package term by term, and the reaction of the shaft on drum and package.

    The weight of the bare drum and the tension of the yarn are not known and left out.
    """

    package: Package
    pins: tuple[str, ...] = ("shaft",)
    acts_on: tuple[str, ...] = ("package",)

    @property
    def residual_limits(self) -> dict[str, float]:
        """Limits of the residuals."""
        return {"drive_torque_routes": 1e-10}

    def analyse(self, linkage: LinkageSample) -> ForceSample:
        """Return each torque term by itself, and the force that carries the package round its axis.

        The drive torque of the linkage is a sum of terms; the second route is the chain rule on J0 omega.
        """
        p, at, torque = self.package, place_of(linkage), linkage.joint("drum").effort
        phi, radius, omega = at.drum_rad, at.package_radius_m, at.drum_rad_per_s
        a = DrumMemory(*linkage.memory.values).yarn_acceleration_m_per_s2
        gravity, inertia = float(gravity_moment(p, radius, phi)), float(package_inertia(p, radius))
        terms = torque_terms(p, radius, phi, at.yarn_m_per_s, a)
        alpha, friction, difference = float(sum(speed_terms(p, radius, phi, at.yarn_m_per_s, a))), 0.0, 0.0
        if linkage.regime == RUNNING:
            friction = torque - terms.total + gravity
            if omega > 0.0 or a > 0.0:
                friction = -float(sliding_torque(p.coulomb_nm, p.viscous_nms_per_rad, omega, 1.0))
                route = float(rate_of_momentum(p, radius, phi, at.yarn_m_per_s, a)) - gravity + friction
                scale = max(*(abs(term) for term in terms[:4]), abs(gravity), abs(friction), 1e-9)
                difference = (torque - route) / scale
        elif omega != 0.0:
            sense = 1.0 if omega > 0.0 else -1.0
            friction = -float(sliding_torque(p.coulomb_nm, p.viscous_nms_per_rad, omega, sense))
            alpha = (gravity - friction) / inertia
        else:
            friction = gravity
        values = (
            *terms,
            gravity,
            friction,
            radius,
            inertia,
            float(package_mass(p, radius)),
            float(tangent_arm(p, radius, phi)),
            alpha,
            a,
            torque * omega,
        )
        return ForceSample(
            step=linkage.step,
            time_s=linkage.time_s,
            pins=self.pins,
            wrenches=(self._shaft(radius, phi, omega, alpha, torque - friction),),
            quantities=Named(QUANTITIES, values),
            body_moment_nm=0.0,
            residuals=Named(("drive_torque_routes",), (difference,)),
        )

    def _shaft(self, radius: float, phi: float, omega: float, alpha: float, moment: float) -> Wrench:
        """Return the shaft's force on the package: what accelerates its centre c, and its weight.

        c'' = -omega^2 c + alpha k x c with c = e (-sin(phi), cos(phi)).
        """
        p = self.package
        mass = float(package_mass(p, radius))
        x, y = -p.eccentricity_m * sin(phi), p.eccentricity_m * cos(phi)
        force_x = mass * (-omega * omega * x - alpha * y)
        force_y = mass * (-omega * omega * y + alpha * x + p.gravity)
        return Wrench(force_x, force_y, moment)
