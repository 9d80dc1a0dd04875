# SPDX-License-Identifier: Apache-2.0
"""The observer on simulated machines: uncertainty through an impact, worth of its sigma, samples that are no news."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from catalogue import PAGES, built
from wrong_machines import wrong_machine

from mech_twin.declarations.configuration_tree import (
    ConfigurationError,
    configuration_tree,
    merged_tree,
    tree_from_flat,
)
from mech_twin.engine.rollout import roll_out
from mech_twin.parameters.load import catalogue_entry
from mech_twin.roles import Machine
from mech_twin.studies.observer.estimate import FrameEstimate, ObserverState, SeenSample, SensedChannel
from mech_twin.studies.observer.filter_state import FilterState, SaltedFilter, state_space
from mech_twin.studies.observer.model_run import AnchorNow, held_sigma, model_run, without_turns
from mech_twin.studies.observer.observer import LOCK_S, PhaseLockedObserver

LATER_S = 1000.0  # clocks of a machine and of a model have nothing to do with each other
CRANK = ("linkage.crank.position", 1e-3)


def samples(
    machine: Machine, channels: list[tuple[str, float]], rate_hz: float, seed: int
) -> Iterator[tuple[SeenSample, np.ndarray]]:
    """Yield what noisy sensors show of a running machine, and every number of the true frame."""
    run, random = roll_out(machine, 3.0), np.random.default_rng(seed)
    every = round(1.0 / rate_hz / machine.coupling_step_s)
    rows = np.column_stack(list(run.columns.values()))
    for i in range(1500 + seed, len(rows), every):
        values = tuple(float(run[name][i] + sigma * random.standard_normal()) for name, sigma in channels)
        yield SeenSample(LATER_S + float(run["time_s"][i]), tuple(range(len(channels))), values), rows[i]


def observer_of(name: str, channels: list[tuple[str, float]]) -> PhaseLockedObserver:
    return PhaseLockedObserver(
        built(name), catalogue_entry(name).build, [SensedChannel(*channel) for channel in channels]
    )


def wrong_of(name: str, seed: int) -> Machine:
    return wrong_machine(built(name).parameters, catalogue_entry(name).build, seed)


def followed(
    observer: PhaseLockedObserver, machine: Machine, channels: list[tuple[str, float]], rate_hz: float, seed: int
) -> list[tuple[FrameEstimate, np.ndarray]]:
    """Return the estimates of a run after the first fifth, each with the true row."""
    pairs = [(observer.take(sample), row) for sample, row in samples(machine, channels, rate_hz, seed)]
    estimated = [(estimate, row) for estimate, row in pairs if estimate is not None]
    return estimated[len(estimated) // 5 :]


def share_inside(
    observer: PhaseLockedObserver, pairs: list[tuple[FrameEstimate, np.ndarray]], names: list[str]
) -> np.ndarray:
    """Return the share of true values inside two sigma of each column."""
    places = [observer.columns[name] for name in names]
    true = np.array([row[places] for _, row in pairs])
    difference = np.array([estimate.row[places] for estimate, _ in pairs]) - true
    angles = np.isin(places, observer.run.angles)
    difference[:, angles] = without_turns(difference[:, angles])
    sigma = np.array([estimate.sigma[places] for estimate, _ in pairs])
    return np.mean(np.abs(difference) <= 2.0 * sigma + 1e-12 * np.abs(true).max(axis=0), axis=0)


def test_slopes_through_an_impact_are_the_saltation_matrix() -> None:
    """``S = DR + (f+ - DR f-) Dh / (Dh f-)`` of gap g and speed v, ``R = (g, -e v)``, ``f = (-v, a)``, ``h = g``."""
    machine = built("impact_mass")
    run = model_run(machine, 0.5)
    columns = run.bank.columns
    space = state_space(run, "impact_mass")
    filter_ = SaltedFilter(run.bank, space, run.angles)
    impacts = [(step, event) for step, event in roll_out(machine, 0.5).stepped_events if event.kind == "impact"]
    step, event = next((s, e) for s, e in impacts if sum(other == s for other, _ in impacts) == 1 and s > 60)
    size, offsets = len(space.places), np.zeros(len(space.places) - space.states)
    state = FilterState(step - 1, run.rows[step - 1].copy(), offsets, np.eye(size), np.zeros((size, 0)))
    slopes = filter_.predicted(state, 1.0).slopes
    row = run.rows[step - 1]
    anchor_m, anchor_m_per_s = (row[columns[f"linkage.memory.anchor_{x}"]] for x in ("gap_m", "velocity_m_per_s"))
    before = event.pre_velocity_m_per_s
    after = -float(row[columns["linkage.memory.restitution_1"]]) * before
    levels = [float(row[columns[f"linkage.memory.phase{i}_acceleration_m_per_s2"]]) for i in (1, 2)]
    flights = [(a, (before - anchor_m_per_s) / a) for a in levels]
    a, flown_s = next((a, t) for a, t in flights if abs(anchor_m - anchor_m_per_s * t - 0.5 * a * t * t) < 1e-9)
    after_s = step * machine.coupling_step_s - event.time_s
    reset = np.diag([1.0, after / before])
    flow_before, flow_after = np.array([-before, a]), np.array([-after, a])
    jump = np.outer(flow_after - reset @ flow_before, [1.0, 0.0]) / -before
    expected = [[1.0, -after_s], [0.0, 1.0]] @ (reset + jump) @ [[1.0, -flown_s], [0.0, 1.0]]
    by_state = [space.names.index(f"linkage.memory.anchor_{name}") for name in ("gap_m", "velocity_m_per_s")]
    places = [columns["linkage.mass.position"], columns["linkage.mass.velocity"]]
    found = np.diag([-1.0, 1.0]) @ slopes[np.ix_(places, by_state)] / space.scales[by_state]
    assert found == pytest.approx(expected, rel=1e-4, abs=1e-6 * np.abs(expected).max())


def test_a_frame_told_from_now_on_moves_as_before_through_its_impacts() -> None:
    run = model_run(built("impact_mass"), 1.0)
    columns, anchor = run.bank.columns, AnchorNow(run, "impact_mass")
    places = [columns[f"linkage.mass.{name}"] for name in ("position", "velocity", "effort")]
    sizes, events, moved = np.ptp(run.rows[:, places], axis=0), 0, 0
    for step in range(200, 500):
        row = anchor.restated(run.rows[step], step)
        moved += not np.array_equal(row, run.rows[step])
        pair = run.bank.advanced(step, np.array([run.rows[step], row]), 1.0)
        if row[columns["linkage.memory.mode_1"]] == run.rows[step, columns["linkage.memory.mode_1"]]:
            assert (
                pair.event_counts[0] == pair.event_counts[1]
            )  # a series of impacts that is told anew lists its small ones anew
        assert pair.rows[1, places] == pytest.approx(pair.rows[0, places], abs=1e-9 * sizes.max())
        events += int(pair.event_counts[0])
    assert events > 30
    assert moved > 200


@pytest.mark.slow
def test_the_sigma_of_the_impact_mass_holds_with_noise_and_wrong_parameters() -> None:
    channels = [("linkage.mass.position", 1e-4), ("linkage.mass.velocity", 1e-2)]
    names = ["linkage.mass.position", "linkage.mass.velocity", "linkage.mass.effort", "forces.stop.force_x_n"]
    inside = []
    for seed in range(6):
        observer = observer_of("impact_mass", channels)
        pairs = followed(observer, wrong_of("impact_mass", seed), channels, 500.0, seed)
        assert observer.counts["lost"] == 0
        inside.append(share_inside(observer, pairs, names))
    assert np.mean(inside) >= 0.95


@pytest.mark.slow
def test_a_wrong_key_is_carried_on_as_what_it_is_and_not_as_noise() -> None:
    """From an exact state a key that pushes by g in each step leads n steps on to ``(sum F^i g)(sum F^i g)'``."""
    run = model_run(built("vibration_crank"), 1.0)
    space = state_space(run, "vibration_crank")
    filter_ = SaltedFilter(run.bank, space, run.angles)
    size = len(space.places)
    effect = np.zeros((len(run.bank.columns), 1))
    effect[space.later, 0] = [0.0, 0.3]
    state = FilterState(
        500, run.rows[500].copy(), np.zeros(size - space.states), np.zeros((size, size)), np.zeros((size, 1))
    )
    pushed = np.zeros(size)
    own = np.zeros(size)
    own[: space.states] = space.signs * effect[space.later, 0] / space.scales[: space.states]
    for _ in range(20):
        ahead = filter_.predicted(state, 1.0)
        transition = np.eye(size)
        transition[: space.states] = ahead.slopes[space.later] / space.scales[: space.states, None]
        pushed = transition @ pushed + own
        state = filter_.committed(state, ahead, np.zeros((size, size)), effect)
    assert own[0] == 0.0 and abs(pushed[0]) > 1e-3  # the push on the speed has turned the crank
    np.testing.assert_allclose(state.with_keys[:, 0], pushed, rtol=1e-9)
    np.testing.assert_allclose(state.covariance, np.outer(pushed, pushed), rtol=1e-7, atol=1e-12 * (pushed @ pushed))


