"""Published formulas of the winding drum: a fragment without numbers."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi

import numpy as np

from mech_twin.capabilities.published import CHANGED, CONTRADICTS, Row, Source
from mech_twin.machines.winding_drum.metrics import cycle_report
from mech_twin.machines.winding_drum.parameters import WindingDrum
from mech_twin.machines.winding_drum.wound_package import (
    package_constants,
    rate_of_momentum,
    speed_terms,
    tangent_arm,
    torque_terms,
    turned,
)

PAPER = "winding fragment"


def rows(parameters: WindingDrum) -> Iterator[Row]:
    """Yield the rows, the misprinted term first."""
    package = package_constants(parameters, winding=False)
    radius, theta, a = (
        parameters.package_radius_m,
        parameters.yarn_speed_m_per_s,
        parameters.yarn_acceleration_m_per_s2,
    )
    paper = Source(PAPER, "eq. (24)", f"R {radius:g} m, e {package.eccentricity_m:g} m, {theta:g} m/s, {a:g} m/s2")
    terms = torque_terms(package, radius, 1.0, theta, a)
    printed = terms.mass / radius
    yield paper.reported(
        "last term as printed (N) for a torque (N m)",
        printed,
        terms.mass,
        CONTRADICTS,
        "dJ/dR must carry R^3: the printed last term is a force, not a torque",
    )
    yield paper.gated(
        "torque by the chain rule, N m",
        float(rate_of_momentum(package, radius, 1.0, theta, a)),
        terms.total,
        "with R^3 both routes to the torque agree; the factor 1/2 on omega dJ/dt is assumed",
        relative=1e-10,
        verdict=CHANGED,
    )
    yield paper.at("eq. (23)").gated(
        "d(omega)/dt, rad/s2",
        _difference(parameters),
        float(sum(speed_terms(package, radius, 1.0, theta, a))),
        "central difference of theta/rho along the motion",
        relative=1e-8,
    )
    report = cycle_report(parameters, package, *parameters.radii_m)
    yield paper.at("eq. (25)").gated(
        "sign changes of the eccentric term in a turn",
        2.0,
        report["eccentric_torque_sign_changes_per_turn"],
        "e sin(phi)/rho^3",
        absolute=0.0,
    )
    yield paper.at("eq. (25)").gated(
        "sign changes of the ideal terms in a turn",
        0.0,
        report["ideal_terms_sign_changes_per_turn"],
        "e = 0",
        absolute=0.0,
    )
    phi = np.arange(720) * pi / 360.0
    lines = np.abs(np.fft.rfft([torque_terms(package, radius, f, theta, 0.0).eccentric for f in phi]))
    yield paper.at("eq. (25)").unknown(
        "share of harmonics in the eccentric term",
        float(lines[2:].max() / lines[1]),
        "'nearly harmonic' is said without numbers; no figure of the fragment has any",
    )


def _difference(parameters: WindingDrum) -> float:
    """Return d(omega)/dt by central differences of theta/rho along the motion, extrapolated to no step (Richardson)."""
    package = package_constants(parameters, winding=False)
    radius, theta, a = (
        parameters.package_radius_m,
        parameters.yarn_speed_m_per_s,
        parameters.yarn_acceleration_m_per_s2,
    )

    def omega(t: float) -> float:
        phi, _ = turned(package, radius, 1.0, theta, a, t)
        length = (theta + 0.5 * a * t) * t
        now = (radius * radius - 2.0 * package.layer_m * length) ** 0.5
        return (theta + a * t) / float(tangent_arm(package, now, phi))

    h = 2e-3
    wide, near = (omega(h) - omega(-h)) / (2.0 * h), (omega(0.5 * h) - omega(-0.5 * h)) / h
    return (4.0 * near - wide) / 3.0
