# SPDX-License-Identifier: Apache-2.0
"""Lengths at the start, the reference of springs and gaps."""

from __future__ import annotations

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.machines.page.assembly import Assembly
from mech_twin.machines.page.elements import DEGREE
from mech_twin.machines.page.force_elements import CouplingElement, SpringElement
from mech_twin.machines.page.parameters import Page
from mech_twin.machines.page.state_places import StatePlaces
from mech_twin.mechanics.kinematics import Kinematics


class StartLengths:
    """Lengths and angles of the springs at the start, where a preload is defined."""

    def __init__(self, places: StatePlaces) -> None:
        self._places = places

    def free(self, spring: SpringElement) -> float:
        """Return the free length, travel (m) or angle (rad) of a spring."""
        if spring.free_m is not None:
            return spring.free_m
        if spring.free_deg is not None:
            return spring.free_deg * DEGREE
        preload = spring.preload_n if spring.preload_n is not None else spring.preload_nm or 0.0
        rate = spring.rate_n_per_m if spring.rate_n_per_m is not None else spring.rate_nm_per_rad or 0.0
        return self.length(spring) + (preload / rate if rate else 0.0)

    def twist(self, coupling: CouplingElement) -> float:
        """Return ratio times the first joint minus the second joint of a coupling at the start (rad or m)."""
        assembly = self._places.assembly
        motion = Kinematics(assembly.structure, assembly.start.tolist())
        first, second = (motion.joint_coordinates(assembly.joint_number(name))[0].value for name in coupling.joints)
        difference = coupling.factor * first - second
        assert isinstance(difference, float | int)
        return float(difference)

    def length(self, spring: SpringElement) -> float:
        """Return length, travel (m) or angle (rad) at the start."""
        assembly = self._places.assembly
        motion = Kinematics(assembly.structure, assembly.start.tolist())
        if spring.joint is not None:
            value = motion.joint_coordinates(assembly.joint_number(spring.joint))[0].value
        else:
            assert spring.between is not None
            first, second = (
                motion.point(assembly.body_number(body), place)
                for body, place in map(assembly.page.point, spring.between)
            )
            value = motion.distance(first, second).value
        assert isinstance(value, float | int)
        return float(value)


def check_lines(page: Page, assembly: Assembly) -> None:
    """Raise if the two points of a spring, damper or distance output coincide at the start.

    Raises
    ------
    ConfigurationError
        If two points coincide.
    """
    motion = Kinematics(assembly.structure, assembly.start.tolist())
    found = {f"springs.{name}.between": spring.between for name, spring in page.springs.items()}
    found |= {f"dampers.{name}.between": damper.between for name, damper in page.dampers.items()}
    found |= {f"outputs.{name}.distance": output.distance for name, output in page.outputs.items()}
    for where, between in found.items():
        if between is None:
            continue
        ends = [motion.point(assembly.body_number(body), at) for body, at in map(page.point, between)]
        if ends[0].x == ends[1].x and ends[0].y == ends[1].y:
            raise ConfigurationError(
                f"{where}: {between[0]} and {between[1]} coincide at the start, so their line has no direction; "
                "name the joint that slides instead, or move a point"
            )
