# SPDX-License-Identifier: Apache-2.0
"""What can go wrong with the breaker."""

from __future__ import annotations

from mech_twin.capabilities.faults import MachineFault, added_to_key, share_of_key, supply_sag
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters, ToolParameters

LESS = (-0.6, -0.5, -0.4, -0.3, -0.2, -0.1, -0.05)
WAVE = "tool.wave"
EITHER = (-0.4, -0.2, -0.1, 0.1, 0.2, 0.4)


RIGID_FAULTS = (
    share_of_key("tool_mass", "a tool of another mass", "tool.mass_kg", EITHER),
    share_of_key("tool_restitution", "the tool's face has changed", "tool.restitution", EITHER),
)


def wave_faults(tool: ToolParameters) -> tuple[MachineFault, ...]:
    """Return the faults of a tool whose blow is a wave: its face, its foot, the wall."""
    wall, found = tool.wave.wall.kind, []
    if tool.wave.face.kind == "linear":
        found.append(share_of_key("face_worn", "the struck face is softer", f"{WAVE}.face.stiffness_n_per_m", LESS))
    if tool.wave.foot.length_m > 0.0:
        found.append(added_to_key("foot_worn", "the foot has play", f"{WAVE}.foot_gap_m", "m", (1e-4, 2e-4, 5e-4)))
    if wall == "loading":
        found.append(share_of_key("wall_soft", "the wall is softer", f"{WAVE}.wall.stiffness_n_per_m", LESS))
    if wall == "yielding":
        found.append(share_of_key("wall_weak", "the wall gives way sooner", "tool.wall_force_n", LESS))
    return tuple(found)


def faults(parameters: BreakerParameters) -> tuple[MachineFault, ...]:
    """Return the faults of springs, collar, tool, bearings and supply."""
    return (
        share_of_key("spring_soft", "the body's springs are soft or broken", "body.spring_rate_n_per_m", LESS),
        share_of_key("preload_lost", "the springs have lost preload", "body.preload_deflection_m", LESS),
        share_of_key("collar_restitution", "the collar's seat has changed", "body.restitution", EITHER),
        share_of_key("tool_worn", "the tool is worn: the striker meets it later", "tool.overtravel_m", LESS),
        *(wave_faults(parameters.tool) if parameters.tool.model == "wave" else RIGID_FAULTS),
        added_to_key(
            "bearing_friction", "the crank's bearing rubs", "friction.coulomb_nm", "N.m", (0.5, 1.0, 2.0, 4.0)
        ),
        supply_sag(),
    )
