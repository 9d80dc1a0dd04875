# SPDX-License-Identifier: Apache-2.0
"""Energy flow of a machine over its last cycle: work of each element, as integrated by the linkage.

Work is positive if an element gives energy to the machine.  The sum of the works equals the change of stored energy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.capabilities.plots import BLUE, COLOURS, GREY, RED, house_style, sheet, turn_axis
from mech_twin.errors import StudyError
from mech_twin.machines.catalog import Entry
from mech_twin.measurements.model_turn import cycle_joint
from mech_twin.roles import Machine
from mech_twin.samples import Frame

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
WORK, LOSS, HELD = "_work_j", "_loss_j", ("energy_j", "stored_energy_j")
OF_A_STEP = "step_"  # prefix of energies of a single step, which are not integrated
TURN = 2.0 * np.pi
STILL = 1e-9  # of the largest work: elements with less are not drawn
LEAST_SAMPLES = 8  # in a cycle


class EnergyFlow(NamedTuple):
    """A cycle: times (s), phase (0 to 1), work of each element since its start (J), and change of stored energy (J).

    ``turns`` is true if the phase is that of a turn, false if it is that of time.
    """

    times_s: Array
    phase: Array
    works_j: dict[str, Array]
    held_j: Array | None
    turns: bool


class EnergyBooks:
    """Collects the energies of a run.

    Raises
    ------
    StudyError
        The linkage integrates no work of its elements.
    """

    def __init__(self, entry: Entry, machine: Machine) -> None:
        names = list(machine.linkage.start().memory.as_dict())
        own = [name for name in names if not name.startswith(OF_A_STEP)]
        self.names = tuple(name for name in own if name.endswith((WORK, LOSS)))
        if not self.names:
            raise StudyError(f"{machine.name}: its linkage keeps no work of its elements")
        self._taken = entry.capabilities.works_taken
        self._held = next((name for name in HELD if name in names), None)
        self._joint = cycle_joint(machine)
        self._rows: list[tuple[float, ...]] = []

    def observe(self, frame: Frame) -> None:
        """Add one frame."""
        linkage, memory = frame.linkage, frame.linkage.memory.as_dict()
        angle = np.nan if self._joint is None else linkage.joint(self._joint).position
        held = np.nan if self._held is None else memory[self._held]
        self._rows.append((linkage.time_s, angle, held, *(memory[name] for name in self.names)))

    def flow(self) -> EnergyFlow:
        """Return the energy flow of the last whole turn; of the whole run if nothing turns.

        Raises
        ------
        StudyError
            The run contains no whole turn, or too few samples.
        """
        rows = np.array(self._rows)
        turns = self._joint is not None
        if self._joint is not None:
            rows = last_turn(rows, self._joint)
        if len(rows) < LEAST_SAMPLES:
            raise StudyError(f"{len(rows)} samples in the cycle; expected {LEAST_SAMPLES} or more: a longer run")
        since = rows - rows[0]
        way = since[:, 1] if turns else since[:, 0]
        signs = [-1.0 if name.endswith(LOSS) or name in self._taken else 1.0 for name in self.names]
        works = {
            name.removesuffix(WORK).removesuffix(LOSS) if name.endswith(WORK) else name.removesuffix("_j"): sign * book
            for name, sign, book in zip(self.names, signs, since[:, 3:].T, strict=True)
        }
        largest = max(float(np.abs(work).max()) for work in works.values())
        moving = {name: work for name, work in works.items() if float(np.abs(work).max()) > STILL * largest}
        return EnergyFlow(rows[:, 0], way / way[-1], moving, None if self._held is None else since[:, 2], turns)


def last_turn(rows: Array, joint: str) -> Array:
    """Return the rows (time, angle, ...) of the last whole turn of a joint, its start interpolated between samples.

    Raises
    ------
    StudyError
        There is no whole turn.
    """
    angle = np.unwrap(rows[:, 1])  # the samples of some machines count within a turn
    rows = np.column_stack((rows[:, 0], angle, rows[:, 2:]))
    sign = 1.0 if angle[-1] >= angle[0] else -1.0
    turned = np.maximum.accumulate(sign * (angle - angle[0]))
    if turned[-1] < TURN:
        raise StudyError(f"joint {joint} makes {turned[-1] / TURN:.3g} of a turn; expected a whole one: a longer run")
    begin = turned[-1] - TURN
    first = int(np.searchsorted(turned, begin))
    if first == 0 or turned[first] == begin:
        return rows[first:]
    share = (begin - turned[first - 1]) / (turned[first] - turned[first - 1])
    return np.vstack((rows[first - 1] + share * (rows[first] - rows[first - 1]), rows[first:]))


def drawn_flow(title: str, flow: EnergyFlow) -> Figure:
    """Return the figure: work of each element along the cycle, and its sum over the cycle."""
    with house_style():
        order = sorted(flow.works_j, key=lambda name: -flow.works_j[name][-1])
        figure, (along, whole) = sheet(1, 2, width=9.6, height=max(3.6, 1.6 + 0.26 * len(order)))
        x = flow.phase * 360.0 if flow.turns else flow.times_s
        for i, name in enumerate(order):
            style = "-" if i < len(COLOURS) else "--"
            colour = COLOURS[i % len(COLOURS)]
            along.plot(x, flow.works_j[name], style, color=colour, label=name.replace("_", " "))
        if flow.held_j is not None:
            along.plot(x, flow.held_j, ":", color=GREY, label="held by the machine")
        if flow.turns:
            turn_axis(along, "angle since the begin of the cycle, degrees")
        else:
            along.set_xlabel("time, s")
        along.set_ylabel("given to the machine, J")
        along.set_title(title)
        along.legend()
        sums = [(name.replace("_", " "), float(flow.works_j[name][-1])) for name in order]
        if flow.held_j is not None:
            sums.append(("out of the machine", -float(flow.held_j[-1])))
        least = STILL * max(abs(value) for _, value in sums)
        values = [value if abs(value) > least else 0.0 for _, value in sums]
        colours = [BLUE if value >= 0.0 else RED for value in values]
        bars = whole.barh(range(len(sums)), values, color=colours)
        whole.bar_label(bars, [f"{value:.4g}" for value in values], padding=3)
        whole.set_yticks(range(len(sums)), [name for name, _ in sums])
        whole.invert_yaxis()
        whole.margins(x=0.25)
        whole.axvline(0.0, color=GREY, linewidth=0.8)
        whole.set_xlabel("over the cycle, J")
        whole.set_title("One cycle" if flow.turns else "The run")
        return figure
