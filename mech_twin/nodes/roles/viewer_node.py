# SPDX-License-Identifier: Apache-2.0
"""The viewer node: shows a run's topics on the bench or writes them for rerun; metrics about once a second.

Its base, the observer, receives every step message, assembles the frames, and collects metrics and events.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from visualization_msgs.msg import MarkerArray

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.trajectory import OPEN_STEPS, FrameAssembler
from mech_twin.messages import scene
from mech_twin.messages.cdr import StepMessage
from mech_twin.messages.step_message import CODECS, MessageError
from mech_twin.messages.topics import EVERY, SCENE, STEP_LINKAGE, step_topics
from mech_twin.nodes.exchange.base_node import RunOptions, TwinNode
from mech_twin.nodes.exchange.direct_exchange import Step
from mech_twin.nodes.exchange.peers import Admission, HeardSource
from mech_twin.parameters.load import catalogue_entry
from mech_twin.samples import Drawing, Frame, Sample, Shape
from mech_twin.studies.simulation import RunMetrics
from mech_twin.view.bench.link import PREFIX, BenchLink
from mech_twin.view.bench.scene import BenchScene
from mech_twin.view.sending import LIVE

if TYPE_CHECKING:
    from mech_twin.view.rerun_scene import RerunScene

FIRST_STEP_S = 1.0  # step length for messages without a step number, until the first step: at time 0 any value does
DECODERS: dict[str, Callable[..., Sample]] = {codec.steps.name: codec.from_message for codec in CODECS}


class ObserverNode(TwinNode):
    """Observes a run from its topics, each from the followed publisher; see `TwinNode` for the arguments.

    A linkage that replaces a lost one and restarts its step count is another run.

    Parameters
    ----------
    on_topics : bool
        Whether to subscribe; if not, the owner of the frames calls `show`.
    """

    def __init__(
        self,
        machine_name: str,
        parameters: Parameters | None = None,
        options: RunOptions | None = None,
        name: str = "observer",
        on_topics: bool = True,
    ) -> None:
        super().__init__(name, machine_name, parameters, options)
        self._entry = catalogue_entry(machine_name)
        self.run_metrics = RunMetrics(lambda: self._entry.build(self.initial_parameters))
        self._begin_anew()
        topics = step_topics(self._entry.has_body) if on_topics else ()
        self._sources = {topic.name: HeardSource(self.options.peer_timeout_s) for topic in topics}
        for topic in topics:
            self.subscribe_steps(
                topic, partial(self._decoded, topic.name), partial(self._on_step, topic.name), qos=EVERY
            )

    def show(self, frame: Frame) -> None:
        """Process one whole frame."""
        self.diagnostics.state = "running"
        self.time_s = frame.linkage.time_s
        self.run_metrics.observe(frame)

    def _begin_anew(self) -> None:
        self.run_metrics.begin_anew()  # the same object: a status line refers to it
        self.newest_step, self.newest_s = -1, 0.0
        self._step_s = FIRST_STEP_S
        self._assembler = FrameAssembler(self._entry.has_body)

    def _decoded(self, name: str, message: StepMessage) -> Sample:
        return DECODERS[name](message, self._step_s)

    def _on_step(self, name: str, sample: Sample, message: Step) -> None:
        admission = self._sources[name].admit(message.source, lambda: self.count_publishers(name) <= 1)
        if admission is Admission.REFUSED:
            reason = f"step {sample.step} from another publisher than the one that is followed"
            self.statistics.count(name, "unknown_source", reason)
            return
        if name == STEP_LINKAGE.name:
            self._follow(sample, admission)
        frame = self._assembler.add(sample)
        if frame is not None:
            self.show(frame)

    def _follow(self, linkage: Sample, admission: Admission) -> None:
        """Register the step of the run; a run that continues from too far back is another one."""
        if admission is Admission.NEWLY_FOLLOWED and linkage.step < self.newest_step - OPEN_STEPS:
            self._begin_anew()
        self.newest_step, self.newest_s = linkage.step, linkage.time_s
        if linkage.step > 0:
            self._step_s = linkage.time_s / linkage.step


METRICS_EVERY_S = 1.0
APART_S = (
    10.0  # largest time between a drawing and the newest step: topics overtake each other, and simulated time is fast
)


def opened_scene(machine_name: str, place: str) -> BenchScene | RerunScene:
    """Return a scene on a bench (``bench:SOCKET``), or in a file for rerun (``NAME.rrd``).

    Raises
    ------
    ConfigurationError
        The place is neither.
    """
    if place.startswith(PREFIX):
        return BenchScene(BenchLink(place), LIVE)
    if not place.endswith(".rrd"):
        raise ConfigurationError(f"viewer: --place {place}: expected a file NAME.rrd or {PREFIX}SOCKET")
    from mech_twin.view.rerun_scene import RerunScene  # the page does without rerun

    return RerunScene(machine_name, rrd_path=place)


class ViewerNode(ObserverNode):
    """Displays a run on a bench, or writes it to a file for rerun.

    Parameters
    ----------
    place : str
        Bench or file: see `opened_scene`, and `TwinNode` for the other arguments.
    """

    def __init__(
        self,
        machine_name: str,
        place: str,
        parameters: Parameters | None = None,
        options: RunOptions | None = None,
        on_topics: bool = True,
    ) -> None:
        super().__init__(machine_name, parameters, options, name="viewer", on_topics=on_topics)
        self.scene = opened_scene(machine_name, place)
        self._shown = time.monotonic()
        # drawn here, so that drawing, state and curves are of the same time
        self._draws = place.startswith(PREFIX) or not on_topics
        self._in_batches = place.startswith(PREFIX) and not on_topics  # the caller of `show` also calls `draw_newest`
        self._undrawn: Frame | None = None
        self.draw: Callable[[Frame], tuple[Shape, ...]] | None = None  # of the run in this process, as it is now
        if not self._draws:
            self.create_subscription(MarkerArray, SCENE.name, self._on_scene, EVERY)

    def close(self) -> None:
        """Show the last frame and metrics, and close the scene."""
        self._draw_last()
        self.scene.metrics(self.run_metrics.numbers())
        self.scene.close()

    def show(self, frame: Frame) -> None:
        """Show a complete frame."""
        self.diagnostics.state = "running"
        self.time_s = frame.linkage.time_s
        self.newest_s = max(self.newest_s, self.time_s)  # without topics the frames set the run's time
        if self.run_metrics.frames == 0:
            self.scene.watch(self.run_metrics.machine)
        self.scene.frame(frame)
        for event in self.run_metrics.observe(frame):
            self.scene.event(event)
        if isinstance(self.scene, BenchScene):
            self.scene.state(frame)
        if self._draws:
            self._undrawn = frame
            if not self._in_batches:
                self.draw_newest()
        now = time.monotonic()
        if now - self._shown > METRICS_EVERY_S:
            self._shown = now
            self.scene.metrics(self.run_metrics.numbers())

    def draw_newest(self) -> None:
        """Draw the newest frame, if it is not drawn yet and a drawing is due."""
        if self._undrawn is not None and self.scene.drawing_due(self._undrawn.linkage.time_s):
            self._draw_last()

    def _draw_last(self) -> None:
        frame, self._undrawn = self._undrawn, None
        if frame is None:
            return
        machine = self.run_metrics.machine
        shapes = machine.draw(frame.linkage, frame.body) if self.draw is None else self.draw(frame)
        self.scene.drawing(Drawing(frame.linkage.step, frame.linkage.time_s, shapes))

    def _on_scene(self, message: MarkerArray) -> None:
        try:
            drawing = scene.from_message(message)
        except MessageError as error:
            self.statistics.count(SCENE.name, "malformed", str(error))
            return
        if abs(drawing.time_s - self.newest_s) > APART_S:
            reason = f"stamp {drawing.time_s:g} s is no time of this run, which is at {self.newest_s:g} s"
            self.statistics.count(SCENE.name, "unknown_source", reason)
            return
        self.scene.drawing(drawing)
