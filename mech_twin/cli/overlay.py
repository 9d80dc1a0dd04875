# SPDX-License-Identifier: Apache-2.0
"""Two runs in one view: each sends its pictures to the bench, the second over those of the first."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import ExitStack
from types import TracebackType
from typing import Any

import numpy as np

from mech_twin.cli.live_view import opened_bench
from mech_twin.declarations.captions import caption
from mech_twin.engine.trajectory import frame_events
from mech_twin.roles import Machine
from mech_twin.samples import Drawing, Frame
from mech_twin.studies.run_comparison import ComparedRun, Comparison, at_equal_angle
from mech_twin.view.bench.link import BenchLink, OverlayLink
from mech_twin.view.bench.picture import packed
from mech_twin.view.bench.scene import BenchScene
from mech_twin.view.sending import RECORDED

PATIENCE_S = 30.0  # that the bench may take for what it has been sent
PICTURE_S = 0.01  # of the machine's time, between two pictures
SHOWN_BYTES = 512 << 20  # of both runs; the oldest pictures go first
MOST_ROWS = 300  # of a table on the page


class OverlaySide:
    """One of the two runs, as it is computed or read."""

    def __init__(self, link: BenchLink) -> None:
        self._scene = BenchScene(link, RECORDED)
        self._drawn_s = -math.inf
        self.machine: Machine | None = None

    def see(self, machine: Machine, frame: Frame) -> None:
        """Show a frame."""
        scene, time_s = self._scene, frame.linkage.time_s
        if self.machine is None:
            self.machine = machine
            scene.watch(machine)
            if machine.mechanism is not None:
                scene.know(machine.mechanism, machine.blow_energy)
        scene.frame(frame.motor, frame.linkage, frame.forces, frame.body)
        for event in frame_events(frame):
            scene.event(event)
        if time_s - self._drawn_s >= PICTURE_S - 1e-9:
            self._drawn_s = time_s
            scene.drawing(Drawing(frame.linkage.step, time_s, machine.draw(frame.linkage, frame.body)))

    def close(self) -> None:
        """Let the bench go."""
        self._scene.close()


class Overlay:
    """A bench with two runs on it; a context manager.

    Parameters
    ----------
    stack : ExitStack
        To which the bench is left.
    port : int
        Of the page; 0: any free one.
    names : sequence of str
        What the two are called.
    """

    def __init__(self, stack: ExitStack, port: int, names: Sequence[str]) -> None:
        self._view = opened_bench(port, stack, history_bytes=SHOWN_BYTES)
        self.page = self._view.page
        self._names = list(names)
        place = self._view.destination or ""
        self._view.tell("status", {"text": f"reading {' and '.join(names)}"})
        self._tell_machine("comparison")
        self.first, self.second = OverlaySide(BenchLink(place, PATIENCE_S)), OverlaySide(OverlayLink(place, PATIENCE_S))

    def tell(self, sides: Sequence[ComparedRun], found: Comparison) -> None:
        """Tell what differs, and which times of the two belong to one angle of the cycle."""
        self._tell_machine(found.machine)
        machine = self.first.machine
        leading = None if machine is None or machine.mechanism is None else leading_angle(machine, sides[0])
        pairs = None if leading is None else at_equal_angle(sides[0], sides[1], leading)
        content: dict[str, Any] = {
            "settings": [[each.name, _shown(each.first), _shown(each.second)] for each in found.settings][:MOST_ROWS],
            "numbers": [
                [_titled(each.name), _shown(each.first), _shown(each.second), _percent(each.relative)]
                for each in sorted(found.numbers, key=lambda each: -each.relative)
            ][:MOST_ROWS],
            "angle": None if pairs is None else [packed(np.asarray(each), "<f8") for each in pairs],
        }
        self._view.tell("comparison", content)

    def __enter__(self) -> Overlay:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.first.close()
        self.second.close()

    def _tell_machine(self, machine: str) -> None:
        told = {"name": machine, "namespace": "", "orders": [], "parameters": [], "recording": "", "sides": self._names}
        self._view.tell("machine", told)


def leading_angle(machine: Machine, side: ComparedRun) -> str | None:
    """Return the column of the joint that leads the cycle, if it turns."""
    column = next((name for name in side.samples if name.startswith("linkage.") and name.endswith(".position")), None)
    slides = frozenset() if machine.mechanism is None else machine.mechanism.sliding_joints
    return None if column is None or column.split(".")[1] in slides else column


def _titled(name: str) -> str:
    words, unit = caption(name)
    return f"{words}, {unit}" if unit else words


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    return "-" if value is None else str(value)


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %" if math.isfinite(share) else "-"
