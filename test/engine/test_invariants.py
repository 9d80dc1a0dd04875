# SPDX-License-Identifier: Apache-2.0
"""A residual over its limit is broken, and so is one that is no number or has no limit."""

from __future__ import annotations

import math

import pytest
from catalogue import NAMES, built

from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import Residual, ResidualWindow, RunInvariants, broken_lines
from mech_twin.parameters import load
from mech_twin.samples import BodySample, ForceSample, Frame, LinkageSample, MotorSample, Named

NAN = float("nan")
NONE = Named()


def carrying(residuals: dict[str, Named]) -> Frame:
    """Return a frame in which only the residuals of these roles are shown."""
    linkage = LinkageSample(0, 0.0, (), (), (), (), 0, 1.0, NONE, residuals.get("linkage", NONE))
    forces = ForceSample(0, 0.0, (), (), NONE, 0.0, residuals.get("forces", NONE))
    body = BodySample(0, 0.0, (), (), (), (), 0, 0.0, NONE, residuals.get("body", NONE))
    return Frame(linkage, MotorSample(0, 0.0, (), (), (), (), 1.0), forces, body)


@pytest.mark.parametrize(
    ("worst", "limit", "broken"),
    [
        (1.0, 1.0, False),
        (math.nextafter(1.0, 2.0), 1.0, True),
        (0.0, 0.0, False),
        (NAN, 1.0, True),
        (0.0, NAN, True),
        (math.inf, 1.0, True),
    ],
)
def test_what_exceeds_its_limit_or_is_no_number_is_broken(worst: float, limit: float, broken: bool) -> None:
    assert Residual(worst, limit).broken is broken


@pytest.mark.parametrize("order", [(1.0, NAN, 2.0), (NAN, 1.0, 2.0), (1.0, 2.0, NAN)])
def test_a_residual_that_was_once_no_number_stays_broken_until_the_window_ends(order: tuple[float, ...]) -> None:
    window = ResidualWindow({"closure_m": 10.0})
    for value in order:
        window.observe(Named(("closure_m",), (value,)))
    assert window.residuals()["closure_m"].broken
    window.close()
    window.observe(Named(("closure_m",), (1.0,)))
    assert not window.residuals()["closure_m"].broken


def test_the_greatest_magnitude_of_either_sign_is_kept() -> None:
    window = ResidualWindow({"closure_m": 1.0})
    for value in (0.5, -2.0, 1.5):
        window.observe(Named(("closure_m",), (value,)))
    assert window.close() == {"closure_m": Residual(2.0, 1.0)}
    assert window.close() == {}


def test_a_residual_nobody_gave_a_limit_is_broken() -> None:
    window = ResidualWindow({})
    window.observe(Named(("forgotten",), (0.0,)))
    assert broken_lines(window.residuals()) == ["forgotten 0 exceeds nan"]


@pytest.mark.parametrize("name", NAMES)
def test_every_residual_of_every_role_has_its_limit_and_can_be_seen_to_break(name: str) -> None:
    machine = built(name)
    run = list(frames(machine, 0.05))
    clean = RunInvariants(machine)
    for frame in run:
        clean.observe(frame)
    assert clean.residuals()
    assert broken_lines(clean.residuals()) == []
    roles = ("linkage", "forces") if machine.body is None else ("linkage", "forces", "body")
    for role in roles:
        sample = getattr(run[-1], role)
        limits = getattr(machine, role).residual_limits
        for i, residual in enumerate(sample.residuals.names):
            for bad in (-1.01 * limits[residual], NAN):
                values = (*sample.residuals.values[:i], bad, *sample.residuals.values[i + 1 :])
                spoilt = sample._replace(residuals=sample.residuals._replace(values=values))
                judged = RunInvariants(machine)
                judged.observe(run[-1]._replace(**{role: spoilt}))
                assert len(broken_lines(judged.residuals())) == 1, (role, residual, bad)


