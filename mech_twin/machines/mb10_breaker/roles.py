"""The breaker's linkage and force analysis as pure maps between samples, and the shaft its motor turns."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from mech_twin.machines.mb10_breaker.dynamics import (
    FLIGHT,
    HELD,
    REST,
    STATES,
    TOOL,
    TOOL_SPEED,
    Breaker,
    P,
    Q,
    U,
    energies,
    spring_moment,
)
from mech_twin.machines.mb10_breaker.dynamics import PHI as BODY
from mech_twin.machines.mb10_breaker.forces import QUANTITIES, PinForces, pin_forces, pin_impulses
from mech_twin.machines.mb10_breaker.impacts import gap
from mech_twin.machines.mb10_breaker.state import (
    EVENT,
    EVENT_ROWS,
    KINDS,
    BreakerMemory,
    Side,
    packed,
    post_side,
    pre_side,
    unpacked,
)
from mech_twin.machines.mb10_breaker.step import Array, advance_step, take_body
from mech_twin.parts.four_bar import closure_error, coefficients, link_angles, position
from mech_twin.roles import CrankState
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

ON_COLLAR = frozenset(("touchdown", "settled", "lift_off"))
STRIKES = frozenset(("blow", "catch_up", "push_begins"))
OF_BEARINGS = {"crank": "crank_bearing", "body": "body_pivot"}
BEARING_KINDS = frozenset(f"{joint}_{kind}" for joint in OF_BEARINGS for kind in ("stopped", "started", "reversed"))
LOADING = STRIKES | ON_COLLAR | BEARING_KINDS | {"pushing", "released"}
RESIDUALS = ("loop_closure_m", "energy_balance", "momentum_balance", "coupling_defect")
FORCE_RESIDUALS = ("drive_torque_routes", "body_moment_routes", "impulse_routes")


def geared_shaft(breaker: Breaker, linkage: LinkageSample) -> tuple[float, float]:
    """Return angle (rad) and speed (rad/s) of the gear's output, seen from the motor: q - phi on the frame, else q."""
    carried = breaker.frame_drive
    crank, body = linkage.joint("crank"), linkage.joint("body")
    turned = 2.0 * math.pi * BreakerMemory(*linkage.memory.values).turns + crank.position
    return turned - carried * body.position, crank.velocity - carried * body.velocity


