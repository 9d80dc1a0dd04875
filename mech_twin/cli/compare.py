# SPDX-License-Identifier: Apache-2.0
"""``mech-twin compare``: two recordings, configurations or machines side by side."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mech_twin.cli.console import FOUND, CommandError, print_json, print_table, progress, say, say_result
from mech_twin.cli.live_view import NO_VIEW, hold_view, opened_bench
from mech_twin.cli.verbs import CompareVerb
from mech_twin.declarations.captions import caption
from mech_twin.declarations.configuration_tree import ConfigurationError, configuration_tree
from mech_twin.engine.run import frames, steps_for
from mech_twin.engine.trajectory import broken_lines, frame_events
from mech_twin.files.output_file import YAML_SUFFIXES, written_file
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.measurements.units import shown_units
from mech_twin.nodes.run.domain import settle_domain
from mech_twin.parameters.load import file_tree, machine_of_prefix
from mech_twin.parameters.load import machine as built_machine
from mech_twin.roles import Machine, own_name
from mech_twin.samples import Drawing, Frame
from mech_twin.studies.resimulation import ConfigurationHistory
from mech_twin.studies.run_comparison import (
    ComparedRun,
    Comparison,
    at_equal_angle,
    columns_apart,
    compared,
    drawn_side_by_side,
    require_one_machine,
)
from mech_twin.studies.simulation import Simulation
from mech_twin.view.bench.link import BenchLink, OverlayLink
from mech_twin.view.bench.picture import packed
from mech_twin.view.bench.scene import BenchScene
from mech_twin.view.sending import RECORDED

if TYPE_CHECKING:
    from mech_twin.view.rerun_scene import RerunScene

USUAL_DURATION_S = 3.0
PANELS = 6
See = Callable[[Machine, Frame], None]


def compare_sides(request: CompareVerb) -> None:
    """Print what differs and, where asked to, show it.

    Exit with 1 if a number differs by more than the tolerance, or a residual is broken.
    """
    picture, columns = request.picture, request.column
    names = [_resolved_name(request.first), _resolved_name(request.second)]
    with ExitStack() as stack:
        overlay = None if request.view == NO_VIEW else Overlay(stack, request.view_port, names)
        shown = overlay is not None or picture is not None
        sides, found = _compared(names, request.tolerance, request.duration_s, overlay, shown=shown)
        if picture is not None:
            _draw(sides, picture, columns, force=request.force)
        if request.as_json:
            print_json(_document(found))
        else:
            _show(found, request.everything)
        say(*_remarks(sides))
        if overlay is not None:
            overlay.tell(sides, found)
            hold_view(overlay.page)
    broken = [f"{side.label}: {'; '.join(side.broken)}" for side in sides if side.broken]
    say(*broken)
    if found.beyond or broken:
        raise SystemExit(FOUND)


def _compared(
    names: Sequence[str], tolerance: float, duration_s: float | None, overlay: Overlay | None, *, shown: bool
) -> tuple[list[ComparedRun], Comparison]:
    """Return both sides, each seen as it is read or computed, and what differs; their samples if they are shown."""
    sees: list[See] = [lambda machine, frame: None] * 2 if overlay is None else [overlay.first.see, overlay.second.see]
    sides = [_Side(name, see, shown) for name, see in zip(names, sees, strict=True)]
    machines = [side.machine for side in sides]
    own_names = [own_name(machine.name, machine.parameters) for machine in machines]
    require_one_machine(names, [machine.name for machine in machines], own_names)
    recorded = [side for side in sides if side.history is not None]
    if duration_s is not None and len(recorded) == len(sides):
        raise CommandError(f"--duration {duration_s:g}: two recordings have their own length; expected a configuration")
    for side in recorded:
        side.read()
    if duration_s is None:
        duration_s = min((side.ends_s[-1] for side in recorded), default=USUAL_DURATION_S)
    for side in sides:
        if side.history is None:
            side.simulate(duration_s)
    runs = [side.run() for side in sides]
    return runs, compared(runs[0], runs[1], tolerance)


def _resolved_name(name: str) -> str:
    """Return a path as it is; a word that is none, and no machine, may be the beginning of a machine's name."""
    path = Path(name)
    if path.exists() or path.name != name or path.suffix:
        return name
    try:
        return machine_of_prefix(name)
    except ConfigurationError as error:
        raise CommandError(f"{name}: there is no such recording, and {error}") from error


def configured_machine(name: str) -> Machine:
    """Return a machine as installed, that of a configuration, or that of a page."""
    if name in CATALOGUE:
        return built_machine(name)
    config, tree = Path(name), file_tree(Path(name))
    kind = str(tree.get("machine", ""))
    if not kind and "bodies" in tree:  # a page says itself what it is
        return built_machine(name)
    if not kind:
        raise CommandError(f"{config}: key 'machine' is missing; expected one of {', '.join(CATALOGUE)}, or a page")
    return built_machine(kind, config)


