# SPDX-License-Identifier: Apache-2.0
"""A machine whose roles are all faces of kernels: what the compiled run needs to know of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mech_twin.engine.compiled_roles import CompiledBody, CompiledForces, CompiledLinkage, CompiledMotor, failed
from mech_twin.engine.compiled_run import (
    DONE,
    FROM_BODY,
    LINKAGE_FAILED,
    SOURCE,
    STEP,
    TABLE_EXTRA,
    Indices,
    Models,
    RunEnd,
    Widths,
    run_steps,
)
from mech_twin.engine.compiled_steps import NoBody
from mech_twin.engine.coupling import next_frame
from mech_twin.engine.errors import MotionError
from mech_twin.engine.sample_vectors import (
    EVENT_WIDTH,
    IMPULSE,
    POST_VELOCITY,
    PRE_VELOCITY,
    TIME,
    Array,
    EventNumbers,
    FrameLayout,
)
from mech_twin.roles import Machine
from mech_twin.samples import Event, Frame

FIRST_BLOCK = 256  # steps of the first call of `CompiledMachine.run`; a later one takes as many as fit the time
SHORTEST_BLOCK_S, LONGEST_BLOCK_S = 0.05, 0.2  # real time of one call: as long as a signal waits


@dataclass(frozen=True)
class CompiledMachine:
    """The kernels' view of a machine.

    Attributes
    ----------
    machine : Machine
        The machine.
    models : Models
        Constants of its roles.
    layout : FrameLayout
        Row of its frames.
    """

    machine: Machine
    models: Models
    layout: FrameLayout

    @cached_property
    def residuals(self) -> dict[str, int]:
        """The place of each residual in a row, under the column's name."""
        return {name: place for name, place in self.layout.columns.items() if ".residual." in name}

    @cached_property
    def residual_places(self) -> Indices:
        """The places of the residuals."""
        return np.array(list(self.residuals.values()), dtype=np.int64)

    @cached_property
    def widths(self) -> Widths:
        """Columns of the tables of events."""
        linkage = self.layout.linkage.events.width
        body = EVENT_WIDTH if self.layout.body is None else self.layout.body.events.width
        return Widths(linkage, body, TABLE_EXTRA + max(linkage, body))

    def run(
        self, first: int, row: Array, targets: Array, picked: Indices, columns: Array, worst: Array
    ) -> tuple[RunEnd, MotionError | None]:
        """Carry a frame on by one step for each target; return how, and the error that ended it before.

        Parameters
        ----------
        first : int
            Step of the frame.
        row : ndarray
            The frame, changed in place.
        targets : ndarray, shape (n,)
            Asked fraction of rated supply frequency at each of the next steps.
        picked : ndarray, shape (m,)
            Places in the row that are kept in ``columns`` (n, m).
        worst : ndarray, shape (r,)
            Greatest magnitude of each residual so far, changed in place.
        """
        step_s = float(self.machine.coupling_step_s)
        fields = run_steps(
            self.models, self.layout.places, self.widths, first, step_s, targets, row, picked, columns,
            self.residual_places, worst,
        )  # fmt: skip
        end = RunEnd(*fields)
        if end.failed == DONE:
            return end, None
        if end.failed == LINKAGE_FAILED:
            return end, self._failure(self.layout.frame(first + end.steps, row.tolist()), targets[end.steps])
        return end, failed(getattr(self.machine.body, "failures", ()), end.status, (first + end.steps) * step_s)

    def _failure(self, frame: Frame, target: float) -> MotionError:
        """Return the error of the step that the linkage gives up, by its role, which has the events at hand."""
        try:
            next_frame(self.machine, frame, target)
        except MotionError as error:
            return error
        raise AssertionError("a step that a roll-out gives up is given up by its role too")

    def run_interruptibly(
        self,
        first: int,
        row: Array,
        targets: Array,
        picked: Indices,
        columns: Array,
        worst: Array,
        between: Callable[[], None],
    ) -> tuple[RunEnd, MotionError | None]:
        """Do what `run` does a block of steps at a time, to the bit, so that a signal need not wait for the last.

        Parameters
        ----------
        first, row, targets, picked, columns, worst
            As for `run`.
        between : callable
            Called before each block; what it raises ends the run.
        """
        done, block, tables = 0, FIRST_BLOCK, [np.empty((0, self.widths.table))]
        failed_role, status, error = DONE, 0, None
        while done < len(targets) and error is None:
            between()
            here, begun = slice(done, done + block), time.perf_counter()
            end, error = self.run(first + done, row, targets[here], picked, columns[here], worst)
            taken_s = time.perf_counter() - begun
            tables.append(end.events[: end.told])
            done, failed_role, status = done + end.steps, end.failed, end.status
            if taken_s < SHORTEST_BLOCK_S:
                block *= 2
            elif taken_s > LONGEST_BLOCK_S:
                block = max(1, block // 2)
        table = np.concatenate(tables)
        return RunEnd(table, len(table), done, failed_role, status), error

    def step_events(self, rows: Array) -> tuple[tuple[Event, ...], tuple[Event, ...]]:
        """Return the events of linkage and of body in rows of the table of a run."""
        linkage, body = self.layout.linkage.events, self.layout.body
        of_body = rows[:, SOURCE] == FROM_BODY
        told = linkage.events(rows[~of_body, TABLE_EXTRA : TABLE_EXTRA + linkage.width])
        if body is None:
            return told, ()
        return told, body.events.events(rows[of_body, TABLE_EXTRA : TABLE_EXTRA + body.events.width])

    def events_in_order(self, table: Array) -> list[tuple[int, Event]]:
        """Return the events in the table of a run with their steps: step by step in time order, the linkage's first."""
        found: list[tuple[int, Event]] = []
        steps = table[:, STEP].astype(np.int64)
        for step in np.unique(steps).tolist():
            events = [event for role in self.step_events(table[steps == step]) for event in role]
            found += [(step, event) for event in sorted(events, key=lambda event: event.time_s)]
        return found

    def event_numbers(self, table: Array) -> EventNumbers:
        """Return the events in the table of a run as arrays, in time order."""
        rows = table[:, TABLE_EXTRA:]
        kinds = np.empty(len(table), dtype=object)
        of_body = table[:, SOURCE] == FROM_BODY
        kinds[~of_body] = self.layout.linkage.events.kind_names(rows[~of_body])
        if self.layout.body is not None:
            kinds[of_body] = self.layout.body.events.kind_names(rows[of_body])
        kinds = kinds.astype(np.str_)
        order = np.lexsort((rows[:, TIME], table[:, STEP]))
        speeds = (rows[order, PRE_VELOCITY], rows[order, POST_VELOCITY], rows[order, IMPULSE])
        return EventNumbers(table[order, STEP].astype(np.int64), rows[order, TIME], kinds[order], *speeds)

    def frame(self, step: int, row: Array, table: Array) -> Frame:
        """Return the frame of a row; ``table`` holds the events of the run, or of its step."""
        return self._frame(step, row.tolist(), table[table[:, STEP] == step])

    def _frame(self, step: int, numbers: list[float], table: Array) -> Frame:
        if not len(table):
            return self.layout.frame(step, numbers)
        events, body_events = self.step_events(table)
        frame = self.layout.frame(step, numbers, events, body_events)
        if events and self.layout.forces.reads_events:
            frame = frame._replace(forces=self.machine.forces.analyse(frame.linkage))  # its loads are in no row
        return frame

    def frames_after(self, start: Frame, targets: Array) -> Iterator[Frame]:
        """Yield the frame of each step after ``start``, one a target; raise where the motion cannot be followed."""
        layout, worst = self.layout, np.zeros(len(self.residuals))
        row, picked = layout.row(start), np.arange(layout.places.end)
        first = start.linkage.step
        columns = np.empty((len(targets), len(picked)))
        end, error = self.run(first, row, targets, picked, columns, worst)
        table = end.events[: end.told]
        steps = table[:, STEP].tolist()
        done = 0
        for step, numbers in enumerate(columns[: end.steps].tolist(), first + 1):
            begin = done
            while done < len(steps) and steps[done] == step:
                done += 1
            yield self._frame(step, numbers, table[begin:done])
        if error is not None:
            raise error


def compiled_machine(machine: Machine) -> CompiledMachine | None:
    """Return the kernels' view of a machine, None if one of its roles is no face of a kernel."""
    motor, linkage, forces, body = machine.motor, machine.linkage, machine.forces, machine.body
    if not (
        isinstance(motor, CompiledMotor)
        and isinstance(linkage, CompiledLinkage)
        and isinstance(forces, CompiledForces)
        and (body is None or isinstance(body, CompiledBody))
    ):
        return None
    models = Models(motor.model, linkage.model, forces.model, NoBody(0.0) if body is None else body.model)
    layout = FrameLayout(linkage.layout, motor.layout, forces.layout, None if body is None else body.layout)
    return CompiledMachine(machine, models, layout)
