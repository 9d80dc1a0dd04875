# SPDX-License-Identifier: Apache-2.0
"""Running metrics of the breaker: the whole run, and its last cycles, in memory that does not grow.

Mechanism and drive are cut into cycles at the blows on the tool.  The body is cut at the same blows where it is driven
by the linkage; under the half sine it has a clock of its own and is cut at its own blows.

What is gathered of the body's motion in one cycle of its excitation: lift, spring force, returns, contact.

What is gathered of drive and mechanism in one pass of the striker, up to a blow on the tool or a miss; only a blow has
the figures of a blow.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from statistics import harmonic_mean

from mech_twin.machines.crank_run import (
    LAST,
    MotorDuty,
    MotorState,
    duty_after,
    duty_metrics,
    in_step_state,
    over_last,
    shaft_work_j,
)
from mech_twin.machines.mb10_breaker.dynamics import Breaker
from mech_twin.machines.mb10_breaker.impacts import blow_contact, fading
from mech_twin.machines.mb10_breaker.metrics import blow_metrics, is_seated
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.roles import PINS
from mech_twin.machines.mb10_breaker.state import EventSide
from mech_twin.parts.friction_and_gear import passed_on
from mech_twin.parts.induction_motor import motor_constants, motor_in_step, supplied_motor
from mech_twin.samples import Coordinate, Event, ForceSample, Frame

COUNTED_ABOVE_M_PER_S = 1e-3  # slower returns to the collar are the tail of a chatter series and not counted
OF_BODY = ("largest_lift_at_tool_m", "largest_spring_force_n")
RETURNS = frozenset(("touchdown", "settled", "impact"))


Record = dict[str, float]


def keep_largest(record: Record, found: Record) -> None:
    """Replace numbers of a record by larger ones that were found."""
    for name, value in found.items():
        record[name] = max(record[name], value)


class BodyCycle:
    """The body from one blow to the next.

    Parameters
    ----------
    start_s : float
        Time of the blow that begins it.
    resting_since_s : float or None
        Since when the body has been resting on its collar; None in flight.
    """

    def __init__(self, start_s: float, resting_since_s: float | None) -> None:
        self.start_s = start_s
        self.resting_since_s = resting_since_s
        self.largest = dict.fromkeys((*OF_BODY, "largest_return_speed_m_per_s"), 0.0)
        self.contact_s = 0.0
        self.settled_s = math.nan
        self.impacts = 0

    def take_event(self, event: Event) -> None:
        """Update with an event at the collar."""
        if event.kind in RETURNS:
            speed = abs(event.pre_velocity_m_per_s)
            keep_largest(self.largest, {"largest_return_speed_m_per_s": speed})
            self.impacts += speed > COUNTED_ABOVE_M_PER_S
        if event.kind == "settled":
            self.settled_s = self.resting_since_s = event.time_s
        if event.kind == "lift_off" and self.resting_since_s is not None:
            self.contact_s += event.time_s - max(self.resting_since_s, self.start_s)
            self.resting_since_s = None

    def contact_share(self, end_s: float) -> float:
        """Return the share of the cycle, up to the blow at ``end_s`` (s), in which the body rests on its collar."""
        resting = 0.0 if self.resting_since_s is None else end_s - max(self.resting_since_s, self.start_s)
        return (self.contact_s + resting) / (end_s - self.start_s)

    def next(self, blow: Event) -> BodyCycle:
        """Return the cycle that a blow begins; the body rests on if the blow does not throw it up."""
        thrown = bool(blow.post) and EventSide(*blow.post).body.velocity > 0.0
        return BodyCycle(blow.time_s, None if thrown else self.resting_since_s)

    def metrics(self, end_s: float) -> dict[str, float]:
        """Return the metrics of the cycle, ended by a blow; the rest goes on into the next."""
        duration = end_s - self.start_s
        found = {
            "body_cycle_rate_hz": 1.0 / duration,
            **self.largest,
            "contact_share": self.contact_share(end_s),
            "impacts_above_1_mm_per_s": float(self.impacts),
        }
        if not math.isnan(self.settled_s):
            found["settled_at_fraction"] = (self.settled_s - self.start_s) / duration
        return found


PEAKS = tuple(f"{pin}_between_blows_peak_n" for pin in PINS)
STRUCK = ("crank_bearing", "rocker_bearing")  # whose impulses of a blow are told


def absolute_crank_speed(side: tuple[Coordinate, ...]) -> float:
    """Return the crank's absolute speed u - phi' on one side of an event (rad/s)."""
    crank, body = side[:2]
    return crank.velocity - body.velocity


def blow_energy(b: Breaker, event: Event) -> float:
    """Return the energy given to the tool by a blow, J^2/(2 m) (J); 0 for other events.

    For a blow as a stress wave it is the striker's loss: J times the mean of its speeds before and after.
    """
    if b.waves and event.contact == "tool" and event.pre:
        before, after = (EventSide(*side).tool.velocity for side in (event.pre, event.post))
        mean = 0.5 * (event.pre_velocity_m_per_s + before + event.post_velocity_m_per_s + after)
        return event.impulse_ns * mean
    return 0.5 * event.impulse_ns**2 / b.tool_mass_kg if event.contact == "tool" else 0.0


def striker_energy(event: Event) -> float:
    """Return the kinetic energy (J) of the mechanism's effective mass at the striker before a blow.

    The impulse J is that mass times the loss of the striker's speed, so E = J v^2/(2 (v - v')); 0 without impulse.
    """
    before, after = (EventSide(*side).tool.velocity for side in (event.pre, event.post))
    speed, left = event.pre_velocity_m_per_s + before, event.post_velocity_m_per_s + after
    if event.impulse_ns == 0.0 or speed == left:
        return 0.0
    return 0.5 * event.impulse_ns * speed * speed / (speed - left)


def blow_peaks(record: Mapping[str, float], contact_force_n: float) -> dict[str, float]:
    """Return the bearings' peak forces in a blow (N), from the peak contact force (N).

    Within a blow the bearing forces are proportional to the contact force, in the ratio of the impulses.
    """
    ratio = contact_force_n / record["blow_impulse_ns"]
    return {f"{pin}_blow_peak_n": ratio * record[f"{pin}_impulse_peak_ns"] for pin in STRUCK}


class Pass:
    """Drive and mechanism from one blow or miss to the next."""

    def __init__(self) -> None:
        self.fastest = self.slowest = math.nan
        self.duty = MotorDuty()
        self.steps = 0
        self.peaks = dict.fromkeys(PEAKS, 0.0)
        self.least_moment = self.greatest_moment = 0.0

    def take_speed(self, u: float) -> None:
        """Update with an absolute crank speed (rad/s)."""
        self.fastest = u if math.isnan(self.fastest) else max(self.fastest, u)
        self.slowest = u if math.isnan(self.slowest) else min(self.slowest, u)

    def take_forces(self, forces: ForceSample) -> None:
        """Update with the forces of one step."""
        self.steps += 1
        self.least_moment = min(self.least_moment, forces.body_moment_nm)
        self.greatest_moment = max(self.greatest_moment, forces.body_moment_nm)
        sizes = (math.hypot(force_x, force_y) for force_x, force_y, _ in forces.wrenches)
        keep_largest(self.peaks, dict(zip(PEAKS, sizes, strict=True)))

    def metrics(self) -> dict[str, float]:
        """Return the metrics of the pass, but for the motor's duty."""
        return {
            "largest_absolute_crank_speed_rad_per_s": self.fastest,
            "smallest_absolute_crank_speed_rad_per_s": self.slowest,
            "fluctuation": 2.0 * (self.fastest - self.slowest) / (self.fastest + self.slowest),
            "largest_body_moment_nm": self.greatest_moment,
            "smallest_body_moment_nm": self.least_moment,
            **self.peaks,
        }


