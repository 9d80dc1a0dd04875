# SPDX-License-Identifier: Apache-2.0
"""Positions of a mechanism that its crank leads, as functions of the crank angle and of free configuration keys."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from mech_twin.configuration_tree import ConfigurationError, configuration_tree, merged_tree, tree_from_flat
from mech_twin.measurements.blocks import Array
from mech_twin.parameters.load import catalogue_entry, validated
from mech_twin.quantity import Parameters
from mech_twin.roles import CrankState, GuidedLinkage

TURN = 2.0 * np.pi
ANGLES = 180  # of a turn at which the mechanism is solved; between them a periodic cubic spline


@dataclass(frozen=True)
class GeometryModel:
    """A machine whose joints follow from its crank.

    Parameters
    ----------
    name : str
        Machine of the catalogue.
    base : Parameters
        Every key that is not free.
    keys : sequence of str
        Free keys, dotted.
    columns : sequence of str
        Positions asked for.
    """

    name: str
    base: Parameters
    keys: tuple[str, ...]
    columns: tuple[str, ...]

    def values(self) -> Array:
        """Return the free keys as configured, shape (keys,).

        Raises
        ------
        ConfigurationError
            A key is unknown or no number.
        """
        return np.array([_number(configuration_tree(self.base), key, self.name) for key in self.keys])

    def parameters(self, values: Sequence[float]) -> Parameters:
        """Return the configuration with these values of the free keys."""
        flat = dict(zip(self.keys, map(float, values), strict=True))
        tree = merged_tree(configuration_tree(self.base), tree_from_flat(flat, "--free"))
        return validated(catalogue_entry(self.name), tree, f"{self.name} with --free {', '.join(self.keys)}")

    def positions(self, values: Sequence[float]) -> Mapping[str, CubicSpline]:
        """Return each column as a periodic function of the crank angle (rad).

        Raises
        ------
        ConfigurationError
            The values are refused, or the machine's joints do not follow from its crank.
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


def _number(tree: Mapping[str, object], key: str, machine: str) -> float:
    branch: object = tree
    for word in key.split("."):
        branch = branch.get(word) if isinstance(branch, Mapping) else None
    if isinstance(branch, bool) or not isinstance(branch, int | float):
        raise ConfigurationError(f"--free {key}: expected a key of {machine} that is a number")
    return float(branch)
