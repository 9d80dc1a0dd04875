# SPDX-License-Identifier: Apache-2.0
"""Laws of the planar linkage: derivatives, the machines that are special cases of it, and what it refuses."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from mech_twin.engine.crank_state import Transmission
from mech_twin.engine.errors import MotionError
from mech_twin.engine.run import frames
from mech_twin.machines.compaction_press.dynamics import press_pins, press_reduced
from mech_twin.machines.compaction_press.parameters import CompactionPress, press_constants
from mech_twin.machines.planar_linkage import build
from mech_twin.machines.planar_linkage.assembly import mechanism_constants
from mech_twin.machines.planar_linkage.chain import CRANK, ChainMotion, chain_motion
from mech_twin.machines.planar_linkage.linkage import IDLE, PlanarLinkage, reduced
from mech_twin.machines.planar_linkage.metrics import cycle, cycle_metrics
from mech_twin.machines.planar_linkage.parameters import PlanarLinkageParameters
from mech_twin.machines.planar_linkage.pins import pin_forces
from mech_twin.machines.planar_linkage.roles import dead_centres, planar_linkage_role, regimes_at
from mech_twin.machines.planar_linkage.sizing import sizing
from mech_twin.machines.vibration_crank import slider_crank
from mech_twin.machines.vibration_crank.parameters import VibrationCrank, slider_crank_constants
from mech_twin.parameters.load import machine, machine_parameters
from mech_twin.samples import LinkageSample, MotorSample

PAGE = Path(__file__).parents[3] / "docs" / "machines" / "planar_linkage.md"
DRIVE = {
    "drive": {"kind": "constant_speed", "speed_rpm": 120.0},
    "supply": {"initial_fraction": 1.0, "rate_per_s": 2.0},
    "coupling": {"step_s": 0.001},
}
ANGLES = np.linspace(0.1, 6.2, 23)


def linkage(**tree: Any) -> PlanarLinkageParameters:
    return PlanarLinkageParameters.model_validate({**DRIVE, **tree})


def examples() -> list[dict[str, Any]]:
    """Return the configurations printed on the machine's page."""
    blocks = re.findall(r"```yaml\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    trees = [yaml.safe_load(block)["/**"]["ros__parameters"] for block in blocks]
    return [{key: value for key, value in tree.items() if key != "machine"} for tree in trees]


def constants(parameters: PlanarLinkageParameters) -> PlanarLinkage:
    return mechanism_constants(parameters)


# -- special cases, which share no code with it -------------------------------------------------------------------


def as_slider_crank(p: VibrationCrank) -> PlanarLinkageParameters:
    """Return the linkage of a vibration crank: the counterweight at the crank, halves of the rod at its ends."""
    s = slider_crank_constants(p)
    turning = s.rotating_mass + s.counter_mass
    centre = (s.rotating_mass * s.crank_m - s.counter_mass * s.counter_m) / turning
    about = s.rotating_mass * s.crank_m**2 + s.counter_mass * s.counter_m**2 - turning * centre**2
    return linkage(
        crank={
            "length_m": s.crank_m,
            "mass": {"mass_kg": turning, "inertia_kg_m2": about, "centre_x_m": centre},
        },
        dyad_1={
            "kind": "rrp",
            "from_link": "crank",
            "to_x_m": s.offset_m,
            "guide_deg": 90.0,
            "first_m": s.rod_m,
            "branch": "plus" if s.sigma > 0.0 else "minus",
            "second": {"mass_kg": s.joint_mass + s.load_mass},
        },
        load_1={"link": "dyad_1_second", "x_m": 0.0, "force_y_n": -s.working_force},
        gravity_m_per_s2=s.gravity,
    )


@pytest.mark.parametrize("slider", ["above", "below"])
def test_a_slider_crank_has_the_forces_of_the_vibration_crank(slider: str) -> None:
    overrides = {"slider": slider, "offset_m": 0.03, "working_force_n": 250.0}
    parameters = machine_parameters("vibration_crank", None, overrides)
    assert isinstance(parameters, VibrationCrank)
    s, chain = slider_crank_constants(parameters), constants(as_slider_crank(parameters))
    for angle in ANGLES:
        expected = slider_crank.pin_forces(s, angle, 15.0, 40.0)
        found = pin_forces(chain, angle, 15.0, 40.0, IDLE)
        by = reduced(chain, angle, IDLE)
        assert (by.inertia, by.slope, by.moment) == pytest.approx(slider_crank.reduced(s, angle), rel=1e-10, abs=1e-9)
        assert found.drive_nm == pytest.approx(expected.moment, rel=1e-10, abs=1e-8)
        assert (found.x[0], found.y[0]) == pytest.approx((expected.bearing_x, expected.bearing_y), rel=1e-9, abs=1e-7)
        assert (found.x[2], found.y[2]) == pytest.approx((expected.pin_x, expected.pin_y), rel=1e-9, abs=1e-7)
        assert found.x[3] == pytest.approx(expected.ground_x, rel=1e-9, abs=1e-7)
        shaking = (expected.frame_x, expected.frame_y)
        assert (found.shaking_x, found.shaking_y) == pytest.approx(shaking, rel=1e-9, abs=1e-7)


def as_four_bar(p: CompactionPress) -> PlanarLinkageParameters:
    """Return the linkage of a press, without its layer."""

    def mass(link: Any) -> dict[str, float]:
        return {
            "mass_kg": link.mass_kg,
            "inertia_kg_m2": link.inertia_kg_m2,
            "centre_x_m": link.centroid_along_m,
            "centre_y_m": link.centroid_across_m,
        }

    bar, links = p.linkage, p.links
    return linkage(
        crank={"length_m": bar.crank_m, "mass": mass(links.crank)},
        dyad_1={
            "kind": "rrr",
            "from_link": "crank",
            "to_x_m": bar.pivot_x_m,
            "to_y_m": bar.pivot_y_m,
            "first_m": bar.coupler_m,
            "second_m": bar.pendulum_m,
            "branch": "minus",
            "first": mass(links.plate),
            "second": mass(links.pendulum),
        },
    )


def test_a_four_bar_has_the_forces_of_the_press() -> None:
    overrides = {"links.plate.centroid_across_m": 0.04, "links.pendulum.centroid_across_m": -0.02}
    parameters = machine_parameters("compaction_press", None, overrides)
    assert isinstance(parameters, CompactionPress)
    press, _ = press_constants(parameters, fitted=False)
    chain = constants(as_four_bar(parameters))
    for angle in ANGLES:
        expected, by = press_pins(press, angle, 20.0, -30.0, 0.0), press_reduced(press, angle, 0)
        found, own = pin_forces(chain, angle, 20.0, -30.0, IDLE), reduced(chain, angle, IDLE)
        assert (own.inertia, own.slope) == pytest.approx((by.inertia, by.slope), rel=1e-10, abs=1e-9)
        assert own.moment == pytest.approx(by.moment, rel=1e-10, abs=1e-9)
        pairs = zip(expected[:8], (v for i in range(4) for v in (found.x[i], found.y[i])), strict=True)
        assert all(abs(one) == pytest.approx(abs(other), rel=1e-9, abs=1e-7) for one, other in pairs)


# -- derivatives and the two routes, on random linkages -----------------------------------------------------------


@st.composite
def linkages(draw: st.DrawFn) -> PlanarLinkageParameters:
    """Draw a linkage of three dyads, one of each kind, on links that move."""

    def number(low: float, high: float) -> float:
        return draw(st.floats(low, high))

    def mass() -> dict[str, float]:
        keys = {
            "mass_kg": (0.1, 5.0),
            "inertia_kg_m2": (0.0, 0.1),
            "centre_x_m": (-0.2, 0.2),
            "centre_y_m": (-0.1, 0.1),
        }
        return {key: number(*bounds) for key, bounds in keys.items()}

    crank = number(0.03, 0.06)
    return linkage(
        crank={"length_m": crank, "mass": mass()},
        dyad_1={
            "kind": "rrr",
            "from_link": "crank",
            "to_x_m": number(0.35, 0.4),
            "to_y_m": number(-0.05, 0.05),
            "first_m": number(0.32, 0.36),
            "second_m": number(0.2, 0.25),
            "branch": draw(st.sampled_from(["plus", "minus"])),
            "first": mass(),
            "second": mass(),
        },
        dyad_2={
            "kind": "rpr",
            "from_link": "dyad_1_first",
            "from_x_m": number(0.1, 0.2),
            "from_y_m": number(-0.1, 0.1),
            "to_x_m": number(0.9, 1.0),
            "to_y_m": number(-0.2, 0.2),
            "second_m": 0.4,
            "first": mass(),
            "second": mass(),
        },
        dyad_3={
            "kind": "rrp",
            "from_link": "dyad_2_second",
            "from_x_m": number(-0.1, 0.1),
            "to_link": draw(st.sampled_from(["ground", "dyad_1_second"])),
            "to_y_m": number(-0.1, 0.1),
            "guide_deg": number(-20.0, 20.0),
            "first_m": number(1.8, 2.2),
            "branch": draw(st.sampled_from(["plus", "minus"])),
            "first": mass(),
            "second": mass(),
        },
        load_1={"link": "dyad_2_second", "x_m": 0.3, "force_x_n": number(-50.0, 50.0), "force_y_n": 20.0},
        spring_1={
            "link": "dyad_1_second", "x_m": 0.1, "ground_x_m": 0.3, "ground_y_m": 0.4,
            "rate_n_per_m": number(0.0, 500.0), "free_m": number(0.0, 0.3),
        },
        working_stroke={"link": "dyad_3_second", "direction_deg": 10.0, "force_n": number(0.0, 200.0)},
    )  # fmt: skip


def values(m: ChainMotion) -> np.ndarray[Any, Any]:
    """Return angles as unit vectors, and origins: numbers without jumps."""
    return np.concatenate([np.cos(m.angle), np.sin(m.angle), m.x, m.y])


def rates(m: ChainMotion) -> np.ndarray[Any, Any]:
    return np.concatenate([-np.sin(m.angle) * m.angle1, np.cos(m.angle) * m.angle1, m.x1, m.y1])


def second_rates(m: ChainMotion) -> np.ndarray[Any, Any]:
    c, s = np.cos(m.angle), np.sin(m.angle)
    return np.concatenate([-c * m.angle1**2 - s * m.angle2, -s * m.angle1**2 + c * m.angle2, m.x2, m.y2])


@given(linkages(), st.floats(-7.0, 7.0))
def test_derivatives_are_those_of_the_positions(parameters: PlanarLinkageParameters, angle: float) -> None:
    dyads, h = constants(parameters).dyads, 1e-5
    here, before, after = (chain_motion(dyads, angle + shift)[0] for shift in (0.0, -h, h))
    assert np.allclose((values(after) - values(before)) / (2.0 * h), rates(here), rtol=1e-6, atol=1e-7)
    assert np.allclose((rates(after) - rates(before)) / (2.0 * h), second_rates(here), rtol=1e-6, atol=1e-7)


@given(linkages(), st.floats(-7.0, 7.0), st.floats(-30.0, 30.0), st.floats(-100.0, 100.0), st.sampled_from([0, 1]))
def test_the_torque_is_the_same_by_work_and_by_equilibrium(
    parameters: PlanarLinkageParameters, angle: float, w: float, e: float, regime: int
) -> None:
    chain = constants(parameters)
    by = reduced(chain, angle, regime)
    torque = by.inertia * e + 0.5 * w * w * by.slope - by.moment
    size = 1.0 + abs(by.inertia * e) + abs(w * w * by.slope) + abs(by.moment) + by.inertia * w * w
    assert pin_forces(chain, angle, w, e, regime).drive_nm == pytest.approx(torque, abs=1e-10 * size)


def test_a_pin_that_carries_a_load_beside_the_crank_costs_the_drive_torque_its_digits_alone() -> None:
    """A spring's 2e10 N on an arm of 100 m, held by the frame: the routes differ by rounding of what cancels."""
    guide = {"kind": "rpr", "from_link": "crank", "to_link": "ground", "to_x_m": 0.0, "to_y_m": -0.0068375}
    slide = {"kind": "rrp", "from_link": "dyad_1_second", "to_link": "ground", "to_x_m": 0.0, "to_y_m": 0.235}
    spring = {"link": "dyad_2_first", "x_m": 100.0, "y_m": 0.387, "ground_x_m": -0.0003, "ground_y_m": 97.424}
    mass = {"mass_kg": 2.53, "inertia_kg_m2": 1.956, "centre_x_m": -0.0094}
    made = build(
        linkage(
            drive={"kind": "constant_speed", "speed_rpm": 0.7},
            crank={"length_m": 0.003567, "flywheel_kg_m2": 0.0763},
            dyad_1={**guide, "branch": "plus", "second": mass},
            dyad_2={**slide, "branch": "plus", "first_m": 0.25},
            spring_1={**spring, "rate_n_per_m": 2.9e8, "free_m": 55.3},
        )
    )
    chain, missed = made.linkage.mechanism.chain, 0.0
    for angle in np.linspace(0.0, 2.0 * math.pi, 1000):
        at, by = pin_forces(chain, angle, 0.1, 0.0, IDLE), reduced(chain, angle, IDLE)
        miss = abs(at.drive_nm - (0.005 * by.slope - by.moment))
        assert miss < 1e-15 * at.balanced_nm
        missed = max(missed, miss)
    assert missed > 1e-10 * made.forces.model.moment_scale_nm
    for frame in frames(made, 0.5):
        assert abs(frame.forces.residuals["drive_torque_routes"]) < 1e-10


@pytest.mark.parametrize("number", range(3))
def test_the_moments_that_cancel_are_no_part_of_the_scale_of_a_usual_linkage(number: int) -> None:
    """The routes are compared over the peak torque, unless the pins' moments are 1e5 times as large."""
    made = build(PlanarLinkageParameters.model_validate(examples()[number]))
    chain, scale = made.linkage.mechanism.chain, made.forces.model.moment_scale_nm
    for angle in ANGLES:
        assert pin_forces(chain, angle, 12.0, 0.0, IDLE).balanced_nm < 1e3 * scale


@given(linkages(), st.floats(0.0, 2.0 * math.pi))
def test_frame_forces_balance_weights_loads_and_inertia(parameters: PlanarLinkageParameters, angle: float) -> None:
    """What ground and springs give the moving links is their inertia less their weight and the load."""
    chain, w = constants(parameters), 12.0
    found = pin_forces(chain, angle, w, 5.0, IDLE)
    grounded = [0] + [3 + 3 * k for k in range(3) if chain.dyads.to_link[k] == 0]
    m, _ = chain_motion(chain.dyads, angle)
    assert CRANK == 1 and m.x[0] == 0.0
    spring, load = parameters.springs[0], parameters.loads[0]
    c, s = math.cos(m.angle[3]), math.sin(m.angle[3])
    x, y = m.x[3] + c * spring.x_m - spring.ground_x_m, m.y[3] + s * spring.x_m - spring.ground_y_m
    pull = spring.rate_n_per_m * (math.hypot(x, y) - spring.free_m) / math.hypot(x, y)
    weight = chain.gravity * chain.masses.mass_kg.sum()
    sum_x = sum(found.x[i] for i in grounded) - pull * x + load.force_x_n
    sum_y = sum(found.y[i] for i in grounded) - pull * y + load.force_y_n - weight
    assert (sum_x, sum_y) == pytest.approx((-found.shaking_x, -found.shaking_y), rel=1e-9, abs=1e-7)


# -- runs ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", range(3))
def test_the_printed_examples_run_within_their_limits(number: int) -> None:
    tree = examples()[number]
    made = build(PlanarLinkageParameters.model_validate(tree))
    limits = {**made.linkage.residual_limits, **made.forces.residual_limits}
    turned = 0.0
    for frame in frames(made, 0.6):
        for sample in (frame.linkage, frame.forces):
            for name, value in sample.residuals.as_dict().items():
                assert abs(value) <= limits[name]
        turned = frame.linkage.joint("crank").position
    assert abs(turned) > 2.0 * math.pi


def test_crank_dyad_and_drive_are_description_enough() -> None:
    """Supply and step that are left out are rated speed from the start, and half a millisecond."""
    tree = {
        "crank": {"length_m": 0.06, "mass": {"mass_kg": 5.0, "inertia_kg_m2": 0.02}},
        "dyad_1": {"kind": "rrr", "from_link": "crank", "to_x_m": 0.3, "first_m": 0.28, "second_m": 0.15},
        "drive": {"kind": "constant_speed", "speed_rpm": 120.0},
    }
    last = list(frames(build(PlanarLinkageParameters.model_validate(tree)), 0.5))[-1].linkage
    assert last.step == 1000
    assert last.joint("crank").position == pytest.approx(2.0 * math.pi, rel=1e-9)


def test_the_working_stroke_takes_its_force_times_its_length() -> None:
    made = machine("planar_linkage")
    seen = [frame.linkage for frame in frames(made, 1.0)]
    parameters = made.parameters
    assert isinstance(parameters, PlanarLinkageParameters) and parameters.working_stroke is not None
    travel = [sample.joint("dyad_2_second").position for sample in seen]
    work = parameters.working_stroke.force_n * (max(travel) - min(travel))
    assert -seen[-1].memory["load_work_j"] == pytest.approx(work, rel=1e-4)
    kinds = [event.kind for sample in seen for event in sample.events]
    assert kinds.count("stroke_begins") == 1 and kinds.count("stroke_ends") == 1


def test_the_largest_forces_of_a_turn_count_both_sides_of_a_dead_centre() -> None:
    parameters = machine_parameters("planar_linkage")
    chain = constants(parameters)
    metrics = cycle_metrics(parameters, chain, ("crank_bearing",))
    w, sense = parameters.drive.speed_rad_per_s, parameters.direction
    centres = dead_centres(chain)
    for centre in (*centres.rear, *centres.front):
        for beside in (centre - 1e-9, centre + 1e-9):
            regime = int(regimes_at(chain, np.array([beside]), sense)[0])
            at = pin_forces(chain, beside, w, 0.0, regime)
            assert math.hypot(at.x[0], at.y[0]) <= metrics["crank_bearing_force_max_n"] * (1.0 + 1e-6)
            assert abs(at.drive_nm) <= metrics["drive_torque_peak_nm"] * (1.0 + 1e-6)


def test_a_tool_that_turns_back_finds_nothing_until_where_it_turned() -> None:
    role = machine("planar_linkage").linkage

    def turned(sample: LinkageSample, speed: float, steps: int) -> list[LinkageSample]:
        seen = []
        for _ in range(steps):
            motor = MotorSample(sample.step, sample.time_s, ("motor",), (0.0,), (speed,), (0.0,), 1.0)
            sample = role.advance(sample, motor, None)
            seen.append(sample)
        return seen

    def regimes(seen: list[LinkageSample]) -> list[str]:
        return [role.regimes[sample.regime] for sample in seen]

    there = turned(role.start(), -6.0, 600)
    assert regimes(there)[-100:] == ["working_reversed"] * 100
    back = turned(there[-1], 6.0, 60)
    assert set(regimes(back[5:])) == {"done_reversed"}
    again = turned(back[-1], -6.0, 100)
    farthest = min(sample.joint("crank").position for sample in [*there, *back])
    working = [at.joint("crank").position < farthest for at in again]
    assert regimes(again) == ["working_reversed" if beyond else "done_reversed" for beyond in working]
    assert any(working)
    assert abs(again[-1].residuals["energy_balance"]) <= role.residual_limits["energy_balance"]


def test_a_link_that_turns_with_the_crank_counts_its_turns() -> None:
    """A drag link: the ground is the shortest link, so coupler and rocker make full turns."""
    tree = {
        "crank": {"length_m": 0.3, "mass": {"mass_kg": 1.0}},
        "dyad_1": {"kind": "rrr", "from_link": "crank", "to_x_m": 0.1, "first_m": 0.28, "second_m": 0.32},
    }
    made = build(linkage(**tree))
    rocker = [frame.linkage.joint("dyad_1_second") for frame in frames(made, 1.6)]
    assert rocker[-1].position - rocker[0].position > 3.0 * 2.0 * math.pi
    steps = np.diff([at.position for at in rocker])
    mean = 0.5e-3 * (np.array([at.velocity for at in rocker[:-1]]) + np.array([at.velocity for at in rocker[1:]]))
    assert np.allclose(steps, mean, atol=1e-5)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_the_flywheel_keeps_the_asked_non_uniformity_in_a_time_run(sense: float) -> None:
    overrides = {"drive.speed_rpm": 60.0 * sense}
    parameters = machine_parameters("planar_linkage", None, overrides)
    assert isinstance(parameters, PlanarLinkageParameters)
    found = sizing(parameters, {"non_uniformity": 0.1}, "flywheel_inertia_kg_m2", lambda name: {})
    sized = found.parameters
    assert isinstance(sized, PlanarLinkageParameters)
    chain = constants(sized)
    torque = cycle(sized, chain).mean_torque_nm
    role = planar_linkage_role(sized, chain)
    run = replace(role, transmission=Transmission(1.0, 1.0, 1e-12), step_s=1e-3)
    sample, speeds, turns = run.start(), [], []
    while len(turns) < 3 and sample.step < 20000:
        motor = MotorSample(sample.step, sample.time_s, ("motor",), (0.0,), (0.0,), (torque,), 1.0)
        before, sample = sample, run.advance(sample, motor, None)
        crank = sample.joint("crank")
        speeds.append(abs(crank.velocity))
        if abs(crank.position) // (2.0 * math.pi) > abs(before.joint("crank").position) // (2.0 * math.pi):
            turns.append(len(speeds))
    last = speeds[turns[0] : turns[1]]
    spread = 2.0 * (max(last) - min(last)) / (max(last) + min(last))
    assert spread == pytest.approx(0.1, rel=0.1)  # the mean speed of a free run is not exactly the rated one


def test_a_load_that_swings_the_crank_too_often_in_a_step_is_refused_with_one_that_holds() -> None:
    """1e7 N on an arm of 100 m turn a crank of 1e-3 kg m^2 some thousand times a second."""
    loaded = {"link": "dyad_1_first", "x_m": 0.36, "y_m": -100.0, "force_y_n": 1e7}
    motor = {"rated_power_w": 22000.0, "rated_speed_rpm": 975.0, "synchronous_speed_rpm": 1000.0}
    motor |= {"breakdown_torque_ratio": 2.4, "starting_torque_ratio": 1.3, "rotor_inertia_kg_m2": 1e-3}
    crank = {"length_m": 0.1, "mass": {"mass_kg": 1e-3, "inertia_kg_m2": 1e-3}}
    tree = {
        "crank": crank,
        "dyad_1": {"kind": "rpr", "from_link": "crank", "from_y_m": -0.2, "to_y_m": -0.25, "second_m": 0.5},
        "load_1": loaded,
        "motor": motor,
        "gear": {"ratio": 2.3667, "efficiency": 0.97},
        "drive": {"kind": "kloss", "speed_rpm": -60.0},
    }
    with pytest.raises(
        MotionError, match=r"^coupling\.step_s = 0\.001 s takes more than 20000 .*; try 0\.0001, in the"
    ) as told:
        list(frames(build(linkage(**tree, coupling={"step_s": 1e-3})), 0.02))
    assert "\n" not in str(told.value)
    held = build(linkage(**tree, coupling={"step_s": 1e-4}))
    for frame in frames(held, 0.02):
        assert abs(frame.linkage.residuals["energy_balance"]) <= held.linkage.residual_limits["energy_balance"]


# -- what is refused ----------------------------------------------------------------------------------------------


def refused() -> Iterator[tuple[dict[str, Any], str]]:
    crank = {"length_m": 0.1, "mass": {"mass_kg": 1.0}}
    four_bar = {"kind": "rrr", "from_link": "crank", "to_x_m": 0.4, "first_m": 0.35, "second_m": 0.2}
    yield {"crank": crank, "dyad_1": {**four_bar, "second_m": 0.1}}, "dyad_1.*cannot make a full turn"
    yield {"crank": crank, "dyad_1": {"kind": "rrp", "from_link": "crank", "first_m": 0.09}}, "does not reach the guide"
    yield {"crank": crank, "dyad_1": {**four_bar, "from_link": "dyad_1_second"}}, "dyad_1.from_link.*link before it"
    yield (
        {"crank": crank, "dyad_1": {"kind": "rrr", "from_link": "crank", "first_m": 0.3}},
        "rrr needs the key second_m",
    )
    yield {"crank": crank, "dyad_1": {"kind": "rpr", "from_link": "crank", "first_m": 0.3, "to_x_m": 0.3}}, "no first_m"
    yield {"crank": crank, "dyad_1": {"kind": "rpr", "from_link": "crank", "to_x_m": 0.1}}, "bar's pivot"
    yield {"crank": {"length_m": 0.1}, "dyad_1": four_bar}, "expected a mass"
    yield {"crank": crank, "dyad_1": four_bar, "dyad_3": four_bar}, "dyad_2 is missing"
    yield {"crank": crank, "dyad_1": four_bar, "load_1": {"link": "ground", "x_m": 0.0}}, "load_1.link.*moving link"


@pytest.mark.parametrize(("tree", "reason"), list(refused()))
def test_what_cannot_turn_is_refused_in_words(tree: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        linkage(**tree)


@pytest.mark.parametrize("speed_rpm", [45.0, -60.0])
def test_no_sample_of_a_run_exceeds_the_largest_forces_of_its_turn(speed_rpm: float) -> None:
    """The largest force lies between two rows of the table of the turn as a rule, and is looked for there."""
    linkage = machine("planar_linkage", overrides={"drive.speed_rpm": speed_rpm, "coupling.step_s": 0.001})
    told = linkage.report()
    for frame in frames(linkage, 1.5):
        for pin, (x, y, _) in zip(frame.forces.pins, frame.forces.wrenches, strict=True):
            assert math.hypot(x, y) <= told[f"{pin}_force_max_n"] * (1.0 + 1e-9), (pin, frame.linkage.time_s)
