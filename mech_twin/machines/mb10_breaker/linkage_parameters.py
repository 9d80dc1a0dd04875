# SPDX-License-Identifier: Apache-2.0
"""Lengths and masses of the percussion mechanism, their constraints, and its angles in given positions."""

from __future__ import annotations

import cmath
import math

from pydantic import model_validator

from mech_twin.declarations.quantity import Parameters, quantity
from mech_twin.parts.four_bar import OPEN, FourBar, failing_inequality

LEAST_TRANSMISSION_DEG = 5.0
LINKS = ("crank", "coupler", "rocker")
MOST_REACH = 10.0  # of centroids and striker, in lengths of the longest link


class LinkageParameters(Parameters):
    """The crank-rocker MO-10: lengths, masses and the arm that strikes."""

    crank_m: float = quantity("m", "crank length", gt=0.0)
    coupler_m: float = quantity("m", "coupler length", gt=0.0)
    rocker_m: float = quantity("m", "rocker length, bearing to coupler pin", gt=0.0)
    ground_m: float = quantity("m", "distance of the crank and rocker bearings on the body", gt=0.0)
    striker_arm_m: float = quantity("m", "arm of the striking face about the rocker bearing", gt=0.0)
    striker_angle_deg: float = quantity("deg", "angle from the rocker to the striker arm", ge=-180.0, le=180.0)
    crank_mass_kg: float = quantity("kg", "mass of crank and flywheel", gt=0.0)
    crank_inertia_kg_m2: float = quantity("kg m^2", "inertia of crank and flywheel about the crank axis", gt=0.0)
    crank_centroid_along_m: float = quantity("m", "crank centroid from its axis along the crank", default=0.0)
    crank_centroid_across_m: float = quantity("m", "crank centroid across the crank", default=0.0)
    coupler_mass_kg: float = quantity("kg", "mass of the coupler", gt=0.0)
    coupler_inertia_kg_m2: float = quantity("kg m^2", "inertia of the coupler about its centroid", ge=0.0)
    coupler_centroid_along_m: float = quantity("m", "coupler centroid from the crank pin along the coupler")
    coupler_centroid_across_m: float = quantity("m", "coupler centroid across the coupler", default=0.0)
    rocker_mass_kg: float = quantity("kg", "mass of rocker and striker", gt=0.0)
    rocker_inertia_kg_m2: float = quantity("kg m^2", "inertia of rocker and striker about the rocker bearing", gt=0.0)
    rocker_centroid_along_m: float = quantity("m", "rocker centroid from its bearing along the rocker")
    rocker_centroid_across_m: float = quantity("m", "rocker centroid across the rocker", default=0.0)
    initial_crank_deg: float = quantity("deg", "crank angle at the start, from the line of the bearings", default=0.0)

    @property
    def four_bar(self) -> FourBar:
        """The linkage in the body's frame: origin on the crank axis, x towards the rocker bearing."""
        return FourBar(self.crank_m, self.coupler_m, self.rocker_m, self.ground_m, 0.0, OPEN)

    @model_validator(mode="after")
    def _turns_fully(self) -> LinkageParameters:
        failing = failing_inequality(self.four_bar, crank_rocker=True)
        if failing:
            raise ValueError(failing)
        sharpest = min(
            transmission_deg(self, self.ground_m - self.crank_m), transmission_deg(self, self.ground_m + self.crank_m)
        )
        if sharpest < LEAST_TRANSMISSION_DEG:
            raise ValueError(
                f"the transmission angle between coupler_m and rocker_m falls to {sharpest:.3g} deg with ground_m "
                f"{self.ground_m:g}: at least {LEAST_TRANSMISSION_DEG:g} deg keep the linkage from a change point"
            )
        return self

    @model_validator(mode="after")
    def _masses_are_within_reach(self) -> LinkageParameters:
        reach = MOST_REACH * max(self.ground_m, self.coupler_m, self.rocker_m)
        lengths = [f"{link}_centroid_{way}_m" for link in LINKS for way in ("along", "across")]
        for key in lengths:
            if abs(getattr(self, key)) > reach:
                raise ValueError(
                    f"{key} must be at most {reach:.6g} m either way, {MOST_REACH:g} times the longest link; "
                    f"got {getattr(self, key):g}"
                )
        for link in LINKS:
            inertia, most = getattr(self, f"{link}_inertia_kg_m2"), getattr(self, f"{link}_mass_kg") * reach * reach
            if inertia > most:
                raise ValueError(
                    f"{link}_inertia_kg_m2 must be at most {most:.6g}, {link}_mass_kg at {MOST_REACH:g} times the "
                    f"longest link; got {inertia:g}"
                )
        if self.striker_arm_m > reach:
            raise ValueError(
                f"striker_arm_m must be at most {reach:.6g} m, {MOST_REACH:g} times the longest link; "
                f"got {self.striker_arm_m:g}"
            )
        return self

    @model_validator(mode="after")
    def _inertias_are_about_their_axes(self) -> LinkageParameters:
        own = self.crank_mass_kg * (self.crank_centroid_along_m**2 + self.crank_centroid_across_m**2)
        if self.crank_inertia_kg_m2 < own:
            raise ValueError(
                f"crank_inertia_kg_m2 is about the crank axis and must be at least mass x centroid distance squared = "
                f"{own:.6g} kg m^2; got {self.crank_inertia_kg_m2:g}"
            )
        own = self.rocker_mass_kg * (self.rocker_centroid_along_m**2 + self.rocker_centroid_across_m**2)
        if self.rocker_inertia_kg_m2 <= own:
            raise ValueError(
                f"rocker_inertia_kg_m2 is about the bearing and must exceed mass x centroid distance squared = "
                f"{own:.6g} kg m^2; got {self.rocker_inertia_kg_m2:g}"
            )
        return self


def _angle_between(first_m: float, second_m: float, across_m: float) -> float:
    """Return the angle (rad) between two sides of a triangle from the length of the third."""
    cosine = (first_m**2 + second_m**2 - across_m**2) / (2.0 * first_m * second_m)
    return math.acos(min(max(cosine, -1.0), 1.0))


def transmission_deg(link: LinkageParameters, across_m: float) -> float:
    """Return the acute angle (deg) of coupler and rocker, the crank pin this far (m) from the rocker bearing."""
    angle = math.degrees(_angle_between(link.coupler_m, link.rocker_m, across_m))
    return min(angle, 180.0 - angle)


def rocker_angle(link: LinkageParameters, reach_m: float) -> float:
    """Return the angle (rad) between rocker and ground link, the rocker pin this far (m) from the crank axis."""
    return _angle_between(link.rocker_m, link.ground_m, reach_m)


def start_angle(link: LinkageParameters) -> float:
    """Return the angle (rad) between rocker and ground link at the start."""
    pin = cmath.rect(link.crank_m, math.radians(link.initial_crank_deg))
    span = link.ground_m - pin
    joint = pin + cmath.rect(
        link.coupler_m, cmath.phase(span) - _angle_between(abs(span), link.coupler_m, link.rocker_m)
    )
    return rocker_angle(link, abs(joint))
