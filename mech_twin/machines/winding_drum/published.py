# SPDX-License-Identifier: Apache-2.0
"""Published formulas of the winding drum: a fragment without numbers."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi

import numpy as np

from mech_twin.capabilities.published import Literature, PublishedRow
from mech_twin.machines.winding_drum.metrics import package_metrics
from mech_twin.machines.winding_drum.parameters import WindingDrum, package_constants
from mech_twin.machines.winding_drum.wound_package import torque_terms, wound_at

PAPER = "winding fragment"


def rows(parameters: WindingDrum) -> Iterator[PublishedRow]:
    """Yield the rows, the misprinted term first."""
    package = package_constants(parameters, winding=False)
    radius, theta, a = (
        parameters.package_radius_m,
        parameters.yarn_speed_m_per_s,
        parameters.yarn_acceleration_m_per_s2,
    )
    paper = Literature(PAPER, "eq. (24)", f"R {radius:g} m, e {package.eccentricity_m:g} m, {theta:g} m/s, {a:g} m/s2")
    wound = wound_at(package, radius)
    terms = torque_terms(package, wound, 1.0, theta, a)
    printed = terms.mass / radius
    yield paper.formula(
        "last term (N) for a torque (N m)",
        printed,
        terms.mass,
        "dJ/dR must carry R^3: the printed last term is a force, not a torque",
    )
    report = package_metrics(parameters, package, *parameters.radii_m)
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
    lines = np.abs(np.fft.rfft([torque_terms(package, wound, f, theta, 0.0).eccentric for f in phi]))
    yield paper.at("eq. (25)").unknown(
        "share of harmonics in the eccentric term",
        float(lines[2:].max() / lines[1]),
        "'nearly harmonic' is said without numbers; no figure of the fragment has any",
    )
