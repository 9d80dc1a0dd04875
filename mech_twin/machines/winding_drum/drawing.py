"""Drawing of the winding drum."""

from __future__ import annotations

from math import cos, pi, sin

from mech_twin.machines.winding_drum.roles import place_of
from mech_twin.machines.winding_drum.wound_package import Package
from mech_twin.samples import LinkageSample, Shape


def _circle(x: float, y: float, radius: float) -> tuple[tuple[float, float], ...]:
    angles = [2.0 * pi * i / 72 for i in range(73)]
    return tuple((x + radius * cos(angle), y + radius * sin(angle)) for angle in angles)


def package_drawing(package: Package, sample: LinkageSample) -> tuple[Shape, ...]:
    """Return the package, its core, a mark that turns with it, and the yarn that leaves at the top."""
    at = place_of(sample)
    phi, radius = at.drum_rad, at.package_radius_m
    x, y = -package.eccentricity_m * sin(phi), package.eccentricity_m * cos(phi)
    top = y + radius
    return (
        Shape("package", "line", _circle(x, y, radius), (196, 164, 112), 0.004),
        Shape("core", "line", _circle(0.0, 0.0, package.core_m), (90, 90, 90), 0.004),
        Shape("mark", "line", ((0.0, 0.0), (x - radius * sin(phi), y + radius * cos(phi))), (200, 60, 40), 0.003),
        Shape("yarn", "line", ((x, top), (x - 4.0 * package.core_m - radius, top)), (60, 90, 180), 0.002),
        Shape("axis", "points", ((0.0, 0.0),), (0, 0, 0), 0.008),
    )