def struck_metrics(b: Breaker, blow: Event, forces: ForceSample) -> dict[str, float]:
    """Return the metrics of a blow on the tool."""
    energy, brought = blow_energy(b, blow), striker_energy(blow)
    found = forces.quantities.as_dict()
    crank, *_ = blow.pre
    crank_after, body_after, *_ = blow.post
    return {
        "blow_energy_j": energy,
        "striker_energy_j": brought,
        "blow_efficiency_fraction": energy / brought if brought > 0.0 else 0.0,
        "blow_impulse_ns": blow.impulse_ns,
        "blow_energy_over_overtravel_n": energy / b.overtravel_m,
        "striking_speed_m_per_s": blow.pre_velocity_m_per_s,
        "crank_before_blow_rad_per_s": crank.velocity,
        "crank_after_blow_rad_per_s": crank_after.velocity,
        "body_leaves_at_rad_per_s": body_after.velocity,
        "blow_impulse_on_body_nms": found["blow_impulse_on_body_nms"],
        "crank_bearing_impulse_peak_ns": found["crank_bearing_impulse_ns"],
        "rocker_bearing_impulse_peak_ns": found["rocker_bearing_impulse_ns"],
    }


COUNTED = {"blow": "blows", "missed": "missed_blows", "off_collar": "off_collar_blows", "stalled": "stalled"}


