# SPDX-License-Identifier: Apache-2.0
"""Inverse dynamics: the motion of the crank alone tells the joints and forces that made it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from catalogue import built
from hypothesis import given, settings
from hypothesis import strategies as st

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import frame_events, joint_numbers
from mech_twin.errors import MeasurementError
from mech_twin.measurements.blocks import NO_DELAYS, Array, Block
from mech_twin.measurements.crank_motion import crank_motion, smoothed
from mech_twin.measurements.measurement_map import Channel
from mech_twin.measurements.model_turn import TURN, ModelTurn, model_turn
from mech_twin.measurements.quality import QualityGauge
from mech_twin.measurements.runs import MeasuredChannel, MeasuredRun
from mech_twin.roles import CrankState, GuidedLinkage
from mech_twin.samples import Frame
from mech_twin.studies.measured_forces import Compared, guided_samples, measured_forces

GUIDED = ("mb10_breaker", "compaction_press", "vibration_crank")
CRANK = "linkage.crank.position"
COUNT = 4500  # samples: longer than a window of the smoothing


def state_of(frame: Frame) -> CrankState:
    crank = frame.linkage.joint("crank")
    e = frame.forces.quantities["crank_acceleration_rad_per_s2"]
    body = frame.linkage.joint("body") if "body" in frame.linkage.joints else None
    return CrankState(crank.position, crank.velocity, e, *(body[:2] if body else ()))


@pytest.mark.parametrize("name", GUIDED)
def test_the_motion_of_the_crank_gives_joints_torque_and_forces_of_the_run(name: str) -> None:
    machine = built(name)
    assert isinstance(machine.linkage, GuidedLinkage)
    compared = 0
    for frame in frames(machine, 0.6):
        tool_free = name != GUIDED[0] or frame.forces.quantities["tool_force_n"] == 0.0
        if frame.linkage.velocity[0] == 0.0 or frame_events(frame) or not tool_free:
            continue  # at rest friction may hold the crank; at an event the acceleration has two values
        guided = machine.linkage.guided(frame.linkage.step, frame.linkage.time_s, state_of(frame))
        own, found = (dict(joint_numbers("linkage", sample)) for sample in (frame.linkage, guided))
        assert guided.regime == frame.linkage.regime
        for column, value in own.items():
            assert found[column] == pytest.approx(
                value, rel=1e-9, abs=1e-9 * (1.0 + abs(own["linkage.crank.effort"]))
            ), column
        forces = machine.forces.analyse(guided)
        for wrench, expected in zip(forces.wrenches, frame.forces.wrenches, strict=True):
            assert wrench == pytest.approx(expected, rel=1e-9, abs=1e-6)
        compared += 1
    assert compared > 200


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_the_regime_is_that_of_the_run_in_either_sense(sense: float) -> None:
    from mech_twin.parameters.load import machine

    press = machine("compaction_press", overrides={"drive.speed_rpm": 300.0 * sense})
    assert isinstance(press.linkage, GuidedLinkage)
    seen = set()
    for frame in frames(press, 0.5):
        if not frame_events(frame):
            guided = press.linkage.guided(0, 0.0, state_of(frame))
            assert guided.regime == frame.linkage.regime
            seen.add(guided.regime)
    assert len(seen) == 2


@pytest.mark.slow
@settings(max_examples=6)
@given(st.floats(0.5, 30.0), st.floats(0.0, 1e-4), st.integers(0, 99))
def test_smoothing_gives_the_derivatives_of_a_noisy_motion(speed: float, noise: float, seed: int) -> None:
    times = np.cumsum(np.random.default_rng(seed).uniform(0.5e-3, 1.5e-3, COUNT))  # unequal intervals
    exact = speed * times + 0.2 * np.sin(speed * times)
    values, rates, accelerations = smoothed(
        times, exact + noise * np.random.default_rng(seed + 1).standard_normal(COUNT)
    )
    inner = slice(50, -50)
    assert np.abs(values - exact)[inner].max() < 1e-6 + 3.0 * noise
    assert np.abs(rates - speed * (1.0 + 0.2 * np.cos(speed * times)))[inner].max() < 0.01 * speed + 300.0 * noise
    wanted = -0.2 * speed**2 * np.sin(speed * times)
    assert np.sqrt(np.mean((accelerations - wanted)[inner] ** 2)) < 0.02 * speed**2 + 2e4 * noise


@pytest.mark.parametrize("gap_s", [0.5, 60.0, 1e4])
def test_a_gap_smooths_the_motion_around_it_no_more(gap_s: float) -> None:
    times = np.arange(2000) * 1e-3
    times[700:] += gap_s
    noise = 3e-4 * np.random.default_rng(0).standard_normal(len(times))
    exact = 12.0 * times + 0.2 * np.sin(12.0 * times)
    _, _, found = smoothed(times, exact + noise)
    off = found + 0.2 * 12.0**2 * np.sin(12.0 * times)
    assert np.sqrt(np.mean(off[50:-50] ** 2)) < 0.1 * 0.2 * 12.0**2


@pytest.fixture(scope="module")
def turn() -> ModelTurn:
    found = model_turn(built("vibration_crank"))
    assert found is not None
    return found


def run_of(zero: float, slider: bool = True, **keys: Any) -> MeasuredRun:
    rows = list(frames(built("vibration_crank"), 2.0))[::4]
    times = np.array([frame.linkage.time_s for frame in rows])
    crank = np.array([frame.linkage.position[0] for frame in rows])
    torque = np.array([frame.linkage.effort[0] for frame in rows])
    columns = {CRANK: crank + zero, "linkage.crank.effort": torque}
    if slider:
        columns["linkage.slider.position"] = np.array([frame.linkage.position[2] for frame in rows]) + 0.3
    return MeasuredRun(Path("run"), tuple(measured(times, name, values, keys) for name, values in columns.items()))


def measured(times: Array, name: str, values: Array, keys: dict[str, Any]) -> MeasuredChannel:
    gauge = QualityGauge()
    gauge.add(Block(0, times, values, NO_DELAYS))
    spec = Channel.model_validate({"source": {"column": name}, "is": name, "zero": keys.get(name, 0.0)})
    return MeasuredChannel(spec, times, values, gauge.quality())


def test_an_unknown_zero_is_found_and_the_torque_follows_from_the_angle(turn: ModelTurn) -> None:
    run = run_of(2.2, **{CRANK: "per_run", "linkage.slider.position": "free"})
    motion = crank_motion(run, turn)
    assert motion.zero_rad == pytest.approx(2.2, abs=0.01)
    found = measured_forces(guided_samples(built("vibration_crank"), motion, run), run, CRANK)
    shares = {each.name: each.share for each in found.compared}
    assert shares["linkage.slider.position"] < 0.02
    assert shares["linkage.crank.effort"] < 0.05
    exact = max(abs(frame.forces.wrenches[0].force_x_n) for frame in frames(built("vibration_crank"), 1.0))
    assert found.largest["forces.crank_bearing.force_x_n"] == pytest.approx(exact, rel=0.02)


def test_two_sensors_of_one_quantity_are_compared_each(turn: ModelTurn) -> None:
    run = run_of(0.0, **{"linkage.slider.position": "free"})
    slider = run.channels[-1]
    rough = replace(slider, values=slider.values + 0.05 * np.sign(np.sin(700.0 * slider.times_s)))
    both = replace(run, channels=(*run.channels, rough))
    motion = crank_motion(run, turn)
    found = measured_forces(guided_samples(built("vibration_crank"), motion, both), both, CRANK)
    rms = [each.rms for each in found.compared if each.name == slider.name]
    assert rms == pytest.approx([0.0, 0.05], abs=0.002)


def compared(run: MeasuredRun, *added: MeasuredChannel) -> list[Compared]:
    """Return the channels beside the model that were added to those of a run."""
    whole = replace(run, channels=(*run.channels, *added))
    model = model_turn(built("vibration_crank"))
    assert model is not None
    samples = guided_samples(built("vibration_crank"), crank_motion(whole, model), whole)
    return measured_forces(samples, whole, CRANK).compared[len(run.channels) - 1 :]


@pytest.mark.slow
@settings(max_examples=8)
@given(
    st.floats(0.5, 50.0),
    st.floats(-5.0, 5.0),
    st.floats(-0.05, 0.15),
    st.sampled_from([1, -1]),
    st.sets(st.sampled_from(["zero", "gain", "lag_s"])),
)
def test_unknown_zero_gain_and_lag_are_those_nearest_to_the_model(
    gain: float, zero: float, lag_s: float, sign: int, unknown: set[str]
) -> None:
    run = run_of(0.0)
    slider = run.channels[-1]
    put_in = {"gain": gain, "zero": zero, "lag_s": lag_s}
    keys = {name: "free" if name in unknown else number for name, number in put_in.items()}
    spec = Channel.model_validate({"source": {"column": "amps"}, "is": slider.name, "unit": "A", "sign": sign, **keys})
    shown = sign * (slider.values - 0.3) / gain + zero
    times_s = slider.times_s + (lag_s if "lag_s" in unknown else 0.0)
    (found,) = compared(run, replace(slider, channel=spec, times_s=times_s, values=spec.to_machine(shown)))
    assert found.share < 1e-3
    assert set(found.found) == unknown
    for name, number in found.found.items():
        assert number == pytest.approx(put_in[name], rel=1e-3, abs=1e-3 if name == "zero" else 1e-5)


def test_a_second_encoder_is_compared_but_for_whole_turns() -> None:
    run = run_of(0.0)
    crank = run.channels[0]
    near, far = compared(
        run, replace(crank, values=crank.values - 2.0 * TURN), replace(crank, values=crank.values + 1.0)
    )
    assert near.rms == pytest.approx(0.0, abs=1e-6)
    assert far.rms == pytest.approx(1.0, abs=1e-6)


@pytest.mark.slow
def test_a_sensor_that_stands_still_is_off_by_its_whole_size() -> None:
    run = run_of(0.0)
    spec = Channel.model_validate(
        {"source": {"column": "a"}, "is": "linkage.crank.effort", "unit": "A", "gain": "free"}
    )
    for dead in (0.0, 1e-3):
        (found,) = compared(
            run, replace(run.channels[1], channel=spec, values=np.full(len(run.channels[1].values), dead))
        )
        assert found.share == 1.0
        assert np.isfinite([found.rms, found.correlation]).all()


@pytest.mark.slow
def test_the_size_of_a_speed_is_that_above_standstill_and_of_a_position_that_of_its_motion() -> None:
    run = run_of(0.0)
    times, slider = run.channels[0].times_s, run.channels[-1]
    speed = 15.708 + 0.0157 * (-1.0) ** np.arange(len(times))
    steady, moved = compared(run, measured(times, "linkage.crank.velocity", speed, {}), replace(slider))
    assert (steady.rms_measured, steady.share) == pytest.approx((15.708, 1e-3), rel=2e-2)
    assert moved.rms_measured == pytest.approx(slider.values.std())


def test_no_lag_is_found_of_a_speed_that_does_not_vary() -> None:
    run = run_of(0.0)
    spec = Channel.model_validate({"source": {"column": "n"}, "is": "linkage.crank.velocity", "lag_s": "free"})
    times_s = run.channels[0].times_s
    speed = 5.0 * np.pi + 0.01 * np.random.default_rng(0).standard_normal(len(times_s))
    turning = measured(times_s, "linkage.crank.velocity", speed, {})
    (found,) = compared(run, replace(turning, channel=spec))
    assert (found.found, found.samples) == ({}, len(times_s))


@pytest.mark.parametrize(
    ("kept", "count"), [(np.arange(501) % 5 == 0, 501), (np.abs(np.arange(501) - 250) > 37, 425)], ids=["few", "gap"]
)
def test_a_channel_is_compared_with_the_curve_between_samples_of_the_crank(
    kept: npt.NDArray[np.bool_], count: int
) -> None:
    run = run_of(0.0)
    crank, slider = run.channels[0], run.channels[-1]
    sparse = replace(crank, times_s=crank.times_s[kept], values=crank.values[kept])
    slide = replace(slider, values=slider.values - 0.3)
    for found in compared(replace(run, channels=(sparse,)), slide, crank):  # the crank by a second encoder too
        assert found.share < 1e-4  # the chord of 18 degrees is off by 1e-2
        assert found.samples == pytest.approx(count, abs=2)  # in the gap of 270 degrees nothing is known


def test_a_channel_of_another_time_is_left_out_for_that_reason(turn: ModelTurn) -> None:
    run = run_of(0.0)
    late = replace(run.channels[-1], times_s=run.channels[-1].times_s + 1e6)
    whole = replace(run, channels=(run.channels[0], late))
    found = measured_forces(guided_samples(built("vibration_crank"), crank_motion(whole, turn), whole), whole, CRANK)
    assert found.compared == []
    ((why, names),) = found.left_out.items()
    assert (names, "none of their samples" in why) == ([late.name], True)


@pytest.mark.parametrize("key", ["zero", "gain"])
def test_a_body_whose_zero_or_gain_is_unknown_gives_no_forces(key: str) -> None:
    breaker = built("mb10_breaker")
    rows = list(frames(breaker, 0.3))
    times_s = np.array([frame.linkage.time_s for frame in rows])
    columns = {name: np.array([frame.linkage.joint(name).position for frame in rows]) for name in ("crank", "body")}
    run = MeasuredRun(
        Path("run"), tuple(measured(times_s, f"linkage.{name}.position", x, {}) for name, x in columns.items())
    )
    model = model_turn(breaker)
    assert model is not None
    motion = crank_motion(run, model)
    assert measured_forces(guided_samples(breaker, motion, run), run, CRANK).compared == []  # the body is given
    spec = run.channels[1].channel.model_copy(update={key: "free"})
    unknown = replace(run, channels=(run.channels[0], replace(run.channels[1], channel=spec)))
    with pytest.raises(MeasurementError, match=f"the {key} of linkage.body.position is free.*expected a number"):
        next(guided_samples(breaker, motion, unknown))


def test_a_zero_that_nothing_tells_is_asked_for(turn: ModelTurn) -> None:
    with pytest.raises(MeasurementError, match="expected a number"):
        crank_motion(run_of(1.0, slider=False, **{CRANK: "free"}), turn)


def test_a_run_without_the_crank_is_refused(turn: ModelTurn) -> None:
    run = run_of(0.0)
    with pytest.raises(MeasurementError, match="is not measured"):
        crank_motion(MeasuredRun(run.path, run.channels[1:]), turn)


def test_a_machine_whose_state_does_not_follow_from_its_crank_says_so(turn: ModelTurn) -> None:
    run = run_of(0.0)
    with pytest.raises(ConfigurationError, match="roller_former"):
        next(guided_samples(built("roller_former"), crank_motion(run, turn), run))
