# SPDX-License-Identifier: Apache-2.0
"""Description of a run: its configuration as a parameter file, with machine, revision and the step of its beginning."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import yaml

from mech_twin import __version__
from mech_twin.declarations.configuration_tree import ConfigurationError, configuration_tree
from mech_twin.declarations.quantity import Parameters
from mech_twin.parameters.load import MACHINE_KEY, catalogue_entry, text_document, text_tree, validated

LARGEST_COUNTER = 2**53  # largest exact integer range of a float64


def description_text(
    name: str,
    parameters: Parameters,
    revision: int = 0,
    from_step: int = 0,
    source: float | None = None,
    own_roles: Mapping[str, str] | None = None,
) -> str:
    """Return the full configuration as a parameter file with the machine's name and the step from which it is valid.

    ``source`` is the number that the describing node puts into its step messages, if any.  ``own_roles`` names the
    class of the user's own in the place of each role.
    """
    head = {"machine": name, "version": __version__, "revision": revision, "from_step": from_step}
    head |= {} if source is None else {"source": int(source)}
    head |= {"own_roles": dict(own_roles)} if own_roles else {}
    tree = {**head, "/**": {"ros__parameters": {MACHINE_KEY: name, **configuration_tree(parameters)}}}
    return yaml.safe_dump(tree, sort_keys=False, allow_unicode=True)


class Description(NamedTuple):
    """Configuration in a description: machine, parameters, and the step from which they are valid."""

    machine: str
    version: str
    revision: int
    from_step: int
    parameters: Parameters
    source: float = 0.0
    own_roles: tuple[tuple[str, str], ...] = ()  # role, and the class in its place


def description(text: str, source: str = "description") -> Description:
    """Return the configuration in the description of a run or a bag."""
    tree = text_tree(text, source)
    head = text_document(text, source)
    name = str(tree.get(MACHINE_KEY, head.get("machine")))
    parameters = validated(catalogue_entry(name), tree, source)
    revision, from_step, described_by = (_counter(head, key, source) for key in ("revision", "from_step", "source"))
    given = head.get("own_roles")
    own_roles = tuple((str(role), str(made)) for role, made in given.items()) if isinstance(given, Mapping) else ()
    return Description(name, str(head.get("version")), revision, from_step, parameters, float(described_by), own_roles)


def _counter(head: Mapping[str, Any], key: str, source: str) -> int:
    value = head.get(key, 0)
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= LARGEST_COUNTER:
        shown = str(value) if not isinstance(value, int) or abs(value) < LARGEST_COUNTER**2 else "a huge number"
        raise ConfigurationError(
            f"{source}: key '{key}', value {shown}: expected a whole number, 0 to {LARGEST_COUNTER}"
        )
    return value