def test_each_role_is_judged_by_its_own_limits_and_a_name_of_two_roles_is_told_with_its_role() -> None:
    machine = load.machine("mb10_breaker", overrides={"excitation.kind": "approximated", "body.inertia_kg_m2": 0.35})
    limits = {role: getattr(machine, role).residual_limits for role in ("linkage", "forces", "body")}
    assert all(limits.values())
    for role, of_role in limits.items():
        for name, limit in of_role.items():
            for value, broken in ((limit, []), (2.0 * limit, [name])):
                judged = RunInvariants(machine)
                judged.observe(carrying({role: Named((name,), (value,))}))
                assert judged.residuals() == {name: Residual(value, limit)}
                assert [line.split()[0] for line in broken_lines(judged.residuals())] == broken
    judged = RunInvariants(machine)
    judged.observe(carrying({"linkage": Named(("drift",), (1.0,)), "body": Named(("drift", "own"), (2.0, 3.0))}))
    judged.observe(carrying({"body": Named(("drift", "own"), (-5.0, 0.0))}))
    assert {name: r.worst for name, r in judged.residuals().items()} == {
        "linkage.drift": 1.0,
        "body.drift": 5.0,
        "own": 3.0,
    }


def test_the_residuals_so_far_do_not_end_a_window_and_a_window_keeps_the_limits_it_was_given() -> None:
    limits = {"closure_m": 1.0}
    window = ResidualWindow(limits)
    limits["closure_m"] = 9.0
    window.observe(Named(("closure_m",), (2.0,)))
    assert window.residuals() == window.residuals() == {"closure_m": Residual(2.0, 1.0)}
    assert window.close() == {"closure_m": Residual(2.0, 1.0)}
    assert window.residuals() == {}


def test_names_and_values_of_unequal_number_are_refused() -> None:
    with pytest.raises(ValueError, match="shorter"):
        ResidualWindow({}).observe(Named(("one", "two"), (1.0,)))


def test_a_run_that_keeps_its_limits_has_no_line() -> None:
    assert broken_lines({"closure_m": Residual(1.0, 1.0), "drift": Residual(0.0, 1.0)}) == []
    assert broken_lines({"closure_m": Residual(2.0, 1.0), "drift": Residual(0.0, 1.0)}) == ["closure_m 2 exceeds 1"]


@pytest.mark.parametrize(
    ("over", "step_s", "shorter"),
    [(3.19, 1e-3, 5e-4), (1.008, 1e-3, 5e-4), (1.02, 2.3e-3, 2e-3), (100.0, 1e-3, 1e-4), (1e6, 1e-3, 1e-6)],
)
def test_a_residual_of_the_step_names_the_key_and_a_shorter_step(over: float, step_s: float, shorter: float) -> None:
    for name, limit in (("coupling_defect", 1e-5), ("body.penetration_rad", 1e-6)):
        told = f"{over * limit:.3g} exceeds {limit:.3g}: coupling.step_s {step_s:g} is too long for this machine"
        assert broken_lines({name: Residual(over * limit, limit)}, step_s) == [f"{name} {told}, try {shorter:g}"]


def test_a_limit_that_falls_with_the_step_is_kept_at_its_least() -> None:
    """A residual that falls as its limit does is no nearer to it at a shorter step, until the limit falls no more."""
    (line,) = broken_lines({"coupling_defect": Residual(1.02e-3, 1e-3)}, 1e-3)
    assert line.endswith("try 5e-05")


@pytest.mark.parametrize(
    ("name", "worst", "step_s"),
    [("energy_balance", 2.0, 1e-3), ("coupling_defect", NAN, 1e-3), ("coupling_defect", 2.0, None), ("own", 2.0, 1e-3)],
)
def test_where_no_step_is_known_to_help_none_is_told(name: str, worst: float, step_s: float | None) -> None:
    assert broken_lines({name: Residual(worst, 1.0)}, step_s) == [f"{name} {worst:.3g} exceeds 1"]
