# SPDX-License-Identifier: Apache-2.0
"""Force analysis of a crank linkage, checked by two independent computations of the drive torque."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import ClassVar

from mech_twin.engine.compiled_roles import CompiledForces
from mech_twin.engine.crank_state import Memory
from mech_twin.engine.sample_vectors import ForceLayout
from mech_twin.kernels.kernel import kernel

RESIDUAL, LIMIT = "drive_torque_routes", 1e-10


@kernel
def route_miss(drive_nm: float, torque_nm: float, inertia: float, memory: Memory, scale_nm: float) -> float:
    """Return the relative difference of two computations of the drive torque.

    Its scale is the largest of the cycle's peak, the present torque and the inertia torque.

    Parameters
    ----------
    drive_nm, torque_nm : float
        Torque at the crank from the equilibrium of the links, and from the linkage's row, with friction (N m).
    inertia : float
        Inertia of the mechanism reduced to its crank (kg m2).
    memory : Memory
        Memory in the linkage's row.
    scale_nm : float
        Largest torque of a cycle (N m).
    """
    scale = max(scale_nm, abs(torque_nm), inertia * abs(memory.crank_acceleration_rad_per_s2), 1e-9)
    return (drive_nm - torque_nm - memory.friction_torque_nm) / scale


class CrankForces(CompiledForces):
    """Pin forces from the equilibrium of the links; the residual is `route_miss`."""

    QUANTITIES: ClassVar[tuple[str, ...]]
    pins: tuple[str, ...]

    @property
    def residual_limits(self) -> Mapping[str, float]:
        """Limit of the residual: relative difference of the two computations of the drive torque."""
        return {RESIDUAL: LIMIT}

    @cached_property
    def layout(self) -> ForceLayout:
        """Row of the samples."""
        return ForceLayout(self.pins, self.QUANTITIES, (RESIDUAL,))
