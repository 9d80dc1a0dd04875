# SPDX-License-Identifier: Apache-2.0
"""Machines of one kind among their sisters: who is apart, and who only moved with all the others."""

from __future__ import annotations

from math import isnan

import numpy as np

from mech_twin.studies.monitoring.fleet import FALSELY_APART, LEAST_SISTERS, FleetMember, fleet_of

NAMES = tuple(f"feature_{i}" for i in range(20))


def healthy(machines: int, random: np.random.Generator, moved: float = 0.0) -> list[FleetMember]:
    """Return healthy machines, all of them moved alike."""
    shifts = moved + random.standard_normal((machines, len(NAMES)))
    return [FleetMember(f"m{i:03d}", 500, shift=dict(zip(NAMES, row, strict=True))) for i, row in enumerate(shifts)]


def test_what_moves_all_sisters_alike_sets_none_apart_and_is_told() -> None:
    fleet = fleet_of(healthy(40, np.random.default_rng(1), moved=30.0))
    assert not any(sister.is_suspect for sister in fleet.sisters)
    assert all(abs(moved - 30.0) < 1.0 for moved in fleet.common.values())


def test_the_one_that_moved_alone_is_first_and_apart_by_its_feature() -> None:
    members = healthy(40, np.random.default_rng(2), moved=-5.0)
    members[17] = members[17]._replace(shift={**members[17].shift, "feature_3": 10.0})
    first, *others = fleet_of(members).sisters
    assert (first.member.name, first.feature, first.verdict) == ("m017", "feature_3", "apart")
    assert first.apart > 8.0
    assert not any(sister.verdict for sister in others)


def test_a_finding_is_confirmed_by_sisters_and_what_was_not_judged_is_told() -> None:
    members = healthy(20, np.random.default_rng(3))
    members[4] = members[4]._replace(shift={**members[4].shift, "feature_0": 40.0})
    members[9] = members[9]._replace(finding="spring_weak")
    members[2] = members[2]._replace(finding="spring_weak", shift={**members[2].shift, "feature_0": 10.0})
    members.append(FleetMember("m020", refused="no complete cycle"))
    fleet = fleet_of(members)
    told = [(sister.member.name, sister.verdict, sister.is_suspect) for sister in fleet.sisters[:3]]
    assert told == [("m002", "confirmed", True), ("m004", "apart", True), ("m009", "unconfirmed", False)]
    assert fleet.confirming < abs(fleet.sisters[0].apart) < fleet.limit
    assert [member.name for member in fleet.refused] == ["m020"]
    assert len(fleet.sisters) == 20


def test_a_healthy_fleet_has_one_apart_not_more_often_than_stated() -> None:
    random, fleets = np.random.default_rng(4), 600
    for machines in (LEAST_SISTERS, 12, 50):
        false = sum(any(s.verdict for s in fleet_of(healthy(machines, random)).sisters) for _ in range(fleets))
        expected = FALSELY_APART * fleets
        assert false <= expected + 3.0 * np.sqrt(expected)


def test_a_few_machines_are_not_compared() -> None:
    members = healthy(LEAST_SISTERS - 1, np.random.default_rng(5))
    members[1] = members[1]._replace(finding="spring_weak")
    fleet = fleet_of(members)
    assert isnan(fleet.limit)
    assert [(sister.verdict, sister.is_suspect) for sister in fleet.sisters[:2]] == [("alone", True), ("", False)]
