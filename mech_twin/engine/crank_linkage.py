"""Linkage with one freedom, turned at its crank: prescribed speed or driving torque, with exact changes of regime.

The mechanism itself comes as three kernels (`CrankKernels`); here is only time: what a coupling step does with them.

Between two boundaries of the crank angle the regime is constant, so a step is cut where a boundary is crossed and
each piece is smooth.  With a prescribed speed the crank angle is a parabola in time and the crossing is a root of a
quadratic; with a driving torque it is the bracketed root of the integrated motion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import floor, isfinite, pi, sqrt
from typing import Any, NamedTuple

from scipy.optimize import brentq

from mech_twin.samples import BodySample, Coordinate, Event, LinkageSample, MotorSample, Named

TURN = 2.0 * pi
MEMORY = (
    "crank_acceleration_rad_per_s2",
    "motor_torque_nm",
    "motor_torque_known_1",
    "drive_work_j",
    "load_work_j",
    "initial_energy_j",
)
RESIDUALS = ("loop_closure_m", "energy_balance")


class CrankKernels(NamedTuple):
    """The mechanism: ``constants`` first, then crank angle f (rad), rate w (rad/s), acceleration e (rad/s2).

    ``state(constants, f, w, e, regime)`` -> positions, velocities, crank torque (N m), energy (J), closure error (m)
    ``prescribed(constants, f, w, e, h, regime)`` -> f, w, drive work, load work (J) after h seconds at constant e
    ``driven(constants, shaft, f, w, torque, slope, h, regime)`` -> f, w, e, drive work, load work after h seconds
    under torque + slope t, with the inertia ``shaft`` (kg m2) of what turns with the crank outside the mechanism
    """

    state: Callable[..., Any]
    prescribed: Callable[..., Any]
    driven: Callable[..., Any]


class Boundary(NamedTuple):
    """A crank angle (rad, any turn) where the regime ``before`` becomes ``after``, met in this direction (+1, -1)."""

    angle: float
    direction: float
    before: int
    after: int
    kind: str


class Transmission(NamedTuple):
    """Motor to crank: ratio, efficiency (its inverse while the motor generates), rotor inertia (kg m2)."""

    ratio: float
    efficiency: float
    rotor_inertia: float

    def crank_torque(self, torque: float) -> float:
        """Return the motor's torque (N m) at the crank."""
        return torque * self.ratio * (self.efficiency if torque >= 0.0 else 1.0 / self.efficiency)

    @property
    def shaft_inertia(self) -> float:
        """Rotor inertia seen from the crank (kg m2)."""
        return self.ratio * self.ratio * self.rotor_inertia


class State(NamedTuple):
    """What changes in a step."""

    f: float
    w: float
    e: float
    drive_work: float
    load_work: float
    regime: int


