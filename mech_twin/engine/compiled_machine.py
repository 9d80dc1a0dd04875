# SPDX-License-Identifier: Apache-2.0
"""A machine whose roles are all backed by kernels, as the compiled run needs it, and its constants as flat arrays.

Kernels take named tuples.  Code that is called with arrays alone, in a unit or on a graphics processor, begins with an
expression such as ``Models(Generator(reals[0], reals[1]), ...)``, which the compiler optimises away.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic

from mech_twin.engine.compiled_roles import CompiledBody, CompiledForces, CompiledLinkage, CompiledMotor, failed
from mech_twin.engine.compiled_steps import (
    DONE,
    FROM_BODY,
    LINKAGE_FAILED,
    SOURCE,
    STEP,
    TABLE_EXTRA,
    Indices,
    Models,
    NoBody,
    RunEnd,
    Widths,
    run_steps,
)
from mech_twin.engine.coupling import next_frame
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
from mech_twin.errors import MotionError
from mech_twin.roles import Machine
from mech_twin.samples import Event, Frame

KINDS = {"f": "reals", "i": "wholes", "b": "flags"}  # NumPy kind of an array, and its flat array
FIRST_BLOCK = 256  # steps of the first call of `CompiledMachine.run`; later ones are adapted to the time below
SHORTEST_BLOCK_S, LONGEST_BLOCK_S = 0.05, 0.2  # wall time of one call: the delay of a signal


@dataclass
class PackedModels:
    """Constants of the kernels of one machine.

    Attributes
    ----------
    reals, wholes, flags : list
        Floats, integers (and single booleans as 0 or 1), and arrays of booleans.
    expression : str
        Python expression over arrays of these names that restores the constants.
    names : dict of str to object
        The named tuples in it, and the functions that return the address of each generated function.
    generated : dict of str to object
        The generated functions by symbol.
    """

    reals: list[float] = field(default_factory=list)
    wholes: list[int] = field(default_factory=list)
    flags: list[bool] = field(default_factory=list)
    expression: str = ""
    names: dict[str, Any] = field(default_factory=dict)
    generated: dict[str, Any] = field(default_factory=dict)


def packed_models(models: Any, function_at: Callable[[int], Any] = lambda _: None) -> PackedModels:
    """Return the constants of a machine's kernels, packed.

    ``function_at`` returns the generated function whose address an integer is, None for a number.
    """
    packed = PackedModels()
    packed.expression = _expression(packed, models, function_at)
    return packed


def _expression(packed: PackedModels, value: Any, function_at: Callable[[int], Any]) -> str:
    """Return the expression of one constant, and add its numbers to the arrays."""
    if isinstance(value, tuple):
        if type(value) is tuple:
            return f"({', '.join(_expression(packed, item, function_at) for item in value)},)"
        inner = ", ".join(_expression(packed, item, function_at) for item in value)
        name = f"{type(value).__module__}.{type(value).__name__}".replace(".", "_")
        packed.names[name] = type(value)
        return f"{name}({inner})"
    if isinstance(value, bool | np.bool_):
        packed.wholes.append(int(value))
        return f"(wholes[{len(packed.wholes) - 1}] != 0)"
    if isinstance(value, int):
        return _whole(packed, value, function_at(value))
    if isinstance(value, float):
        packed.reals.append(value)
        return f"reals[{len(packed.reals) - 1}]"
    name = KINDS[value.dtype.kind]
    into = getattr(packed, name)
    begin = len(into)
    into.extend(value.ravel().tolist())
    flat = f"{name}[{begin}:{len(into)}]"
    return flat if value.ndim == 1 else f"{flat}.reshape({value.shape})"


def _whole(packed: PackedModels, value: int, function: Any) -> str:
    """Return the expression of an integer, or of the address of a generated function."""
    if function is None:
        packed.wholes.append(value)
        return f"wholes[{len(packed.wholes) - 1}]"
    symbol = f"mech_generated_{len(packed.generated)}"
    packed.generated[symbol] = function
    packed.names[f"address_of_{symbol}"] = _address_of(symbol)
    return f"address_of_{symbol}()"


def _address_of(symbol: str) -> Any:
    """Return a numba intrinsic without arguments that returns the address of a symbol linked with the code."""

    def address(typing_context: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            module = builder.module
            known = module.globals.get(symbol)
            function = known or ir.Function(module, ir.FunctionType(ir.VoidType(), ()), symbol)
            return builder.ptrtoint(function, ir.IntType(64))

        return types.int64(), generate

    return intrinsic(address)


@dataclass(frozen=True)
class CompiledMachine:
    """A machine as the kernels use it.

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
        """Index in a row of each residual, by the name of its column."""
        return {name: place for name, place in self.layout.columns.items() if ".residual." in name}

    @cached_property
    def residual_places(self) -> Indices:
        """Indices in a row of the residuals."""
        return np.array(list(self.residuals.values()), dtype=np.int64)

    @cached_property
    def widths(self) -> Widths:
        """Numbers of columns of the tables of events."""
        linkage = self.layout.linkage.events.width
        body = EVENT_WIDTH if self.layout.body is None else self.layout.body.events.width
        return Widths(linkage, body, TABLE_EXTRA + max(linkage, body))

    def run(
        self, first: int, row: Array, targets: Array, picked: Indices, columns: Array, worst: Array
    ) -> tuple[RunEnd, MotionError | None]:
        """Advance a frame by one step for each target; return the end of the run, and the error if there was one.

        Parameters
        ----------
        first : int
            Step of the frame.
        row : ndarray
            The frame, changed in place.
        targets : ndarray, shape (n,)
            Asked fraction of rated supply frequency at each of the next steps.
        picked : ndarray, shape (m,)
            Indices in the row whose numbers are stored in ``columns`` (n, m).
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
        """Return the error of a failed linkage step by repeating it with the role, which knows the events."""
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
        """Run as `run` does, with identical results, in blocks of steps, so that signals are handled between them.

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
            tables.append(end.events[: end.event_count])
            done, failed_role, status = done + end.steps, end.failed, end.status
            if taken_s < SHORTEST_BLOCK_S:
                block *= 2
            elif taken_s > LONGEST_BLOCK_S:
                block = max(1, block // 2)
        table = np.concatenate(tables)
        return RunEnd(table, len(table), done, failed_role, status), error

    def step_events(self, rows: Array) -> tuple[tuple[Event, ...], tuple[Event, ...]]:
        """Return the events of linkage and of body from rows of the table of a run."""
        linkage, body = self.layout.linkage.events, self.layout.body
        of_body = rows[:, SOURCE] == FROM_BODY
        linkage_events = linkage.events(rows[~of_body, TABLE_EXTRA : TABLE_EXTRA + linkage.width])
        if body is None:
            return linkage_events, ()
        return linkage_events, body.events.events(rows[of_body, TABLE_EXTRA : TABLE_EXTRA + body.events.width])

    def events_in_order(self, table: Array) -> list[tuple[int, Event]]:
        """Return the events of a run with their steps, in time order; at equal times the linkage's first."""
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
        """Return a row as a frame; ``table`` holds the events of the run, or of this step."""
        return self._frame(step, row.tolist(), table[table[:, STEP] == step])

    def _frame(self, step: int, numbers: list[float], table: Array) -> Frame:
        if not len(table):
            return self.layout.frame(step, numbers)
        events, body_events = self.step_events(table)
        frame = self.layout.frame(step, numbers, events, body_events)
        if events and self.layout.forces.reads_events:
            frame = frame._replace(forces=self.machine.forces.analyse(frame.linkage))  # rows hold no loads
        return frame

    def frames_after(self, start: Frame, targets: Array) -> Iterator[Frame]:
        """Yield the frame of each step after ``start``, one for each target; raise the error of a failed step."""
        layout, worst = self.layout, np.zeros(len(self.residuals))
        row, picked = layout.row(start), np.arange(layout.places.end)
        first = start.linkage.step
        columns = np.empty((len(targets), len(picked)))
        end, error = self.run(first, row, targets, picked, columns, worst)
        table = end.events[: end.event_count]
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
    """Return a machine as the kernels use it, None if one of its roles is not backed by a kernel.

    Its arrays are its own: kernels work in some of them, and runs of one machine may be computed at the same time.
    """
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
    return CompiledMachine(machine, _with_own_arrays(models), layout)


def _with_own_arrays(value: Any) -> Any:
    """Return constants of kernels with copies of the arrays that can be written."""
    if isinstance(value, tuple):
        items = map(_with_own_arrays, value)
        return tuple(items) if type(value) is tuple else type(value)(*items)
    return value.copy(order="K") if isinstance(value, np.ndarray) and value.flags.writeable else value
