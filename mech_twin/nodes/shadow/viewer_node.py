# SPDX-License-Identifier: Apache-2.0
"""The viewer node of a shadow: overlays measurement and model, and shows residuals, state, faults and advice."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import starmap
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from mech_twin.declarations.captions import titled
from mech_twin.declarations.quantity import Parameters
from mech_twin.measurements.units import column_unit, joint_column, shown_unit, sliding_in
from mech_twin.nodes.exchange.base_node import TwinNode
from mech_twin.nodes.shadow.inputs import StampOrigin
from mech_twin.nodes.shadow.monitor_node import MonitorNode
from mech_twin.nodes.shadow.shadow_node import ShadowNode
from mech_twin.parameters.load import catalogue_entry
from mech_twin.roles import Machine
from mech_twin.samples import BodySample, Frame, LinkageSample, Shape
from mech_twin.studies.advice import Recommendation
from mech_twin.studies.identification.verdicts import KeyVerdict
from mech_twin.studies.live_monitor import LiveMonitor
from mech_twin.studies.monitoring.diagnosis import Candidate
from mech_twin.studies.monitoring.findings import FaultLife
from mech_twin.studies.observer.estimate import FrameEstimate, SeenSample, SensedChannel
from mech_twin.studies.observer.filter_state import GATE
from mech_twin.view.annotations import Card
from mech_twin.view.bench.link import PREFIX, BenchLink
from mech_twin.view.shadow_picture import (
    ChannelReading,
    ShadowPicture,
    ShownAdvice,
    ShownChannel,
    ShownFault,
    ShownFit,
)
from mech_twin.view.shadow_scene import ShadowScene

if TYPE_CHECKING:
    from mech_twin.nodes.shadow.advisor_node import AdvisorNode
    from mech_twin.nodes.shadow.identifier_node import IdentifierNode

TICK_S = 0.5  # period of the pictures without estimates
SEEN = ("active", "latched", "pending")
MOST_DIGITS = 12  # of the bounds of an interval
Placed = TypeVar("Placed", LinkageSample, BodySample)


class ShadowState(NamedTuple):
    """Contents of the status line: observer, level, time (s), residual (in sigma), faults if monitored."""

    observer: str
    level: str
    time_s: float | None
    largest_sigma: float
    faults: tuple[FaultLife, ...] | None


class ShadowViewerNode(TwinNode):
    """Shows a shadow's results; see `TwinNode` for the other arguments.

    It gets samples and estimates within the process and subscribes to no topic.

    Parameters
    ----------
    place : str
        A bench (``bench:SOCKET``), or the file to write for rerun.
    shadow : ShadowNode
        Source of the estimates.
    monitor : MonitorNode, optional
        Source of the faults.
    advisor : AdvisorNode, optional
        Source of the advice.
    identifier : IdentifierNode, optional
        Source of the identified keys.
    """

    def __init__(
        self,
        machine_name: str,
        place: str,
        shadow: ShadowNode,
        monitor: MonitorNode | None = None,
        advisor: AdvisorNode | None = None,
        identifier: IdentifierNode | None = None,
        parameters: Parameters | None = None,
    ) -> None:
        super().__init__("shadow_viewer", machine_name, parameters)
        self._shadow, self._monitor, self._advisor, self._identifier = shadow, monitor, advisor, identifier
        self.adopt(self.initial_parameters)
        self._largest_sigma = 0.0
        sliding = sliding_in(self._machine)
        shown = [ShownChannel(each.column, channel_title(each.column, sliding)) for each in self._channels]
        self.scene = opened_shadow_scene(machine_name, shown, place)
        self.every(TICK_S, self._tick)

    def adopt(self, parameters: Parameters) -> None:
        """Draw a model of these parameters from now on."""
        self._machine = catalogue_entry(self.machine_name).build(parameters)
        self._channels = self._shadow.observer.channels

    def take(self, sample: SeenSample, estimate: FrameEstimate) -> None:
        """Show a sample of the machine and its estimate."""
        self.diagnostics.state = "running"
        self.time_s = self._shadow.origin.clock_s(estimate.time_s)
        readings = channel_readings(self._shadow, estimate, sample)
        self.scene.take(estimate.time_s, readings)
        shares = [abs(each.residual) / each.sigma for each in readings.values() if each.sigma > 0.0]
        self._largest_sigma = max(shares, default=0.0)
        if self.scene.is_due():
            frame = self._shadow.observer.frame(estimate)
            model, measured = drawings(self._machine, frame, self._channels, sample)
            self.scene.show(self._picture(model, measured))

    def close(self) -> None:
        """Show the last state and close the scene."""
        self.scene.show(self._picture())
        self.scene.close()

    def _tick(self) -> None:
        """Show the state while no estimates arrive: faults, advice and what somebody answers change meanwhile."""
        if self._shadow.diagnostics.state != "locked" and self.scene.is_due():
            self.scene.show(self._picture())

    def _picture(self, model: Sequence[Shape] = (), measured: Sequence[Shape] = ()) -> ShadowPicture:
        state = self._state()
        faults = () if self._monitor is None else shown_faults(self._monitor.live)
        known = state_line(state), state.observer, shown_cards(state, self._shadow.origin), faults, self._advice()
        fit = None if self._identifier is None else shown_fit(self._identifier)
        return ShadowPicture(model, measured, *known, fit)

    def _advice(self) -> ShownAdvice:
        advisor = self._advisor
        if advisor is None:
            return ShownAdvice()
        answer = advisor.answer
        decided = "" if answer is None else f"t = {answer.time_s:.1f} s: {answer.what}: {answer.reason}"
        if advisor.state.advice is None:
            return ShownAdvice(decided=decided)
        is_on_trial = advisor.state.phase == "trial"
        rows = advice_rows(advisor.state.advice, is_on_trial=is_on_trial, dry_run=advisor.wish.dry_run)
        return ShownAdvice(rows, is_on_trial, decided)

    def _state(self) -> ShadowState:
        shadow, monitor = self._shadow, self._monitor
        faults = None if monitor is None else tuple(monitor.live.monitor.lives.values())
        time_s = None if shadow.estimate is None else shadow.estimate.time_s
        observer = shadow.diagnostics.state  # as old as the last peer check
        observer = observer if observer.startswith("waiting") else shadow.observer.state.value
        return ShadowState(observer, shadow.level, time_s, self._largest_sigma, faults)


def shown_cards(state: ShadowState, origin: StampOrigin) -> tuple[Card, ...]:
    """Return the headline of a shadow, with the second that its times count from if that is not 0."""
    largest, name = state.largest_sigma, "largest residual"
    residual = Card(name, f"{largest:.1f} sigma", name, largest, "sigma", GATE**0.5)
    clock = (Card("machine's clock at t = 0", f"{origin.second} s"),) if origin.second else ()
    return Card("level", state.level), residual, *clock


def shown_faults(live: LiveMonitor) -> tuple[ShownFault, ...]:
    """Return the faults that are pending, active or latched, each with the size of its best candidate."""
    found = live.newest
    if found is None:
        return ()
    shown = []
    for life in live.monitor.lives.values():
        if life.state in SEEN:
            until_s = life.shelved_until_s if life.shelved_until_s > found.time_s else None
            shown.append(
                ShownFault(life.name, life.state, life.since_s, _size(life.candidates), life.is_acknowledged, until_s)
            )
    return tuple(shown)


def shown_fit(identifier: IdentifierNode) -> ShownFit:
    """Return the rows of an identification."""
    found = identifier.found
    keys = () if found is None else found.keys
    rows = tuple(
        (each.key, f"{each.before:.4g}", f"{each.estimate:.4g}", _interval(each), each.verdict.replace("_", " "))
        for each in keys
    )
    held = () if found is None else found.held_out_fits
    scores = tuple((channel, f"{before:.1f} %", f"{after:.1f} %") for channel, after, before in held)
    kept_s = int(identifier.recent.span_s)
    return ShownFit(identifier.phase, identifier.status_line, identifier.keys, kept_s, rows, scores, identifier.text)


def _interval(key: KeyVerdict) -> str:
    if not (math.isfinite(key.low_95) and math.isfinite(key.high_95)):
        return "-"
    width, size = key.high_95 - key.low_95, max(abs(key.low_95), abs(key.high_95))
    apart = math.ceil(math.log10(size / width)) + 2 if 0.0 < width < size else 0  # digits in which the ends differ
    digits = min(max(4, apart), MOST_DIGITS)
    return f"{key.low_95:.{digits}g} to {key.high_95:.{digits}g}"


def _size(candidates: tuple[Candidate, ...]) -> str:
    best = next(iter(candidates), None)
    if best is None or not math.isfinite(best.size):
        return ""
    return f"{best.name} {best.size:.4g} ({best.low_95:.4g} to {best.high_95:.4g}) {shown_unit(best.unit)}".rstrip()


def advice_rows(advice: Recommendation, *, is_on_trial: bool, dry_run: bool) -> tuple[tuple[str, str], ...]:
    """Return the contents of an advice and its evidence, by name."""
    until = ("holds until", f"t = {advice.expires_s:.1f} s")
    accepted = ("if accepted", "noted, nothing is sent" if dry_run else "sent to the machine, on trial")
    return (
        ("set", advice.key),
        ("from, to", f"{advice.value:.4g} to {advice.proposed:.4g} (of {advice.low:.4g} to {advice.high:.4g})"),
        ("gain", f"{advice.figure} nearer by {advice.gain:.3g} ({advice.gain_low:.3g} to {advice.gain_high:.3g})"),
        ("because", advice.evidence),
        *([("on trial", "if rejected, the value before is sent again")] if is_on_trial else [until, accepted]),
    )


def opened_shadow_scene(machine_name: str, channels: Sequence[ShownChannel], place: str) -> ShadowScene:
    """Return the scene of a shadow on a bench (``bench:SOCKET``), or in a file for rerun."""
    if place.startswith(PREFIX):
        return ShadowScene(channels, BenchLink(place))
    from mech_twin.view.rerun_pictures import RerunFile  # the page needs no rerun

    return ShadowScene(channels, RerunFile(f"{machine_name} shadow", place))


def state_line(state: ShadowState) -> str:
    """Return the state line in Markdown."""
    parts = [f"**{state.observer}**", f"level: {state.level}"]
    if state.time_s is not None:
        parts += [f"t = {state.time_s:.2f} s", f"residual {state.largest_sigma:.1f} sigma"]
    return "  ·  ".join([*parts, *_fault_words(state.faults)])


def _fault_words(faults: Sequence[FaultLife] | None) -> list[str]:
    if faults is None:
        return ["no monitor"]
    seen = [fault for fault in faults if fault.state in SEEN]
    return [
        f"**FAULT {fault.name}: {fault.state}{', acknowledged' if fault.is_acknowledged else ''}**" for fault in seen
    ] or ["no fault"]


def channel_title(column: str, sliding: frozenset[str]) -> str:
    """Return the title of a channel's plot, with unit; ``sliding`` are the joints measured in m."""
    parts = joint_column(column)
    name = f"{titled(parts.joint)} {parts.field}" if parts is not None else titled(column.partition(".")[2] or column)
    return f"{name}, {shown_unit(column_unit(column, sliding))}"