class BreakerLinkage:
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
    coupling_defect : float
        Limit of the share of the energy held that a step may change by taking the body's own angle.
    """

    joints = ("crank", "coupler", "rocker", "body")
    coordinates = ("crank", "body", "tool", "crank_bearing", "body_pivot")
    regimes = ("rest", "flight", "held")

    def __init__(
        self,
        breaker: Breaker,
        initial_crank_rad: float,
        initial_command: float,
        step_s: float,
        order: int,
        coupling_defect: float,
    ) -> None:
        self._b = breaker
        self._initial = initial_crank_rad
        self._command = initial_command
        self._step_s = step_s
        self._order = order
        self.residual_limits: Mapping[str, float] = MappingProxyType(
            {
                "loop_closure_m": 1e-12,
                "energy_balance": 1e-9,
                "momentum_balance": 1e-9,
                "coupling_defect": coupling_defect,
            }
        )

    def start(self, step: int = 0) -> LinkageSample:
        """Return the machine at rest, the body on its collar."""
        state = np.zeros(STATES)
        state[Q] = self._initial % (2.0 * math.pi)
        kinetic, potential, _ = energies(self._b, state[Q], 0.0, 0.0, 0.0)
        memory = BreakerMemory(energy_j=kinetic + potential, begin_crank_rad=float(state[Q]))
        return self._sample(step, state, memory, HELD if self._b.held else REST, 0.0, self._command, 0.0)

    def advance(self, linkage: LinkageSample, motor: MotorSample, body: BodySample | None) -> LinkageSample:
        """Return the linkage one coupling step later; angle and rate of the body are taken from its own sample."""
        b, old, (torque,) = self._b, BreakerMemory(*linkage.memory.values), motor.effort
        state = np.zeros(STATES)
        state[Q], state[U], _ = linkage.joint("crank")
        state[BODY], state[P], _ = linkage.joint("body")
        state[TOOL], state[TOOL_SPEED] = old.tool_travel_m, old.tool_speed_m_per_s
        record, regime = packed(old), linkage.regime
        phi, p, rests = float(state[BODY]), float(state[P]), regime != FLIGHT
        if body is not None and not b.held:
            (phi,), (p,), rests = body.position, body.velocity, body.regime == REST
        regime = take_body(b, state, record, regime, phi, p, rests)
        log = np.empty(EVENT_ROWS, dtype=EVENT)
        regime, count, drive = advance_step(b, state, record, regime, torque, self._step_s, self._order, log)
        memory = unpacked(record)
        events = tuple(self._event(linkage.time_s, log[i]) for i in range(count))
        defect = memory.coupling_defect_j - old.coupling_defect_j
        return self._sample(linkage.step + 1, state, memory, regime, drive, motor.command, defect, events)

    def guided(self, step: int, time_s: float, motion: CrankState) -> LinkageSample:
        """Return the breaker in a measured motion between blows; a body that is not measured rests on its collar.

        The acceleration of the crank is a straight line in the torque, so two torques tell the one that it needs.
        """
        q, u, acceleration, phi, p = motion
        off = phi is not None and phi > 0.0 and not self._b.held
        regime = HELD if self._b.held else FLIGHT if off else REST
        body, rate = (phi, p) if off and phi is not None else (0.0, 0.0)
        idle, loaded = (pin_forces(self._b, q, u, body, rate, t, regime, 0.0).crank_acceleration for t in (0.0, 1.0))
        state = np.zeros(STATES)
        state[Q], state[U], state[BODY], state[P] = q % (2.0 * math.pi), u, body, rate
        memory = BreakerMemory(begin_crank_rad=q, begin_crank_rad_per_s=u, begin_body_rad=body)
        torque = (acceleration - idle) / (loaded - idle)
        return self._sample(step, state, memory, regime, torque, self._command, 0.0)._replace(time_s=time_s)

    def _sample(
        self,
        step: int,
        state: Array,
        memory: BreakerMemory,
        regime: int,
        drive: float,
        command: float,
        defect_j: float,
        events: tuple[Event, ...] = (),
    ) -> LinkageSample:
        b = self._b
        q, u, phi, p = float(state[Q]), float(state[U]), float(state[BODY]), float(state[P])
        at = position(b.bar, q)
        by = coefficients(at)
        coupler, rocker = link_angles(at)
        residuals = (closure_error(b.bar, at), *self._balances(q, u, phi, p, memory, defect_j))
        return LinkageSample(
            step,
            step * self._step_s,
            self.joints,
            (q, coupler, rocker, phi),
            (u, by.g2 * u, by.g3 * u, p),
            (drive, 0.0, 0.0, -spring_moment(b, phi)),
            regime,
            command,
            Named(BreakerMemory._fields, tuple(memory)),
            Named(RESIDUALS, residuals),
            events,
        )

    def _balances(
        self, q: float, u: float, phi: float, p: float, memory: BreakerMemory, defect_j: float
    ) -> tuple[float, float, float]:
        """Return what the balances of energy and of the body's angular momentum leave open, and the coupling defect."""
        kinetic, potential, momentum = energies(self._b, q, u, phi, p)
        held, turning = max(kinetic + abs(potential), 1.0), max(abs(momentum), 1.0)
        angular = 0.0 if self._b.held else abs(memory.momentum_error_nms) / turning
        return abs(memory.energy_error_j) / held, angular, abs(defect_j) / held

    def _event(self, start_s: float, row: np.void) -> Event:
        kind = KINDS[int(row["kind"])]
        return Event(
            start_s + float(row["time_s"]),
            kind,
            _contact_of(kind),
            float(row["before_m_per_s"]),
            float(row["after_m_per_s"]),
            float(row["impulse_ns"]),
            int(row["cycle"]),
            self._coordinates(pre_side(row)),
            self._coordinates(post_side(row)),
        )

    def _coordinates(self, side: Side) -> tuple[Coordinate, ...]:
        return (
            Coordinate(side.crank_rad, side.crank_rad_per_s, side.drive_torque_nm),
            Coordinate(side.body_rad, side.body_rad_per_s, -spring_moment(self._b, side.body_rad)),
            Coordinate(side.tool_m, side.tool_m_per_s, side.tool_force_n),
            Coordinate(side.crank_rad, side.crank_rad_per_s, side.crank_friction_nm),
            Coordinate(side.body_rad, side.body_rad_per_s, side.body_friction_nm),
        )


def _contact_of(kind: str) -> str:
    """Return what an event of this kind takes place at."""
    if kind in BEARING_KINDS:
        return OF_BEARINGS[kind.split("_", maxsplit=1)[0]]
    return "collar" if kind in ON_COLLAR else "tool"


NO_IMPULSE = PinForces(*(0.0,) * len(PinForces._fields))


