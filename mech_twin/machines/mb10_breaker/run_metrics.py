# SPDX-License-Identifier: Apache-2.0
"""Running metrics of the breaker: the whole run, and its last cycles, in memory that does not grow.

Mechanism and drive are cut into cycles at the blows on the tool.  The body is cut at the same blows where it is driven
by the linkage; under the half sine it has a clock of its own and is cut at its own blows.
"""

from __future__ import annotations

from collections import deque

from mech_twin.capabilities.last_records import LAST, over_last
from mech_twin.machines.mb10_breaker.blow_contact import blow_contact, fading
from mech_twin.machines.mb10_breaker.blow_cycle_metrics import (
    PEAKS,
    BlowCycle,
    absolute_crank_speed,
    blow_peaks,
)
from mech_twin.machines.mb10_breaker.body_cycle_metrics import BodyCycle
from mech_twin.machines.mb10_breaker.dynamics import Breaker
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.seat import is_seated
from mech_twin.machines.mb10_breaker.state import EventSide
from mech_twin.machines.mb10_breaker.wave_metrics import blow_metrics
from mech_twin.machines.motor_duty import MotorState, duty_after, shaft_work_j
from mech_twin.parts.induction_motor import motor_constants, motor_torque
from mech_twin.samples import Coordinate, Event, Frame, LinkageSample