def test_the_state_of_a_frame_is_found_and_drives_have_an_unknown_offset() -> None:
    space = state_space(model_run(built("vibration_crank"), 1.0), "vibration_crank")
    assert space.names == ("linkage.crank.position", "linkage.crank.velocity", "motor.motor.velocity")
    assert space.states == 2


@pytest.mark.slow
def test_two_sigma_hold_95_percent_with_noise_and_wrong_parameters() -> None:
    inside = []
    for seed in range(6):
        observer = observer_of("vibration_crank", [CRANK])
        forces = [name for name in observer.columns if name.startswith("forces.") and name.endswith("_n")]
        names = [*forces, "linkage.crank.effort", "linkage.slider.position", "linkage.slider.velocity"]
        moving = [name for name in names if np.ptp(observer.run.settled[:, observer.columns[name]]) > 0.0]
        pairs = followed(observer, wrong_of("vibration_crank", seed), [CRANK], 100.0, seed)
        assert len(pairs) > 80
        inside.append(share_inside(observer, pairs, moving))
    assert np.mean(inside) >= 0.95


def test_a_ram_that_rests_on_its_anvil_is_followed_through_noise() -> None:
    """A sample moves the estimate off what holds the ram. No step begins there; the machine is not lost by that."""
    page = next(page for page in PAGES if page.endswith("spring_hammer.yaml"))
    ram = ("linkage.ram_guide.position", 3e-4)
    channels = [("linkage.crank_bearing.position", 1e-3), ram]
    observer = observer_of(page, channels)
    pairs = [(observer.take(sample), row) for sample, row in samples(built(page), channels, 500.0, 1)]
    found = [(estimate, row) for estimate, row in pairs if estimate is not None]
    assert observer.counts["lost"] == 0 and len(found) > 0.8 * len(pairs)
    place = observer.columns[ram[0]]
    off = [estimate.row[place] - row[place] for estimate, row in found]
    assert np.sqrt(np.mean(np.square(off))) < ram[1]


