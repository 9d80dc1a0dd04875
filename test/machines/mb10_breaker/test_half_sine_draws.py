# SPDX-License-Identifier: Apache-2.0
"""Any legal body under the half sine runs: finite, within its residuals, in time; the rest is refused in one line."""

import math

import pytest
from draws.random_draw import Draw, Drawn
from pydantic import ValidationError, model_validator

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters
from mech_twin.machines.mb10_breaker.half_sine_body import half_sine_body
from mech_twin.machines.mb10_breaker.pressed_body.free_swing import swing_regime
from mech_twin.machines.mb10_breaker.pressed_body.parameters import (
    BodyParameters,
    ExcitationParameters,
    motion_refusal,
    pressed_body,
)
from mech_twin.parameters.load import machine_parameters
from mech_twin.samples import ForceSample, Named

STEP_S = 5e-3


class SwungBody(Parameters):
    """A body and its half sine, without the linkage that narrows what they may be."""

    body: BodyParameters
    excitation: ExcitationParameters

    @model_validator(mode="after")
    def _has_a_closed_form(self):
        refusal = motion_refusal(self.body, self.excitation)
        if refusal or self.body.friction.coulomb_nm > 0.0 or self.excitation.kind != "approximated":
            raise ValueError(refusal or "only the half sine on a body without dry friction has a closed form")
        return self


USUAL = {
    "body": {
        "inertia_kg_m2": 0.35,
        "spring_arm_m": 0.2,
        "spring_rate_n_per_m": 3108.9,
        "preload_deflection_m": 0.03,
        "restitution": 0.4,
        "tool_radius_m": 0.25,
        "damping_ratio": 0.0,
    },
    "excitation": {"kind": "approximated", "amplitude_nm": 60.0, "onset_fraction": 0.9, "blow_rate_hz": 10.0},
}
# stiff, damped bodies that follow a slow load
SLOWLY_LOADED = [
    ({"inertia_kg_m2": 1.7429042478671806, "spring_rate_n_per_m": 7854294.235278325, "preload_deflection_m":
     0.00015710834929969606, "restitution": 0.0, "damping_ratio": 0.99, "contact": "none"}, {"form": "printed",
     "amplitude_nm": -1e6, "onset_fraction": 0.43896880820811485, "blow_rate_hz": 0.12676294808430977}),
    ({"inertia_kg_m2": 0.001, "spring_arm_m": 0.015134155420432567, "spring_rate_n_per_m": 1e10,
     "preload_deflection_m": 0.006489732948330646, "restitution": 0.0, "tool_radius_m": 0.004936403444694,
     "damping_ratio": 0.9850436227839859}, {"form": "printed", "amplitude_nm": 1e6, "onset_fraction":
     0.2456004223110051}),
    ({"inertia_kg_m2": 0.1137416126204901, "spring_arm_m": 0.07067436504761301, "spring_rate_n_per_m": 1e10,
     "preload_deflection_m": 0.0018365071466399081, "restitution": 0.047764718007289264, "tool_radius_m":
     0.7155663049757263, "damping_ratio": 0.8593262742600303}, {"amplitude_nm": 1e6, "onset_fraction":
     0.12275541935382232, "blow_rate_hz": 12.171110897347948}),
    ({"spring_arm_m": 0.060344661674718476, "spring_rate_n_per_m": 4624394.358393508, "preload_deflection_m":
     0.11722240775381848, "restitution": 0.99, "tool_radius_m": 0.040238868472044616, "damping_ratio":
     0.7317217536178194}, {"amplitude_nm": -1e6, "onset_fraction": 0.028722130805656006, "blow_rate_hz": 0.1}),
    ({"spring_arm_m": 0.8417520999957695, "spring_rate_n_per_m": 336907.2522472347, "preload_deflection_m":
     1.3787456630857045, "tool_radius_m": 0.8617098598636581, "damping_ratio": 0.99, "blow_impulse_nms":
     64970.73570701441}, {"form": "printed", "amplitude_nm": -625164.6732130682, "onset_fraction":
     0.5074689369438629, "blow_rate_hz": 0.14177462564783141}),
    ({"inertia_kg_m2": 0.41061493891524714, "spring_arm_m": 0.01243062742213913, "spring_rate_n_per_m":
     181042278.14625853, "preload_deflection_m": 0.1584346704058129, "restitution": 0.8823230106721537,
     "tool_radius_m": 0.001, "damping_ratio": 0.99, "blow_impulse_nms": 0.0682281853644917}, {"form": "printed",
     "amplitude_nm": 758587.7205663, "onset_fraction": 0.27510999568922345, "blow_rate_hz": 0.1}),
    ({"inertia_kg_m2": 0.001, "spring_arm_m": 0.001, "spring_rate_n_per_m": 1e10, "preload_deflection_m":
     5.45998505231295e-07, "tool_radius_m": 10.0, "damping_ratio": 0.5426411505463405, "blow_impulse_nms":
     373.39503420795637}, {"onset_fraction": 0.12121835500355738, "blow_rate_hz": 1.054562540658632}),
]  # fmt: skip


