# SPDX-License-Identifier: Apache-2.0
"""Numbers of a run of a crank machine: extremes, means from the energy balance, the last whole turn, the motor's load.

Numbers of a run start with ``run_`` and those of its last whole turn with ``turn_``: a cycle at constant speed, which
a machine's report computes in closed form, is something else.

A motor's duty is its work, torque and heat in the rotor, relative to its rating.  The heat in an induction motor's
rotor is the air-gap power that does not leave by the shaft, M (f w_0 - w): torque times slip speed.  At rated load it
is M_n s_n w_0.  This is the rotor loss alone.  Copper and iron losses of the stator and the magnetising current, which
heat an idle motor too, are not known from rating and speeds. If the RMS torque is below the rated one, the load's share
of the heat is too, for a duty cycle short against the thermal time constant.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import inf, pi
from typing import NamedTuple

from mech_twin.engine.crank_state import Memory
from mech_twin.parts.induction_motor import (
    MotorConstants,
    MotorInStep,
    command_in_step,
    motor_in_step,
    torque_in_step,
)
from mech_twin.samples import Frame

LAST = 20  # cycles, or blows, that are used
TURN = 2.0 * pi
SETTLED = 1e-3  # relative difference of the mean speeds of two turns that follow each other


def over_last(records: Sequence[dict[str, float]], prefix: str = "steady_") -> dict[str, float]:
    """Return each metric that all records have: extreme if its name has smallest, largest or peak, else mean."""
    found = {}
    for name in records[-1]:
        values = [record[name] for record in records if name in record]
        if len(values) < len(records):
            continue
        if "smallest" in name:
            found[f"{prefix}{name}"] = min(values)
        elif "largest" in name or "peak" in name:
            found[f"{prefix}{name}"] = max(values)
        else:
            found[f"{prefix}{name}"] = sum(values) / len(values)
    return found


class MotorState(NamedTuple):
    """Torque (N m), speed and slip speed (rad/s) of the rotor at an instant."""

    torque_nm: float
    speed_rad_per_s: float
    slip_rad_per_s: float


def in_step_state(motor: MotorInStep, t: float, rotor_rad_per_s: float) -> MotorState:
    """Return a motor's state at a time of a step (s); without supply the rotor has no field, and no slip in it."""
    field = command_in_step(motor, t) * motor.curve.synchronous_speed_rad_per_s
    slip = field - rotor_rad_per_s if motor.command else 0.0
    return MotorState(torque_in_step(motor, t, rotor_rad_per_s), rotor_rad_per_s, slip)


class MotorDuty(NamedTuple):
    """Integrals over a time: of torque, its square, shaft power and rotor loss."""

    time_s: float = 0.0
    torque_nms: float = 0.0
    torque_square_n2m2s: float = 0.0
    work_j: float = 0.0
    rotor_loss_j: float = 0.0


def _product(a0: float, a1: float, b0: float, b1: float) -> float:
    """Return the mean over a span of the product of two quantities that are linear in it."""
    return (2.0 * (a0 * b0 + a1 * b1) + a0 * b1 + a1 * b0) / 6.0


def shaft_work_j(begin: MotorState, end: MotorState, span_s: float) -> float:
    """Return the shaft work (J) over a span in which torque and speed are linear."""
    mean = _product(begin.torque_nm, end.torque_nm, begin.speed_rad_per_s, end.speed_rad_per_s)
    return mean * span_s


def duty_after(
    duty: MotorDuty, begin: MotorState, end: MotorState, span_s: float, missed_work_j: float = 0.0
) -> MotorDuty:
    """Return the duty a span later.

    Parameters
    ----------
    duty : MotorDuty
        The duty up to the span.
    begin, end : MotorState
        Ends of the span; torque, speed and slip are taken as linear between them.
    span_s : float
        Length (s).
    missed_work_j : float
        Work (J) besides that of linear torque and speed; it is spread evenly over the angle turned.  RMS torque and
        heat are those of linear torque and speed.
    """
    turned = 0.5 * (begin.speed_rad_per_s + end.speed_rad_per_s) * span_s
    first, last = begin.torque_nm, end.torque_nm
    missed_impulse = missed_work_j / turned * span_s if abs(turned) > 1e-9 else 0.0
    return MotorDuty(
        duty.time_s + span_s,
        duty.torque_nms + 0.5 * (first + last) * span_s + missed_impulse,
        duty.torque_square_n2m2s + _product(first, last, first, last) * span_s,
        duty.work_j + shaft_work_j(begin, end, span_s) + missed_work_j,
        duty.rotor_loss_j + _product(first, last, begin.slip_rad_per_s, end.slip_rad_per_s) * span_s,
    )