class BreakerObserver:
    """Running metrics of a run of the breaker.

    Parameters
    ----------
    parameters : BreakerParameters
        Configuration.
    breaker : Breaker
        Its constants.
    """

    def __init__(self, parameters: BreakerParameters, breaker: Breaker) -> None:
        self.use(parameters, breaker)
        self._counts = dict.fromkeys((*COUNTED.values(), "unseated_blows"), 0.0)
        self._cycle = Pass()
        self._body = BodyCycle(0.0, 0.0 if parameters.body.contact == "one_sided" else None)
        self._passes: deque[tuple[MotorDuty, Record, Record | None]] = deque(maxlen=LAST)
        self._feed_m = 0.0
        self._body_cycles: deque[Record] = deque(maxlen=LAST)
        self._worst: Record = {}
        self._run: Record = dict.fromkeys(
            ("largest_spring_force_n", "largest_lift_at_tool_m", "largest_gap_at_blow_m", *PEAKS), 0.0
        )
        self._time_s = self._work_j = 0.0
        self._efficiency = breaker.efficiency
        self._state: MotorState | None = None
        self._in_step, self._began_s = supplied_motor(self._motor, 0.0), 0.0
        self._seen_blow = self._seen_body_blow = False

    def use(self, parameters: BreakerParameters, breaker: Breaker) -> None:
        """Take the frames that follow as those of this breaker."""
        self._b, self._motor, tool = breaker, motor_constants(parameters.motor), parameters.tool
        self._stiffness, self._line = tool.contact_stiffness_n_per_m, tool.wave.life.line
        self._step_s = parameters.coupling.step_s

    def observe(self, frame: Frame) -> None:
        """Take one frame into account: its events in their order, then the step's end."""
        if self._state is None:
            self._body.start_s = frame.linkage.time_s
        own = () if frame.body is None else frame.body.events
        happened = (*frame.linkage.events, *own)
        events = sorted(happened, key=lambda event: event.time_s) if happened else happened
        crank, body = frame.linkage.joint("crank"), frame.linkage.joint("body")
        state = self._motor_state(crank.velocity, body.velocity, frame.linkage.time_s)
        missed = self._missed_work(frame, state, crank.effort)
        for event in events:
            self._run_motor_to(event, missed)
            self._take_event(event, frame)
        self._take_step(frame, crank, body, state, missed)
        worst = self._worst
        for sample in (frame.linkage, frame.forces, frame.body):
            if sample is not None:
                for name, value in zip(*sample.residuals, strict=True):
                    worst[name] = max(worst.get(name, 0.0), abs(value))

    def numbers(self) -> dict[str, float]:
        """Return the metrics of the run (``run_...``), and means and peaks of its last cycles (``steady_...``)."""
        keep_largest(self._run, self._cycle.peaks)
        found = {"time_s": self._time_s, **self._counts}
        found["rest_force_n"] = self._b.spring_rate_n_per_m * self._b.preload_m
        found.update({f"run_{name}": value for name, value in self._run.items()})
        found.update({f"worst_{name}": value for name, value in self._worst.items()})
        if self._passes:
            duties, passes, blows = zip(*self._passes, strict=True)
            duty, struck = MotorDuty(*map(math.fsum, zip(*duties, strict=True))), [each for each in blows if each]
            found |= {"steady_blows": float(len(struck)), "steady_blow_rate_hz": len(struck) / duty.time_s}
            found |= over_last([duty_metrics(duty, self._motor)]) | over_last(passes)
            found |= over_last(struck) if struck else {}
        if self._body_cycles:
            found |= {"steady_body_cycles": float(len(self._body_cycles)), **over_last(self._body_cycles)}
            found["steady_body_cycle_rate_hz"] = harmonic_mean(each["body_cycle_rate_hz"] for each in self._body_cycles)
        return found

    def _rotor_speed(self, crank_speed: float, body_speed: float) -> float:
        return self._b.ratio * (crank_speed - self._b.frame_drive * body_speed)

    def _motor_state(self, crank_speed: float, body_speed: float, time_s: float) -> MotorState:
        speed = self._rotor_speed(crank_speed, body_speed)
        return in_step_state(self._in_step, min(time_s - self._began_s, self._step_s), speed)

    def _missed_work(self, frame: Frame, state: MotorState, crank_nm: float) -> float:
        """Return the motor's mean power from the energy balance less that from linear interpolation of a step (W)."""
        memory, span = frame.linkage.memory, frame.linkage.time_s - self._time_s
        work = memory.values[memory.names.index("drive_work_j")]
        done, self._work_j = work - self._work_j, work
        if self._state is None or span <= 0.0:
            return 0.0
        eta = self._efficiency = passed_on(self._b.ratio * state.torque_nm, crank_nm, self._efficiency)
        last, time_s = self._state, self._time_s
        sides = [
            (event.time_s, self._across(event.pre, event.time_s), self._across(event.post, event.time_s))
            for event in frame.linkage.events
            if event.pre
        ]
        for until_s, before, after in [*sides, (frame.linkage.time_s, state, state)]:
            linear = shaft_work_j(last, before, until_s - time_s)
            done -= linear * eta if linear > 0.0 else linear / eta  # the torque may change its sign at a blow
            last, time_s = after, until_s
        return (done / eta if linear > 0.0 else done * eta) / span

    def _across(self, side: tuple[Coordinate, ...], time_s: float) -> MotorState:
        crank, body, *_ = side
        return self._motor_state(crank.velocity, body.velocity, time_s)

    def _run_motor_to(self, event: Event, missed_w: float) -> None:
        """Add the motor's duty up to an event of the linkage."""
        if event.pre and self._state is not None:
            span = event.time_s - self._time_s
            before = self._across(event.pre, event.time_s)
            self._cycle.duty = duty_after(self._cycle.duty, self._state, before, span, missed_w * span)
            self._state, self._time_s = self._across(event.post, event.time_s), event.time_s

    def _take_event(self, event: Event, frame: Frame) -> None:
        tool = event.contact == "tool"
        if event.kind in COUNTED and (tool or event.kind != "blow"):
            self._counts[COUNTED[event.kind]] += 1.0
        for side in (event.pre, event.post):
            if side:
                self._cycle.take_speed(absolute_crank_speed(side))
        if not tool:
            self._body.take_event(event)
        if event.kind in {"blow", "missed"} and tool:
            self._end_pass(event, frame)
        elif event.kind == "blow" and frame.body is not None:
            self._end_body_cycle(event, frame.body.memory.as_dict()["blow_angle_rad"])

    def _end_pass(self, event: Event, frame: Frame) -> None:
        """End the pass at this blow, or miss, and begin the next."""
        body, cycle = EventSide(*event.pre).body, self._cycle
        self._feed_m += frame.linkage.memory.as_dict()["feed_per_blow_m"]  # of the pass before
        blow = None
        if event.kind == "blow" and event.impulse_ns > 0.0:
            blow = struck_metrics(self._b, event, frame.forces) | {"feed_per_blow_m": self._feed_m}
            self._feed_m = 0.0
            if not self._b.held:
                blow["gap_at_blow_m"] = self._b.tool_radius_m * body.position
            if self._b.waves:
                blow |= blow_metrics(self._b, event, self._line)
                blow |= blow_peaks(blow, blow["peak_force_n"])
            elif self._stiffness is not None:
                blow |= self._contact(event, self._stiffness)
                blow |= blow_peaks(blow, blow["contact_peak_force_n"])
        if self._seen_blow and cycle.steps and cycle.duty.time_s > 0.0:
            self._passes.append((cycle.duty, cycle.metrics(), blow))
        self._seen_blow = True
        keep_largest(self._run, self._cycle.peaks)
        self._cycle = Pass()
        self._cycle.take_speed(absolute_crank_speed(event.post))
        if not self._b.held:
            self._end_body_cycle(event, body.position)

    def _contact(self, event: Event, stiffness: float) -> Record:
        b, (crank, body, *_), after = self._b, event.pre, EventSide(*event.post).body
        rests = b.held or after.velocity == body.velocity  # a body that takes no part in the blow
        fades = fading(b, crank.position, crank.velocity, body.position, body.velocity, crank.effort, rests)
        return blow_contact(b, stiffness, event.pre_velocity_m_per_s, event.impulse_ns, fades)

    def _end_body_cycle(self, event: Event, angle: float) -> None:
        gap, time_s = self._b.tool_radius_m * angle, event.time_s
        if event.kind == "blow":
            keep_largest(self._run, {"largest_gap_at_blow_m": gap})
            if time_s > self._body.start_s:
                self._counts["unseated_blows"] += not is_seated(gap, self._body.contact_share(time_s))
        if self._seen_body_blow and time_s > self._body.start_s:
            own = {"gap_at_blow_m": gap} if self._b.held else {}
            self._body_cycles.append(self._body.metrics(time_s) | own)
        self._seen_body_blow = True
        self._body = self._body.next(event)

    def _take_step(self, frame: Frame, crank: Coordinate, body: Coordinate, state: MotorState, missed_w: float) -> None:
        b = self._b
        if self._state is not None:
            span = frame.linkage.time_s - self._time_s
            self._cycle.duty = duty_after(self._cycle.duty, self._state, state, span, missed_w * span)
        linkage, motor = frame.linkage, frame.motor
        rotor = self._rotor_speed(crank.velocity, body.velocity)
        begun = motor_in_step(self._motor, linkage.command, rotor, motor.effort[0], motor.command, self._step_s)
        self._in_step, self._state = begun, in_step_state(begun, 0.0, rotor)
        self._time_s = self._began_s = linkage.time_s
        self._cycle.take_speed(crank.velocity - body.velocity)
        self._cycle.take_forces(frame.forces)
        phi = body.position if frame.body is None else frame.body.joint("body").position
        force = 0.0 if frame.body is None else frame.body.pressing_force_n  # by rate and preload of this step
        found = dict(zip(OF_BODY, (b.tool_radius_m * phi, force), strict=True))
        keep_largest(self._body.largest, found)
        keep_largest(self._run, found)
