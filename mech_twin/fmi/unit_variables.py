# SPDX-License-Identifier: Apache-2.0
"""The variables of a unit that an importer sets and reads: each with its physical unit, named as in the samples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.compiled_machine import CompiledMachine, PackedModels, compiled_machine, packed_models
from mech_twin.engine.coupling import complete_frame
from mech_twin.engine.sample_vectors import Array
from mech_twin.fmi.step_object import EVENT_FIELDS
from mech_twin.measurements.units import column_unit, sliding_in
from mech_twin.mechanics.code_generation import generated_at
from mech_twin.parameters.errors import Key, keys
from mech_twin.parameters.load import catalogue_entry, changed_configuration
from mech_twin.roles import EffortMotor, Machine, own_name
from mech_twin.samples import Frame

# value references, consecutive within each group (the same numbers as in sources/unit.h)
TIME_REFERENCE, COMMAND, MOTOR_GIVEN, EFFORTS, PARAMETERS, FRAME, EVENTS = 0, 1, 2, 100, 10_000, 100_000, 1_000_000
FIRST_COMMAND = 1.0
WIDEST = 2.0  # a parameter may be set from its value divided by this to its value times this
TRIED = (1.001, 0.999, 1.25, 0.8, 1.5, 1.0 / 1.5, WIDEST, 1.0 / WIDEST)
Causality = Literal["independent", "input", "parameter", "output", "local"]


class Variable(NamedTuple):
    """A variable of the model description: name, value reference, type, unit, start value, bounds."""

    name: str
    reference: int
    kind: Literal["real", "count", "truth"]
    causality: Causality
    variability: Literal["continuous", "discrete", "fixed"]
    unit: str = ""
    start: float | None = None
    least: float | None = None
    greatest: float | None = None
    meaning: str = ""


class Adjustable(NamedTuple):
    """A configuration key that an importer may set: declaration, indices in the real constants, and bounds."""

    key: Key
    places: tuple[int, ...]
    least: float
    greatest: float


@dataclass(frozen=True)
class MachineUnit:
    """Data of a machine for its unit: constants, first frame vector, variables."""

    machine: Machine
    compiled: CompiledMachine
    packed: PackedModels
    first_row: Array
    adjustable: tuple[Adjustable, ...]
    efforts: tuple[int, ...]  # indices in a frame vector of the motor efforts that act on the linkage
    kinds: tuple[str, ...]  # kinds of events: of the linkage, then of the body

    @property
    def name(self) -> str:
        """Name of the machine, of a page the one on it."""
        return own_name(self.machine.name, self.machine.parameters)

    @property
    def supply_off(self) -> bool:
        """Whether the supply is off if efforts are given as inputs: then only they act on the linkage."""
        motor = self.machine.motor
        return isinstance(motor, EffortMotor) and motor.effort_limit > 0.0

    @property
    def variables(self) -> tuple[Variable, ...]:
        """All variables, in the order of the model description."""
        return tuple(_variables(self))


def unit_of(machine: Machine, compiled: CompiledMachine) -> MachineUnit:
    """Return the data of a machine for its unit."""
    frame = _first_frame(machine)
    layout = compiled.layout
    packed, row = packed_models(compiled.models, generated_at), layout.row(frame)
    of_body = () if layout.body is None else layout.body.events.kinds
    kinds = (*layout.linkage.events.kinds, *(f"body_{kind}" for kind in of_body))
    first = layout.places.motor + 3
    efforts = tuple(first + 3 * joint for joint in range(len(frame.motor.joints)) if _feels(machine, frame, joint))
    return MachineUnit(machine, compiled, packed, row, tuple(_adjustable(_Built(machine, packed, row))), efforts, kinds)


def _first_frame(machine: Machine) -> Frame:
    return complete_frame(machine, machine.linkage.start(), None, FIRST_COMMAND)


def _feels(machine: Machine, frame: Frame, joint: int) -> bool:
    """Return whether a changed effort of a joint of the motor changes the next step of the linkage."""
    efforts = enumerate(frame.motor.effort)
    stronger = frame.motor._replace(effort=tuple(2.0 * e + 1.0 if place == joint else e for place, e in efforts))
    alike = machine.linkage.advance(frame.linkage, frame.motor, frame.body)
    return machine.linkage.advance(frame.linkage, stronger, frame.body) != alike


def _adjustable(built: _Built) -> Iterator[Adjustable]:
    """Yield the keys whose value appears unchanged in the kernels' constants, for all tried values in its range.

    Other keys enter derived constants or the first frame; to change those, export the machine again.  A live key may
    enter the first frame: it changes only while the unit runs, as in a run.  Two keys are allowed together at every
    pair of their bounds.
    """
    machine, before = built.machine, list[Adjustable]()
    for key in keys(machine.parameters):
        if type(key.value) is not float or key.value == 0.0:
            continue
        found: set[tuple[int, ...] | None] = set()
        values = []
        for factor in TRIED:
            value = key.value * factor
            beside = [{each.key.name: bound} for each in before for bound in (each.least, each.greatest)]
            alone = _configured(machine, {key.name: value})
            if alone is None or any(_configured(machine, {key.name: value, **others}) is None for others in beside):
                continue
            other = _built(machine.name, alone)
            if other is not None:
                values.append(value)
                found.add(_places(built, other, key._replace(value=value), key.value))
        places = found.pop() if len(found) == 1 else None
        if places:
            before.append(Adjustable(key, places, min((key.value, *values)), max((key.value, *values))))
            yield before[-1]


class _Built(NamedTuple):
    """A machine, its constants and first frame."""

    machine: Machine
    packed: PackedModels
    row: Array


def _configured(machine: Machine, values: Mapping[str, float]) -> Parameters | None:
    """Return the configuration with other values of some keys; None if it is not valid."""
    try:
        return changed_configuration(machine.name, machine.parameters, values, "unit")
    except ConfigurationError:
        return None


def _built(name: str, parameters: Parameters) -> _Built | None:
    """Return the machine of a configuration; None if it cannot be built."""
    try:
        built = catalogue_entry(name).build(parameters)
        compiled = compiled_machine(built)
        if compiled is None:
            return None
        return _Built(built, packed_models(compiled.models, generated_at), compiled.layout.row(_first_frame(built)))
    except (ConfigurationError, ValueError, ArithmeticError):
        return None


def _places(built: _Built, other: _Built, key: Key, old: float) -> tuple[int, ...] | None:
    """Return the indices of the value in the real constants; None if anything else has changed too."""
    packed, theirs = built.packed, other.packed
    if other.machine.coupling_step_s != built.machine.coupling_step_s:
        return None
    if (packed.expression, packed.wholes, packed.flags) != (theirs.expression, theirs.wholes, theirs.flags):
        return None
    new, live = key.value, key.live
    ours, found = np.array(packed.reals), np.array(theirs.reals)
    apart = np.flatnonzero((ours != found) & ~(np.isnan(ours) & np.isnan(found)))  # NaN: unused
    if not (np.all(ours[apart] == old) and np.all(found[apart] == new)):
        return None
    if not live and not np.array_equal(built.row, other.row, equal_nan=True):
        return None  # a live key acts from the first step on; the first frame stays
    return tuple(apart.tolist())


def _variables(unit: MachineUnit) -> Iterator[Variable]:
    machine, layout = unit.machine, unit.compiled.layout
    command = "asked fraction of rated supply frequency, kept within 0 and 1; counts from the next coupling step on"
    yield Variable("time", TIME_REFERENCE, "real", "independent", "continuous", "s")
    yield Variable("speed_command", COMMAND, "real", "input", "discrete", "1", FIRST_COMMAND, 0.0, 1.0, command)
    sliding, names = sliding_in(machine), list(layout.columns)
    if unit.efforts:
        given = "whether the efforts of the motor are given from outside, in place of the machine's own motor"
        yield Variable("motor_given", MOTOR_GIVEN, "truth", "parameter", "fixed", start=0.0, meaning=given)
    for i, place in enumerate(unit.efforts):
        effort = names[place]
        yield Variable(
            f"given.{effort}", EFFORTS + i, "real", "input", "discrete", column_unit(effort, sliding),
            float(unit.first_row[place]), meaning=f"{effort} where motor_given is true, held over a coupling step",
        )  # fmt: skip
    for i, (key, _, least, greatest) in enumerate(unit.adjustable):
        meaning, spelled = key.field.description or key.name, key.unit.replace("^", "").replace(" ", ".")
        kind: tuple[str, Causality, Any] = ("parameters", "parameter", "fixed")
        if key.live:
            kind = ("live", "input", "discrete")
        yield Variable(
            f"{kind[0]}.{key.name}", PARAMETERS + i, "real", *kind[1:], spelled, key.value, least, greatest, meaning
        )
    for place, name in enumerate(names[1:], 1):
        inner = ".memory." in name or ".residual." in name
        causality: Causality = "local" if inner else "output"
        yield Variable(name, FRAME + place, "real", causality, "discrete", "" if inner else column_unit(name, sliding))
    yield from _events(unit)


def _events(unit: MachineUnit) -> Iterator[Variable]:
    units: Mapping[str, str] = dict(zip(EVENT_FIELDS, ("", "s", "m/s", "m/s", "N.s"), strict=True))
    meaning = {"count": "how many there were", "time_s": "exact time of the last, the start time before the first"}
    for i, kind in enumerate(unit.kinds):
        for j, name in enumerate(EVENT_FIELDS):
            what: Any = "count" if name == "count" else "real"
            yield Variable(
                f"event.{kind}.{name}", EVENTS + len(EVENT_FIELDS) * i + j, what, "output", "discrete", units[name],
                meaning=meaning.get(name, "of the last"),
            )  # fmt: skip
