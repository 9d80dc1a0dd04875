"""Yarn package on a drum: its radius, its speed and the torque that its changing mass asks for.

::

              yarn, speed theta
        <-----------------------+
                         , - ~ ~| ,
                     , '        |   ' ,        R    radius of the package
                   ,        rho |       ,      e    offset of its centre from the axis
                  ,             |        ,     phi  drum angle, counter-clockwise
                  ,     c <--e--O        ,     rho = R + e cos(phi), arm of the tangent yarn
                   ,                    ,      omega = theta / rho
                     ,                , '
                       ' - , _ _ , - '

Unwinding (L = layer / (2 pi) > 0) by conservation of area R' = -L theta / R; winding is the same with L negative.
"""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import NamedTuple

from pydantic import model_validator

from mech_twin.kernel import kernel
from mech_twin.quantity import Parameters, quantity


class WoundPackage(Parameters):
    """A yarn package, its drum and the yarn that runs off or onto it."""

    package_radius_m: float = quantity("m", "radius of the full package", gt=0.0)
    core_radius_m: float = quantity("m", "radius of the bare drum, where the package is empty", gt=0.0)
    package_width_m: float = quantity("m", "width of the package along the axis", gt=0.0)
    eccentricity_m: float = quantity(
        "m", "offset of the package's centre from the axis; 0 is the ideal package", ge=0.0
    )
    layer_thickness_m: float = quantity("m", "thickness of one layer of yarn", gt=0.0)
    yarn_speed_m_per_s: float = quantity("m/s", "rated yarn speed", gt=0.0, live=True)
    yarn_acceleration_m_per_s2: float = quantity("m/s2", "acceleration of the yarn while its speed changes", ge=0.0)
    package_density_kg_per_m3: float = quantity("kg/m3", "density of the package, its specific weight over g", gt=0.0)
    drum_inertia_kg_m2: float = quantity("kg m2", "moment of inertia of the bare drum", ge=0.0)

    @model_validator(mode="after")
    def _sizes_fit(self) -> WoundPackage:
        if self.package_radius_m <= self.core_radius_m:
            raise ValueError(
                f"package_radius_m > core_radius_m fails: {self.package_radius_m} m > {self.core_radius_m} m"
            )
        if self.eccentricity_m >= self.core_radius_m:
            raise ValueError(f"eccentricity_m < core_radius_m fails: {self.eccentricity_m} m < {self.core_radius_m} m")
        return self


class Package(NamedTuple):
    """The constants of a package: SI; ``layer_m`` is L, negative for winding."""

    core_m: float
    width_m: float
    eccentricity_m: float
    layer_m: float
    density: float
    drum_inertia: float


class Torque(NamedTuple):
    """Torque on a package (N m), term by term; ``total`` is their sum."""

    acceleration: float
    radius: float
    eccentric: float
    mass: float
    total: float


def package_constants(parameters: WoundPackage, winding: bool) -> Package:
    """Return the constants of the kernels; winding turns the sign of L."""
    layer = parameters.layer_thickness_m / (2.0 * pi)
    return Package(
        parameters.core_radius_m,
        parameters.package_width_m,
        parameters.eccentricity_m,
        -layer if winding else layer,
        parameters.package_density_kg_per_m3,
        parameters.drum_inertia_kg_m2,
    )


@kernel
def package_inertia(p: Package, radius: float) -> float:
    """Return the moment of inertia J0 of drum and package (kg m2) at a package radius (m); e^2 is neglected."""
    return p.drum_inertia + 0.5 * pi * p.density * p.width_m * (radius**4 - p.core_m**4)


@kernel
def package_mass(p: Package, radius: float) -> float:
    """Return the mass of the yarn on the drum (kg)."""
    return pi * p.density * p.width_m * (radius**2 - p.core_m**2)


@kernel
def tangent_arm(p: Package, radius: float, phi: float) -> float:
    """Return rho = R + e cos(phi), the arm of the yarn (m)."""
    return radius + p.eccentricity_m * cos(phi)


@kernel
def speed_terms(p: Package, radius: float, phi: float, theta: float, a: float) -> tuple[float, float, float]:
    """Return the terms of d(omega)/dt (rad/s2): a/rho, theta^2 L/(rho^2 R), theta^2 e sin(phi)/rho^3."""
    rho = tangent_arm(p, radius, phi)
    square = theta * theta
    return a / rho, square * p.layer_m / (rho * rho * radius), square * p.eccentricity_m * sin(phi) / rho**3


