# SPDX-License-Identifier: Apache-2.0
"""A run stepped from outside is the run that nobody steps, and a state given back goes on with the same bits."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from bench_run import BenchRun
from catalogue import built
from std_srvs.srv import SetBool, Trigger

from mech_twin.engine.coupling import complete_frame, next_frame
from mech_twin.engine.run import frames
from mech_twin.engine.stored_state import StoredState, state_text, stored_state
from mech_twin.engine.trajectory import StepSamples
from mech_twin.errors import StateError
from mech_twin.parameters.load import machine as built_machine
from mech_twin.samples import Frame
from mech_twin.studies.resimulation import resimulated

pytestmark = pytest.mark.usefixtures("ros_domain")
CRANK = "vibration_crank"


def asked(run: BenchRun, service: str) -> Any:
    return run.call(Trigger, service, Trigger.Request())


def paused(run: BenchRun, steps: int = 20) -> None:
    run.steps(steps)
    assert run.call(SetBool, "pause", SetBool.Request(data=True)).success


def test_a_paused_run_takes_the_steps_asked_for_and_no_other() -> None:
    with BenchRun(CRANK) as run:
        paused(run)
        before = run.samples[-1].step
        assert run.set_parameters("linkage", run__step_count=7)[0].successful
        for i in (1, 2):
            answer = asked(run, "step")
            assert answer.success
            assert answer.message.startswith(f"step {before + 7 * i}, ")
            assert run.samples[-1].step == before + 7 * i
        run.spin_for(0.3)
        assert run.samples[-1].step == before + 14
        alone = [frame.linkage.position for frame in frames(built(CRANK), run.samples[-1].time_s)]
        assert [sample.position for sample in run.samples] == alone[: len(run.samples)]


def test_a_pause_ends_the_steps_that_are_being_taken() -> None:
    with BenchRun(CRANK) as run:
        paused(run)
        assert run.set_parameters("linkage", run__step_count=100_000)[0].successful
        client = run.client.create_client(Trigger, "step")
        run.until(client.service_is_ready)
        begun, answer = run.samples[-1].step, client.call_async(Trigger.Request())
        run.until(lambda: run.samples[-1].step > begun)
        assert run.call(SetBool, "pause", SetBool.Request(data=True)).message == "paused"
        run.until(answer.done)
        assert not answer.result().success
        assert answer.result().message.startswith("ended at step ")
        run.spin_for(0.2)
        held = run.samples[-1].step
        run.spin_for(0.3)
        assert run.samples[-1].step == held < begun + 100_000
        assert run.set_parameters("linkage", run__step_count=3)[0].successful
        assert asked(run, "step").success
        assert run.samples[-1].step == held + 3


def test_a_run_that_is_not_paused_is_not_stepped() -> None:
    with BenchRun(CRANK) as run:
        run.steps(5)
        answer = asked(run, "step")
        assert not answer.success
        assert "not paused" in answer.message
    with BenchRun(CRANK) as run:
        run.steps(5)
        assert not run.set_parameters("linkage", run__step_count=0)[0].successful


@pytest.mark.parametrize("name", ["mb10_breaker", "impact_mass", CRANK])
def test_a_run_set_to_a_state_goes_on_as_it_did_from_there(name: str) -> None:
    with BenchRun(name) as run:
        paused(run, 40)
        state = asked(run, "get_state")
        while not state.success:  # a step that ends with an event is not offered
            assert "event" in state.message
            asked(run, "step")
            state = asked(run, "get_state")
        begun = json.loads(state.message)["step"]
        run.set_parameters("linkage", run__step_count=60)
        asked(run, "step")
        assert run.set_parameters("linkage", run__reset_state=state.message)[0].successful
        assert asked(run, "reset").message == "stored state at the next step"
        bodies: list[Any] = []
        if built(name).body is not None:
            run.node("body").on_sample = bodies.append
        asked(run, "step")
        at = next(i for i, sample in enumerate(run.samples) if any(e.kind == "reset" for e in sample.events))
        once = {sample.step: sample for sample in run.samples[:at]}
        for offset, again in enumerate(run.samples[at:]):
            assert again.step == run.samples[at].step + offset
            assert again.position == once[begun + offset].position
            assert again.velocity == once[begun + offset].velocity
        known = [frame.body for frame in frames(built(name), once[begun].time_s + 0.1)]
        for body in bodies:
            assert body.position == known[body.step - run.samples[at].step + begun].position
        assert len(bodies) >= (50 if built(name).body is not None else 0)


def frames_with_a_given_state(name: str) -> list[Frame]:
    machine = built(name)
    run = list(frames(machine, 0.3))
    kept = next(f for f in run[100:] if not f.linkage.events and (f.body is None or not f.body.events))
    text = state_text(machine, StoredState(kept.linkage, kept.body))
    last = run[-1]
    given = stored_state(machine, text, StoredState(last.linkage, last.body), last.linkage.step + 1)
    frame = complete_frame(machine, given.linkage, None, 1.0)._replace(body=given.body)
    run.append(frame)
    for _ in range(100):
        run.append(next_frame(machine, run[-1], 1.0))
    return run


@pytest.mark.parametrize("name", ["mb10_breaker", "impact_mass"])
def test_a_recording_with_a_given_state_is_computed_again(name: str) -> None:
    verdict = resimulated(map(_known, frames_with_a_given_state(name)), lambda _: built(name))
    assert verdict.identical
    assert len(verdict.taken_up) == 1


def _known(frame: Frame) -> StepSamples:
    return StepSamples(frame.linkage.step, frame.linkage, frame.motor, frame.forces, frame.body)


@pytest.mark.parametrize(
    ("change", "line"),
    [
        ({"machine": "winding_drum"}, "machine 'winding_drum': expected 'vibration_crank'"),
        ({"step": -1}, "step -1"),
        ({"step": 2**60}, "step 1152921504606846976: expected a whole number, 0 to"),
        ({"step": True}, "step True"),
        ({"speed": 1.0}, "state has 'speed': expected machine, step, command, linkage"),
        ({"body": {}}, "state has 'body'"),
        ({"linkage": {}}, "linkage.regime None"),
        ({"linkage": {"mass": 1.0}}, "linkage has 'mass': expected regime"),
        ({"command": "high"}, "command 'high': expected a finite number"),
        ({"command": float("inf")}, "command inf: expected a finite number"),
    ],
)
def test_what_is_no_state_is_refused_in_one_line(change: dict[str, Any], line: str) -> None:
    machine = built(CRANK)
    frame = complete_frame(machine, machine.linkage.start(), None, 1.0)
    like = StoredState(frame.linkage, frame.body)
    told = json.loads(state_text(machine, like)) | change
    with pytest.raises(StateError, match=line):
        stored_state(machine, json.dumps(told), like, 5)
    with BenchRun(CRANK) as run:
        run.steps(5)
        result = run.set_parameters("linkage", run__reset_state=json.dumps(told))[0]
        assert not result.successful
        assert line.partition(":")[0] in result.reason


@pytest.mark.parametrize(("joint", "value"), [("package_radius", 0.0), ("yarn", 1e300)])
def test_a_state_from_which_the_machine_cannot_go_on_is_refused(joint: str, value: float) -> None:
    machine = built("winding_drum")
    frame = complete_frame(machine, machine.linkage.start(), None, 1.0)
    like = StoredState(frame.linkage, frame.body)
    told = json.loads(state_text(machine, like))
    told["linkage"]["position"][joint] = value
    with pytest.raises(StateError, match="winding_drum cannot go on from it"):
        stored_state(machine, json.dumps(told), like, 5)


def test_a_machine_driven_by_the_time_offers_no_state() -> None:
    machine = built_machine(str(Path(__file__).resolve().parents[2] / "config" / "pages" / "impact_mass.yaml"))
    frame = complete_frame(machine, machine.linkage.start(), None, 1.0)
    with pytest.raises(StateError, match="follows the time of the run"):
        state_text(machine, StoredState(frame.linkage, frame.body))


def test_the_features_told_are_those_there_are() -> None:
    with BenchRun(CRANK) as run:
        run.steps(5)
        told = asked(run, "get_features").message
        assert "STEP_SIMULATION_MULTIPLE" in told
        assert "run.reset_state" in told
        assert "SIMULATION_RESET_TIME" not in told