def _recorded_history(name: str) -> ConfigurationHistory | None:
    """Return the configurations of a recording; None of a configuration, or a machine as installed."""
    if name in CATALOGUE or Path(name).suffix in YAML_SUFFIXES:
        return None
    settle_domain()
    from mech_twin.recording.bag_reader import open_bag
    from mech_twin.recording.bag_samples import BagSamples

    with open_bag(Path(name)) as reader:
        return ConfigurationHistory(BagSamples(reader).descriptions(), name)


class _Side:
    """One side as it is read or computed; all its samples are kept only if they are shown."""

    def __init__(self, label: str, see: See, shown: bool) -> None:
        self._label, self._see, self._shown = label, see, shown
        self.history = _recorded_history(label)
        self.machine = configured_machine(label) if self.history is None else self.history.machine_at(0)
        self._simulation = Simulation(self.machine)
        self._begin_s: list[float] = []
        self.ends_s: deque[float] = deque(maxlen=2)

    def _take(self, frame: Frame) -> None:
        self._simulation.observe(frame)
        self._begin_s = self._begin_s or [frame.linkage.time_s]
        self.ends_s.append(frame.linkage.time_s)
        if self._shown:
            self._simulation.trajectory.append(frame)
        self._see(self.machine, frame)

    def simulate(self, duration_s: float) -> None:
        """Run the machine from rest."""
        steps = steps_for(self.machine, duration_s) + 1
        with progress(frames(self.machine, duration_s), steps, self._label) as run:
            for frame in run:
                self._take(frame)

    def read(self) -> None:
        """Read the recording; of an incomplete step nothing is used."""
        from mech_twin.recording.bag_reader import open_bag
        from mech_twin.recording.bag_samples import BagSamples

        bag, incomplete = self._label, 0
        with open_bag(Path(bag)) as reader:
            samples = BagSamples(reader, self.machine.coupling_step_s)
            with progress(samples.steps(), samples.count, bag) as steps:
                for known in steps:
                    frame = known.frame(self.machine.body is not None)
                    if frame is None:
                        incomplete += 1
                    else:
                        self._take(frame)
        if not self.ends_s:
            raise CommandError(f"{bag}: holds no whole step")
        if incomplete:
            say(f"{bag}: {incomplete} incomplete steps left out")
        say(*(f"{bag}: {number} recorded samples not used: {reason}" for reason, number in samples.unused.items()))

    def run(self) -> ComparedRun:
        """Return the compared run; if samples are not shown, it has only its first and its last two times."""
        simulation, machine = self._simulation, self.machine
        return ComparedRun(
            self._label,
            machine.name,
            configuration_tree(machine.parameters),
            simulation.summary(),
            tuple(broken_lines(simulation.residuals(), machine.coupling_step_s)),
            simulation.trajectory.columns() if self._shown else {"time_s": [*self._begin_s, *self.ends_s]},
            shown_units(machine),
            0 if self.history is None else self.history.changes,
            simulation.since(),
        )


def _remarks(sides: Sequence[ComparedRun]) -> list[str]:
    """Return a line on each side whose parameters changed or numbers began anew, and one where lengths differ."""
    changed = [
        f"{side.label}: parameters changed {side.changes} time{'' if side.changes == 1 else 's'} during the run; the "
        "settings are those at its start"
        for side in sides
        if side.changes
    ]
    anew = [f"{side.label}: {side.since}" for side in sides if side.since]
    return [*changed, *anew, *filter(None, [_of_lengths(sides)])]


def _of_lengths(sides: Sequence[ComparedRun]) -> str:
    """Return a line where one side begins or ends later, by more than a step of either; else an empty one."""
    times_s = [side.samples["time_s"] for side in sides]
    step_s = max(float(each[-1] - each[-2:][0]) for each in times_s)
    found = []
    for word, place in (("begins", 0), ("ends", -1)):
        first_s, second_s = (float(each[place]) for each in times_s)
        if abs(first_s - second_s) > step_s:
            found.append(f"A {word} at {first_s:.6g} s, B at {second_s:.6g} s")
    return f"{', '.join(found)}: numbers of the whole run differ by that alone" if found else ""


def _draw(sides: list[ComparedRun], picture: Path, columns: Sequence[str], *, force: bool) -> None:
    shared = [name for name in sides[0].samples if name in sides[1].samples and name != "time_s"]
    for name in columns:
        if name not in shared:
            raise CommandError(f"--column {name}: expected one of {', '.join(shared)}")
    names = list(columns) or columns_apart(sides[0], sides[1], PANELS)
    if not names:
        say(f"{picture}: not drawn, no column differs")
        return
    with written_file(picture, force=force) as path:
        drawn_side_by_side(sides[0], sides[1], names).savefig(path, dpi=200)


