# SPDX-License-Identifier: Apache-2.0
r"""Yarn package on a drum: its radius, its speed and the torque required by its changing mass.

::

              yarn, speed theta
        <-----------------------+
                         , - ~ ~| ,
                     , '   c    |   ' ,        R    radius of the package
                   ,        \   | rho   ,      e    offset Oc of its centre from the axis
                  ,        e \phi        ,     phi  drum angle, counter-clockwise from the upright
                  ,           \|        ,     rho = R + e cos(phi), arm of the yarn that leaves at the top
                   ,            O       ,      omega = theta / rho
                     ,                , '      c = (-e sin(phi), e cos(phi)), weight acts downwards there
                       ' - , _ _ , - '

Unwinding (L = layer / (2 pi) > 0) by conservation of area R' = -L theta / R; winding is the same with L negative.
"""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import NamedTuple

from mech_twin.kernels.kernel import embedded_kernel, kernel


class Package(NamedTuple):
    """The constants of a package: SI; ``layer_m`` is L, negative for winding."""

    core_m: float
    width_m: float
    eccentricity_m: float
    layer_m: float
    density: float
    drum_inertia: float
    gravity: float = 9.80665
    coulomb_nm: float = 0.0
    viscous_nms_per_rad: float = 0.0


class Wound(NamedTuple):
    """Size of the package: radius R (m), and R^2 - c^2 (m2) with the core's radius c.

    On a nearly bare drum the differences of squares and of fourth powers lose digits.  Mass and inertia are therefore
    computed from the area, which is integrated with the yarn besides the radius.
    """

    radius_m: float
    square_m2: float


class PackageTorque(NamedTuple):
    """Torque on a package (N m), term by term; ``total`` is their sum."""

    acceleration: float
    radius: float
    eccentric: float
    mass: float
    total: float


@embedded_kernel
def wound_at(p: Package, radius: float) -> Wound:
    """Return the size of the package at a radius (m)."""
    return Wound(radius, (radius - p.core_m) * (radius + p.core_m))


@embedded_kernel
def wound_after(p: Package, wound: Wound, length: float) -> Wound:
    """Return the size of the package after a length of yarn (m) has run: R^2 - 2 L s, the area law integrated."""
    return Wound(radius_after(p, wound.radius_m, length), wound.square_m2 - 2.0 * p.layer_m * length)


@embedded_kernel
def package_inertia(p: Package, wound: Wound) -> float:
    """Return the moment of inertia J0 of drum and package (kg m2), by R^4 - c^4 from the area; e^2 is neglected."""
    quartic = wound.square_m2 * (wound.square_m2 + 2.0 * p.core_m * p.core_m)
    return p.drum_inertia + 0.5 * pi * p.density * p.width_m * quartic


@embedded_kernel
def package_mass(p: Package, wound: Wound) -> float:
    """Return the mass of the yarn on the drum (kg)."""
    return pi * p.density * p.width_m * wound.square_m2


@embedded_kernel
def tangent_arm(p: Package, radius: float, phi: float) -> float:
    """Return rho = R + e cos(phi), the arm of the yarn (m)."""
    return radius + p.eccentricity_m * cos(phi)


@embedded_kernel
def speed_terms(p: Package, radius: float, phi: float, theta: float, a: float) -> tuple[float, float, float]:
    """Return the terms of d(omega)/dt (rad/s2): a/rho, theta^2 L/(rho^2 R), theta^2 e sin(phi)/rho^3."""
    rho = tangent_arm(p, radius, phi)
    square = theta * theta
    return a / rho, square * p.layer_m / (rho * rho * radius), square * p.eccentricity_m * sin(phi) / rho**3


@embedded_kernel
def torque_terms(p: Package, wound: Wound, phi: float, theta: float, a: float) -> PackageTorque:
    """Return the torque on drum and package, each term by itself.

    M = J0 [a/rho + theta^2 L/(rho^2 R) + theta^2 e sin(phi)/rho^3] - pi H gamma0/g theta^2 L R^2/rho.

    Parameters
    ----------
    p : Package
        Constants.
    wound : Wound
        Size of the package.
    phi : float
        Drum angle (rad).
    theta, a : float
        Yarn speed (m/s) and acceleration (m/s2).

    Notes
    -----
    After (23)-(25) of [winding_drum], with R^3 in dJ/dR (the printed last term is a force).  The last term is
    omega/2 dJ/dt: the factor 1/2 is the usual variable-mass convention, assumed here; with it M omega is exactly the
    rate of J0 omega^2/2.
    """
    inertia, radius = package_inertia(p, wound), wound.radius_m
    first, second, third = speed_terms(p, radius, phi, theta, a)
    rho = tangent_arm(p, radius, phi)
    mass = -pi * p.width_m * p.density * theta * theta * p.layer_m * radius * radius / rho
    first, second, third = inertia * first, inertia * second, inertia * third
    return PackageTorque(first, second, third, mass, first + second + third + mass)


@kernel
def rate_of_momentum(p: Package, wound: Wound, phi: float, theta: float, a: float) -> float:
    """Return the same torque (N m) by the chain rule: J d(theta/rho)/dt + omega/2 dJ/dR R'."""
    radius = wound.radius_m
    rho = tangent_arm(p, radius, phi)
    omega = theta / rho
    radius_rate = -p.layer_m * theta / radius
    rho_rate = radius_rate - p.eccentricity_m * sin(phi) * omega
    inertia_rate = 2.0 * pi * p.density * p.width_m * radius**3 * radius_rate
    return package_inertia(p, wound) * (a - omega * rho_rate) / rho + 0.5 * omega * inertia_rate


@embedded_kernel
def radius_after(p: Package, radius: float, length: float) -> float:
    """Return the radius (m) after a length of yarn (m) has run: R^2 - 2 L s, the area law integrated."""
    return sqrt(radius * radius - 2.0 * p.layer_m * length)


@embedded_kernel
def gravity_moment(p: Package, wound: Wound, phi: float) -> float:
    """Return the moment of the offset package's weight about the axis, m g e sin(phi), counter-clockwise (N m)."""
    return package_mass(p, wound) * p.gravity * p.eccentricity_m * sin(phi)
