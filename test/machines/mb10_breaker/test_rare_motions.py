# SPDX-License-Identifier: Apache-2.0
"""Motions that random legal breakers came upon: each keeps every residual, or is refused with the bound it passes."""

from __future__ import annotations

import pytest

from mech_twin.configuration_tree import ConfigurationError
from mech_twin.engine.invariants import broken_lines
from mech_twin.engine.rollout import roll_out
from mech_twin.parameters.load import machine

# the pivot's friction holds the lifted body while the striker pushes the tool up to the rocker's extreme
HELD_BODY = {
    "body.friction.coulomb_nm": 49.43817132449243,
    "coupling.extrapolation_order": 0,
    "coupling.step_s": 0.0010951514531432852,
    "linkage.coupler_mass_kg": 13.263039959912021,
    "linkage.crank_inertia_kg_m2": 0.9950848555143744,
    "linkage.crank_mass_kg": 1269.3530190453766,
    "linkage.initial_crank_deg": 100000.0,
    "linkage.rocker_mass_kg": 4.9999999999979,
    "motor.rated_speed_rpm": 1496.159488338103,
    "motor.torque_curve": "starting_corrected",
    "tool.overtravel_m": 0.0023262375023235158,
}
# a heavy tool throws a crank without flywheel back, so that the gear turns its loss round
THROWN_BACK = {
    "excitation.kind": "approximated",
    "coupling.extrapolation_order": 0,
    "coupling.step_s": 0.0012566027999516168,
    "linkage.coupler_centroid_along_m": -0.003422936341003108,
    "linkage.coupler_inertia_kg_m2": 0.0013375547413553505,
    "linkage.crank_centroid_along_m": -1.9245008445683795e-07,
    "linkage.crank_inertia_kg_m2": 1e-12,
    "linkage.rocker_m": 0.36834291668543545,
    "linkage.rocker_mass_kg": 4.4675019101897036,
    "motor.starting_torque_ratio": 1.618414428142375e-08,
    "tool.mass_kg": 1052.9754180454938,
}
STIFF_SPRING = {"body.spring_arm_m": 10.0, "body.spring_rate_n_per_m": 2e6, "body.inertia_kg_m2": 3.9}


def residuals_of(overrides, command, duration_s=0.5):
    """Return the residuals over their limits of a run, in equal parts at each asked fraction of the supply."""
    built = machine("mb10_breaker", overrides=overrides)
    steps = round(duration_s / built.coupling_step_s)
    run = roll_out(built, duration_s, [], None, lambda step: command[step * len(command) // (steps + 1)])
    assert run.error is None
    return broken_lines(run.residuals), [event.kind for event in run.events]


def test_striker_that_turns_back_leaves_a_body_held_by_friction_at_once():
    broken, kinds = residuals_of(HELD_BODY, (1.0,))
    assert broken == []
    assert "released" in kinds


def test_gear_that_turns_back_within_a_step_loses_no_energy_unseen():
    broken, _ = residuals_of(THROWN_BACK, (1.0, 0.9213070926481903, 0.0, 1.0))
    assert broken == []


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"motor.rotor_inertia_kg_m2": 100.0}, "rotor_inertia_kg_m2 must be at most 60.79"),
        ({"body.friction.coulomb_nm": 1e6}, "body.friction.coulomb_nm must be at most 600000 N m"),
        ({"friction.coulomb_nm": 1e6}, "friction.coulomb_nm must be at most 31848.4 N m"),
        (
            {"tool.wall_force_n": 1e7, "linkage.crank_inertia_kg_m2": 1e-3, "motor.rotor_inertia_kg_m2": 1e-4}
            | {"coupling.step_s": 2e-5},
            "tool.wall_force_n must be at most",
        ),
        (STIFF_SPRING, "on a body that swings on its spring"),
        (
            {"linkage.coupler_mass_kg": 3e4, "linkage.crank_inertia_kg_m2": 0.3, "body.inertia_kg_m2": 0.5}
            | {"coupling.step_s": 1.9e-3},
            "body.inertia_kg_m2 0.5: the linkage's moment",
        ),
    ],
)
def test_what_cannot_be_followed_is_refused_with_its_bound(overrides, words):
    with pytest.raises(ConfigurationError, match=words) as refused:
        machine("mb10_breaker", overrides=overrides)
    assert "\n" not in str(refused.value)


def test_a_body_that_swings_fast_keeps_its_residuals_at_the_longest_step_it_allows():
    with pytest.raises(ConfigurationError) as refused:
        machine("mb10_breaker", overrides=STIFF_SPRING)
    longest_s = float(str(refused.value).split("must be at most ")[1].split()[0])
    broken, kinds = residuals_of(STIFF_SPRING | {"coupling.step_s": 0.999 * longest_s}, (1.0,), 0.6)
    assert broken == []
    assert "touchdown" in kinds
