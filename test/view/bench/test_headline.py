# SPDX-License-Identifier: Apache-2.0
"""Headline numbers carry their unit, and of a machine with a rated motor what that is rated for."""

from __future__ import annotations

from catalogue import built

from mech_twin.engine.run import frames
from mech_twin.view.banner import Banner
from mech_twin.view.bench.scene import rated_power_w


def test_the_mean_drive_power_stands_beside_the_rated_power_of_the_motor():
    machine = built("roller_former")
    banner = Banner(machine.mechanism)
    banner.rated_power_w = rated_power_w(machine)
    for frame in frames(machine, 0.1):
        banner.add(frame.motor, frame.linkage, frame.forces)
    cards = {card.key: card for card in banner.cards()}
    assert (cards["mean drive power"].unit, cards["mean drive power"].most) == ("W", 11000.0)
    assert cards["mean drive power"].value != 0.0
    assert all(card.most is None for key, card in cards.items() if key != "mean drive power")


def test_a_machine_whose_configuration_tells_no_rated_power_has_no_limit():
    assert rated_power_w(built("vibration_crank")) is None
