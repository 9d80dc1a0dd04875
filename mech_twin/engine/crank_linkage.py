"""Linkage with one freedom, turned at its crank: prescribed speed or motor torque, with exact changes of regime.

The mechanism itself comes as kernels (`CrankKernels`); here is only what a coupling step does with them.  Between two
boundaries of the crank angle the regime is constant, and between two instants of rest the sense of turning is, so a
step is cut there and each piece is smooth.  With a prescribed speed the crank angle is a parabola in time and the cuts
are roots of it; with a motor they are found on the integrated motion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import copysign, floor, inf, isfinite, isnan, sqrt
from typing import Any

import numpy as np

from mech_twin.engine.crank_motion import (
    AT_ANGLE,
    AT_REST,
    LONGEST_TURN_RAD,
    NOT_INTEGRATED,
    SPAN_ENDED,
    ShaftDrive,
    integrated_work,
    turn_crank,
)
from mech_twin.engine.crank_state import (
    LARGE_ANGLE,
    NO_FRICTION,
    TURN,
    Boundary,
    CrankKernels,
    Memory,
    Piece,
    Resisting,
    ShaftFriction,
    State,
    Transmission,
    within_a_turn,
)
from mech_twin.engine.errors import MotionError
from mech_twin.parts.friction import released
from mech_twin.parts.gear import GearTorque, gear_split
from mech_twin.roles import CrankState
from mech_twin.samples import BodySample, Coordinate, Event, LinkageSample, MotorSample, Named

CRANK = "crank"  # the joint whose angle the motion is integrated in
MOST_PIECES = 10_000  # of one coupling step
TOLERANCE = 1e-12  # of a step: angle in rad, speed and works over their size
SCALE_ANGLES = 72
HELD_SHARE = 0.01  # of the energy held and moved: no error of work is asked to be below its rounding
RESIDUALS = ("loop_closure_m", "energy_balance")
STARTED, STOPPED, STALLED, REVERSED = "started", "stopped", "stalled", "reversed"


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
    friction: ShaftFriction = NO_FRICTION
    coordinates: tuple[str, ...] = (CRANK,)
    size_m: float = 1.0
    resisting: Mapping[int, Resisting] = field(default_factory=dict)
    energy_scale_j: float = 0.0

    @property
    def residual_limits(self) -> Mapping[str, float]:
        """Limits of the residuals: rod lengths (m, of a linkage beyond 1 m over its size), energy balance."""
        return {"loop_closure_m": 1e-12 * max(1.0, self.size_m), "energy_balance": 1e-8}

    def at_rated_speed(self, speed_rad_per_s: float) -> CrankLinkage:
        """Return this linkage, its energy balance over at least the largest energy of a turn at a speed.

        Where its masses stand still a mechanism holds little, and a stop gives back what the drive gave.
        """
        angles = (TURN * i / SCALE_ANGLES for i in range(SCALE_ANGLES))
        energies = [self.kernels.state(self.constants, f, speed_rad_per_s, 0.0, self.start_regime)[3] for f in angles]
        return replace(self, energy_scale_j=max(map(abs, energies)))

    def start(self, step: int = 0) -> LinkageSample:
        """Return the machine at its first angle and speed; at rest it is held until the motor is heard."""
        f, w = self.start_angle, self.start_speed
        state = State(f, w, 0.0, _sign(w), 0.0, 0.0, 0.0, 0.0, self.start_regime)
        held = self._holding(state) if w == 0.0 else 0.0
        return self._sample(step, state, self.start_command, held, None, 0.0, ())

    def advance(self, linkage: LinkageSample, motor: MotorSample, body: BodySample | None) -> LinkageSample:
        """Return the linkage one step later, its changes of regime and instants of rest located inside the step."""
        past = Memory(*linkage.memory.values)
        works = (past.drive_work_j, past.gear_loss_j, past.friction_loss_j, past.load_work_j)
        crank = linkage.joint(CRANK)
        now = State(
            crank.position,
            crank.velocity,
            past.crank_acceleration_rad_per_s2,
            past.turning_sense,
            *works,
            linkage.regime,
            past.stalled_1,
            1.0,
            past.turned_back_rad,
        )
        adjusted = self.kernels.state(self.constants, now.f, now.w, 0.0, now.regime)[3] - past.energy_j
        events: list[Event] = []
        if self.transmission is None:
            now, held = self._led(now, linkage.time_s, motor, events)
        else:
            drive = self.transmission.drive(linkage, motor, self.step_s, self.friction)
            now, held = self._driven(now, linkage.time_s, drive, motor.command, events)
        return self._sample(linkage.step + 1, now, motor.command, held, past, adjusted, tuple(events))

    def guided(self, step: int, time_s: float, motion: CrankState) -> LinkageSample:
        """Return the linkage in a measured motion of its crank, with the torque at the crank that it needs."""
        f, w, e = motion[:3]
        sense = _sign(w)
        state = State(f, w, e, sense, 0.0, 0.0, 0.0, 0.0, self._regime_at(f, sense))
        return self._sample(step, state, self.start_command, 0.0, None, 0.0, ())._replace(time_s=time_s)

    def _regime_at(self, f: float, sense: float) -> int:
        """Return the regime of a crank that came to an angle in this sense: the one after the last boundary it met."""
        passed = [
            (TURN * ((sense * (f - boundary.angle) / TURN) % 1.0), boundary.after)
            for boundary in self.boundaries
            if boundary.direction == sense and not isnan(boundary.angle)
        ]
        return min(passed)[1] if passed else self.start_regime

    # ---- prescribed speed

    def _led(self, now: State, start_s: float, motor: MotorSample, events: list[Event]) -> tuple[State, float]:
        """Return the state at the end of the step, and the friction torque (N m) where the crank is at rest."""
        (asked,) = motor.velocity
        e, done = (asked - now.w) / self.step_s, 0.0
        for _ in range(MOST_PIECES):
            now = now._replace(e=e, sense=_sign(now.w) or _sign(e))
            boundary, aim = self._next_boundary(now)
            piece = self._led_piece(now, self.step_s - done, aim)
            done += piece.span
            now = piece.after
            if piece.what == SPAN_ENDED:
                now = now._replace(w=asked)
                return now, self._holding(now) if now.sense == 0.0 else 0.0
            if piece.what == AT_ANGLE and boundary is not None:
                now = self._crossed(start_s + done, now, boundary, events)
            elif piece.what == AT_REST:
                now = self._turned_back(now._replace(w=0.0, sense=_sign(now.e)))
        raise MotionError(f"more than {MOST_PIECES} changes of regime in the step from {start_s} s")

    def _led_piece(self, now: State, left: float, aim: float) -> Piece:
        span, what = left, SPAN_ENDED
        turns_back = -now.w / now.e if now.w * now.e < 0.0 else inf
        if turns_back < left:
            span, what = turns_back, AT_REST
        end = now.f + (now.w + 0.5 * now.e * span) * span
        if now.sense * (end - aim) >= 0.0 and isfinite(aim):
            way = aim - now.f
            root = sqrt(max(now.w * now.w + 2.0 * now.e * way, 0.0))
            below = now.w + now.sense * root
            span, what, end = min(span, 2.0 * way / below if below else 0.0), AT_ANGLE, aim
        return Piece(self._led_state(now, span, end), span, what)

    def _led_state(self, now: State, h: float, end: float) -> State:
        w, e = now.w, now.e
        lost = self.friction.coulomb_nm * abs(end - now.f)
        lost += self.friction.viscous_nms_per_rad * h * (w * w + w * e * h + e * e * h * h / 3.0)
        system = self.kernels.prescribed(self.constants, within_a_turn(now.f), w, e, now.regime)
        fastest = max(abs(w), abs(w + e * h), 1e-9)
        tolerance = TOLERANCE * self._work_scale(now, h)
        work = integrated_work(system, h, tolerance, LONGEST_TURN_RAD / fastest) if h > 0.0 else 0.0
        if not isfinite(work):
            raise MotionError(f"the drive's work has no integral from crank angle {now.f} rad at {w} rad/s")
        work += self._rounding_work(now, h, end)
        return now._replace(
            f=end,
            w=w + e * h,
            drive_work=now.drive_work + work + lost,
            friction_loss=now.friction_loss + lost,
            load_work=now.load_work + self.kernels.load_work(self.constants, now.f, end, now.regime),
        )

    def _rounding_work(self, now: State, h: float, end: float) -> float:
        """Return the work (J) on the way by which a large angle at the end is rounded: equal steps round alike."""
        if abs(end) < LARGE_ANGLE:
            return 0.0
        after = now._replace(f=end, w=now.w + now.e * h)
        return self._torque(after) * ((end - now.f) - (now.w + 0.5 * now.e * h) * h)

    def _torque(self, at: State) -> float:
        """Return the torque (N m) on the mechanism that gives it its acceleration."""
        return float(self.kernels.state(self.constants, at.f, at.w, at.e, at.regime)[2])

    def _holding(self, at: State) -> float:
        """Return the friction torque (N m) at rest: all it can carry of the load, the drive holds what is left."""
        needed = self._load_torque(at)
        return min(max(needed, -self.friction.coulomb_nm), self.friction.coulomb_nm)

    # ---- motor

    def _driven(
        self, now: State, start_s: float, drive: ShaftDrive, command: float, events: list[Event]
    ) -> tuple[State, float]:
        """Return the state at the end of the step, and the friction torque (N m) where the crank is at rest."""
        done = 0.0
        for _ in range(MOST_PIECES):
            if now.w == 0.0:
                now = self._set_off(now, start_s + done, drive, done, command, events)
            boundary, aim = self._next_boundary(now)
            piece = self._turned(now, drive, done, self.step_s - done, aim)
            if piece.what == AT_REST and now.w == 0.0 == piece.span:  # on the edge of sticking, within rounding
                piece = Piece(now._replace(sense=0.0, e=0.0), self.step_s - done, SPAN_ENDED)
            done += piece.span
            now = piece.after
            if piece.what == SPAN_ENDED:
                return self._rest(now, drive, done) if now.sense == 0.0 else (now, 0.0)
            if piece.what == AT_ANGLE and boundary is not None:
                now = self._crossed(start_s + done, now, boundary, events)
        raise MotionError(f"more than {MOST_PIECES} changes of regime in the step from {start_s} s")

    def _set_off(
        self, now: State, time_s: float, drive: ShaftDrive, t: float, command: float, events: list[Event]
    ) -> State:
        """Return the state with the sense in which a crank without speed goes on, 0 where it sticks, and log that."""
        after, _ = self._rest(now, drive, t)
        if after.sense != 0.0:
            after = self._turned_back(after._replace(stalled=0.0))
        held_for_good = after.sense == now.sense == 0.0 and command != 0.0 and drive.time_slope == 0.0
        if after.sense == now.sense and (not held_for_good or now.stalled):
            return after
        kind = STARTED if now.sense == 0.0 else STOPPED if after.sense == 0.0 else REVERSED
        if held_for_good or now.sense * command > 0.0:
            kind, after = STALLED, after._replace(stalled=float(after.sense == 0.0))
        smooth = self._grip(drive, t).friction_nm + self.friction.coulomb_nm == 0.0
        if kind == STALLED or not smooth:
            torque = self._load_torque(now)
            at = (Coordinate(now.f, 0.0, torque),)
            events.append(Event(time_s, kind, "crank", period=self._period(now), pre=at, post=at))
        return after

    def _grip(self, drive: ShaftDrive, t: float) -> GearTorque:
        torque = drive.torque_nm - drive.speed_slope * drive.ratio * drive.speed + drive.time_slope * t
        torque = min(max(torque, -drive.torque_limit_nm), drive.torque_limit_nm)
        return GearTorque(*gear_split(drive.ratio, drive.efficiency, torque))

    def _rest(self, now: State, drive: ShaftDrive, t: float) -> tuple[State, float]:
        """Return a crank without speed with the sense in which it starts (0: it sticks), and the bearing's torque."""
        if now.w != 0.0:
            return now._replace(sense=_sign(now.w)), 0.0
        grip = self._grip(drive, t)
        limit = grip.friction_nm + self.friction.coulomb_nm
        driving, load_share = self._driving(now, grip.mean_nm, limit)
        sense = released(limit, driving)
        share = self.friction.coulomb_nm / limit if limit > 0.0 else 0.0
        after = now._replace(sense=sense, e=0.0, share=load_share if sense == 0.0 else 1.0)
        return after, -driving * share if sense == 0.0 else 0.0

    def _driving(self, now: State, mean: float, limit: float) -> tuple[float, float]:
        """Return the torque (N m) that would turn a crank at rest, and the share of the load that acts on it.

        A load that only resists takes of itself what holds the crank, from nothing to the whole.
        """
        whole = self._load_torque(now)
        resists = self.resisting.get(now.regime)
        if resists is None:
            return mean - whole, 1.0
        bare = self._load_torque(now._replace(regime=resists.after))
        if resists.sense * (mean - whole) > limit:
            return mean - whole, 1.0
        share = 0.0 if whole == bare else min(max((mean - bare) / (whole - bare), 0.0), 1.0)
        return mean - bare - share * (whole - bare), share

    def _turned_back(self, now: State) -> State:
        """Return the state, out of a load that only resists where the crank sets off against its sense."""
        resists = self.resisting.get(now.regime)
        if resists is None or now.sense in (0.0, resists.sense):
            return now
        return now._replace(regime=resists.after, mark=now.f)

    def _release_time(self, now: State, drive: ShaftDrive, t: float, left: float) -> float:
        """Return how long a crank at rest goes on sticking (s), at most ``left``.

        The motor's torque is a straight line in time, and so is, on either side of 0, what the gear passes on: the
        margin |T| - c - friction of the gear grows with one sign of slope, so its root is bracketed by the ends.
        """

        def sticks(after: float) -> bool:
            return self._rest(now, drive, t + after)[0].sense == 0.0

        if sticks(left):
            return left
        low, high = 0.0, left
        while high - low > 1e-15 * self.step_s:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if sticks(middle) else (low, middle)
        return high

    def _turned(self, now: State, drive: ShaftDrive, t: float, left: float, aim: float) -> Piece:
        if now.sense == 0.0:
            span = self._release_time(now, drive, t, left)
            return Piece(now._replace(e=0.0), span, SPAN_ENDED if span == left else AT_REST)
        size = self._work_scale(now, left)
        near = within_a_turn(now.f)
        y = np.array([near, now.w, now.drive_work, now.gear_loss, now.friction_loss])
        tolerance = TOLERANCE * np.array([1.0, 1.0 + abs(now.w), size, size, size])
        system = self.kernels.driven(self.constants, drive._replace(direction=now.sense), now.regime)
        span, what, e = turn_crank(system, t, y, left, now.sense, aim - (now.f - near), tolerance)
        if what == NOT_INTEGRATED:
            raise MotionError(f"no step is small enough at crank angle {y[0]} rad and {y[1]} rad/s")
        turned, w, drive_work, gear_loss, friction_loss = y.tolist()
        f = aim if what == AT_ANGLE else now.f + (turned - near) if near != now.f else turned
        if near != now.f:
            drive_work += self._torque(now._replace(f=f, w=w, e=e)) * ((f - now.f) - (turned - near))
        load = now.load_work + self.kernels.load_work(self.constants, now.f, f, now.regime)
        after = now._replace(
            f=f, w=w, e=e, drive_work=drive_work, gear_loss=gear_loss, friction_loss=friction_loss, load_work=load
        )
        return Piece(after, span, what)

    # ---- both

    def _load_torque(self, at: State) -> float:
        """Return the torque (N m) that holds the mechanism at rest."""
        return float(self.kernels.state(self.constants, at.f, 0.0, 0.0, at.regime)[2])

    def _turned_over(self, at: State) -> float:
        return max(1.0, abs(at.drive_work), abs(at.load_work), at.friction_loss)

    def _work_scale(self, at: State, h: float) -> float:
        """Return the size (J) an error of work is measured by: what was turned over, or is held and moved in ``h``."""
        _, _, torque, energy, _ = self.kernels.state(self.constants, at.f, at.w, at.e, at.regime)
        friction = self.friction.coulomb_nm + self.friction.viscous_nms_per_rad * abs(at.w)
        moved = (abs(torque) + friction) * (abs(at.w) + abs(at.e) * h) * h
        return max(self._turned_over(at), HELD_SHARE * float(abs(energy) + moved))

    def _next_boundary(self, now: State) -> tuple[Boundary | None, float]:
        """Return the next boundary in the sense of turning, and its angle in this turn (rad)."""
        best: Boundary | None = None
        aim = copysign(inf, now.sense)
        for boundary in self.boundaries:
            sign = boundary.direction
            if boundary.before != now.regime or sign != now.sense:
                continue
            angle = now.mark
            if not isnan(boundary.angle):
                turns = floor(sign * (now.f - boundary.angle) / TURN) + 1.0
                angle = boundary.angle + sign * turns * TURN
            if best is None or sign * (angle - aim) < 0.0:
                best, aim = boundary, angle
        return best, aim

    def _period(self, at: State) -> int:
        return max(0, floor((at.f - self.start_angle) / TURN * (1.0 if at.sense >= 0.0 else -1.0)))

    def _crossed(self, time_s: float, before: State, boundary: Boundary, events: list[Event]) -> State:
        """Return the state in the next regime, and log the event with the speed of the loaded point."""
        after = before._replace(regime=boundary.after)
        speed = float(self.kernels.load_speed(self.constants, before.f, before.w))
        coordinates = [
            (Coordinate(at.f, at.w, self.kernels.state(self.constants, at.f, at.w, at.e, at.regime)[2]),)
            for at in (before, after)
        ]
        turn = self._period(before)
        events.append(Event(time_s, boundary.kind, self.contact, speed, speed, 0.0, turn, *coordinates))
        return after

    def _sample(
        self,
        step: int,
        at: State,
        command: float,
        held: float,
        past: Memory | None,
        adjusted: float,
        events: tuple[Event, ...],
    ) -> LinkageSample:
        constants = self.constants if at.share == 1.0 else self.kernels.shared(self.constants, at.share)
        positions, velocities, torque, energy, closure = self.kernels.state(constants, at.f, at.w, at.e, at.regime)
        if not isfinite(torque):
            raise MotionError(f"crank torque is not finite at crank angle {at.f} rad, step {step}")
        friction = held
        if at.sense != 0.0:
            friction = -self.friction.coulomb_nm * at.sense - self.friction.viscous_nms_per_rad * at.w
        initial, booked = (energy, 0.0) if past is None else (past.initial_energy_j, past.adjustment_work_j + adjusted)
        works = (at.drive_work, at.gear_loss, at.friction_loss, at.load_work)
        memory = Memory(at.e, friction, at.sense, at.stalled, at.share, at.mark, *works, booked, energy, initial)
        miss = energy - initial - at.drive_work - at.load_work + at.friction_loss - booked
        scale = max(self._turned_over(at), abs(initial), abs(energy), abs(booked), self.energy_scale_j)
        return LinkageSample(
            step,
            step * self.step_s,
            self.joints,
            positions,
            velocities,
            (torque - friction,) + (0.0,) * (len(self.joints) - 1),
            at.regime,
            command,
            Named(Memory._fields, memory),
            Named(RESIDUALS, (closure, miss / scale)),
            events,
        )


def _sign(value: float) -> float:
    return 0.0 if value == 0.0 else copysign(1.0, value)
