# SPDX-License-Identifier: Apache-2.0
"""A configuration with some keys changed, validated again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from mech_twin.declarations.configuration_tree import configuration_tree, merged_tree, tree_from_flat
from mech_twin.declarations.quantity import Parameters

Model = TypeVar("Model", bound=Parameters)


def varied(parameters: Model, changes: Mapping[str, Any]) -> Model:
    """Return the parameters with these dotted keys changed; the value None removes an optional key.

    Raises
    ------
    pydantic.ValidationError
        If the changed configuration is invalid.
    """
    return type(parameters).model_validate(merged_tree(configuration_tree(parameters), tree_from_flat(changes)))
