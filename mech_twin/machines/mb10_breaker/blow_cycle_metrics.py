# SPDX-License-Identifier: Apache-2.0
"""What is gathered of drive and mechanism from one blow on the tool to the next."""

from __future__ import annotations

import math
from collections.abc import Mapping

from mech_twin.machines.mb10_breaker.dynamics import Breaker
from mech_twin.machines.mb10_breaker.roles import BreakerForces
from mech_twin.machines.mb10_breaker.state import EventSide
from mech_twin.machines.motor_duty import MotorDuty, duty_metrics
from mech_twin.parts.induction_motor import MotorConstants
from mech_twin.samples import Coordinate, Event, ForceSample

PEAKS = tuple(f"{pin}_between_blows_peak_n" for pin in BreakerForces.pins)
STRUCK = ("crank_bearing", "rocker_bearing")  # whose impulses of a blow are told


def absolute_crank_speed(side: tuple[Coordinate, ...]) -> float:
    """Return the crank's absolute speed u - phi' on one side of an event (rad/s)."""
    crank, body = side[:2]
    return crank.velocity - body.velocity


def blow_energy(b: Breaker, event: Event) -> float:
    """Return the energy the tool has from a blow, J^2/(2 m) (J); 0 for what does not fall on the tool.

    Of a blow as a wave what the striker gave: J times the mean of its speeds before and after.
    """
    if b.waves and event.contact == "tool" and event.pre:
        before, after = (EventSide(*side).tool.velocity for side in (event.pre, event.post))
        mean = 0.5 * (event.pre_velocity_m_per_s + before + event.post_velocity_m_per_s + after)
        return event.impulse_ns * mean
    return 0.5 * event.impulse_ns**2 / b.tool_mass_kg if event.contact == "tool" else 0.0


def striker_energy(event: Event) -> float:
    """Return the energy the mechanism brings to the tool before a blow (J): that of its mass at the striker.

    The impulse J is that mass times the loss of the striker's speed, so E = J v^2/(2 (v - v')).  0 of a
    pass that misses the tool.
    """
    before, after = (EventSide(*side).tool.velocity for side in (event.pre, event.post))
    speed, left = event.pre_velocity_m_per_s + before, event.post_velocity_m_per_s + after
    if event.impulse_ns == 0.0 or speed == left:
        return 0.0
    return 0.5 * event.impulse_ns * speed * speed / (speed - left)


def blow_peaks(record: Mapping[str, float], contact_force_n: float) -> dict[str, float]:
    """Return the bearings' peak forces in a blow (N), from that of the contact (N).

    Within a blow mechanism and bearings follow the contact's force in the ratio of their impulses.
    """
    ratio = contact_force_n / record["blow_impulse_ns"]
    return {f"{pin}_blow_peak_n": ratio * record[f"{pin}_impulse_peak_ns"] for pin in STRUCK}


class BlowCycle:
    """Drive and mechanism from one blow to the next.

    Parameters
    ----------
    start_s : float
        Time of the blow that begins it.
    """

    def __init__(self, start_s: float) -> None:
        self.start_s = start_s
        self.fastest = self.slowest = math.nan
        self.duty = MotorDuty()
        self.steps = 0
        self.peaks = [0.0] * len(PEAKS)
        self.least_moment = self.greatest_moment = 0.0

    def take_speed(self, u: float) -> None:
        """Take an absolute crank speed into account."""
        self.fastest = u if math.isnan(self.fastest) else max(self.fastest, u)
        self.slowest = u if math.isnan(self.slowest) else min(self.slowest, u)

    def take_forces(self, forces: ForceSample) -> None:
        """Take the forces at one step into account."""
        self.steps += 1
        self.least_moment = min(self.least_moment, forces.body_moment_nm)
        self.greatest_moment = max(self.greatest_moment, forces.body_moment_nm)
        peaks = self.peaks
        for i, (force_x, force_y, _) in enumerate(forces.wrenches):
            size = math.hypot(force_x, force_y)
            peaks[i] = max(peaks[i], size)

    def metrics(self, b: Breaker, motor: MotorConstants, blow: Event, forces: ForceSample) -> dict[str, float]:
        """Return the metrics of the cycle that this blow (or miss) ends."""
        energy, brought = blow_energy(b, blow), striker_energy(blow)
        found = forces.quantities.as_dict()
        crank, *_ = blow.pre
        crank_after, body_after, *_ = blow.post
        return {
            "blow_rate_hz": 1.0 / (blow.time_s - self.start_s),
            "blow_energy_j": energy,
            "striker_energy_j": brought,
            "blow_efficiency_fraction": energy / brought if brought > 0.0 else 0.0,
            "blow_impulse_ns": blow.impulse_ns,
            "blow_energy_over_overtravel_n": energy / b.overtravel_m,
            "striking_speed_m_per_s": blow.pre_velocity_m_per_s,
            "crank_before_blow_rad_per_s": crank.velocity,
            "crank_after_blow_rad_per_s": crank_after.velocity,
            "body_leaves_at_rad_per_s": body_after.velocity,
            "largest_absolute_crank_speed_rad_per_s": self.fastest,
            "smallest_absolute_crank_speed_rad_per_s": self.slowest,
            "fluctuation": 2.0 * (self.fastest - self.slowest) / (self.fastest + self.slowest),
            **duty_metrics(self.duty, motor),
            "largest_body_moment_nm": self.greatest_moment,
            "smallest_body_moment_nm": self.least_moment,
            "blow_impulse_on_body_nms": found["blow_impulse_on_body_nms"],
            "crank_bearing_impulse_peak_ns": found["crank_bearing_impulse_ns"],
            "rocker_bearing_impulse_peak_ns": found["rocker_bearing_impulse_ns"],
            **dict(zip(PEAKS, self.peaks, strict=True)),
        }
