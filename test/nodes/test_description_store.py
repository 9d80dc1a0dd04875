# SPDX-License-Identifier: Apache-2.0
"""A role adopts the configuration its questions name, of the source they name, and no other.  Without ROS."""

from __future__ import annotations

from catalogue import built

from mech_twin.messages.step_message import ConfigurationMark
from mech_twin.nodes.roles.follower_node import REMEMBERED_SOURCES, DescriptionStore
from mech_twin.parameters.description import Description

PARAMETERS = built("winding_drum").parameters


def described(source: float, revision: int) -> Description:
    return Description("winding_drum", "1", revision, 0, PARAMETERS, source)


def test_another_sources_description_is_never_found() -> None:
    store = DescriptionStore()
    store.add(described(2.0, 99), "theirs")
    assert store.find(ConfigurationMark(1, 1.0)) is None
    store.add(described(1.0, 1), "ours")
    found = store.find(ConfigurationMark(1, 1.0))
    assert found is not None
    assert found.text == "ours"


def test_an_older_revision_does_not_replace_a_newer_one() -> None:
    store = DescriptionStore()
    store.add(described(1.0, 3), "third")
    store.add(described(1.0, 2), "second")
    found = store.find(ConfigurationMark(3, 1.0))
    assert found is not None
    assert (found.content.revision, found.content.source) == (3, 1.0)
    assert store.find(ConfigurationMark(4, 1.0)) is None


def test_many_strangers_do_not_fill_the_memory() -> None:
    store = DescriptionStore()
    for source in range(1000):
        store.add(described(float(source), 1), "")
    assert sum(store.find(ConfigurationMark(1, float(s))) is not None for s in range(1000)) == REMEMBERED_SOURCES
