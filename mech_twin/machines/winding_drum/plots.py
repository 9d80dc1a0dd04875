# SPDX-License-Identifier: Apache-2.0
"""Figure of the winding drum: the terms of the torque over a turn."""

from __future__ import annotations

from collections.abc import Iterator
from math import pi

import numpy as np

from mech_twin.capabilities.plots import BLUE, GREEN, ORANGE, RED, Picture, sheet, turn_axis
from mech_twin.machines.winding_drum.parameters import WindingDrum, package_constants
from mech_twin.machines.winding_drum.wound_package import PackageTorque, torque_terms, wound_at


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
