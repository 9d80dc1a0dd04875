"""The metrics of a running breaker: the whole run, and its last blows, in memory that does not grow."""

from __future__ import annotations

import math
from collections import deque

from mech_twin.machines.mb10_breaker.dynamics import Breaker
from mech_twin.machines.mb10_breaker.roles import BreakerForces
from mech_twin.samples import Coordinate, Event, Frame

STEADY_BLOWS = 20
COUNTED_ABOVE_M_PER_S = 1e-3  # impacts on the collar slower than this are the tail of a chatter series and not counted
PEAKS = tuple(f"{pin}_peak_n" for pin in BreakerForces.pins)


def _absolute(side: tuple[Coordinate, ...]) -> float:
    """Return the crank's absolute speed, u - phi'."""
    return side[0].velocity - side[1].velocity


class Cycle:
    """What is gathered from one blow to the next.

    Parameters
    ----------
    start_s : float
        Time of the blow that begins it.
    """

    def __init__(self, start_s: float) -> None:
        self.start_s = start_s
        self.fastest = self.slowest = math.nan
        self.lift = self.spring = 0.0
        self.settled_s = math.nan
        self.contact_s = 0.0
        self.return_speed = 0.0
        self.impacts = 0
        self.torque = self.power = 0.0
        self.samples = 0
        self.peaks = [0.0] * len(PEAKS)
        self.moments = [0.0, 0.0]

    def sees_speed(self, u: float) -> None:
        """Take an absolute crank speed into account."""
        self.fastest = u if math.isnan(self.fastest) else max(self.fastest, u)
        self.slowest = u if math.isnan(self.slowest) else min(self.slowest, u)


