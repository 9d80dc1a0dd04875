# SPDX-License-Identifier: Apache-2.0
"""Linkage role of the press: its regimes, and the boundaries of the layer along the crank's turn."""

from __future__ import annotations

from math import nan

from mech_twin.engine.crank_linkage import CrankLinkage
from mech_twin.engine.crank_state import NO_FRICTION, Boundary, Resisting, ShaftFriction, Transmission
from mech_twin.machines.compaction_press.cycle import regime_at
from mech_twin.machines.compaction_press.dynamics import (
    COMPACTED,
    COMPACTED_REVERSED,
    CONTACT,
    CONTACT_REVERSED,
    FREE,
    Press,
)
from mech_twin.machines.compaction_press.parameters import Stroke

REGIMES = ("free", "contact", "contact_reversed", "compacted", "compacted_reversed")
SET_LAYER = {CONTACT: Resisting(1.0, COMPACTED), CONTACT_REVERSED: Resisting(-1.0, COMPACTED_REVERSED)}


def press_boundaries(stroke: Stroke, first: str, gives_back: bool = True) -> tuple[Boundary, ...]:
    """Return the boundaries of contact with the layer: first contact (event ``first``), bottom, release, new contact.

    A layer without spring-back is in contact again where the crank reversed, and is a new one after the top.
    """
    pressed = (
        Boundary(stroke.contact, 1.0, FREE, CONTACT, first),
        Boundary(stroke.bottom, 1.0, CONTACT, FREE, "bottom"),
        Boundary(stroke.contact_reversed, -1.0, FREE, CONTACT_REVERSED, first),
        Boundary(stroke.bottom, -1.0, CONTACT_REVERSED, FREE, "bottom"),
    )
    if gives_back:
        return (
            *pressed,
            Boundary(stroke.contact, -1.0, CONTACT, FREE, "release"),
            Boundary(stroke.contact_reversed, 1.0, CONTACT_REVERSED, FREE, "release"),
        )
    return (
        *pressed,
        Boundary(nan, 1.0, COMPACTED, CONTACT, first),
        Boundary(stroke.top, -1.0, COMPACTED, FREE, "top"),
        Boundary(nan, -1.0, COMPACTED_REVERSED, CONTACT_REVERSED, first),
        Boundary(stroke.top, 1.0, COMPACTED_REVERSED, FREE, "top"),
    )


def press_linkage(
    press: Press,
    stroke: Stroke,
    step_s: float,
    speed: float,
    command: float,
    direction: float,
    first_contact: str,
    transmission: Transmission | None,
    friction: ShaftFriction = NO_FRICTION,
    gives_back: bool = True,
) -> CrankLinkage:
    """Return the linkage role: crank at angle 0 and this speed (rad/s), the layer's boundaries along its turn."""
    return CrankLinkage(
        press,
        step_s,
        0.0,
        speed,
        command,
        ("crank", "plate", "pendulum"),
        "plate",
        REGIMES,
        regime_at(stroke, 0.0, direction),
        press_boundaries(stroke, first_contact, gives_back),
        transmission,
        friction,
        size_m=press.bar.coupler_m + press.bar.rocker_m,
        resisting={} if gives_back else SET_LAYER,
    )