def swung(body, excitation):
    """The usual body and half sine with some keys changed."""
    return SwungBody(body=USUAL["body"] | body, excitation=USUAL["excitation"] | excitation)


def trouble(swung_body, duration_s=0.5):
    """What is wrong with a run and the closed-form regime of this configuration; empty if nothing is."""
    body, excitation = swung_body.body, swung_body.excitation
    role = half_sine_body(body, excitation, STEP_S)

    def forces(step):
        return ForceSample(step, step * STEP_S, (), (), Named(), 0.0, Named())

    sample, told = role.start(forces(0)), []
    for step in range(1, round(duration_s / STEP_S) + 1):
        sample = role.follow(sample, forces(step))
        numbers = (*sample.position, *sample.velocity, *sample.effort, sample.pressing_force_n, *sample.memory.values)
        if not all(math.isfinite(number) for number in numbers):
            told.append(f"not finite at {sample.time_s}: {sample}")
        for name, value in sample.residuals.as_dict().items():
            if not abs(value) <= role.residual_limits[name]:
                told.append(f"{name} {value:g} at {sample.time_s}")
        if body.contact == "one_sided" and sample.position[0] < 0.0:
            told.append(f"angle {sample.position[0]:g} below the collar at {sample.time_s}")
        if told:
            return told
    if math.isnan(swing_regime(pressed_body(body, excitation)).largest_angle_rad):
        told.append("the regime of the free swing is not a number")
    return told


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_random_legal_bodies_run():
    what = Drawn("swung body", SwungBody, (USUAL,))
    for number in range(120):
        drawn = Draw(what, 1, number).parameters
        assert trouble(drawn) == [], (number, drawn)


@pytest.mark.parametrize(("body", "excitation"), SLOWLY_LOADED)
def test_bodies_that_once_had_no_end_run(body, excitation):
    """The search's bounds were too wide, or the response overflowed."""
    assert trouble(swung(body, excitation)) == []


@pytest.mark.timeout(60)
@pytest.mark.parametrize("inertia", [0.35, 6.0])
def test_a_stiff_spring_hardly_deflected_does_not_hang(inertia):
    stiff = {"inertia_kg_m2": inertia, "spring_rate_n_per_m": 1e9, "preload_deflection_m": 1e-7}
    assert trouble(swung(stiff, {}), 1.0) == []


@pytest.mark.parametrize("rate_hz", [20.0, 32.34578364180735, 100.0])
def test_a_body_that_only_rounding_would_lift_is_refused_and_one_hardly_pressed_runs(rate_hz):
    """The printed load is zero as each cycle ends; without preload a run had no end, or its energy 39 % of an error."""
    excitation = {"form": "printed", "blow_rate_hz": rate_hz}
    with pytest.raises(ValidationError, match=r"body\.preload_deflection_m must be above 0 .* printed"):
        swung({"preload_deflection_m": 0.0}, excitation)
    assert trouble(swung({"preload_deflection_m": 1e-12}, excitation)) == []


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("body.spring_rate_n_per_m", 9.9e9, r"body\.spring_rate_n_per_m must be at most"),
        ("body.restitution", 0.999, r"body\.restitution"),
        ("body.damping_ratio", 0.999, r"body\.damping_ratio"),
        ("excitation.blow_rate_hz", 1e3, r"excitation\.blow_rate_hz"),
        ("excitation.onset_fraction", 0.9999, r"excitation\.onset_fraction"),
        ("body.inertia_kg_m2", 1e-9, r"body\.inertia_kg_m2"),
    ],
)
def test_what_is_beyond_the_range_is_refused_by_name(key, value, words):
    overrides = {"excitation.kind": "approximated", "body.inertia_kg_m2": 0.01, "excitation.frequency_ratio": None}
    with pytest.raises(ConfigurationError, match=words):
        machine_parameters("mb10_breaker", overrides=overrides | {key: value})
    assert math.isfinite(value)