COUNTED = {"blow": "blows", "missed": "missed_blows", "off_collar": "off_collar_blows", "stalled": "stalled"}
Record = dict[str, float]


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
        self._b = breaker
        self._motor = motor_constants(parameters.motor)
        self._stiffness = parameters.tool.contact_stiffness_n_per_m
        self._counts = dict.fromkeys((*COUNTED.values(), "unseated_blows"), 0.0)
        self._line = parameters.tool.wave.life.line
        self._cycle = BlowCycle(0.0)
        self._body = BodyCycle(0.0, 0.0 if parameters.body.contact == "one_sided" else None)
        self._blows: deque[Record] = deque(maxlen=LAST)
        self._waves: deque[Record] = deque(maxlen=LAST)
        self._body_cycles: deque[Record] = deque(maxlen=LAST)
        self._worst: Record = {}
        self._run: Record = dict.fromkeys(
            ("largest_spring_force_n", "largest_lift_at_tool_m", "largest_gap_at_blow_m", *PEAKS), 0.0
        )
        self._time_s = self._work_j = 0.0
        self._state: MotorState | None = None
        self._seen_blow = self._seen_body_blow = False
        self._joints: tuple[str, ...] | None = None
        self._crank_and_body = (0, 0)

    def observe(self, frame: Frame) -> None:
        """Take one frame into account: its events in their order, then the step's end."""
        own = () if frame.body is None else frame.body.events
        happened = (*frame.linkage.events, *own)
        events = sorted(happened, key=lambda event: event.time_s) if happened else happened
        state = self._at_step(frame)
        missed = self._missed_work(frame, state)
        for event in events:
            self._run_motor_to(event, frame, missed)
            self._take_event(event, frame)
        self._take_step(frame, state, missed)
        worst = self._worst
        for sample in (frame.linkage, frame.forces, frame.body):
            if sample is not None:
                for name, value in zip(*sample.residuals, strict=True):
                    size, known = abs(value), worst.get(name)
                    if known is None or size > known:
                        worst[name] = max(0.0, size)

    def numbers(self) -> dict[str, float]:
        """Return the metrics of the run (``run_...``), and means and peaks of its last cycles (``steady_...``)."""
        self._keep_peaks()
        found = {"time_s": self._time_s, **self._counts}
        found["rest_force_n"] = self._b.spring_rate_n_per_m * self._b.preload_m
        found.update({f"run_{name}": value for name, value in self._run.items()})
        found.update({f"worst_{name}": value for name, value in self._worst.items()})
        for count, records in (("steady_blows", self._blows), ("steady_body_cycles", self._body_cycles)):
            if records:
                found[count] = float(len(records))
                found.update(over_last(records))
        if self._waves:
            found.update(over_last(self._waves))
        return found

    def _motor_state(self, crank_speed: float, body_speed: float, command: float) -> MotorState:
        speed = self._b.ratio * (crank_speed - self._b.frame_drive * body_speed)
        field = command * self._motor.synchronous_speed_rad_per_s
        return MotorState(motor_torque(self._motor, speed, command), speed, field - speed)

    def _at_step(self, frame: Frame) -> MotorState:
        crank, body = self._places(frame.linkage)
        speeds = frame.linkage.velocity
        return self._motor_state(speeds[crank], speeds[body], frame.motor.command)

    def _places(self, linkage: LinkageSample) -> tuple[int, int]:
        """Return where crank and body stand among the joints."""
        if linkage.joints is not self._joints:
            self._joints = linkage.joints
            self._crank_and_body = linkage.joints.index("crank"), linkage.joints.index("body")
        return self._crank_and_body

    def _missed_work(self, frame: Frame, state: MotorState) -> float:
        """Return by how much the motor's mean power by the energy balance exceeds that of its linear course (W)."""
        memory, span = frame.linkage.memory, frame.linkage.time_s - self._time_s
        work = memory.values[memory.names.index("drive_work_j")]
        done, self._work_j = work - self._work_j, work
        if self._state is None or span <= 0.0:
            return 0.0
        shaft = done / self._b.efficiency if done > 0.0 else done * self._b.efficiency
        last, time_s, linear = self._state, self._time_s, 0.0
        for event in frame.linkage.events:
            if event.pre:
                before, after = (self._across(side, frame) for side in (event.pre, event.post))
                linear += shaft_work_j(last, before, event.time_s - time_s)
                last, time_s = after, event.time_s
        linear += shaft_work_j(last, state, frame.linkage.time_s - time_s)
        return (shaft - linear) / span

    def _across(self, side: tuple[Coordinate, ...], frame: Frame) -> MotorState:
        crank, body, *_ = side
        return self._motor_state(crank.velocity, body.velocity, frame.motor.command)

    def _run_motor_to(self, event: Event, frame: Frame, missed_w: float) -> None:
        """Add the motor's duty up to an event of the linkage."""
        if event.pre and self._state is not None:
            span = event.time_s - self._time_s
            before = self._across(event.pre, frame)
            self._cycle.duty = duty_after(self._cycle.duty, self._state, before, span, missed_w * span)
            self._state, self._time_s = self._across(event.post, frame), event.time_s

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
            self._end_blow_cycle(event, frame)
        elif event.kind == "blow" and frame.body is not None:
            self._end_body_cycle(event, frame.body.memory.as_dict()["blow_angle_rad"])

    def _end_blow_cycle(self, event: Event, frame: Frame) -> None:
        """End the cycle at this blow, or miss, and begin the next."""
        body = EventSide(*event.pre).body
        if self._b.waves and event.kind == "blow":
            self._waves.append(blow_metrics(self._b, event, self._line))
        if self._seen_blow and self._cycle.steps and event.time_s > self._cycle.start_s:
            record = self._cycle.metrics(self._b, self._motor, event, frame.forces)
            if self._stiffness is not None and not self._b.waves and event.impulse_ns > 0.0:
                record.update(self._contact(event, self._stiffness))
                record.update(blow_peaks(record, record["contact_peak_force_n"]))
            elif self._b.waves and event.kind == "blow" and event.impulse_ns > 0.0:
                record.update(blow_peaks(record, self._waves[-1]["peak_force_n"]))
            record["feed_per_blow_m"] = frame.linkage.memory.as_dict()["feed_per_blow_m"]  # of the pass before
            self._blows.append(record)
        self._seen_blow = True
        self._keep_peaks()
        self._cycle = BlowCycle(event.time_s)
        self._cycle.take_speed(absolute_crank_speed(event.post))
        if not self._b.held:
            self._end_body_cycle(event, body.position)

    def _contact(self, event: Event, stiffness: float) -> Record:
        b, (crank, body, *_), after = self._b, event.pre, EventSide(*event.post).body
        rests = b.held or after.velocity == body.velocity  # a body that takes no part in the blow
        fades = fading(b, crank.position, crank.velocity, body.position, body.velocity, crank.effort, rests)
        return blow_contact(b, stiffness, event.pre_velocity_m_per_s, event.impulse_ns, fades).metrics

    def _end_body_cycle(self, event: Event, angle: float) -> None:
        gap, time_s = self._b.tool_radius_m * angle, event.time_s
        if event.kind == "blow" and time_s > self._body.start_s:
            self._counts["unseated_blows"] += not is_seated(gap, self._body.contact_share(time_s))
        self._run["largest_gap_at_blow_m"] = max(self._run["largest_gap_at_blow_m"], gap)
        if self._seen_body_blow and time_s > self._body.start_s:
            self._body_cycles.append(self._body.metrics(time_s, gap))
        self._seen_body_blow = True
        self._body = self._body.next(event)

    def _take_step(self, frame: Frame, state: MotorState, missed_w: float) -> None:
        b = self._b
        if self._state is not None:
            span = frame.linkage.time_s - self._time_s
            self._cycle.duty = duty_after(self._cycle.duty, self._state, state, span, missed_w * span)
        self._state, self._time_s = state, frame.linkage.time_s
        crank, body = self._places(frame.linkage)
        speeds = frame.linkage.velocity
        self._cycle.take_speed(speeds[crank] - speeds[body])
        self._cycle.take_forces(frame.forces)
        phi = frame.linkage.position[body] if frame.body is None else frame.body.joint("body").position
        force = b.spring_rate_n_per_m * (b.spring_arm_m * phi + b.preload_m)
        self._body.take_position(b.tool_radius_m * phi, force)
        run = self._run
        run["largest_lift_at_tool_m"] = max(run["largest_lift_at_tool_m"], b.tool_radius_m * phi)
        run["largest_spring_force_n"] = max(run["largest_spring_force_n"], force)

    def _keep_peaks(self) -> None:
        """Take the peaks of the cycle so far into those of the run."""
        run = self._run
        for name, peak in zip(PEAKS, self._cycle.peaks, strict=True):
            run[name] = max(run[name], peak)