def duty_metrics(duty: MotorDuty, motor: MotorConstants) -> dict[str, float]:
    """Return means and RMS values of a duty, also relative to the motor's rating; empty for a duty of no time."""
    if duty.time_s <= 0.0:
        return {}
    rms = math.sqrt(duty.torque_square_n2m2s / duty.time_s)
    loss = duty.rotor_loss_j / duty.time_s
    rated_loss = motor.rated_torque_nm * motor.rated_slip * motor.synchronous_speed_rad_per_s
    return {
        "motor_torque_nm": duty.torque_nms / duty.time_s,
        "motor_power_w": duty.work_j / duty.time_s,
        "motor_rms_torque_nm": rms,
        "motor_rms_torque_over_rated": rms / motor.rated_torque_nm,
        "motor_rotor_loss_w": loss,
        "motor_rotor_loss_over_rated": loss / rated_loss,
    }


class RunSums(NamedTuple):
    """Sums since the start of a run: time (s), crank angle (rad), work (J), duty of the motor."""

    time_s: float
    angle_rad: float
    drive_work_j: float
    duty: MotorDuty


class Rates(NamedTuple):
    """Crank speed (rad/s), power on the crank (W) and the motor at an instant."""

    speed_rad_per_s: float
    power_w: float
    motor: MotorState


@dataclass
class Extremes:
    """Minimum and maximum of some numbers, by name; the braces of a name stand for min and max."""

    found: dict[str, tuple[float, float]] = field(default_factory=dict)

    def take(self, name: str, value: float) -> None:
        """Update with one value."""
        least, most = self.found.get(name, (inf, -inf))
        self.found[name] = min(least, value), max(most, value)

    def numbers(self, prefix: str) -> dict[str, float]:
        """Return minima and maxima by their full names."""
        out: dict[str, float] = {}
        for name, (least, most) in self.found.items():
            out[prefix + name.format("min")] = least + 0.0  # no -0
            out[prefix + name.format("max")] = most + 0.0
        return out


