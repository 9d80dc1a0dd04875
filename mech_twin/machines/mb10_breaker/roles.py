"""The breaker's motor, linkage and force analysis as pure maps between samples."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from mech_twin.machines.mb10_breaker.dynamics import (
    FLIGHT,
    HELD,
    JAMMED,
    REST,
    STATES,
    Breaker,
    P,
    Q,
    U,
    energies,
    gap,
    spring_moment,
)
from mech_twin.machines.mb10_breaker.dynamics import PHI as BODY
from mech_twin.machines.mb10_breaker.forces import QUANTITIES, PinForces, pin_forces, pin_impulses
from mech_twin.machines.mb10_breaker.step import (
    AFTER,
    BEFORE,
    BEGIN,
    CYCLE_OF,
    EVENT_ROWS,
    IMPULSE,
    KIND,
    KINDS,
    MEMORY,
    POST,
    PRE,
    ROW,
    TIME,
    Array,
    advanced,
    taken_over,
)
from mech_twin.parts.four_bar import closure_error, coefficients, link_angles, position
from mech_twin.parts.induction_motor import MotorConstants, motor_torque
from mech_twin.parts.supply import limited_command
from mech_twin.samples import (
    BodySample,
    Coordinate,
    Event,
    ForceSample,
    LinkageSample,
    Load,
    MotorSample,
    Named,
    Wrench,
)

CONTACTS = {"blow": "tool", "missed": "tool", "unseated": "tool", "jammed": "tool"}
LOADING = frozenset(("blow", "touchdown", "settled", "lift_off", "jammed"))
RESIDUALS = ("loop_closure_m", "energy_balance", "momentum_balance")
FORCE_RESIDUALS = ("drive_torque_routes", "body_moment_routes", "impulse_routes")


class KlossDrive:
    """The induction motor at the speed its rotor has: i (u - phi') on the frame, i u on the body.

    Parameters
    ----------
    constants : MotorConstants
        Kloss curve.
    breaker : Breaker
        Constants of the machine, for the gear.
    rate_per_s : float
        Largest change of the supply fraction per second.
    step_s : float
        Coupling step.
    """

    joints = ("rotor",)

    def __init__(self, constants: MotorConstants, breaker: Breaker, rate_per_s: float, step_s: float) -> None:
        self._motor = constants
        self._ratio = breaker.ratio
        self._carried = breaker.frame_drive
        self._rate_per_s = rate_per_s
        self._step_s = step_s

    def respond(self, linkage: LinkageSample, target: float) -> MotorSample:
        """Return rotor angle, speed and shaft torque at the linkage's step."""
        command = limited_command(linkage.command, target, self._rate_per_s, self._step_s)
        speed = self._ratio * (linkage.velocity[0] - self._carried * linkage.velocity[3])
        turned = 2.0 * math.pi * linkage.memory.values[0] + linkage.position[0]
        angle = self._ratio * (turned - self._carried * linkage.position[3])
        torque = motor_torque(self._motor, speed, command)
        return MotorSample(linkage.step, linkage.time_s, self.joints, (angle,), (speed,), (torque,), command)


class Percussion:
    """The crank-rocker, its drive and, where the body is led, the body with it.

    Parameters
    ----------
    breaker : Breaker
        Constants.
    initial_crank_rad : float
        Crank angle at the start.
    initial_command : float
        Supply fraction in force at the start.
    step_s : float
        Coupling step.
    order : int
        Order of the torque's extrapolation.
    """

    joints = ("crank", "coupler", "rocker", "body")
    coordinates = ("crank", "body")
    regimes = ("rest", "flight", "held", "jammed")
    residual_limits: Mapping[str, float] = MappingProxyType(
        {"loop_closure_m": 1e-12, "energy_balance": 1e-9, "momentum_balance": 1e-9}
    )

    def __init__(
        self, breaker: Breaker, initial_crank_rad: float, initial_command: float, step_s: float, order: int
    ) -> None:
        self._b = breaker
        self._initial = initial_crank_rad
        self._command = initial_command
        self._step_s = step_s
        self._order = order

    def start(self, step: int = 0) -> LinkageSample:
        """Return the machine at rest, the body on its collar."""
        state = np.zeros(STATES)
        state[Q] = self._initial % (2.0 * math.pi)
        memory = np.zeros(len(MEMORY))
        kinetic, potential, _ = energies(self._b, state[Q], 0.0, 0.0, 0.0)
        memory[MEMORY.index("takeover_energy_j")] = kinetic + potential
        memory[MEMORY.index("torque_history")] = -1.0
        memory[BEGIN] = state[Q]
        return self._sample(step, state, memory, HELD if self._b.held else REST, 0.0, self._command, ())

    def advance(self, linkage: LinkageSample, motor: MotorSample, body: BodySample | None) -> LinkageSample:
        """Return the linkage one coupling step later; angle and rate of the body are taken from its own sample."""
        state = np.zeros(STATES)
        state[Q], state[U] = linkage.position[0], linkage.velocity[0]
        state[BODY], state[P] = linkage.position[3], linkage.velocity[3]
        memory = np.array(linkage.memory.values)
        regime = linkage.regime
        if body is not None and not self._b.held:
            regime = taken_over(self._b, state, memory, regime, body.position[0], body.velocity[0], body.regime == REST)
        log = np.empty((EVENT_ROWS, ROW))
        regime, count, drive = advanced(self._b, state, memory, regime, motor.effort[0], self._step_s, self._order, log)
        events = tuple(self._event(linkage.time_s, log[i]) for i in range(count))
        return self._sample(linkage.step + 1, state, memory, regime, drive, motor.command, events)

    def _sample(
        self,
        step: int,
        state: Array,
        memory: Array,
        regime: int,
        drive: float,
        command: float,
        events: tuple[Event, ...],
    ) -> LinkageSample:
        b = self._b
        q, u, phi, p = float(state[Q]), float(state[U]), float(state[BODY]), float(state[P])
        at = position(b.bar, q)
        by = coefficients(at)
        coupler, rocker = link_angles(at)
        values = tuple(memory.tolist())
        if regime == JAMMED:
            drive = pin_forces(b, q, u, phi, p, 0.0, regime).drive
        return LinkageSample(
            step,
            step * self._step_s,
            self.joints,
            (q, coupler, rocker, phi),
            (u, by.g2 * u, by.g3 * u, p),
            (drive, 0.0, 0.0, -spring_moment(b, phi)),
            regime,
            command,
            Named(MEMORY, values),
            Named(RESIDUALS, (closure_error(b.bar, at), *self._books(q, u, phi, p, values))),
            events,
        )

    def _books(self, q: float, u: float, phi: float, p: float, memory: tuple[float, ...]) -> tuple[float, float]:
        """Return the relative errors of the energy book and of the book of the body's angular momentum."""
        kinetic, potential, momentum = energies(self._b, q, u, phi, p)
        work, damped, turned, blow, tool, collar, jam, takeover, impacts, shifted = memory[3:13]
        energy = kinetic + potential - (takeover + work - damped - blow - tool - collar - jam)
        angular = 0.0 if self._b.held else momentum - (shifted + turned + impacts)
        return abs(energy) / max(kinetic + abs(potential), 1.0), abs(angular) / max(abs(momentum), 1.0)

    def _event(self, start_s: float, row: Array) -> Event:
        kind = KINDS[int(row[KIND])]
        return Event(
            start_s + float(row[TIME]),
            kind,
            CONTACTS.get(kind, "collar"),
            float(row[BEFORE]),
            float(row[AFTER]),
            float(row[IMPULSE]),
            int(row[CYCLE_OF]),
            self._coordinates(row[PRE : PRE + 5]),
            self._coordinates(row[POST : POST + 5]),
        )

    def _coordinates(self, side: Array) -> tuple[Coordinate, Coordinate]:
        q, u, phi, p, drive = side.tolist()
        return Coordinate(q, u, drive), Coordinate(phi, p, -spring_moment(self._b, phi))


class PinAnalysis:
    """Every pin, the moment on the body and its impulses, from the joint states alone.

    Parameters
    ----------
    breaker : Breaker
        Constants.
    """

    pins = ("crank_bearing", "crank_pin", "rocker_pin", "rocker_bearing")
    acts_on = ("crank", "coupler", "coupler", "rocker")
    residual_limits: Mapping[str, float] = MappingProxyType(dict.fromkeys(FORCE_RESIDUALS, 1e-10))

    def __init__(self, breaker: Breaker) -> None:
        self._b = breaker

    def analyse(self, linkage: LinkageSample) -> ForceSample:
        """Return the forces at the step, and the loads on the body at each event of the step."""
        b = self._b
        q, u, phi, p = linkage.position[0], linkage.velocity[0], linkage.position[3], linkage.velocity[3]
        found = pin_forces(b, q, u, phi, p, linkage.effort[0], linkage.regime)
        loads, impulses = [], [PinForces(*(0.0,) * len(PinForces._fields))]
        for event in linkage.events:
            if event.pre and event.kind in LOADING:
                jump = self._across(event)
                if event.kind != "jammed":  # what stops a jammed linkage is not known
                    impulses.append(jump)
                loads.append(self._load(event, jump.moment, linkage.regime))
            elif not event.pre:
                loads.append(Load(event.time_s, event.kind, event.contact, found.moment, found.moment, 0.0))
        return ForceSample(
            linkage.step,
            linkage.time_s,
            self.pins,
            (
                Wrench(found.o_x, found.o_y, 0.0),
                Wrench(found.a_x, found.a_y, 0.0),
                Wrench(found.b_x, found.b_y, 0.0),
                Wrench(found.c_x, found.c_y, 0.0),
            ),
            Named(QUANTITIES, (*self._quantities(q, u, phi, p, found, impulses), self._moment_at_begin(linkage))),
            found.moment,
            Named(FORCE_RESIDUALS, self._errors(u, found, impulses)),
            tuple(loads),
        )

    def _moment_at_begin(self, linkage: LinkageSample) -> float:
        """Return the moment on the body as the step began, the torque just extrapolated anew."""
        q, u, phi, p, drive = linkage.memory.values[BEGIN : BEGIN + 5]
        return pin_forces(self._b, q, u, phi, p, drive, FLIGHT if linkage.regime == JAMMED else linkage.regime).moment

    def _across(self, event: Event) -> PinForces:
        crank, body = event.pre
        crank_after, body_after = event.post
        blow = event.impulse_ns if event.kind == "blow" else 0.0
        return pin_impulses(
            self._b,
            crank.position,
            body.position,
            crank_after.velocity - crank.velocity,
            body_after.velocity - body.velocity,
            blow,
        )

    def _load(self, event: Event, impulse: float, regime: int) -> Load:
        sides = []
        for index, (crank, body) in enumerate((event.pre, event.post)):
            state = HELD if self._b.held else JAMMED if index and event.kind == "jammed" else FLIGHT
            sides.append(
                pin_forces(
                    self._b, crank.position, crank.velocity, body.position, body.velocity, crank.effort, state
                ).moment
            )
        return Load(event.time_s, event.kind, event.contact, sides[0], sides[1], impulse)

    def _quantities(
        self, q: float, u: float, phi: float, p: float, found: PinForces, impulses: list[PinForces]
    ) -> tuple[float, ...]:
        b = self._b
        opening, closing = gap(b, q, u, phi, p)
        return (
            found.drive,
            found.crank_acceleration,
            found.body_acceleration,
            phi,
            p,
            found.collar_moment / b.radius,
            b.rate * (b.arm * phi + b.deflection),
            -found.o_x - found.c_x,
            -found.o_y - found.c_y,
            opening,
            closing,
            sum(jump.moment for jump in impulses),
            max(math.hypot(jump.o_x, jump.o_y) for jump in impulses),
            max(math.hypot(jump.c_x, jump.c_y) for jump in impulses),
        )

    def _errors(self, u: float, found: PinForces, impulses: list[PinForces]) -> tuple[float, float, float]:
        """Return the misses of the two routes over the torque that turns the flywheel in a radian, at least 1 N m."""
        b = self._b
        scale = max(abs(found.drive), b.crank.inertia_kg_m2 * u * u, 1.0)
        across = max(abs(jump.drive) for jump in impulses)
        return abs(found.drive_error) / scale, abs(found.body_error) / scale, across / scale
