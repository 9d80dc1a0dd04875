# SPDX-License-Identifier: Apache-2.0
"""Parameters in force at each step of a recorded run."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable

from mech_twin.declarations.configuration_tree import ConfigurationError, configuration_tree
from mech_twin.declarations.quantity import Parameters
from mech_twin.parameters.load import Description, catalogue_entry, description
from mech_twin.roles import Machine
from mech_twin.studies.run_comparison import changed_settings


class ConfigurationHistory:
    """Configurations of a run, each valid from its step on.

    Parameters
    ----------
    texts : iterable of str
        Descriptions in the recording; a revision that is described again (after a node restart) counts once.
    source : str
        Name of the recording in error messages.

    Raises
    ------
    ConfigurationError
        If there is none, one is invalid, or they describe different machines.
    """

    def __init__(self, texts: Iterable[str], source: str) -> None:
        found: dict[int, Description] = {}
        for text in texts:
            described = description(text, source)
            found.setdefault(described.revision, described)
        if not found:
            raise ConfigurationError(f"{source}: holds no configuration; expected a description of the machine")
        names = {described.machine for described in found.values()}
        if len(names) > 1:
            raise ConfigurationError(f"{source}: describes more than one machine: {', '.join(sorted(names))}")
        self._described = sorted(found.values(), key=lambda item: (item.from_step, item.revision))
        self._from = [described.from_step for described in self._described]
        self._built: tuple[int, Machine] | None = None

    @property
    def name(self) -> str:
        """Name of the machine."""
        return self._described[0].machine

    @property
    def versions(self) -> tuple[str, ...]:
        """Versions of this package that made the recording."""
        return tuple(dict.fromkeys(described.version for described in self._described))

    @property
    def parameters(self) -> Parameters:
        """Parameters at the start of the run."""
        return self._described[0].parameters

    @property
    def changes(self) -> int:
        """Number of changes of parameters during the run."""
        return len(self._described) - 1

    def machine_at(self, step: int) -> Machine:
        """Return the machine with the parameters in force at a step."""
        place = max(0, bisect_right(self._from, step) - 1)
        if self._built is None or self._built[0] != place:
            self._built = place, catalogue_entry(self.name).build(self._described[place].parameters)
        return self._built[1]


def recorded_settings(texts: Iterable[str]) -> list[list[str]]:
    """Return the settings at the start of a recording that differ from the installed configuration.

    It is empty if the recording has no valid configuration.
    """
    try:
        history = ConfigurationHistory(texts, "the recording")
    except ConfigurationError:
        return []
    return changed_settings(history.name, configuration_tree(history.parameters))
