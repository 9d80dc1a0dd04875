# SPDX-License-Identifier: Apache-2.0
"""What a winding drum may be: each size to its bound and not past it, told in one line, and what follows from them."""

from __future__ import annotations

import math
from typing import Any

import pytest
from parameter_bounds import has_range, live_names
from pydantic import ValidationError

from mech_twin.machines.winding_drum.dynamics import package_inertia, wound_at
from mech_twin.machines.winding_drum.parameters import WindingDrum, YarnSupply, package_constants

VALID: dict[str, Any] = {
    "package_radius_m": 0.25,
    "core_radius_m": 0.125,
    "package_width_m": 1.5,
    "eccentricity_m": 0.0,
    "layer_thickness_m": 0.001,
    "yarn_speed_m_per_s": 8.0,
    "yarn_acceleration_m_per_s2": 2.0,
    "package_density_kg_per_m3": 400.0,
    "drum_inertia_kg_m2": 0.75,
    "supply": {"initial_fraction": 0.0},
    "coupling": {"step_s": 0.001},
}


def drum(**changes: Any) -> WindingDrum:
    return WindingDrum(**{**VALID, **changes})


def refusal(**changes: Any) -> str:
    with pytest.raises(ValidationError) as refused:
        drum(**changes)
    (error,) = refused.value.errors()
    return str(error["msg"])


@pytest.mark.parametrize("key", ["package_radius_m", "core_radius_m", "layer_thickness_m"])
def test_a_size_is_a_micrometre_at_least(key: str) -> None:
    assert refusal(**{key: 0.999e-6}) == "Input should be greater than or equal to 0.000001"


@pytest.mark.parametrize(
    ("key", "smallest", "largest"),
    [
        ("package_width_m", 1e-6, 1e4),
        ("yarn_speed_m_per_s", 1e-9, 1e4),
        ("yarn_acceleration_m_per_s2", 0.0, 1e4),
        ("package_density_kg_per_m3", 1e-3, 1e5),
        ("drum_inertia_kg_m2", 1e-12, 1e8),
        ("gravity_m_per_s2", 0.0, 1e4),
    ],
)
def test_a_number_may_be_all_that_its_unit_may_but_not_below_0(key: str, smallest: float, largest: float) -> None:
    legal = {**VALID, "supply": {"initial_fraction": 0.0, "rate_per_s": 1.0}}
    assert has_range(WindingDrum, legal, key, smallest, largest)


def test_a_package_may_be_centred_and_not_off_centre_by_less_than_0() -> None:
    assert drum(eccentricity_m=0.0).eccentricity_m == 0.0
    assert refusal(eccentricity_m=-5e-324) == "Input should be greater than or equal to 0"


def test_the_supply_s_fraction_is_between_0_and_1_and_its_rate_above_0() -> None:
    assert has_range(YarnSupply, {"initial_fraction": 0.5}, "initial_fraction", 0.0, 1.0)
    assert has_range(YarnSupply, {"initial_fraction": 0.5}, "rate_per_s", 1e-6, 1e6)
    assert YarnSupply(initial_fraction=0.5).rate_per_s is None


def test_only_the_yarn_s_speed_may_change_while_it_runs() -> None:
    assert live_names(WindingDrum) == {"yarn_speed_m_per_s"}


def test_gravity_is_standard_bearings_are_smooth_and_yarn_unwinds_unless_said() -> None:
    found = drum()
    assert (found.gravity_m_per_s2, found.direction) == (9.80665, "unwinding")
    assert (found.friction.coulomb_nm, found.friction.viscous_nms_per_rad) == (0.0, 0.0)


def test_the_package_is_larger_than_its_core_by_a_thousandth() -> None:
    assert "package_radius_m >= 1.001 core_radius_m fails: 0.125 m >=" in refusal(package_radius_m=0.125)
    assert "package_radius_m >= 1.001 core_radius_m fails: 0.1 m >=" in refusal(package_radius_m=0.1)
    least = 1.001 * 0.125
    assert drum(package_radius_m=least, layer_thickness_m=1e-5).package_radius_m == least
    below = math.nextafter(least, 0.0)
    told = refusal(package_radius_m=below, layer_thickness_m=1e-5)
    assert f"package_radius_m >= 1.001 core_radius_m fails: {below!r} m >= {least!r} m" in told