def _document(found: Comparison) -> dict[str, Any]:
    """Return the document; of a row the side that has it not is left out: null is a number that is not finite."""
    rows = {
        kind: [{name: value for name, value in row._asdict().items() if value is not None} for row in found_rows]
        for kind, found_rows in (("settings", found.settings), ("numbers", found.numbers))
    }
    head = {"machine": found.machine, "first": found.labels[0], "second": found.labels[1]}
    return {**head, "tolerance": found.tolerance, "within_tolerance": not found.beyond, **rows}


def _show(found: Comparison, all_numbers: bool) -> None:
    say_result(f"{found.machine}\n  A  {found.labels[0]}\n  B  {found.labels[1]}")
    if found.settings:
        print_table("settings that differ", ("key", "A", "B"), [item[:3] for item in found.settings])
    shown = found.numbers if all_numbers else found.beyond
    if shown:
        title = "numbers" if all_numbers else f"numbers that differ by more than {found.tolerance:g}"
        rows = [(n.name, *("-" if side is None else side for side in n[1:3]), _percent(n.relative)) for n in shown]
        print_table(title, ("quantity", "A", "B", "apart"), rows)
    count = len(found.numbers)
    say_result(f"{count - len(found.beyond)} of {count} numbers within a tolerance of {found.tolerance:g}")


PATIENCE_S = 30.0  # that the bench may take for what it has been sent
SHOWN_BYTES = 512 << 20  # of both runs; the oldest pictures go first
MOST_ROWS = 300  # of a table on the page
EVERY_ROW = RECORDED._replace(window=1)  # the curves of two runs are taken from one another at equal rows


def drawn(machine: Machine, frame: Frame) -> Drawing:
    """Return the drawing of a machine at a frame."""
    return Drawing(frame.linkage.step, frame.linkage.time_s, machine.draw(frame.linkage, frame.body))


class SeenRun:
    """A run that a scene shows as it is computed or read."""

    def __init__(self, scene: BenchScene | RerunScene) -> None:
        self.scene = scene
        self._undrawn: Frame | None = None
        self.machine: Machine | None = None

    def see(self, machine: Machine, frame: Frame) -> None:
        """Show a frame and its events, and draw it where that is due."""
        if self.machine is None:
            self.machine = machine
            self.scene.watch(machine)
        draw, self._undrawn = self.scene.drawing_due(frame.linkage.time_s), frame
        self.scene.frame(frame)
        for event in frame_events(frame):
            self.scene.event(event)
        if draw:
            self.end()

    def end(self) -> None:
        """Draw the last frame, unless it is drawn."""
        if self.machine is not None and self._undrawn is not None:
            self.scene.drawing(drawn(self.machine, self._undrawn))
            self._undrawn = None


class Overlay:
    """A bench with two runs on it, by their names; bench and runs are left to the stack."""

    def __init__(self, stack: ExitStack, port: int, names: Sequence[str]) -> None:
        self._view = opened_bench(port, stack, history_bytes=SHOWN_BYTES)
        self.page = self._view.page
        self._names = list(names)
        place = self._view.destination or ""
        self._view.tell("status", {"text": f"reading {' and '.join(names)}"})
        self._tell_machine("comparison")
        links = (BenchLink(place, PATIENCE_S), OverlayLink(place, PATIENCE_S))
        self.first, self.second = (SeenRun(BenchScene(link, EVERY_ROW)) for link in links)
        for side in (self.second, self.first):
            stack.callback(side.scene.close)

    def tell(self, sides: Sequence[ComparedRun], found: Comparison) -> None:
        """Send the differences, and the pairs of times at equal angles of the cycle."""
        for side in (self.first, self.second):
            side.end()
        self._tell_machine(found.machine)
        machine = self.first.machine
        leading = None if machine is None or machine.mechanism is None else _leading_angle(machine, sides[0])
        pairs = None if leading is None else at_equal_angle(sides[0], sides[1], leading)
        farthest = sorted(found.numbers, key=lambda each: -each.relative)[:MOST_ROWS]
        content: dict[str, Any] = {
            "settings": [
                [each.name, *("-" if side is None else str(side) for side in each[1:3])] for each in found.settings
            ][:MOST_ROWS],
            "numbers": [
                [", ".join(filter(None, caption(each.name))), *map(_shown, each[1:3]), _percent(each.relative)]
                for each in farthest
            ],
            "note": ". ".join(_remarks(sides)),
            "angle": None if pairs is None else [packed(np.asarray(each), "<f8") for each in pairs],
        }
        self._view.tell("comparison", content)

    def _tell_machine(self, machine: str) -> None:
        head = {"name": machine, "namespace": "", "orders": [], "parameters": [], "recording": "", "sides": self._names}
        self._view.tell("machine", head)


def _leading_angle(machine: Machine, side: ComparedRun) -> str | None:
    """Return the column of the joint that leads the cycle, if it turns."""
    column = next((name for name in side.samples if name.startswith("linkage.") and name.endswith(".position")), None)
    slides = frozenset() if machine.mechanism is None else machine.mechanism.sliding_joints
    return None if column is None or column.split(".")[1] in slides else column


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    return "-" if value is None else str(value)


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %" if math.isfinite(share) else "-"