def test_a_hidden_speed_is_found() -> None:
    parameters, build = built("vibration_crank").parameters, catalogue_entry("vibration_crank").build
    tree = merged_tree(configuration_tree(parameters), tree_from_flat({"drive.speed_rpm": 153.0}))
    true = build(type(parameters).model_validate(tree))
    observer = observer_of("vibration_crank", [CRANK])
    estimate, row = followed(observer, true, [CRANK], 200.0, 0)[-1]
    place = observer.columns["linkage.crank.velocity"]
    assert estimate.row[place] == pytest.approx(row[place], abs=2.0 * estimate.sigma[place])
    assert estimate.sigma[place] < 0.01 * row[place]


def test_samples_that_are_no_news_are_counted_and_change_nothing() -> None:
    observer = observer_of("vibration_crank", [CRANK])
    stream = [sample for sample, _ in samples(built("vibration_crank"), [CRANK], 100.0, 0)]
    for sample in stream[:60]:
        observer.take(sample)
    assert observer.state is ObserverState.LOCKED
    assert observer.take(stream[59]) is None
    assert observer.take(stream[50]) is None
    assert observer.counts["repeated"] == 1
    assert observer.counts["late"] == 1
    assert observer.take(stream[60]) is not None
    off = stream[61]._replace(values=(stream[61].values[0] + 1.0,))
    estimate = observer.take(off)
    assert estimate is not None
    assert estimate.used == (False,)
    assert observer.counts["unbelievable"] == 1


def test_after_a_jump_of_the_stamps_the_machine_is_located_anew() -> None:
    observer = observer_of("vibration_crank", [CRANK])
    stream = [sample for sample, _ in samples(built("vibration_crank"), [CRANK], 100.0, 0)]
    for sample in stream[:50]:
        observer.take(sample)
    moved = [sample._replace(time_s=sample.time_s - 500.0) for sample in stream[50:]]
    assert observer.take(moved[0]) is None
    assert observer.state is ObserverState.SEARCHING
    assert observer.counts["jump"] == 1
    assert [observer.take(sample) is not None for sample in moved[1:]][-1]


@pytest.mark.parametrize("shift_s", [3600.0, 0.4, -5.0, -500.0])
@pytest.mark.parametrize("at", [0, 10, 50])
def test_one_stamp_that_jumps_costs_a_search_and_no_more(at: int, shift_s: float) -> None:
    observer = observer_of("vibration_crank", [CRANK])
    stream = [sample for sample, _ in samples(built("vibration_crank"), [CRANK], 100.0, 0)]
    estimates = 0
    for i, sample in enumerate(stream):
        if i == at:
            observer.take(sample._replace(time_s=sample.time_s + shift_s))
        estimates += observer.take(sample) is not None
    searched = LOCK_S * 100.0
    assert observer.state is ObserverState.LOCKED
    assert estimates >= len(stream) - 2.0 * searched


def test_another_motion_is_never_locked_on_to() -> None:
    observer = observer_of("vibration_crank", [CRANK, ("linkage.slider.position", 1e-3)])
    random = np.random.default_rng(1)
    for i in range(200):
        values = (float(random.uniform(0.0, 6.0)), float(random.uniform(-1.0, 1.0)))
        assert observer.take(SeenSample(0.01 * i, (0, 1), values)) is None


def test_what_is_held_is_known_ever_less_but_never_worse_than_its_range() -> None:
    run = model_run(built("vibration_crank"), 1.0)
    sigma = np.full(len(run.spread), 1e-3)
    grown = [held_sigma(run, sigma, silent_s) for silent_s in (0.0, 0.01, 0.1, 1e6)]
    assert grown[0] == pytest.approx(sigma)
    assert all((later >= earlier).all() for earlier, later in pairwise(grown))
    assert grown[-1] == pytest.approx(np.hypot(sigma, np.where(run.steepest > 0.0, run.spread, 0.0)))


def test_a_channel_that_is_no_column_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="expected a column of vibration_crank"):
        observer_of("vibration_crank", [("linkage.crank.angle", 1e-3)])