def channel_readings(shadow: ShadowNode, estimate: FrameEstimate, sample: SeenSample) -> dict[str, ChannelReading]:
    """Return the readings of a sample's channels; sigma is that of the residual, by which samples are rejected too."""
    channels = [shadow.observer.channels[place].column for place in estimate.channels]
    readings = zip(sample.values, estimate.innovations, estimate.innovation_sigma, strict=True)
    return dict(zip(channels, starmap(ChannelReading, readings), strict=True))


def drawings(
    machine: Machine, frame: Frame, channels: Sequence[SensedChannel], sample: SeenSample
) -> tuple[tuple[Shape, ...], tuple[Shape, ...]]:
    """Return drawings of the mechanism as estimated, and with the measured joints in place of the estimated ones.

    The second is empty if no position is measured.
    """
    model = machine.draw(frame.linkage, frame.body)
    positions = {
        parts.joint: value
        for place, value in zip(sample.channels, sample.values, strict=True)
        if (parts := joint_column(channels[place].column)) is not None and parts.field == "position"
    }
    if not positions:
        return model, ()
    body = None if frame.body is None else _placed(frame.body, positions)
    return model, machine.draw(_placed(frame.linkage, positions), body)


def _placed(sample: Placed, positions: Mapping[str, float]) -> Placed:
    placed = tuple(positions.get(joint, at) for joint, at in zip(sample.joints, sample.position, strict=True))
    return sample._replace(position=placed)
