# SPDX-License-Identifier: Apache-2.0
"""Drawing of the winding drum: package, core, eccentricity with its direction, and the yarn."""

from math import cos, sin

from mech_twin.capabilities.figure import (
    CRANK,
    FOLLOWER,
    GROUND,
    MATERIAL,
    ROD,
    STEEL,
    Point,
    bearing,
    circle,
    label,
    millimetres,
)
from mech_twin.capabilities.mechanism import ROOT, Bar, FrameTree, fixed, sliding, turning
from mech_twin.machines.winding_drum.dynamics import Package
from mech_twin.samples import LinkageSample, Shape

SEEN_ECCENTRICITY = 0.25  # drawn length of the eccentricity's arrow, in radii of the core
TURN_POINTS = 10


def package_drawing(package: Package, sample: LinkageSample) -> tuple[Shape, ...]:
    """Return package, core, a mark that turns with it, eccentricity, and the yarn that touches at the top."""
    phi, _, radius = sample.position
    x, y = -package.eccentricity_m * sin(phi), package.eccentricity_m * cos(phi)
    top = y + radius
    outward = (-sin(phi), cos(phi))
    winds = package.layer_m < 0.0
    reach = 4.0 * package.core_m + radius
    # the drum turns anticlockwise, so that its top goes left: what is wound comes from the right
    away = x + reach if winds else x - reach
    half = 0.5 * (x + away)
    speed = sample.joint("drum").velocity
    sense = "winding" if winds else "unwinding"
    wound = radius - package.core_m
    layers = enumerate((package.core_m + share * wound for share in (1.0 / 3.0, 2.0 / 3.0)), 1)  # stand for all
    return (
        Shape("frame", "line", bearing((0.0, 0.0), 0.35 * package.core_m), GROUND, 0.004),
        Shape("package", "line", circle((x, y), radius, 72), MATERIAL, 0.008),
        *(Shape(f"layer_{i}", "line", circle((x, y), r), MATERIAL, 0.002) for i, r in layers),
        Shape("core", "line", circle((0.0, 0.0), package.core_m), STEEL, 0.006),
        Shape("mark", "line", ((0.0, 0.0), (x - radius * sin(phi), y + radius * cos(phi))), ROD, 0.003),
        Shape("yarn", "line", ((x, top), (away, top)), FOLLOWER, 0.004),
        Shape("yarn_pull", "arrow", ((half + 0.06, top), (half - 0.06, top)), FOLLOWER, 0.006, "yarn"),
        label("package_name", (x, y + 0.5 * (radius + package.core_m)), f"package, {sense}", MATERIAL),
        label("core_name", (0.0, -0.4 * package.core_m), "core"),
        *_turning(radius, speed),
        *_eccentricity(package, outward),
        Shape("axis", "points", ((0.0, 0.0),), STEEL, 0.014),
    )


def _turning(radius_m: float, speed_rad_per_s: float) -> tuple[Shape, ...]:
    """Return an arc with a head that shows in which direction the drum turns; nothing at rest."""
    if speed_rad_per_s == 0.0:
        return ()
    sense = 1.0 if speed_rad_per_s > 0.0 else -1.0
    reach = 0.78 * radius_m
    angles = [-0.6 + sense * (1.0 * i / (TURN_POINTS - 1.0) - 0.5) for i in range(TURN_POINTS)]
    arc = tuple((reach * cos(angle), reach * sin(angle)) for angle in angles)
    return (
        Shape("turning", "line", arc[:-1], CRANK, 0.005),
        Shape("turning_head", "arrow", arc[-2:], CRANK, 0.005),
    )


def _eccentricity(package: Package, outward: Point) -> tuple[Shape, ...]:
    """Return an arrow from the axis towards the middle of the package, longer than it is; nothing if centred."""
    if package.eccentricity_m == 0.0:
        return ()
    length = max(package.eccentricity_m, SEEN_ECCENTRICITY * package.core_m)
    end = (length * outward[0], length * outward[1])
    text = f"eccentricity {millimetres(package.eccentricity_m)}"
    return (Shape("eccentricity", "arrow", ((0.0, 0.0), end), CRANK, 0.006, text),)


def mechanism(package: Package, largest_radius_m: float) -> FrameTree:
    """Return the frames; ``package`` is turned back to the machine's axes, `yarn_exit` lies a radius above it."""
    middle = (0.0, package.eccentricity_m)
    return FrameTree(
        (
            fixed(ROOT, "shaft"),
            turning("drum", "shaft", "drum"),
            turning("drum", "drum", "package", middle, ratio=-1.0),
            sliding("package_radius", "package", "yarn_exit", (0.0, 1.0), largest_radius_m),
        ),
        (),
        (
            Bar("drum", (0.0, -package.core_m), (0.0, package.core_m), 0.004, (90, 90, 90)),
            Bar("yarn_exit", (-4.0 * package.core_m, 0.0), (0.0, 0.0), 0.002, (60, 90, 180)),
        ),
        ("yarn", "motor"),
        mass_remarks=("drum: its mass is not known; that of the yarn on it changes while it winds",),
    )