def test_the_axis_keeps_a_tenth_of_the_core_s_radius_from_the_yarn() -> None:
    most = 0.9 * 0.125
    assert drum(eccentricity_m=most).eccentricity_m == most
    past = math.nextafter(most, 1.0)
    assert f"eccentricity_m <= 0.9 core_radius_m fails: {past} m <= 0.1125 m" in refusal(eccentricity_m=past)


def test_a_layer_is_no_thicker_than_what_is_wound() -> None:
    assert drum(layer_thickness_m=0.125).layer_thickness_m == 0.125
    past = math.nextafter(0.125, 1.0)
    told = refusal(layer_thickness_m=past)
    assert f"layer_thickness_m <= package_radius_m - core_radius_m fails: {past} m <= 0.125 m" in told


def test_the_supply_s_rate_is_the_yarn_s_acceleration_over_its_speed_unless_given() -> None:
    assert drum().rate_per_s == 2.0 / 8.0
    given = {"initial_fraction": 0.0, "rate_per_s": 3.0}
    assert drum(supply=given).rate_per_s == 3.0
    assert drum(supply=given, yarn_acceleration_m_per_s2=0.0).rate_per_s == 3.0
    assert "it gives supply.rate_per_s where that is absent" in refusal(yarn_acceleration_m_per_s2=0.0)


def test_the_drum_turns_by_2000_rad_at_most_in_a_step() -> None:
    long: dict[str, Any] = {"eccentricity_m": 0.025, "coupling": {"step_s": 0.0625}}
    most = 2000.0 * (0.125 - 0.025) / 0.0625  # of the yarn, at its shortest arm
    assert drum(**long, yarn_speed_m_per_s=most * (1.0 - 1e-12))
    told = refusal(**long, yarn_speed_m_per_s=most * (1.0 + 1e-6))
    assert "yarn_speed_m_per_s coupling.step_s / (core_radius_m - eccentricity_m) <= 2000 fails" in told
    assert "the drum would turn by 2e+03 rad in one step; shorten coupling.step_s" in told


def test_bearings_slow_the_full_package_by_no_more_than_ten_thousand_time_constants_in_a_step_of_winding() -> None:
    package = package_constants(drum(), True)
    inertia = package_inertia(package, wound_at(package, 0.25))
    most = 1e4 * inertia / 0.001
    below, past = ({"viscous_nms_per_rad": most * (1.0 + e)} for e in (-1e-12, 1e-6))
    assert drum(direction="winding", friction=below)
    told = refusal(direction="winding", friction=past)
    assert "friction.viscous_nms_per_rad coupling.step_s / inertia of the full package <= 10000 fails" in told
    assert "1e+04; shorten coupling.step_s" in told
    assert drum(direction="unwinding", friction=past)


def test_yarn_runs_from_the_full_radius_to_the_core_s_or_back() -> None:
    assert drum(direction="unwinding").radii_m == (0.25, 0.125)
    assert drum(direction="winding").radii_m == (0.125, 0.25)


@pytest.mark.parametrize("winding", [False, True])
def test_the_constants_are_the_configuration_s_and_winding_thickens_by_a_layer_a_turn(winding: bool) -> None:
    friction = {"coulomb_nm": 3.0, "viscous_nms_per_rad": 0.5}
    found = package_constants(drum(eccentricity_m=0.01, gravity_m_per_s2=9.0, friction=friction), winding)
    layer = found.layer_m * 2.0 * math.pi  # the radius changes by the layer in a turn: dR/dphi = L
    assert layer == pytest.approx(0.001 if not winding else -0.001, rel=1e-15)
    assert found._replace(layer_m=0.0) == (0.125, 1.5, 0.01, 0.0, 400.0, 0.75, 9.0, 3.0, 0.5)