@kernel
def torque_terms(p: Package, radius: float, phi: float, theta: float, a: float) -> Torque:
    """Return the torque on drum and package, each term by itself.

    M = J0 [a/rho + theta^2 L/(rho^2 R) + theta^2 e sin(phi)/rho^3] - pi H gamma0/g theta^2 L R^2/rho.

    Parameters
    ----------
    p : Package
        Constants.
    radius, phi : float
        Package radius (m), drum angle (rad).
    theta, a : float
        Yarn speed (m/s) and acceleration (m/s2).

    Notes
    -----
    After (23)-(25) of [winding_drum], with R^3 in dJ/dR (the printed last term is a force).  The last term is
    omega/2 dJ/dt: the factor 1/2 is the usual variable-mass convention, assumed here; with it M omega is exactly the
    rate of J0 omega^2/2.
    """
    inertia = package_inertia(p, radius)
    first, second, third = speed_terms(p, radius, phi, theta, a)
    rho = tangent_arm(p, radius, phi)
    mass = -pi * p.width_m * p.density * theta * theta * p.layer_m * radius * radius / rho
    first, second, third = inertia * first, inertia * second, inertia * third
    return Torque(first, second, third, mass, first + second + third + mass)


@kernel
def rate_of_momentum(p: Package, radius: float, phi: float, theta: float, a: float) -> float:
    """Return the same torque (N m) by the chain rule: J d(theta/rho)/dt + omega/2 dJ/dR R'."""
    rho = tangent_arm(p, radius, phi)
    omega = theta / rho
    radius_rate = -p.layer_m * theta / radius
    rho_rate = radius_rate - p.eccentricity_m * sin(phi) * omega
    inertia_rate = 2.0 * pi * p.density * p.width_m * radius**3 * radius_rate
    return package_inertia(p, radius) * (a - omega * rho_rate) / rho + 0.5 * omega * inertia_rate


@kernel
def radius_after(p: Package, radius: float, length: float) -> float:
    """Return the radius (m) after a length of yarn (m) has run: R^2 - 2 L s, the area law integrated."""
    return sqrt(radius * radius - 2.0 * p.layer_m * length)


@kernel
def time_of_length(theta: float, a: float, length: float) -> float:
    """Return when a length of yarn (m) has run at speed theta + a t: the stable root of the quadratic (s)."""
    return 2.0 * length / (theta + sqrt(theta * theta + 2.0 * a * length))


@kernel
def _rates(p: Package, radius: float, phi: float, theta: float, a: float, t: float) -> tuple[float, float]:
    speed = theta + a * t
    now = radius_after(p, radius, (theta + 0.5 * a * t) * t)
    omega = speed / tangent_arm(p, now, phi)
    return omega, torque_terms(p, now, phi, speed, a).total * omega


@kernel
def turned(p: Package, radius: float, phi: float, theta: float, a: float, h: float) -> tuple[float, float]:
    """Return the drum angle after h seconds (rad) and the work of the torque meanwhile (J).

    The radius is known in closed form, so only phi' = theta/rho is integrated: Dormand and Prince's fifth-order
    weights, in two halves of the step.
    """
    work = 0.0
    g = 0.5 * h
    for i in range(2):
        t = i * g
        k1, w1 = _rates(p, radius, phi, theta, a, t)
        k2, _ = _rates(p, radius, phi + g * k1 / 5.0, theta, a, t + g / 5.0)
        k3, w3 = _rates(p, radius, phi + g * (3.0 * k1 + 9.0 * k2) / 40.0, theta, a, t + 0.3 * g)
        k4, w4 = _rates(
            p, radius, phi + g * (44.0 / 45.0 * k1 - 56.0 / 15.0 * k2 + 32.0 / 9.0 * k3), theta, a, t + 0.8 * g
        )
        x5 = 19372.0 / 6561.0 * k1 - 25360.0 / 2187.0 * k2 + 64448.0 / 6561.0 * k3 - 212.0 / 729.0 * k4
        k5, w5 = _rates(p, radius, phi + g * x5, theta, a, t + 8.0 / 9.0 * g)
        x6 = 9017.0 / 3168.0 * k1 - 355.0 / 33.0 * k2 + 46732.0 / 5247.0 * k3 + 49.0 / 176.0 * k4
        x6 -= 5103.0 / 18656.0 * k5
        k6, w6 = _rates(p, radius, phi + g * x6, theta, a, t + g)
        phi += g * (
            35.0 / 384.0 * k1 + 500.0 / 1113.0 * k3 + 125.0 / 192.0 * k4 - 2187.0 / 6784.0 * k5 + 11.0 / 84.0 * k6
        )
        work += g * (
            35.0 / 384.0 * w1 + 500.0 / 1113.0 * w3 + 125.0 / 192.0 * w4 - 2187.0 / 6784.0 * w5 + 11.0 / 84.0 * w6
        )
    return phi, work