class CrankRun:
    """Running numbers of a run.

    Parameters
    ----------
    motor : MotorConstants or None
        The motor, if there is one: its load is then also given relative to its rating.
    further : callable
        ``further(frame)``: numbers whose extremes are reported too; the braces of a name stand for min and max.
    last : callable
        ``last(numbers, memory)``: numbers of the machine beside those found, by the memory of its last frame.
    """

    def __init__(
        self,
        motor: MotorConstants | None,
        further: Callable[[Frame], dict[str, float]],
        last: Callable[[dict[str, float], Memory], dict[str, float]],
    ) -> None:
        self._motor, self._further, self._last = motor, further, last
        self._whole, self._turn, self._last_turn = Extremes(), Extremes(), Extremes()
        self._first: RunSums | None = None
        self._now: RunSums | None = None
        self._rates = Rates(0.0, 0.0, MotorState(0.0, 0.0, 0.0))
        self._turns: list[RunSums] = []  # the last three instants at which a turn was complete
        self._memory: Memory | None = None
        self._counts = Counter[str]()

    def observe(self, frame: Frame) -> None:
        """Update with one frame."""
        linkage = frame.linkage
        angle, speed, torque = linkage.joint("crank")
        self._memory, before = Memory(*linkage.memory.values), self._now
        rates = Rates(speed, torque * speed, self._motor_state(frame))
        now = RunSums(linkage.time_s, angle, self._memory.drive_work_j, MotorDuty())
        if before is None:
            self._turns = [now]
            self._first = now
        else:
            span = now.time_s - before.time_s
            now = now._replace(duty=duty_after(before.duty, self._rates.motor, rates.motor, span))
            self._complete_turns(before, self._rates, now, rates)
            self._counts.update(event.kind for event in linkage.events)
        self._now, self._rates = now, rates
        values = {"drive_torque_{}_nm": torque, "power_{}_w": torque * speed, "crank_speed_{}_rad_per_s": speed}
        for name, value in (values | self._further(frame)).items():
            self._whole.take(name, value)
            self._turn.take(name, value)

    def _motor_state(self, frame: Frame) -> MotorState:
        if self._motor is None:
            return MotorState(0.0, 0.0, 0.0)
        (speed,), (torque,), asked = frame.motor.velocity, frame.motor.effort, frame.motor.command
        return in_step_state(motor_in_step(self._motor, frame.linkage.command, speed, torque, asked, 1.0), 0.0, speed)

    def _complete_turns(self, before: RunSums, rates_before: Rates, now: RunSums, rates: Rates) -> None:
        start = self._turns[-1].angle_rad
        way = now.angle_rad - start
        while abs(way) >= TURN:
            start += TURN if way > 0.0 else -TURN
            self._turns = [*self._turns[-2:], _at_angle(start, before, rates_before, now, rates)]
            self._last_turn, self._turn = self._turn, Extremes()
            way = now.angle_rad - start

    def numbers(self) -> dict[str, float]:
        """Return the numbers so far."""
        if self._first is None or self._now is None or self._memory is None:
            return {}
        out = {
            **self._whole.numbers("run_"),
            "run_crank_turns": self._now.angle_rad / TURN,
            "run_drive_work_j": self._memory.drive_work_j,
            "run_friction_loss_j": self._memory.friction_loss_j,
            "run_gear_loss_j": self._memory.gear_loss_j,
            **self._means("run_", self._first, self._now),
            **{f"run_{kind}_events": float(count) for kind, count in self._counts.items()},
        }
        if len(self._turns) > 1:
            out.update(self._last_turn.numbers("turn_"))
            out.update(self._means("turn_", *self._turns[-2:]))
            least, most = self._last_turn.found["crank_speed_{}_rad_per_s"]
            out["turn_non_uniformity"] = 2.0 * abs(most - least) / max(abs(most + least), 1e-300)
        if len(self._turns) > 2:
            one, two = (TURN / (self._turns[i].time_s - self._turns[i - 1].time_s) for i in (-2, -1))
            out["turn_is_settled"] = 1.0 if abs(two - one) <= SETTLED * abs(two) else 0.0
        return out | self._last(out, self._memory)

    def _means(self, prefix: str, first: RunSums, last: RunSums) -> dict[str, float]:
        span, way = last.time_s - first.time_s, last.angle_rad - first.angle_rad
        if span <= 0.0:
            return {}
        work = last.drive_work_j - first.drive_work_j
        out = {f"{prefix}power_mean_w": work / span, f"{prefix}crank_speed_mean_rad_per_s": way / span}
        if abs(way) >= TURN * (1.0 - 1e-9):
            out[f"{prefix}drive_torque_mean_nm"] = work / way
        if self._motor is not None:
            duty = MotorDuty(*(b - a for a, b in zip(first.duty, last.duty, strict=True)))
            out.update({prefix + name: value for name, value in duty_metrics(duty, self._motor).items()})
        return out


def on_cubic(span: float, ends: tuple[float, float], rates: tuple[float, float], share: float) -> float:
    """Return a value within a span by cubic Hermite interpolation of values and rates at both ends."""
    x, y = share * share * (3.0 - 2.0 * share), share * (1.0 - share)
    return ends[0] + x * (ends[1] - ends[0]) + span * y * ((1.0 - share) * rates[0] - share * rates[1])


def share_at(value: float, span: float, ends: tuple[float, float], rates: tuple[float, float]) -> float:
    """Return the share of a span at which its cubic Hermite interpolant reaches a value between its ends."""
    low, high, sense = 0.0, 1.0, 1.0 if ends[1] >= ends[0] else -1.0
    for _ in range(53):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if sense * (on_cubic(span, ends, rates, middle) - value) < 0.0 else (low, middle)
    return high


def _at_angle(angle: float, first: RunSums, rates: Rates, last: RunSums, last_rates: Rates) -> RunSums:
    """Return the sums at the instant the crank passes an angle (rad), by cubic Hermite interpolation."""
    span = last.time_s - first.time_s
    speeds = rates.speed_rad_per_s, last_rates.speed_rad_per_s
    share = share_at(angle, span, (first.angle_rad, last.angle_rad), speeds)
    work = on_cubic(span, (first.drive_work_j, last.drive_work_j), (rates.power_w, last_rates.power_w), share)
    duty = MotorDuty(*(a + share * (b - a) for a, b in zip(first.duty, last.duty, strict=True)))
    return RunSums(first.time_s + share * span, angle, work, duty)
