"""Linkage role of the press: its regimes, and the boundaries of the layer along the crank's turn."""

from __future__ import annotations

from mech_twin.engine.crank_linkage import (
    NO_FRICTION,
    Boundary,
    CrankKernels,
    CrankLinkage,
    ShaftFriction,
    Transmission,
)
from mech_twin.machines.compaction_press.cycle import regime_at
from mech_twin.machines.compaction_press.dynamics import (
    CONTACT,
    CONTACT_REVERSED,
    FREE,
    DrivenPress,
    LedPress,
    Press,
    press_load_speed,
    press_load_work,
    press_state,
)
from mech_twin.machines.compaction_press.parameters import Stroke

KERNELS = CrankKernels(press_state, press_load_work, press_load_speed, LedPress, DrivenPress)
REGIMES = ("free", "contact", "contact_reversed")


def press_boundaries(stroke: Stroke, first: str) -> tuple[Boundary, ...]:
    """Return where the layer is met (``first`` is the event), left at the bottom, let go when the crank turns back."""
    return (
        Boundary(stroke.contact, 1.0, FREE, CONTACT, first),
        Boundary(stroke.bottom, 1.0, CONTACT, FREE, "bottom"),
        Boundary(stroke.contact, -1.0, CONTACT, FREE, "release"),
        Boundary(stroke.contact_reversed, -1.0, FREE, CONTACT_REVERSED, first),
        Boundary(stroke.bottom, -1.0, CONTACT_REVERSED, FREE, "bottom"),
        Boundary(stroke.contact_reversed, 1.0, CONTACT_REVERSED, FREE, "release"),
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
) -> CrankLinkage:
    """Return the linkage role: crank at angle 0 and this speed (rad/s), the layer's boundaries along its turn."""
    return CrankLinkage(
        press,
        KERNELS,
        step_s,
        0.0,
        speed,
        command,
        ("crank", "plate", "pendulum"),
        "plate",
        REGIMES,
        regime_at(stroke, 0.0, direction),
        press_boundaries(stroke, first_contact),
        transmission,
        friction,
        size_m=press.bar.coupler_m + press.bar.rocker_m,
    )
