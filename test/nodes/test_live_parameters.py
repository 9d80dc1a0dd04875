# SPDX-License-Identifier: Apache-2.0
"""Changes of live parameters add up until a step adopts them, and a bad one changes nothing.  Without ROS."""

from __future__ import annotations

import pytest
from catalogue import built

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.nodes.roles.linkage_node import LiveParameters

IN_FORCE = built("impact_mass").parameters


def test_changes_before_one_step_add_up_and_are_taken_once() -> None:
    live = LiveParameters("impact_mass")
    live.request(IN_FORCE, {"restitution": 0.5})
    live.request(IN_FORCE, {"mass_kg": IN_FORCE.mass_kg * 2.0})
    taken = live.take()
    assert taken is not None
    assert (taken.restitution, taken.mass_kg) == (0.5, IN_FORCE.mass_kg * 2.0)
    assert live.take() is None


def test_a_bad_value_is_refused_and_what_was_asked_before_stays() -> None:
    live = LiveParameters("impact_mass")
    live.request(IN_FORCE, {"restitution": 0.5})
    with pytest.raises(ConfigurationError, match="restitution"):
        live.request(IN_FORCE, {"restitution": 1.5})
    taken = live.take()
    assert taken is not None
    assert taken.restitution == 0.5


def test_how_a_node_is_run_is_no_parameter_of_the_machine() -> None:
    assert LiveParameters("impact_mass").validated(IN_FORCE, {"run.pace": "max"}) == IN_FORCE
