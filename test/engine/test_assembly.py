# SPDX-License-Identifier: Apache-2.0
"""Samples arriving one by one become steps: each once, in order, whole unless a sample of it was lost."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mech_twin.engine.trajectory import FIELDS, OPEN_STEPS, FrameAssembler, StepAssembler
from mech_twin.samples import BodySample, ForceSample, LinkageSample, MotorSample, Named

NONE = Named((), ())
ROLES = {
    "linkage": lambda step: LinkageSample(step, 0.001 * step, (), (), (), (), 0, 0.0, NONE, NONE),
    "motor": lambda step: MotorSample(step, 0.001 * step, (), (), (), (), 1.0),
    "forces": lambda step: ForceSample(step, 0.001 * step, (), (), NONE, 0.0, NONE),
    "body": lambda step: BodySample(step, 0.001 * step, (), (), (), (), 0, 0.0, NONE, NONE),
}


@st.composite
def arrivals(draw, most_behind=10):
    """Samples of a run: every role in order, some lost, some sent twice, the roles shifted against each other."""
    steps = draw(st.integers(1, 40))
    timed, lost = [], set()
    for name, sample in ROLES.items():
        behind = draw(st.integers(0, most_behind))
        gone = draw(st.sets(st.integers(0, steps - 1), max_size=3))
        lost |= {(name, step) for step in gone}
        timed += [(step + behind, sample(step)) for step in range(steps) if step not in gone]
    timed.sort(key=lambda item: item[0])
    return [sample for _, sample in timed], lost, steps


def role_of(sample):
    return FIELDS[type(sample)]


@given(arrivals())
@settings(deadline=None)
def test_each_step_comes_once_in_order_with_every_sample_that_arrived(run):
    samples, lost, steps = run
    assembler = StepAssembler(frozenset(ROLES))
    given_back = [step for sample in samples for step in assembler.add(sample)] + assembler.rest()
    assert [step.step for step in given_back] == sorted({sample.step for sample in samples})
    for step in given_back:
        missing = {name for name in ROLES if getattr(step, name) is None}
        assert missing == {name for name, number in lost if number == step.step}
    assert assembler.incomplete == sum(any(getattr(step, name) is None for name in ROLES) for step in given_back)
    assert not assembler.unused
    assert len(given_back) <= steps


@pytest.mark.slow
@given(arrivals(), st.data())
@settings(deadline=None)
def test_a_sample_sent_again_is_counted_and_changes_nothing(run, data):
    samples, _, _ = run
    assembler, repeating = StepAssembler(frozenset(ROLES)), StepAssembler(frozenset(ROLES))
    given_back, again, repeats = [], [], 0
    for place, sample in enumerate(samples):
        given_back += assembler.add(sample)
        again += repeating.add(sample)
        if data.draw(st.booleans()):
            repeats += 1
            earlier = samples[data.draw(st.integers(0, place))]
            again += repeating.add(earlier._replace(time_s=earlier.time_s + data.draw(st.sampled_from([0.0, 1.0]))))
    assert again == given_back
    assert repeating.unused.total() == repeats


@given(arrivals())
@settings(deadline=None)
def test_frames_are_the_whole_steps(run):
    samples, lost, steps = run
    assembler = FrameAssembler(has_body=True)
    frames = [frame for sample in samples if (frame := assembler.add(sample)) is not None]
    assert [frame.linkage.step for frame in frames] == sorted(set(range(steps)) - {step for _, step in lost})


def test_a_sample_that_is_not_used_is_counted_under_its_reason():
    assembler = StepAssembler(frozenset(("linkage", "motor")))
    first, other = ROLES["linkage"](1), ROLES["linkage"](1)._replace(command=0.5)
    equal = first._replace()
    for sample in (first, equal, other, other):
        assert assembler.add(sample) == []
    assert assembler.unused == {"repeated": 1, "contradicting": 2}
    assert [step.linkage for step in assembler.add(ROLES["motor"](1))] == [first]
    for sample in (equal, other, ROLES["motor"](1), ROLES["linkage"](0)):  # of the step just given back, and earlier
        assert assembler.add(sample) == []
    assert assembler.unused == {"repeated": 3, "contradicting": 3, "late": 1}
    assert assembler.contradicted_from == 1


def test_a_second_other_sample_is_known_as_such_some_steps_later():
    assembler = StepAssembler(frozenset(("linkage",)))
    for step in range(10):
        assembler.add(ROLES["linkage"](step))
    assembler.add(ROLES["linkage"](3))
    assert assembler.contradicted_from is None
    for step in (5, 0, 7):
        assembler.add(ROLES["linkage"](step)._replace(command=0.5))
    assert assembler.contradicted_from == 0
    assert assembler.unused == {"repeated": 1, "contradicting": 3}


def test_a_sample_nobody_expected_makes_no_step_whole():
    assembler = StepAssembler(frozenset(("linkage", "motor")))
    for role in ("body", "linkage", "motor"):
        assert assembler.add(ROLES[role](1)) == []
    (step,) = assembler.rest()
    assert (step.body, assembler.incomplete) == (ROLES["body"](1), 1)


def test_frames_left_out_are_counted():
    frames = FrameAssembler(has_body=False)
    for number, roles in ((0, ("motor", "forces")), (1, ("linkage", "motor", "forces"))):
        given_back = [frames.add(ROLES[role](number)) for role in roles]
    assert [frame is not None for frame in given_back] == [False, False, True]
    assert frames.incomplete == 1


def test_a_role_that_falls_silent_does_not_hold_more_steps_than_the_bound():
    assembler = StepAssembler(frozenset(("linkage", "motor")))
    given_back = [step for number in range(1000) for step in assembler.add(ROLES["linkage"](number))]
    assert [step.step for step in given_back] == list(range(1000 - OPEN_STEPS))
    assert assembler.add(ROLES["motor"](3)) == []
    assert assembler.unused == {"late": 1}
