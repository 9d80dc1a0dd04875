# SPDX-License-Identifier: Apache-2.0
"""Positions of a crank-driven mechanism as functions of the crank angle and of free configuration keys."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from scipy.interpolate import CubicSpline

from mech_twin.declarations.configuration_tree import ConfigurationError, merged_tree, tree_from_flat
from mech_twin.declarations.quantity import Parameters
from mech_twin.measurements.blocks import Array
from mech_twin.parameters.load import catalogue_entry, validated
from mech_twin.roles import CrankState, GuidedLinkage
from mech_twin.studies.identification.keyed_configuration import (
    KeyedConfiguration,
    declared_field,
    machine_keys,
    unit_at,
)

TURN = 2.0 * np.pi
LENGTHENED = 1e-3  # relative change of a key: enough to move the mechanism
ANGLES = 180  # in a turn, at which the mechanism is solved; interpolated by a periodic cubic spline


@dataclass(frozen=True)
class GeometryModel(KeyedConfiguration):
    """A machine whose joint positions are functions of its crank angle, with lengths as free keys.

    Parameters
    ----------
    columns : tuple of str
        Requested positions.
    """

    columns: tuple[str, ...]

    def positions(self, values: Sequence[float] | Array) -> Mapping[str, CubicSpline]:
        """Return each column as a periodic spline over the crank angle (rad).

        Raises
        ------
        ConfigurationError
            The values are rejected, or the joint positions are not functions of the crank angle.
        """
        machine = catalogue_entry(self.name).build(self.parameters(values))
        if not isinstance(machine.linkage, GuidedLinkage):
            raise ConfigurationError(f"{self.name}: expected a machine whose joints follow from its crank")
        angles = np.linspace(0.0, TURN, ANGLES + 1)
        rows = [machine.linkage.guided(0, 0.0, CrankState(angle, 1.0, 0.0)).position for angle in angles.tolist()]
        places = [machine.linkage.joints.index(column.split(".")[1]) for column in self.columns]
        found = {}
        for column, place in zip(self.columns, places, strict=True):
            curve = np.array([row[place] for row in rows])
            curve[-1] = curve[0]
            found[column] = CubicSpline(angles, curve, bc_type="periodic")
        return found


def lengths(name: str, base: Parameters, columns: tuple[str, ...]) -> tuple[str, ...]:
    """Return the keys in metres that the positions in ``columns`` depend on."""
    found = []
    for key in machine_keys(name, base):
        model = GeometryModel(name, base, (key,), columns)
        if unit_at(type(base), key) == "m" and _moves(model, model.values() + LENGTHENED * model.scales()):
            found.append(key)
    return tuple(found)


def assemblies(model: GeometryModel, fixed: Sequence[str] = ()) -> Iterator[tuple[dict[str, str], GeometryModel]]:
    """Yield the mechanism as configured, then in its other assembly modes, each with the changed configuration words.

    Parameters
    ----------
    model : GeometryModel
        The configured mechanism.
    fixed : sequence of str
        Keys that stay as configured.
    """
    yield {}, model
    entry, base = catalogue_entry(model.name), type(model.base)
    for key, value in _words(model.tree):
        declared = declared_field(base, key)
        for other in get_args(declared.annotation) if declared is not None and key not in fixed else ():
            if other == value or not isinstance(other, str):
                continue
            tree = merged_tree(model.tree, tree_from_flat({key: other}))
            try:
                mirrored = GeometryModel(model.name, validated(entry, tree, key), model.keys, model.columns)
                differs = _moves(model, model.values(), mirrored)
            except ConfigurationError:
                continue
            if differs:
                yield {key: other}, mirrored


def _words(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for name, value in tree.items():
        if isinstance(value, Mapping):
            yield from _words(value, f"{prefix}{name}.")
        elif isinstance(value, str):
            yield prefix + name, value


def _moves(model: GeometryModel, values: Array, other: GeometryModel | None = None) -> bool:
    """Return whether other key values, or another model, change a position."""
    before = model.positions(model.values())
    try:
        after = (other or model).positions(values)
    except ConfigurationError:
        return False
    return any(not np.allclose(before[each].c, after[each].c, rtol=1e-9, atol=1e-12) for each in model.columns)
