"""``mech-twin view``: a recording shown the same way as a live run."""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from mech_twin.cli.console import progress, say
from mech_twin.cli.failure import CommandError
from mech_twin.engine.step_samples import StepSamples
from mech_twin.nodes.domain import settle_domain
from mech_twin.parameters.errors import ConfigurationError
from mech_twin.samples import Event

if TYPE_CHECKING:
    from mech_twin.nodes.run_metrics import RunMetrics
    from mech_twin.nodes.stop_signal import StopSignal
    from mech_twin.recording.bag_samples import BagSamples
    from mech_twin.view.stage import Stage

WAIT_S = 0.05


def view_bag(bag: Path, save: Path | None, port: int) -> None:
    """Show a bag in the viewer until stopped, or write it to a file."""
    if save is not None and save.suffix != ".rrd":
        raise CommandError(f"--save {save}: expected a file NAME.rrd")
    if save is not None and not save.absolute().parent.is_dir():
        raise CommandError(f"--save {save}: directory {save.absolute().parent} does not exist")
    settle_domain()
    from mech_twin.nodes.stop_signal import StopSignal
    from mech_twin.recording.bag_reader import BagReader
    from mech_twin.recording.bag_samples import BagSamples
    from mech_twin.view.stage import Stage

    with ExitStack() as stack:
        stop = stack.enter_context(StopSignal())
        samples = BagSamples(stack.enter_context(BagReader(bag)))
        stage = stack.enter_context(Stage(samples.machine, grpc_url=_viewer(stack, save, port), rrd_path=save))
        _show(stage, samples, stop)
        stage.close()
        if save is not None:
            say(f"written to {save}")
            return
        say("shown; Ctrl-C ends")
        while not stop.asked:
            time.sleep(WAIT_S)


def _viewer(stack: ExitStack, save: Path | None, port: int) -> str | None:
    if save is not None:
        return None
    from mech_twin.view.viewer_process import ViewerProcess

    viewer = stack.enter_context(ViewerProcess(port or None))
    say(f"view: {viewer.web_url}")
    return viewer.grpc_url


def _show(stage: Stage, samples: BagSamples, stop: StopSignal) -> None:
    figures = _figures(samples)
    with progress(samples.shown(), samples.count, "showing") as shown:
        for item in shown:
            if stop.asked:
                return
            if not isinstance(item, StepSamples):
                stage.drawing(item)
                continue
            stage.frame(motor=item.motor, linkage=item.linkage, forces=item.forces, body=item.body)
            for event in _events(item):
                stage.event(event)
            frame = None if figures is None else item.frame(samples.has_body)
            if figures is not None and frame is not None:
                figures.observe(frame)
    if figures is not None:
        stage.figures(figures.numbers())
    for reason, number in samples.passed_over.items():
        say(f"{number} recorded samples passed over: {reason}")


def _events(item: StepSamples) -> list[Event]:
    events = [event for sample in (item.linkage, item.body) if sample is not None for event in sample.events]
    return sorted(events, key=lambda event: event.time_s)


def _figures(samples: BagSamples) -> RunMetrics | None:
    """Return what gathers the owner's figures; None for a machine the catalogue does not know."""
    from mech_twin.nodes.run_metrics import RunMetrics
    from mech_twin.studies.configuration_history import ConfigurationHistory

    try:
        return RunMetrics(ConfigurationHistory(samples.descriptions(), "the recording").machine_at(0))
    except ConfigurationError as error:
        say(f"no figures: {error}")
        return None
