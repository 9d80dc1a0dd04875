# SPDX-License-Identifier: Apache-2.0
"""Positions of a mechanism that its crank leads, as functions of the crank angle and of free configuration keys."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.measurements.blocks import Array
from mech_twin.parameters.load import catalogue_entry
from mech_twin.roles import CrankState, GuidedLinkage
from mech_twin.studies.identification.keyed_configuration import KeyedConfiguration

TURN = 2.0 * np.pi
ANGLES = 180  # of a turn at which the mechanism is solved; between them a periodic cubic spline


@dataclass(frozen=True)
class GeometryModel(KeyedConfiguration):
    """A machine whose joints follow from its crank, its lengths among the free keys.

    Parameters
    ----------
    columns : tuple of str
        Positions asked for.
    """

    columns: tuple[str, ...]

    def positions(self, values: Sequence[float] | Array) -> Mapping[str, CubicSpline]:
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