class BreakerForces:
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
        b, memory = self._b, BreakerMemory(*linkage.memory.values)
        (q, u, torque), (phi, p, _) = linkage.joint("crank"), linkage.joint("body")
        rubbing = memory.crank_friction_nm, memory.body_friction_nm
        found = pin_forces(b, q, u, phi, p, torque, linkage.regime, memory.tool_force_n, *rubbing)
        loads, impulses, collar = [], [NO_IMPULSE], 0.0
        for event in linkage.events:
            if event.pre and event.kind in LOADING:
                jump = self._across(event)
                impulses.append(jump)
                pressed = self._collar_impulse(event, jump)
                loads.append(self._load(event, jump.moment + pressed))
                collar += pressed
            elif not event.pre:
                loads.append(Load(event.time_s, event.kind, event.contact, found.moment, found.moment, 0.0))
        quantities = self._quantities(q, u, phi, p, found, impulses)
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
            Named(QUANTITIES, (*quantities, self._moment_at_begin(linkage, memory), found.tool_force, collar)),
            found.moment,
            Named(FORCE_RESIDUALS, self._errors(u, found, impulses)),
            tuple(loads),
        )

    def _moment_at_begin(self, linkage: LinkageSample, memory: BreakerMemory) -> float:
        """Return the moment on the body as the step began, the torque just extrapolated anew."""
        return pin_forces(
            self._b,
            memory.begin_crank_rad,
            memory.begin_crank_rad_per_s,
            memory.begin_body_rad,
            memory.begin_body_rad_per_s,
            memory.begin_drive_torque_nm,
            linkage.regime,
            memory.begin_tool_force_n,
            memory.begin_crank_friction_nm,
            memory.begin_body_friction_nm,
        ).moment

    def _across(self, event: Event) -> PinForces:
        crank, body = event.pre[:2]
        crank_after, body_after = event.post[:2]
        return pin_impulses(
            self._b,
            crank.position,
            body.position,
            crank_after.velocity - crank.velocity,
            body_after.velocity - body.velocity,
            event.impulse_ns if event.kind in STRIKES else 0.0,
        )

    def _collar_impulse(self, event: Event, jump: PinForces) -> float:
        """Return the collar's angular impulse on a resting body that stays on it through a blow (N m s)."""
        body, after = event.pre[1], event.post[1]
        rests = body.position == body.velocity == after.velocity == 0.0
        return -jump.moment if rests and event.kind in STRIKES and not self._b.held else 0.0

    def _load(self, event: Event, impulse: float) -> Load:
        regime = HELD if self._b.held else FLIGHT
        before, after = (self._moment(side, regime) for side in (event.pre, event.post))
        return Load(event.time_s, event.kind, event.contact, before, after, impulse)

    def _moment(self, side: tuple[Coordinate, ...], regime: int) -> float:
        crank, body, tool, bearing, pivot = side
        return pin_forces(
            self._b,
            crank.position,
            crank.velocity,
            body.position,
            body.velocity,
            crank.effort,
            regime,
            tool.effort,
            bearing.effort,
            pivot.effort,
        ).moment

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
            found.collar_moment / b.tool_radius_m,
            b.spring_rate_n_per_m * (b.spring_arm_m * phi + b.preload_m),
            -found.o_x - found.c_x,
            -found.o_y - found.c_y,
            opening,
            closing,
            sum(jump.moment for jump in impulses),
            max(math.hypot(jump.o_x, jump.o_y) for jump in impulses),
            max(math.hypot(jump.c_x, jump.c_y) for jump in impulses),
        )

    def _errors(self, u: float, found: PinForces, impulses: list[PinForces]) -> tuple[float, float, float]:
        """Return the misses of the two routes over the largest moment in them, at least 1 N m."""
        b = self._b
        scale = max(abs(found.drive), b.crank.inertia_kg_m2 * u * u, 1.0, self._moments(found))
        across = max(abs(jump.drive) for jump in impulses)
        return abs(found.drive_error) / scale, abs(found.body_error) / scale, across / scale

    def _moments(self, found: PinForces) -> float:
        """Return the largest of the moments (N m) that the routes add up: inertia, collar, and pin forces at lengths.

        Where a heavy linkage moves a light body, their sum is far smaller than they are.
        """
        b = self._b
        spin = max(abs(found.crank_acceleration), abs(found.body_acceleration))
        return max(
            (b.crank.inertia_kg_m2 + b.rotor_11_kg_m2) * spin,
            b.body_inertia_kg_m2 * abs(found.body_acceleration),
            abs(found.collar_moment),
            b.bar.crank_m * math.hypot(found.a_x, found.a_y),
            b.bar.rocker_m * math.hypot(found.b_x, found.b_y),
            math.hypot(b.bar.pivot_x_m, b.bar.pivot_y_m) * math.hypot(found.c_x, found.c_y),
        )
