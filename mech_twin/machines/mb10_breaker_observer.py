"""The owner's figures of a breaker's run: cycle by cycle, quoted for the newest cycles."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass

from mech_twin.machines.mb10_breaker_dynamics import Breaker
from mech_twin.samples import Event, Frame

QUOTED_CYCLES = 20
REST_REGIME = 0


@dataclass
class Cycle:
    """What is gathered between two blows."""

    steps: int = 0
    resting: int = 0
    crank_max: float = -math.inf
    crank_min: float = math.inf
    lift: float = 0.0
    spring_max: float = 0.0
    torque: float = 0.0
    power: float = 0.0
    begin_s: float = 0.0
    length_s: float = 0.0
    impulse: float = 0.0
    before: float = 0.0
    after: float = 0.0
    gap: float = 0.0
    leaving: float = 0.0
    return_speed: float = 0.0
    settled_s: float = math.nan
    touchdowns: int = 0


class BreakerObserver:
    """Running figures of a breaker, over its newest cycles; a cycle runs from blow to blow.

    Parameters
    ----------
    breaker : Breaker
        Constants of the machine.
    step_s : float
        Coupling step.
    """

    def __init__(self, breaker: Breaker, step_s: float) -> None:
        self._b = breaker
        self._step_s = step_s
        self._cycles: deque[Cycle] = deque(maxlen=QUOTED_CYCLES)
        self._cycle: Cycle | None = None
        self._events: Counter[str] = Counter()
        self._pins: dict[str, float] = {}
        self._time_s = 0.0

    def observe(self, frame: Frame) -> None:
        """Take one frame into account."""
        self._time_s = frame.linkage.time_s
        body_events: tuple[Event, ...] = () if frame.body is None else frame.body.events
        for event in sorted((*frame.linkage.events, *body_events), key=lambda event: event.time_s):
            self._take(event)
        self._watch_pins(frame)
        if self._cycle is not None:
            self._add(self._cycle, frame)

    def numbers(self) -> dict[str, float]:
        """Return the figures so far; those of a cycle are means over the newest 20, extremes are named so."""
        counts = {f"{kind}_count": float(self._events[kind]) for kind in ("blow", "missed", "unseated", "jammed")}
        peaks = {f"{pin}_peak_n": peak for pin, peak in self._pins.items()}
        cycles = [cycle for cycle in self._cycles if cycle.steps > 0]
        return {"time_s": self._time_s, **counts, **peaks, **(self._steady(cycles) if cycles else {})}

    def _take(self, event: Event) -> None:
        self._events[event.kind] += 1
        cycle = self._cycle
        if event.kind == "blow" and event.contact == "tool":
            if cycle is not None:
                cycle.length_s = event.time_s - cycle.begin_s
                self._cycles.append(cycle)
            self._cycle = _begun(event, self._b)
        elif cycle is not None and event.kind == "touchdown":
            cycle.return_speed = cycle.return_speed or abs(event.pre_velocity_m_per_s)
            cycle.touchdowns += 1
        elif cycle is not None and event.kind == "settled":
            cycle.settled_s = event.time_s - cycle.begin_s

    def _watch_pins(self, frame: Frame) -> None:
        for pin, wrench in zip(frame.forces.pins, frame.forces.wrenches, strict=True):
            size = math.hypot(wrench.force_x_n, wrench.force_y_n)
            self._pins[pin] = max(self._pins.get(pin, 0.0), size)

    def _add(self, cycle: Cycle, frame: Frame) -> None:
        speed, motor = frame.linkage.velocity[0] - frame.linkage.velocity[3], frame.motor
        cycle.steps += 1
        cycle.crank_max = max(cycle.crank_max, speed)
        cycle.crank_min = min(cycle.crank_min, speed)
        cycle.torque += motor.effort[0]
        cycle.power += motor.effort[0] * motor.velocity[0]
        if frame.body is not None:
            cycle.resting += frame.body.regime == REST_REGIME
            cycle.lift = max(cycle.lift, frame.body.position[0])
            cycle.spring_max = max(cycle.spring_max, frame.body.pressing_force_n)

    def _steady(self, cycles: list[Cycle]) -> dict[str, float]:
        b = self._b
        impulse = _mean(cycle.impulse for cycle in cycles)
        fast, slow = _mean(cycle.crank_max for cycle in cycles), _mean(cycle.crank_min for cycle in cycles)
        energy = _mean(cycle.impulse**2 for cycle in cycles) / (2.0 * b.tool_mass)
        settled = [cycle.settled_s / cycle.length_s for cycle in cycles if math.isfinite(cycle.settled_s)]
        return {
            "quoted_cycles": float(len(cycles)),
            "blow_rate_hz": 1.0 / _mean(cycle.length_s for cycle in cycles),
            "blow_impulse_ns": impulse,
            "blow_energy_j": energy,
            "wall_force_limit_n": energy / b.overtravel,
            # absolute: what the flywheel and the rotor have
            "crank_speed_max_rad_per_s": fast,
            "crank_speed_min_rad_per_s": slow,
            "crank_fluctuation": 2.0 * (fast - slow) / (fast + slow),
            "crank_before_blow_rad_per_s": _mean(cycle.before for cycle in cycles),
            "crank_after_blow_rad_per_s": _mean(cycle.after for cycle in cycles),
            "body_leaving_rate_rad_per_s": _mean(cycle.leaving for cycle in cycles),
            "lift_at_tool_max_m": b.radius * max(cycle.lift for cycle in cycles),
            "gap_at_blow_m": _mean(cycle.gap for cycle in cycles),
            "return_speed_m_per_s": _mean(cycle.return_speed for cycle in cycles),
            "settled_share": _mean(settled) if len(settled) == len(cycles) else 1.0,
            "contact_share": _mean(cycle.resting / cycle.steps for cycle in cycles),
            "touchdowns_per_cycle": _mean(cycle.touchdowns for cycle in cycles),
            "spring_force_max_n": max(cycle.spring_max for cycle in cycles),
            "rest_spring_force_n": b.rate * b.deflection,
            "motor_torque_mean_nm": sum(c.torque for c in cycles) / sum(c.steps for c in cycles),
            "motor_power_mean_w": sum(c.power for c in cycles) / sum(c.steps for c in cycles),
        }


def _begun(event: Event, b: Breaker) -> Cycle:
    """Return the cycle that begins with a blow."""
    cycle = Cycle(begin_s=event.time_s, impulse=event.impulse_ns)
    if len(event.pre) > 1 and len(event.post) > 1:
        cycle.gap = b.radius * event.pre[1].position
        cycle.leaving = event.post[1].velocity
        cycle.before, cycle.after = event.pre[0].velocity, event.post[0].velocity  # against the body
        cycle.crank_max = event.pre[0].velocity - event.pre[1].velocity
        cycle.crank_min = event.post[0].velocity - event.post[1].velocity
    return cycle


def _mean(values: Iterable[float]) -> float:
    numbers = list(values)
    return math.fsum(numbers) / len(numbers)
