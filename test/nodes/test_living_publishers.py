# SPDX-License-Identifier: Apache-2.0
"""Who publishes a topic at once: a node killed and started again is one, two nodes are two."""

from __future__ import annotations

from mech_twin.nodes.exchange.peers import FORGOTTEN_S, UNKNOWN, LivingPublishers

DEAD, BORN, OTHER = ("/motor", b"1"), ("/motor", b"2"), ("/stranger", b"3")


def test_a_node_killed_and_started_again_is_one_publisher() -> None:
    publishers = LivingPublishers()
    assert publishers.living([DEAD], 0.0) == 1
    assert publishers.living([DEAD, BORN], 100.0) == 1
    assert publishers.living([DEAD, BORN], 100.0 + FORGOTTEN_S - 1.0) == 1
    assert publishers.living([BORN], 200.0) == 1


def test_nodes_of_two_names_are_two_at_once_and_none_is_none() -> None:
    publishers = LivingPublishers()
    assert publishers.living([], 0.0) == 0
    assert publishers.living([DEAD, OTHER], 1.0) == 2


def test_two_of_one_name_are_two_where_a_dead_one_would_be_forgotten() -> None:
    publishers = LivingPublishers()
    publishers.living([DEAD, BORN], 0.0)
    assert publishers.living([DEAD, BORN], FORGOTTEN_S + 1.0) == 2


def test_an_endpoint_whose_node_is_not_yet_known_is_no_second_publisher() -> None:
    publishers = LivingPublishers()
    nameless = (f"_NODE_NAMESPACE_UNKNOWN_/{UNKNOWN}", b"2")
    assert publishers.living([nameless], 0.0) == 1
    assert publishers.living([DEAD, nameless], 1.0) == 1
    assert publishers.living([DEAD, BORN], 2.0) == 1


def test_a_nameless_endpoint_that_lasts_is_a_second_publisher() -> None:
    publishers = LivingPublishers()
    nameless = (f"_NODE_NAMESPACE_UNKNOWN_/{UNKNOWN}", b"2")
    publishers.living([DEAD, nameless], 0.0)
    assert publishers.living([DEAD, nameless], FORGOTTEN_S + 1.0) == 2
