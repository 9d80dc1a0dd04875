# SPDX-License-Identifier: Apache-2.0
"""Laws of the vibration crank: rod length, derivatives, equilibrium, energy; slider and boom, both drives."""

from math import inf, pi

import pytest
from crank_drives import BOOM
from crank_drives import VIBRATION_CRANK_KLOSS as KLOSS
from hypothesis import given, settings
from hypothesis import strategies as st

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.run import frames
from mech_twin.machines.vibration_crank.slider_crank import drive_moment, follower, pin_forces, rod_error
from mech_twin.parameters.load import machine

KINDS = {
    "finite rod": {"offset_m": 0.02, "working_force_n": 300.0},
    "below": {"slider": "below", "offset_m": -0.05},
    "infinite rod": {"rod_m": inf},
    "boom": BOOM,
}


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=25, deadline=None)
@given(th=st.floats(-10.0, 10.0))
def test_rates_are_the_derivatives_of_position(kind, th):
    mechanism = MECHANISMS[kind]
    h = 1e-3
    at = [follower(mechanism, th + i * h) for i in (-2, -1, 0, 1, 2)]
    first = (8.0 * (at[3].z - at[1].z) - (at[4].z - at[0].z)) / (12.0 * h)
    second = (8.0 * (at[3].z1 - at[1].z1) - (at[4].z1 - at[0].z1)) / (12.0 * h)
    assert at[2].z1 == pytest.approx(first, abs=1e-9)
    assert at[2].z2 == pytest.approx(second, abs=1e-9)
    assert rod_error(mechanism, th) < 1e-12


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=25, deadline=None)
@given(th=st.floats(-10.0, 10.0), w=st.floats(-40.0, 40.0), e=st.floats(-50.0, 50.0))
def test_reduced_and_pin_routes_give_one_moment(kind, th, w, e):
    mechanism = MECHANISMS[kind]
    peak = 300.0 + 10.0 * w * w + 20.0 * abs(e)
    assert pin_forces(mechanism, th, w, e).moment == pytest.approx(drive_moment(mechanism, th, w, e), abs=1e-12 * peak)


@pytest.mark.parametrize("drive", [{}, KLOSS, {"drive.speed_rpm": -150.0, "supply.initial_fraction": 0.0}])
@pytest.mark.parametrize("kind", KINDS)
def test_run_keeps_its_energy_balance_and_closes(kind, drive):
    crank = machine("vibration_crank", overrides={**KINDS[kind], **drive})
    for frame in frames(crank, 0.8):
        for named, limits in (
            (frame.linkage.residuals, crank.linkage.residual_limits),
            (frame.forces.residuals, crank.forces.residual_limits),
        ):
            for name, value in named.as_dict().items():
                assert abs(value) <= limits[name], (name, frame.linkage.step)


@pytest.mark.parametrize("friction", [{}, {"friction.coulomb_nm": 20.0, "friction.viscous_nms_per_rad": 1.0}])
@pytest.mark.parametrize("speed_rpm", [150.0, -150.0])
def test_run_meets_the_closed_form_peak(friction, speed_rpm):
    crank = machine("vibration_crank", overrides={**friction, "drive.speed_rpm": speed_rpm})
    observer = crank.observer()
    for frame in frames(crank, 0.4):
        observer.observe(frame)
    report = crank.report()
    assert observer.numbers()["run_drive_torque_peak_nm"] == pytest.approx(report["drive_torque_peak_nm"], rel=1e-3)
    for end in ("min", "max"):
        told = report[f"drive_torque_{end}_nm"]
        assert observer.numbers()[f"run_drive_torque_{end}_nm"] == pytest.approx(told, rel=1e-3)
    assert observer.numbers()["run_shaking_force_max_n"] == pytest.approx(report["shaking_force_max_n"], rel=1e-3)


def test_kloss_run_does_not_depend_on_the_step():
    ends = []
    for step in (0.002, 0.0005, 0.000125):
        last = list(frames(machine("vibration_crank", overrides={**KLOSS, "coupling.step_s": step}), 0.3))[-1]
        ends.append(last.linkage.position[0])
    assert ends[0] == pytest.approx(ends[2], abs=1e-9)
    assert ends[1] == pytest.approx(ends[2], abs=1e-9)


def test_long_boom_is_the_slider():
    far = {"boom.pivot_x_m": -2000.0, "boom.pivot_y_m": 0.504, "boom.length_m": 2000.0, "boom.load_ratio": 1.0}
    boom = machine("vibration_crank", overrides={**far, "boom.side": "left"})
    slider = machine("vibration_crank")
    for i in range(12):
        th = i * pi / 6.0 + 0.1
        expected = slider.analyse(th)["drive_torque_nm"]
        assert boom.analyse(th)["drive_torque_nm"] == pytest.approx(expected, abs=0.3)


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"rod_m": 0.1}, "rod_m > crank_m"),
        ({**BOOM, "boom.length_m": 0.3}, "fails"),
        ({**BOOM, "rod_m": inf}, "finite"),
        ({"drive.kind": "kloss"}, "motor and gear"),
        ({"drive.speed_rpm": 0.0}, "must not be 0"),
    ],
)
def test_impossible_crank_is_refused_in_words(overrides, words):
    with pytest.raises(ConfigurationError, match=words):
        machine("vibration_crank", overrides=overrides)


MECHANISMS = {
    kind: machine("vibration_crank", overrides=overrides).linkage.mechanism for kind, overrides in KINDS.items()
}
