# SPDX-License-Identifier: Apache-2.0
"""A change of live parameters, from being asked for to the step it takes effect at.  Knows no ROS."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mech_twin.configuration_tree import configuration_tree, merged_tree, tree_from_flat
from mech_twin.parameters.load import RUN_GROUP, catalogue_entry
from mech_twin.parameters.load import validated as validated_tree
from mech_twin.quantity import Parameters


class LiveParameters:
    """The configuration asked for, until the next step adopts it.

    Parameters
    ----------
    machine_name : str
        Machine of the catalogue.
    """

    def __init__(self, machine_name: str) -> None:
        self._entry = catalogue_entry(machine_name)
        self._pending: Parameters | None = None

    def validated(self, in_force: Parameters, changes: Mapping[str, Any]) -> Parameters:
        """Return the configuration with changes (dotted keys) laid over what is in force or already asked for.

        Raises
        ------
        ConfigurationError
            If it does not validate as a whole.
        """
        flat = {name: value for name, value in changes.items() if not name.startswith(f"{RUN_GROUP}.")}
        base = configuration_tree(self._pending or in_force)
        return validated_tree(self._entry, merged_tree(base, tree_from_flat(flat)), "parameter change")

    def request(self, in_force: Parameters, changes: Mapping[str, Any]) -> None:
        """Ask for a change; see `validated`."""
        self._pending = self.validated(in_force, changes)

    def take(self) -> Parameters | None:
        """Return the configuration to adopt now, if one was asked for, and ask for none any more."""
        pending, self._pending = self._pending, None
        return pending
