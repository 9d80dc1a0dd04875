# SPDX-License-Identifier: Apache-2.0
import pytest

from mech_twin.declarations.captions import caption, metrics_table, titled


@pytest.mark.parametrize(
    ("name", "words", "unit"),
    [
        ("return_speed_m_per_s", "return speed", "m/s"),
        ("drive_torque_nm", "drive torque", "N m"),
        ("body_inertia_kg_m2", "body inertia", "kg m²"),
        ("crank_speed_rad_per_s", "crank speed", "rad/s"),
        ("spring_rate_n_per_m", "spring rate", "N/m"),
        ("angular_impulse_nms", "angular impulse", "N m s"),
        ("impacts_per_cycle", "impacts per cycle", ""),
        ("contact_share", "contact share", ""),
        ("steady_impacts_above_1_mm_per_s", "steady impacts above 1 mm per s", ""),
        ("worst_body_inertia_kg_m2_factor_of_rate_n_per_m", "worst body inertia kg m2 factor of rate n per m", ""),
        ("blow_rate_hz", "blow rate", "Hz"),
        ("energy_balance", "energy balance", ""),
        ("s", "s", ""),
    ],
)
def test_the_unit_is_read_off_the_end_of_the_name(name, words, unit):
    assert caption(name) == (words, unit)


def test_a_title_holds_words_and_unit():
    assert titled("loop_closure_m") == "loop closure [m]"
    assert titled("share") == "share"


def test_metrics_become_a_table_of_four_digits():
    assert metrics_table({"blow_energy_j": 18.81234}).splitlines()[-1] == "| blow energy | 18.81 | J |"