class BreakerObserver:
    """Running figures of a run of the breaker.

    Parameters
    ----------
    breaker : Breaker
        Constants.
    """

    def __init__(self, breaker: Breaker) -> None:
        self._b = breaker
        self._counts = dict.fromkeys(("blow", "missed", "unseated", "stalled"), 0)
        self._cycle = Cycle(0.0)
        self._resting_since: float | None = 0.0
        self._records: deque[dict[str, float]] = deque(maxlen=STEADY_BLOWS)
        self._worst: dict[str, float] = {}
        self._spring = self._lift = 0.0
        self._peaks = [0.0] * len(PEAKS)
        self._time_s = 0.0
        self._seen_blow = False

    def observe(self, frame: Frame) -> None:
        """Take one frame into account: its events in their order, then the step's end."""
        body = () if frame.body is None else frame.body.events
        for event in sorted((*frame.linkage.events, *body), key=lambda event: event.time_s):
            self._happened(event, frame)
        self._sampled(frame)
        for sample in (frame.linkage, frame.forces, frame.body):
            if sample is not None:
                for name, value in zip(sample.residuals.names, sample.residuals.values, strict=True):
                    self._worst[name] = max(self._worst.get(name, 0.0), abs(value))

    def numbers(self) -> dict[str, float]:
        """Return the figures of the run, and the means and peaks of its last blows."""
        run = {
            "time_s": self._time_s,
            "blows": float(self._counts["blow"]),
            "missed_blows": float(self._counts["missed"]),
            "unseated_blows": float(self._counts["unseated"]),
            "stalled": float(self._counts["stalled"]),
            "largest_spring_force_n": self._spring,
            "largest_lift_at_tool_m": self._lift,
            "rest_force_n": self._b.rate * self._b.deflection,
        }
        run.update(zip(PEAKS, self._peaks, strict=True))
        run.update({f"worst_{name}": value for name, value in self._worst.items()})
        if self._records:
            run["steady_blows"] = float(len(self._records))
            run.update({f"steady_{name}": self._over_last(name) for name in self._records[-1] if self._always(name)})
        return run

    def _always(self, name: str) -> bool:
        return all(name in record for record in self._records)

    def _over_last(self, name: str) -> float:
        values = [record[name] for record in self._records]
        if "smallest" in name:
            return min(values)
        return max(values) if "largest" in name or "peak" in name else sum(values) / len(values)

    def _happened(self, event: Event, frame: Frame) -> None:
        own = event.contact == "tool"
        if event.kind in self._counts and (own or event.kind != "blow"):
            self._counts[event.kind] += 1
        for side in (event.pre, event.post):
            if side:
                self._cycle.sees_speed(_absolute(side))
        if event.kind in ("touchdown", "settled", "impact") and event.contact != "tool":
            self._touched(event)
        leaves = event.kind in ("blow", "lift_off")
        if leaves and self._resting_since is not None and not self._b.held:
            self._cycle.contact_s += event.time_s - max(self._resting_since, self._cycle.start_s)
            self._resting_since = None
        if event.kind in ("blow", "missed") and own:
            self._closed(event, frame)

    def _touched(self, event: Event) -> None:
        speed = abs(event.pre_velocity_m_per_s)
        self._cycle.return_speed = max(self._cycle.return_speed, speed)
        self._cycle.impacts += speed > COUNTED_ABOVE_M_PER_S
        if event.kind == "settled":
            self._cycle.settled_s = event.time_s
            self._resting_since = event.time_s

    def _closed(self, event: Event, frame: Frame) -> None:
        """End the cycle at this blow and begin the next."""
        c, b = self._cycle, self._b
        duration = event.time_s - c.start_s
        found = frame.forces.quantities.as_dict()
        if self._seen_blow and c.samples and duration > 0.0:
            energy = 0.5 * event.impulse_ns**2 / b.tool_mass
            record: dict[str, float] = {
                "blow_rate_hz": 1.0 / duration,
                "blow_energy_j": energy,
                "blow_impulse_ns": event.impulse_ns,
                "blow_energy_over_overtravel_n": energy / b.overtravel,
                "striking_speed_m_per_s": event.pre_velocity_m_per_s,
                "crank_before_blow_rad_per_s": event.pre[0].velocity,
                "crank_after_blow_rad_per_s": event.post[0].velocity,
                "body_leaves_at_rad_per_s": event.post[1].velocity,
                "largest_absolute_crank_speed_rad_per_s": c.fastest,
                "smallest_absolute_crank_speed_rad_per_s": c.slowest,
                "fluctuation": 2.0 * (c.fastest - c.slowest) / (c.fastest + c.slowest),
                "largest_lift_at_tool_m": c.lift,
                "settled_at_fraction": (c.settled_s - c.start_s) / duration,
                "gap_at_blow_m": b.radius * event.pre[1].position,
                "largest_return_speed_m_per_s": c.return_speed,
                "largest_spring_force_n": c.spring,
                "contact_share": c.contact_s / duration,
                "impacts_above_1_mm_per_s": float(c.impacts),
                "motor_torque_nm": c.torque / c.samples,
                "motor_power_w": c.power / c.samples,
                "largest_body_moment_nm": c.moments[1],
                "smallest_body_moment_nm": c.moments[0],
                "blow_impulse_on_body_nms": found["blow_impulse_on_body_nms"],
                "crank_bearing_impulse_peak_ns": found["crank_bearing_impulse_ns"],
                "rocker_bearing_impulse_peak_ns": found["rocker_bearing_impulse_ns"],
            }
            record.update(zip(PEAKS, c.peaks, strict=True))
            if math.isnan(c.settled_s):
                del record["settled_at_fraction"]
            self._records.append(record)
        self._seen_blow = True
        self._cycle = Cycle(event.time_s)
        if event.post:
            self._cycle.sees_speed(_absolute(event.post))

    def _sampled(self, frame: Frame) -> None:
        c, b = self._cycle, self._b
        self._time_s = frame.linkage.time_s
        c.sees_speed(frame.linkage.velocity[0] - frame.linkage.velocity[3])
        phi = frame.linkage.position[3] if frame.body is None else frame.body.position[0]
        force = b.rate * (b.arm * phi + b.deflection)
        c.lift, self._lift = max(c.lift, b.radius * phi), max(self._lift, b.radius * phi)
        c.spring, self._spring = max(c.spring, force), max(self._spring, force)
        c.torque += frame.motor.effort[0]
        c.power += frame.motor.effort[0] * frame.motor.velocity[0]
        c.samples += 1
        c.moments[0] = min(c.moments[0], frame.forces.body_moment_nm)
        c.moments[1] = max(c.moments[1], frame.forces.body_moment_nm)
        for i, wrench in enumerate(frame.forces.wrenches):
            size = math.hypot(wrench.force_x_n, wrench.force_y_n)
            c.peaks[i] = max(c.peaks[i], size)
            self._peaks[i] = max(self._peaks[i], size)
