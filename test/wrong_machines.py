# SPDX-License-Identifier: Apache-2.0
"""Machines that differ from their model as the observer is told they may."""

from collections.abc import Callable

import numpy as np

from mech_twin.capabilities.faults import value_at
from mech_twin.declarations.configuration_tree import (
    ConfigurationError,
    configuration_tree,
    merged_tree,
    tree_from_flat,
)
from mech_twin.declarations.quantity import Parameters
from mech_twin.roles import Machine
from mech_twin.studies.observer.parameter_error import uncertain_keys


def wrong_machine(
    parameters: Parameters, build: Callable[[Parameters], Machine], seed: int, share: float = 0.02
) -> Machine:
    """Return a machine with every uncertain key changed by a normally distributed share; reproducible by the seed.

    It tests an observer whose model has the configured values.  A change that the machine rejects is left out.
    """
    tree, random = configuration_tree(parameters), np.random.default_rng(seed)
    for key, deviation in uncertain_keys(parameters, share).items():
        value = value_at(parameters, key) + deviation * random.standard_normal()
        changed = merged_tree(tree, tree_from_flat({key: value}))
        try:
            build(type(parameters).model_validate(changed))
        except (ValueError, ConfigurationError):
            continue
        tree = changed
    return build(type(parameters).model_validate(tree))
