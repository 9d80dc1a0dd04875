# SPDX-License-Identifier: Apache-2.0
"""The two excitations side by side: their impulses follow from the motions they belong to."""

import importlib.util
import math
from pathlib import Path

import pytest

from mech_twin.engine.run import frames
from mech_twin.machines.mb10_breaker import build
from mech_twin.machines.mb10_breaker.published import assumed_pulse
from mech_twin.parameters.load import machine_parameters

PARAMETERS = machine_parameters("mb10_breaker")
SPEC = importlib.util.spec_from_file_location(
    "excitations", Path(__file__).parents[3] / "benchmarks/breaker_excitations.py"
)
EXCITATIONS = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(EXCITATIONS)


@pytest.fixture(scope="module")
def pulses():
    return EXCITATIONS.compared_pulses(PARAMETERS)


def test_the_half_sine_carries_two_amplitudes_over_its_frequency(pulses):
    assumed, _ = pulses
    duration = 0.1 / PARAMETERS.excitation.blow_rate_hz
    assert assumed.steady_impulse_nms == pytest.approx(2.0 * 60.0 * duration / math.pi, rel=1e-4)
    assert assumed.blow_impulse_nms == 0.0
    assert assumed.period_s == pytest.approx(0.1)


def test_the_computed_blow_is_what_the_resting_body_leaves_with(pulses):
    _, computed = pulses
    blows = [e for f in frames(build(PARAMETERS), 5.0) for e in f.linkage.events if e.kind == "blow"]
    leaves = blows[-1].post[1].velocity
    assert blows[-1].pre[1].velocity == 0.0
    assert computed.blow_impulse_nms == pytest.approx(PARAMETERS.body.inertia_kg_m2 * leaves, rel=1e-9)
    assert computed.period_s == pytest.approx(blows[-1].time_s - blows[-2].time_s, abs=1e-15)


def test_one_cycle_reaches_from_blow_to_blow_in_order(pulses):
    for pulse in pulses:
        assert pulse.share[0] == pytest.approx(0.0, abs=1e-12)
        assert pulse.share[-1] == pytest.approx(1.0, abs=1e-12)
        assert all(pulse.share[i] <= pulse.share[i + 1] for i in range(len(pulse.share) - 1))


def test_a_blow_impulse_given_to_the_half_sine_is_shown():
    overrides = {"excitation.kind": "approximated", "body.inertia_kg_m2": 0.35, "body.blow_impulse_nms": 0.05}
    pulse = assumed_pulse(machine_parameters("mb10_breaker", overrides=overrides))
    assert pulse.blow_impulse_nms == 0.05
    assert pulse.lift_m.max() > 0.0


def test_the_picture_and_the_summary_show_the_same_numbers(pulses):
    assumed, computed = pulses
    caption = EXCITATIONS.excitation_picture(assumed, computed).caption
    assert f"blow {computed.blow_impulse_nms:.2f} N m s" in caption
    assert f"{computed.moment_nm.max():.1f} N m" in EXCITATIONS.pulse_summary("computed", computed)