@dataclass(frozen=True)
class CrankLinkage:
    """Owner of crank angle and speed; ``transmission`` is None for a prescribed speed."""

    constants: Any
    kernels: CrankKernels
    step_s: float
    start_angle: float
    start_speed: float
    start_command: float
    joints: tuple[str, ...]
    contact: str
    regimes: tuple[str, ...] = ("free",)
    start_regime: int = 0
    boundaries: tuple[Boundary, ...] = ()
    transmission: Transmission | None = None
    coordinates: tuple[str, ...] = ("crank",)

    @property
    def residual_limits(self) -> Mapping[str, float]:
        """Limits of the running proofs: rod lengths (m), energy book over the energy turned over."""
        return {"loop_closure_m": 1e-12, "energy_balance": 1e-8}

    def start(self, step: int = 0) -> LinkageSample:
        """Return the machine at its first angle and speed; the motor is not heard yet."""
        e = 0.0
        if self.transmission is not None:
            e = self._driven(self.start_angle, self.start_speed, 0.0, 0.0, 0.0, self.start_regime).e
        state = State(self.start_angle, self.start_speed, e, 0.0, 0.0, self.start_regime)
        return self._sample(step, state, self.start_command, (0.0, 0.0), None, ())

    def advance(self, linkage: LinkageSample, motor: MotorSample, body: BodySample | None) -> LinkageSample:
        """Return the linkage one step later, its changes of regime located inside the step."""
        e, torque, slope, w = 0.0, 0.0, 0.0, linkage.velocity[0]
        if self.transmission is None:
            e = (motor.velocity[0] - w) / self.step_s
        else:
            torque = self.transmission.crank_torque(motor.effort[0])
            _, before, known, *_ = linkage.memory.values
            if known:
                slope = (torque - self.transmission.crank_torque(before)) / self.step_s
        drive_work, load_work = linkage.memory.values[3:5]
        now = State(linkage.position[0], w, e, drive_work, load_work, linkage.regime)
        done, events = 0.0, []
        while True:
            left = self.step_s - done
            after = self._stepped(now, torque + slope * done, slope, left)
            met = self._boundary_met(now, after.f)
            if met is None:
                now = after
                break
            boundary, angle = met
            span = self._time_of(now, angle, torque + slope * done, slope, left)
            there = self._stepped(now, torque + slope * done, slope, span)
            done += span
            now = there._replace(regime=boundary.after)
            events.append(self._event(linkage.time_s + done, boundary, there, now))
        if self.transmission is None:
            now = now._replace(w=motor.velocity[0])
        memory = (motor.effort[0], 1.0)
        return self._sample(linkage.step + 1, now, motor.command, memory, linkage, tuple(events))

    def _driven(self, f: float, w: float, torque: float, slope: float, h: float, regime: int) -> State:
        shaft = 0.0 if self.transmission is None else self.transmission.shaft_inertia
        f, w, e, drive, load = self.kernels.driven(self.constants, shaft, f, w, torque, slope, h, regime)
        return State(f, w, e, drive, load, regime)

    def _stepped(self, now: State, torque: float, slope: float, h: float) -> State:
        if self.transmission is None:
            f, w, drive, load = self.kernels.prescribed(self.constants, now.f, now.w, now.e, h, now.regime)
            after = State(f, w, now.e, drive, load, now.regime)
        else:
            after = self._driven(now.f, now.w, torque, slope, h, now.regime)
        return after._replace(drive_work=now.drive_work + after.drive_work, load_work=now.load_work + after.load_work)

    def _boundary_met(self, now: State, end: float) -> tuple[Boundary, float] | None:
        """Return the first boundary between now and the end of the step, and its angle in this turn."""
        best: tuple[Boundary, float] | None = None
        for boundary in self.boundaries:
            if boundary.before != now.regime:
                continue
            sign = boundary.direction
            turns = floor(sign * (now.f - boundary.angle) / TURN) + 1.0
            angle = boundary.angle + sign * turns * TURN
            if sign * (angle - end) <= 0.0 and (best is None or sign * (angle - best[1]) < 0.0):
                best = (boundary, angle)
        return best

    def _time_of(self, now: State, angle: float, torque: float, slope: float, left: float) -> float:
        way = angle - now.f
        if self.transmission is None:
            root = sqrt(max(now.w * now.w + 2.0 * now.e * way, 0.0))
            return min(left, 2.0 * way / (now.w + (root if now.w + now.e * left >= 0.0 and way >= 0.0 else -root)))
        miss = [self._driven(now.f, now.w, torque, slope, h, now.regime).f - angle for h in (0.0, left)]
        if miss[0] * miss[1] >= 0.0:
            return left
        return float(
            brentq(
                lambda h: self._driven(now.f, now.w, torque, slope, h, now.regime).f - angle,
                0.0,
                left,
                xtol=1e-16,
                rtol=8.9e-16,
            )
        )

    def _event(self, time_s: float, boundary: Boundary, before: State, after: State) -> Event:
        def coordinate(at: State) -> tuple[Coordinate, ...]:
            torque = self.kernels.state(self.constants, at.f, at.w, at.e, at.regime)[2]
            return (Coordinate(at.f, at.w, torque),)

        turn = max(0, floor((before.f - self.start_angle) / TURN * (1.0 if before.w >= 0.0 else -1.0)))
        return Event(time_s, boundary.kind, self.contact, period=turn, pre=coordinate(before), post=coordinate(after))

    def _sample(
        self,
        step: int,
        at: State,
        command: float,
        motor: tuple[float, float],
        before: LinkageSample | None,
        events: tuple[Event, ...],
    ) -> LinkageSample:
        positions, velocities, torque, energy, closure = self.kernels.state(self.constants, at.f, at.w, at.e, at.regime)
        start = energy if before is None else before.memory.values[5]
        turned_over = max(1.0, abs(start), abs(at.drive_work), abs(at.load_work), abs(energy))
        if not isfinite(torque):
            raise ArithmeticError(f"crank torque is not finite at crank angle {at.f} rad, step {step}")
        return LinkageSample(
            step,
            step * self.step_s,
            self.joints,
            positions,
            velocities,
            (torque,) + (0.0,) * (len(self.joints) - 1),
            at.regime,
            command,
            Named(MEMORY, (at.e, *motor, at.drive_work, at.load_work, start)),
            Named(RESIDUALS, (closure, (energy - start - at.drive_work - at.load_work) / turned_over)),
            events,
        )
