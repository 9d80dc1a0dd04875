# SPDX-License-Identifier: Apache-2.0
"""A configuration with some keys changed, and the box of tolerances about it.

In the box each assumed number varies by up to a share of its value.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from mech_twin.declarations.configuration_tree import configuration_tree, merged_tree, tree_from_flat, value_in
from mech_twin.declarations.quantity import Parameters

Model = TypeVar("Model", bound=Parameters)
Factors = dict[str, float]  # factor of the configured value, by dotted key


def varied(parameters: Model, changes: Mapping[str, Any]) -> Model:
    """Return the parameters with these dotted keys changed; the value None removes an optional key.

    Raises
    ------
    pydantic.ValidationError
        If the changed configuration is invalid.
    """
    return type(parameters).model_validate(merged_tree(configuration_tree(parameters), tree_from_flat(changes)))


def scaled(parameters: Model, factors: Mapping[str, float]) -> Model:
    """Return the configuration with these numbers multiplied by their factors; see `varied`."""
    tree = configuration_tree(parameters)
    return varied(parameters, {key: float(value_in(tree, key)) * factor for key, factor in factors.items()})


def inner_points(keys: Sequence[str], tolerance: float, count: int, seed: int = 1) -> Iterator[Factors]:
    """Yield random points of the box, reproducible by the seed."""
    drawn = np.random.default_rng(seed).uniform(-tolerance, tolerance, (count, len(keys)))
    for row in drawn:
        yield {key: 1.0 + float(part) for key, part in zip(keys, row, strict=True)}


def neighbours(corner: Mapping[str, float], tolerance: float) -> Iterator[Factors]:
    """Yield the corners that differ from this one in a single number."""
    for key, factor in corner.items():
        yield {**corner, key: 1.0 - tolerance if factor > 1.0 else 1.0 + tolerance}
