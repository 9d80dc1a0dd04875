# SPDX-License-Identifier: Apache-2.0
"""A machine from a page that is followed: its state within its uncertainty, told under the page's own name."""

from __future__ import annotations

import numpy as np
import pytest
from machines.page.test_page_machines import page as shipped
from studies.test_observer import followed, share_inside
from wrong_machines import wrong_machine

from mech_twin.nodes.shadow.session import follow
from mech_twin.nodes.shadow.shadow_node import ShadowSetup
from mech_twin.parameters.load import catalogue_entry, machine
from mech_twin.studies.observer.estimate import SensedChannel
from mech_twin.studies.observer.observer import PhaseLockedObserver
from mech_twin.studies.observer.parameter_error import uncertain_keys

FOUR_BAR = shipped("four_bar")
CRANK = ("linkage.crank_bearing.position", 1e-3)


@pytest.mark.slow
def test_a_page_with_wrong_masses_is_followed_by_its_crank_alone():
    built, build = machine(FOUR_BAR), catalogue_entry(FOUR_BAR).build
    observer = PhaseLockedObserver(built, build, [SensedChannel(*CRANK)])
    assert "bodies.crank.mass_kg" in observer.parameters.keys
    pairs = followed(observer, wrong_machine(built.parameters, build, 3), [CRANK], 200.0, 3)
    joints = [f"linkage.{joint}.{field}" for joint in built.linkage.joints for field in ("position", "velocity")]
    assert len(pairs) > 150
    assert (share_inside(observer, pairs, joints) > 0.9).all()


def test_masses_and_stiffnesses_of_elements_are_uncertain():
    parameters = machine(shipped("spring_hammer")).parameters
    found = uncertain_keys(parameters, 0.02)
    assert found["springs.spring.rate_n_per_m"] == pytest.approx(0.02 * parameters.springs["spring"].rate_n_per_m)
    assert found["bodies.ram.mass_kg"] == pytest.approx(0.02 * parameters.bodies["ram"].mass_kg)
    assert np.isfinite(list(found.values())).all()


@pytest.mark.slow
def test_a_page_is_told_of_below_its_own_name(ros_domain):
    outcome = follow("page", ShadowSetup("/plant"), machine(FOUR_BAR).parameters, duration_s=0.2, own_name="four_bar")
    own = [topic for topic in outcome.sent if topic != "/diagnostics"]
    assert len(own) > 5
    assert all(topic.startswith("/four_bar/twin/") for topic in own)
    assert outcome.silent == ("/plant/joint_states",)
