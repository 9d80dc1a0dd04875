# SPDX-License-Identifier: Apache-2.0
"""Published formulas of the winding drum, a fragment without numbers, and the terms of its torque over a turn."""

from collections.abc import Iterator
from math import pi

import numpy as np

from mech_twin.capabilities.plots import BLUE, GREEN, ORANGE, RED, Picture, sheet, turn_axis
from mech_twin.capabilities.published import Literature, PublishedRow
from mech_twin.machines.winding_drum.dynamics import PackageTorque, torque_terms, wound_at
from mech_twin.machines.winding_drum.metrics import package_metrics
from mech_twin.machines.winding_drum.parameters import WindingDrum, package_constants

PAPER = "winding fragment"


def pictures(parameters: WindingDrum) -> Iterator[Picture]:
    """Yield the figure."""
    p, package = parameters, package_constants(parameters, winding=False)
    angles = np.linspace(0.0, 2.0 * pi, 361)
    terms = [
        torque_terms(package, wound_at(package, p.package_radius_m), phi, p.yarn_speed_m_per_s, 0.0) for phi in angles
    ]
    turn = PackageTorque(*np.array(terms).T)
    figure, panels = sheet(1, 2, 8.2, 3.8)
    panels[0].plot(np.degrees(angles), turn.eccentric, color=RED, label="eccentric term")
    panels[0].plot(np.degrees(angles), turn.total, color=BLUE, linestyle="--", label="sum, steady")
    panels[1].plot(np.degrees(angles), turn.radius, color=GREEN, label="radius")
    panels[1].plot(np.degrees(angles), turn.mass, color=ORANGE, label="mass")
    for axes, title in zip(panels, ("eccentric package (eqs. (24), (25))", "terms of the ideal package"), strict=True):
        turn_axis(axes, r"drum angle $\varphi$, degrees")
        axes.set_title(title)
        axes.set_ylabel(r"torque $M$, N m")
        axes.legend()
    caption = (
        "Eqs. (24), (25), steady unwinding: the eccentric term is nearly harmonic and changes sign twice a turn, the"
    )
    yield Picture("winding_drum_torque", f"{caption} ideal terms never do. The fragment has no figure.", figure)


def rows(parameters: WindingDrum) -> Iterator[PublishedRow]:
    """Yield the rows, the misprinted term first; those of the eccentric term where there is one."""
    package = package_constants(parameters, winding=False)
    radius, theta = parameters.package_radius_m, parameters.yarn_speed_m_per_s
    a = parameters.yarn_acceleration_m_per_s2
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
    report = package_metrics(parameters, package)
    yield paper.at("eq. (25)").gated(
        "sign changes of the ideal terms in a turn",
        0.0,
        report["ideal_terms_sign_changes_per_turn"],
        "e = 0",
        absolute=0.0,
    )
    if package.eccentricity_m == 0.0:  # no eccentric term to speak of
        return
    yield paper.at("eq. (25)").gated(
        "sign changes of the eccentric term in a turn",
        2.0,
        report["eccentric_torque_sign_changes_per_turn"],
        "e sin(phi)/rho^3",
        absolute=0.0,
    )
    phi = np.arange(720) * pi / 360.0
    lines = np.abs(np.fft.rfft([torque_terms(package, wound, f, theta, 0.0).eccentric for f in phi]))
    yield paper.at("eq. (25)").unknown(
        "share of harmonics in the eccentric term",
        float(lines[2:].max() / lines[1]),
        "'nearly harmonic' is said without numbers; no figure of the fragment has any",
    )
