# SPDX-License-Identifier: Apache-2.0
"""Coupling of the roller former: trends with damping, what the sweeps say of the published stiffness."""

import numpy as np
import pytest
from roller_former_cases import parameters_for

from mech_twin.machines.roller_former.sizing import (
    PUBLISHED_STIFFNESS,
    coupling_point,
    damping_sweep,
    installation,
)

STUDIED = (2, 3, 4)


@pytest.mark.parametrize("carts", (1, 2, 3, 4))
def test_the_installation_made_from_one_is_the_configuration_of_the_other(carts):
    assert installation(parameters_for(2), carts) == parameters_for(carts)


@pytest.mark.parametrize("carts", STUDIED)
def test_the_coupling_moment_falls_with_damping_most_of_it_before_8000(carts):
    points = damping_sweep(parameters_for(carts), (200.0, 500.0, 1000.0, 2000.0, 4000.0, 8000.0, 15000.0))
    for name in ("coupling_max_nm", "coupling_rms_nm", "elastic_max_nm", "coupling_rms_about_mean_nm"):
        values = [getattr(point, name) for point in points]
        assert values == sorted(values, reverse=True), name
    most = [point.coupling_max_nm for point in points]
    assert most[0] - most[-2] > 0.8 * (most[0] - most[-1])


@pytest.mark.slow
@pytest.mark.parametrize("carts", STUDIED)
def test_the_published_stiffness_is_no_unique_minimum(carts):
    parameters = parameters_for(carts)
    published = parameters.drive.stiffness_nm_per_rad
    assert published == PUBLISHED_STIFFNESS[carts]
    damping = parameters.drive.damping_nms_per_rad
    stiffness = np.geomspace(20000.0, 800000.0, 41)
    most = np.array([coupling_point(parameters, c, damping).coupling_max_nm for c in stiffness])
    minima = np.flatnonzero((most[1:-1] < most[:-2]) & (most[1:-1] < most[2:])) + 1
    near = [i for i in minima if stiffness[i - 1] <= published <= stiffness[i + 1]]
    lowest = int(np.nanargmin(most))
    assert not (len(minima) == 1 and near == [lowest])
    assert most[lowest] <= coupling_point(parameters, published, damping).coupling_max_nm


def test_the_coupling_is_well_within_its_rated_moment():
    for carts in STUDIED:
        (point,) = damping_sweep(parameters_for(carts), (8000.0,))
        assert 0.2 < point.share_of_rated < 0.5
