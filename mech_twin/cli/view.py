# SPDX-License-Identifier: Apache-2.0
"""``mech-twin view``: shows a recording, or a run of a page, in the viewer, with the layout of a live run."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from mech_twin.cli.compare import (
    PATIENCE_S,
    SHOWN_BYTES,
    USUAL_DURATION_S,
    SeenRun,
    configured_machine,
    drawn,
)
from mech_twin.cli.console import CommandError, progress, say
from mech_twin.cli.live_view import opened_bench
from mech_twin.cli.verbs import ViewVerb
from mech_twin.declarations.configuration_tree import ConfigurationError, configuration_tree
from mech_twin.engine.run import frames, steps_for
from mech_twin.engine.trajectory import StepSamples
from mech_twin.files.output_file import written_file
from mech_twin.nodes.run.domain import settle_domain
from mech_twin.parameters.load import is_page
from mech_twin.process.interruption import StopSignal
from mech_twin.roles import Machine, own_name
from mech_twin.studies.run_comparison import changed_settings
from mech_twin.studies.simulation import RunMetrics

if TYPE_CHECKING:
    from mech_twin.recording.bag_samples import BagSamples
    from mech_twin.studies.resimulation import ConfigurationHistory
    from mech_twin.view.bench.scene import BenchScene
    from mech_twin.view.rerun_scene import RerunScene

    Show = Callable[[BenchScene | RerunScene, StopSignal], None]

WAIT_S = 0.05


def view_bag(request: ViewVerb) -> None:
    """Show a recording, a run of a page, or by a map a measured run, until stopped, or write it to a file."""
    bag, save, map_file = request.bag, request.save, request.given_map
    if not (simulated := is_page(str(bag))) and request.duration_s is not None:
        raise CommandError(f"--duration {request.duration_s:g}: a recording has its own length; expected a page")
    settle_domain()
    with ExitStack() as stack:
        stop = stack.enter_context(StopSignal())
        with stop.interrupting():
            if simulated:
                duration_s = USUAL_DURATION_S if request.duration_s is None else request.duration_s
                machine = configured_machine(str(bag))
                shown = _of_machine(machine, lambda scene, stop: _show_run(scene, machine, duration_s, stop))
            elif map_file is not None:
                from mech_twin.cli.measured import read_measured, show_measured

                read = read_measured(bag, map_file, request.config)
                shown = _of_machine(read.machine, lambda scene, stop: show_measured(scene, read, stop))
            else:
                from mech_twin.recording.bag_reader import open_bag
                from mech_twin.recording.bag_samples import BagSamples
                from mech_twin.studies.resimulation import recorded_settings, recorded_step_s

                reader = stack.enter_context(open_bag(bag))
                samples = BagSamples(reader, recorded_step_s(BagSamples(reader).descriptions()))
                shown = _Shown(
                    samples.machine or "machine",  # of the root namespace
                    lambda scene, stop: _show(scene, samples, stop),
                    lambda: recorded_settings(samples.descriptions()),
                )
            scene: BenchScene | RerunScene
            if save is None:
                scene = _bench(stack, request.port, shown, bag)
            else:
                from mech_twin.view.rerun_scene import RerunScene

                file = stack.enter_context(written_file(save, force=request.force))
                scene = stack.enter_context(RerunScene(shown.machine, rrd_path=file))
        shown.show(scene, stop)
        scene.close()
        if save is not None and stop.asked:
            raise KeyboardInterrupt  # an incomplete file is not kept
        if save is not None:
            return
        say("complete; press Ctrl-C to close the view")
        while not stop.asked:
            time.sleep(WAIT_S)


class _Shown(NamedTuple):
    """A run to show: its machine, what puts it into the scene; its name, and its settings that are not as installed."""

    machine: str
    show: Show
    described: Callable[[], tuple[str, list[list[str]]]]


def _of_machine(machine: Machine, show: Show) -> _Shown:
    name = own_name(machine.name, machine.parameters)
    return _Shown(name, show, lambda: (name, changed_settings(machine.name, configuration_tree(machine.parameters))))


def _show_run(scene: BenchScene | RerunScene, machine: Machine, duration_s: float, stop: StopSignal) -> None:
    seen, metrics = SeenRun(scene), RunMetrics(lambda: machine)
    with progress(frames(machine, duration_s), steps_for(machine, duration_s) + 1, "showing") as run:
        for frame in run:
            if stop.asked:
                return
            seen.see(machine, frame)
            metrics.observe(frame)
    seen.end()
    scene.metrics(metrics.numbers())


def _bench(stack: ExitStack, port: int, shown: _Shown, bag: Path) -> BenchScene:
    """Return a scene on a bench started here."""
    from mech_twin.view.bench.link import BenchLink
    from mech_twin.view.bench.scene import BenchScene
    from mech_twin.view.sending import RECORDED

    view = opened_bench(port, stack, history_bytes=SHOWN_BYTES)
    view.tell("status", {"text": f"reading {bag}"})
    name, settings = shown.described()
    description = {"namespace": "", "orders": [], "parameters": [], "recording": str(bag), "settings": settings}
    view.tell("machine", description | {"name": name or shown.machine})
    return stack.enter_context(BenchScene(BenchLink(view.destination or "", PATIENCE_S), RECORDED))


def _show(scene: BenchScene | RerunScene, samples: BagSamples, stop: StopSignal) -> None:
    history = None if stop.asked else _history(samples)
    metrics, undrawn = None, None
    if history is not None:
        machine = history.machine_at(0)
        metrics = RunMetrics(lambda: machine, history.machine_at)
        scene.watch(machine)
    draws = not samples.has_drawings
    with progress(samples.shown(), samples.count, "showing") as shown:
        for item in shown:
            if stop.asked:
                return
            if not isinstance(item, StepSamples):
                scene.drawing(item)
                undrawn = None
                continue
            scene.frame(item)
            for event in item.events:
                scene.event(event)
            frame = None if history is None else item.frame(samples.has_body)
            if history is not None and metrics is not None and frame is not None:
                metrics.observe(frame)
                undrawn = frame
                if draws and scene.drawing_due(frame.linkage.time_s):
                    scene.drawing(drawn(history.machine_at(frame.linkage.step), frame))
                    undrawn = None
    if history is not None and undrawn is not None:  # later than the last drawing that was recorded
        scene.drawing(drawn(history.machine_at(undrawn.linkage.step), undrawn))
    if metrics is not None:
        scene.metrics(metrics.numbers())
        say(*filter(None, [metrics.since()]))
    say(*(f"{number} recorded samples not used: {reason}" for reason, number in samples.unused.items()))


def _history(samples: BagSamples) -> ConfigurationHistory | None:
    """Return the recorded configurations; None of a machine that is not in the catalogue."""
    from mech_twin.studies.resimulation import ConfigurationHistory

    try:
        history = ConfigurationHistory(samples.descriptions(), "the recording")
        history.machine_at(0)
    except ConfigurationError as error:
        say(f"no metrics: {error}")
        return None
    return history
