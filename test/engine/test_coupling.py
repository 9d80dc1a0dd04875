# SPDX-License-Identifier: Apache-2.0
"""What is computed from what at a step: the linkage leads, the body follows, a reset begins both anew."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from types import MappingProxyType

import pytest
from catalogue import built
from parameter_bounds import has_range, live_names
from pydantic import ValidationError

from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.coupling import RESET, Coupling, coupling_step, next_body, next_frame, restarted
from mech_twin.engine.run import frames
from mech_twin.samples import BodySample, ForceSample, Load, Named

NONE = Named((), ())
MACHINE = "impact_mass"


class ShortStep(Parameters):
    """Coupling of a machine whose longest step is short."""

    step_s: float = coupling_step(0.02)


class FollowedSteps:
    """A body whose angle is the number of steps it has followed since it was put on its stop."""

    joints = ("count",)
    regimes = ("counting",)
    residual_limits = MappingProxyType({})

    def start(self, forces: ForceSample) -> BodySample:
        return self._at(forces, 0.0)

    def follow(self, body: BodySample, forces: ForceSample) -> BodySample:
        return self._at(forces, body.position[0] + 1.0)

    def _at(self, forces: ForceSample, count: float) -> BodySample:
        return BodySample(forces.step, forces.time_s, self.joints, (count,), (0.0,), (0.0,), 0, 0.0, NONE, NONE)


def forces_at(step: int, *kinds: str) -> ForceSample:
    received = [
        kind.encode().decode() for kind in kinds
    ]  # equal to the word of the code, as from a topic, not the same
    loads = tuple(Load(0.01 * step, kind, "linkage", 0.0, 0.0, 0.0) for kind in received)
    return ForceSample(step, 0.01 * step, (), (), NONE, 0.0, NONE, loads)


def test_a_body_follows_until_a_reset_and_then_begins_anew():
    body, counts = None, []
    for step, kinds in enumerate(
        [(), (), ("impact", "separation"), ("impact", RESET, "impact"), (), (RESET,), ("impact",)]
    ):
        body = next_body(FollowedSteps(), body, forces_at(step, *kinds))
        counts.append(body.position[0])
        assert body.step == step
    assert counts == [0.0, 1.0, 2.0, 0.0, 1.0, 0.0, 1.0]


def test_a_restarted_linkage_is_the_first_one_at_a_later_step_and_says_so_first():
    machine = built(MACHINE)
    first, again = machine.linkage.start(), restarted(machine, 7)
    assert (again.position, again.velocity, again.regime) == (first.position, first.velocity, first.regime)
    assert again.step == 7
    assert again.time_s == pytest.approx(7 * machine.coupling_step_s, rel=1e-12)
    reset, *rest = again.events
    assert (reset.kind, reset.contact, reset.time_s) == (RESET, "linkage", again.time_s)
    assert tuple(rest) == machine.linkage.start(7).events


def test_the_roles_of_a_frame_are_of_one_step_and_a_run_goes_on_from_any_frame():
    machine = built(MACHINE)
    run = list(frames(machine, 0.1, lambda step: 0.5))
    for frame in run:
        assert frame.motor.step == frame.forces.step == frame.linkage.step
        assert frame.body is None
    for before, after in pairwise(run):
        assert after.linkage.step == before.linkage.step + 1
        assert next_frame(machine, before, 0.5) == after
    commands = [frame.motor.command for frame in run]
    assert commands == sorted(commands, reverse=True)  # the supply is on its way down to what was asked
    assert 0.5 <= commands[-1] < commands[0]


def test_a_body_of_a_run_follows_each_step_from_the_one_before():
    machine = replace(built(MACHINE), body=FollowedSteps())
    for step, frame in enumerate(frames(machine, 0.02)):
        assert frame.body is not None
        assert (frame.body.step, frame.body.position) == (step, (float(step),))


def test_a_step_is_at_least_a_microsecond_and_at_most_what_the_machine_allows():
    assert has_range(Coupling, {"step_s": 0.01}, "step_s", 1e-6, 1.0)
    assert has_range(ShortStep, {"step_s": 0.01}, "step_s", 1e-6, 0.02)
    assert live_names(Coupling) == set()


def test_a_step_must_be_given():
    with pytest.raises(ValidationError, match="step_s"):
        Coupling()
