# SPDX-License-Identifier: Apache-2.0
"""Laws of the press: equilibrium, power, mirror symmetry, events, energy; any design, either direction."""

from math import atan2, cos, hypot, pi, sin

import numpy as np
import pytest
from crank_drives import PRESS_KLOSS as KLOSS

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.run import frames
from mech_twin.machines.compaction_press.cycle import WORK_POSITIONS, mean_torque, press_cycle, regime_at
from mech_twin.machines.compaction_press.dynamics import (
    CONTACT,
    loaded_height,
    press_pins,
    press_reduced,
    press_weights,
)
from mech_twin.machines.compaction_press.metrics import cycle_metrics
from mech_twin.machines.compaction_press.parameters import press_constants
from mech_twin.parameters.load import machine
from mech_twin.parts.four_bar import Link, failing_inequality


def random_presses(count):
    """Return presses with random rotatable four-bars, masses off the lines, and loads."""
    random = np.random.default_rng(7)
    base, _ = press_constants(machine("compaction_press").parameters)
    out = []
    while len(out) < count:
        r, r1, r3, x, y = random.uniform((0.02, 0.3, 0.1, 0.3, -0.5), (0.12, 0.8, 0.6, 0.8, 0.5))
        bar = base.bar._replace(crank_m=r, coupler_m=r1, rocker_m=r3, pivot_x_m=x, pivot_y_m=y)
        ground = hypot(x, y)
        if min(r1 + r3 - r - ground, abs(ground - r) - abs(r1 - r3)) < 0.005 or failing_inequality(bar):
            continue
        bar = bar._replace(branch=random.choice((-1.0, 1.0)))
        links = [Link(*random.uniform((1.0, 0.01, -0.2, -0.1), (40.0, 1.0, 0.4, 0.1))) for _ in range(3)]
        # the crank's inertia is about O
        links[0] = links[0]._replace(
            inertia_kg_m2=links[0].inertia_kg_m2 + links[0].mass_kg * (links[0].along_m ** 2 + links[0].across_m ** 2)
        )
        along, across = random.uniform((0.0, -0.1), (r1, 0.1))
        out.append(
            base._replace(bar=bar, crank=links[0], plate=links[1], pendulum=links[2], along_m=along, across_m=across)
        )
    return out


def test_reduced_and_dyad_routes_agree_on_random_designs():
    random = np.random.default_rng(11)
    for press in random_presses(200):
        w, e = random.uniform(-60.0, 60.0), random.uniform(-200.0, 200.0)
        difference, peak = 0.0, 0.0
        for f in np.arange(72) * (2.0 * pi / 72):
            now = press_reduced(press, f, CONTACT)
            reduced = now.inertia * e + 0.5 * w * w * now.slope - now.moment
            pins = press_pins(press, f, w, e, now.force)
            difference = max(difference, abs(reduced - pins.moment))
            peak = max(peak, abs(pins.moment))
        assert difference <= 1e-10 * peak


def test_power_balances_on_random_designs():
    """Drive and load power equal the rate of kinetic and potential energy, by differences of the energy."""
    for press in random_presses(25):
        w, h = 20.0, 1e-4
        for f in (0.3, 2.2, 4.4):
            now = press_reduced(press, f, CONTACT)
            power = press_pins(press, f, w, 0.0, now.force).moment * w + now.force * now.y1 * w

            def energy(f, press=press, w=w):
                return 0.5 * press_reduced(press, f, 0).inertia * w * w + press_weights(press, f)

            rate = (8.0 * (energy(f + h) - energy(f - h)) - (energy(f + 2 * h) - energy(f - 2 * h))) / (12.0 * h) * w
            assert power == pytest.approx(rate, abs=1e-8 * max(1.0, abs(power), energy(f) * w))


def test_mirrored_branch_mirrors_forces():
    """The press mirrored in the x axis, gravity and load off: forces mirror, the moment turns its sign."""
    for press in random_presses(20):
        free = press._replace(gravity=0.0)
        mirrored = free._replace(
            bar=free.bar._replace(pivot_y_m=-free.bar.pivot_y_m, branch=-free.bar.branch),
            crank=free.crank._replace(across_m=-free.crank.across_m),
            plate=free.plate._replace(across_m=-free.plate.across_m),
            pendulum=free.pendulum._replace(across_m=-free.pendulum.across_m),
            across_m=-free.across_m,
        )
        for f in (0.4, 1.9, 5.0):
            one, two = press_pins(free, f, 12.0, 3.0, 500.0), press_pins(mirrored, -f, -12.0, -3.0, -500.0)
            for name in ("o_x", "a_x", "b_x", "c_x"):
                assert getattr(two, name) == pytest.approx(getattr(one, name), abs=1e-7)
            for name in ("o_y", "a_y", "b_y", "c_y", "moment"):
                assert getattr(two, name) == pytest.approx(-getattr(one, name), abs=1e-7)


def test_position_and_rates_from_direct_closure():
    press = machine("compaction_press")
    for f in np.linspace(0.0, 6.2, 13):
        at = press.analyse(f)
        (a_x, a_y), (b_x, b_y) = at["a_m"], at["b_m"]
        assert hypot(b_x - a_x, b_y - a_y) == pytest.approx(0.5, abs=1e-12)
        assert hypot(b_x - 0.5, b_y - 0.24) == pytest.approx(0.3, abs=1e-12)
        assert (a_x, a_y) == pytest.approx((0.06 * cos(f), 0.06 * sin(f)), abs=1e-15)
        assert at["gamma_deg"] == pytest.approx(abs(atan2(b_y - a_y, b_x - a_x)) * 180.0 / pi, abs=1e-12)


@pytest.mark.parametrize(
    "overrides",
    [
        {},
        {"drive.speed_rpm": -300.0, "supply.initial_fraction": 0.0},
        {"linkage.branch": "crossed", "linkage.pivot_y_m": -0.24},
        {"working_force.contact_fraction": 0.0, "working_force.exponent": 2.0},
        KLOSS,
    ],
    ids=["forward", "backward from rest", "crossed", "square layer", "kloss"],
)
def test_run_keeps_its_energy_balance_and_meets_the_layer_once_a_turn(overrides):
    press = machine("compaction_press", overrides=overrides)
    kinds = []
    for frame in frames(press, 2.0):
        for role, sample in ((press.linkage, frame.linkage), (press.forces, frame.forces)):
            for name, value in sample.residuals.as_dict().items():
                assert abs(value) <= role.residual_limits[name], (name, frame.linkage.step)
        kinds += [event.kind for event in frame.linkage.events if event.contact == "plate"]
        assert all(
            (step - 1) * press.coupling_step_s <= event.time_s <= step * press.coupling_step_s + 1e-15
            for step in (frame.linkage.step,)
            for event in frame.linkage.events
        )
    assert kinds[1::2] == ["bottom"] * (len(kinds) // 2)
    assert len(kinds) >= 4


# the loaded point has two lows a turn: on its way to the lower one it rises above the layer again
TWO_LOWS = {
    "drive.speed_rpm": -341.0,
    "linkage.crank_m": 3.58,
    "linkage.coupler_m": 8.48,
    "linkage.pendulum_m": 3.62,
    "linkage.pivot_x_m": 8.37,
    "linkage.pivot_y_m": 1.52,
    "links.crank.inertia_kg_m2": 4000.0,
    "working_force.application_from_a_m": 16.0,
    "working_force.peak_n": 1e6,
    "working_force.contact_fraction": 0.12,
}


def test_a_layer_is_met_at_the_first_of_its_heights_and_leaves_nothing_open_where_the_plate_rises_off_it():
    press = machine("compaction_press", overrides={**TWO_LOWS, "working_force.exponent": 1.0})
    constants, stroke = press_constants(press.parameters)
    assert stroke.risen_m > 0.1
    way = -np.linspace(0.0, (stroke.top - stroke.contact_reversed) % (2.0 * pi), 200)[1:-1]
    assert all(loaded_height(constants, stroke.top + f)[0] > stroke.contact_y_m for f in way)
    run = list(frames(press, 0.4))
    assert max(abs(frame.linkage.residuals["energy_balance"]) for frame in run) < 1e-8
    kinds = [event.kind for frame in run for event in frame.linkage.events]
    assert kinds == ["contact", "bottom", "contact", "bottom", "contact"]  # in two turns and a quarter


@pytest.mark.parametrize("exponent", [0.0, 0.5])
def test_a_force_that_sets_in_at_once_is_refused_where_the_plate_rises_off_the_layer(exponent):
    with pytest.raises(ConfigurationError, match=r"working_force.exponent must be at least 1 where .* got "):
        machine("compaction_press", overrides={**TWO_LOWS, "working_force.exponent": exponent})


def test_a_plate_that_rises_off_the_layer_by_a_hair_between_even_angles_is_seen():
    keys = {
        "linkage.crank_m": 0.24535445737738037,
        "working_force.application_from_a_m": 0.25,
        "working_force.application_across_m": -0.437717237975624,
        "working_force.working_quarter": True,
    }
    _, stroke = press_constants(
        machine("compaction_press", overrides={**keys, "working_force.exponent": 1.0}).parameters
    )
    assert 0.0 < stroke.risen_m < 1e-3
    with pytest.raises(ConfigurationError, match=r"working_force.exponent must be at least 1 where .* got 0"):
        machine("compaction_press", overrides={**keys, "working_force.exponent": 0.0})


def test_events_come_at_their_crank_angle():
    press = machine("compaction_press")
    stroke = press_constants(press.parameters)[1]
    events = [event for frame in frames(press, 0.5) for event in frame.linkage.events]
    times = [(stroke.contact + 2.0 * pi * i, stroke.bottom + 2.0 * pi * i) for i in range(3)]
    for event, angle in zip(events, [angle for pair in times for angle in pair], strict=False):
        assert event.time_s == pytest.approx(angle / (10.0 * pi), abs=1e-12)


def test_run_equals_the_closed_form_cycle():
    press = machine("compaction_press")
    report, observer = press.report(), press.observer()
    for frame in frames(press, 0.2):
        observer.observe(frame)
    numbers = observer.numbers()
    assert numbers["run_drive_torque_max_nm"] == pytest.approx(report["drive_torque_peak_nm"], rel=1e-4)
    assert numbers["run_drive_work_j"] == pytest.approx(report["work_per_cycle_j"], rel=1e-9)


def test_kloss_run_does_not_depend_on_the_step():
    ends = [
        list(frames(machine("compaction_press", overrides={**KLOSS, "coupling.step_s": step}), 0.4))[-1]
        for step in (0.002, 0.001, 0.0005)
    ]
    for coarse in ends[:2]:
        assert coarse.linkage.position[0] == pytest.approx(ends[2].linkage.position[0], abs=1e-9)


def test_extremes_are_those_of_the_curve_where_a_small_transmission_angle_makes_its_peaks_narrow():
    """No position of a turn has a torque, or asks for a flywheel, beyond what the cycle tells."""
    narrow = {
        "linkage.crank_m": 0.02417391,
        "linkage.coupler_m": 0.04421957,
        "linkage.pendulum_m": 0.02653175,
        "linkage.pivot_x_m": 0.04421957,
        "linkage.pivot_y_m": 0.01462356,
        "links.plate.mass_kg": 0.0,
        "links.plate.inertia_kg_m2": 0.0,
        "links.pendulum.mass_kg": 2500.0,
        "links.pendulum.inertia_kg_m2": 0.147,
        "links.pendulum.centroid_along_m": 0.0,
        "working_force.application_from_a_m": 0.0221,
        "working_force.working_quarter": True,
        "drive.speed_rpm": -120.0,
    }
    press = machine("compaction_press", overrides=narrow)
    told = cycle_metrics(press.parameters)
    assert min(told["transmission_angle_min_deg"], 180.0 - told["transmission_angle_max_deg"]) < 2.0
    constants, stroke = press_constants(press.parameters)
    torques = press_cycle(constants, stroke, press.parameters.drive.speed_rad_per_s, WORK_POSITIONS).drive_torque_nm
    assert told["drive_torque_peak_nm"] == pytest.approx(np.abs(torques).max(), rel=1e-5)
    assert told["drive_torque_max_nm"] == pytest.approx(torques.max(), rel=1e-5)
    assert told["drive_torque_min_nm"] == pytest.approx(torques.min(), rel=1e-5)
    assert told["flywheel_inertia_kg_m2"] == pytest.approx(told["flywheel_inertia_wittenbauer_kg_m2"], rel=1e-5)


@pytest.mark.parametrize("speed_rpm", [300.0, -300.0])
def test_peak_torque_is_the_largest_by_size_in_either_sense(speed_rpm):
    """Turning backward the press is driven by negative torques; its peak is theirs."""
    told = cycle_metrics(machine("compaction_press", overrides={"drive.speed_rpm": speed_rpm}).parameters)
    assert told["drive_torque_peak_nm"] == max(told["drive_torque_max_nm"], -told["drive_torque_min_nm"])
    assert told["drive_torque_peak_nm"] == pytest.approx(200.0, abs=5.0)


@pytest.mark.parametrize("speed_rpm", [300.0, -300.0])
def test_the_cycle_s_torque_and_power_bear_the_shaft_s_friction(speed_rpm):
    """At constant speed w friction takes c sign w + v w, always against the motion, and no part of the flywheel."""
    speed = {"drive.speed_rpm": speed_rpm}
    rubbing = {**speed, "friction.coulomb_nm": 10.0, "friction.viscous_nms_per_rad": 0.5}
    without, told = (cycle_metrics(machine("compaction_press", overrides=o).parameters) for o in (speed, rubbing))
    drag = 10.0 + 0.5 * 10.0 * pi
    for name in ("mean", "max", "min"):
        expected = without[f"drive_torque_{name}_nm"] + np.sign(speed_rpm) * drag
        assert told[f"drive_torque_{name}_nm"] == pytest.approx(expected, rel=1e-12)
    assert told["power_mean_w"] == pytest.approx(without["power_mean_w"] + drag * 10.0 * pi, rel=1e-12)
    assert told["flywheel_inertia_kg_m2"] == without["flywheel_inertia_kg_m2"]


def test_of_two_equal_lows_the_first_after_the_top_is_the_bottom():
    """Loaded at the pendulum's pin, the path is an arc through its lowest point twice a turn."""
    pin = {"working_force.application_from_a_m": 0.5}
    just_below = {"working_force.application_from_a_m": 0.5 - 1e-9}
    press, stroke = press_constants(machine("compaction_press", overrides=pin).parameters)
    _, beside = press_constants(machine("compaction_press", overrides=just_below).parameters)
    lows = [loaded_height(press, f)[0] for f in (stroke.bottom, 1.3319385)]
    assert lows[0] == pytest.approx(lows[1], abs=1e-12)
    assert stroke.bottom == pytest.approx(1.5 * pi, abs=1e-6)
    assert beside.bottom == pytest.approx(stroke.bottom, abs=1e-6)


@pytest.mark.parametrize("fraction", [0.5, 0.2])
@pytest.mark.parametrize("speed", [30.0, -30.0])
def test_closed_form_work_is_the_integral_of_torque(fraction, speed):
    """Backward with the layer met early, crank angle 0 lies inside the layer: the balance holds there too."""
    overrides = {"working_force.contact_fraction": fraction}
    press, stroke = press_constants(machine("compaction_press", overrides=overrides).parameters)
    cycle = press_cycle(press, stroke, speed, WORK_POSITIONS)
    way = np.abs(cycle.angle_rad)
    torque = np.sign(speed) * (cycle.load_torque_nm + mean_torque(press, stroke, speed))
    work = np.concatenate(([0.0], np.cumsum(0.5 * (torque[1:] + torque[:-1]) * np.diff(way))))
    assert cycle.work_j == pytest.approx(work, abs=2e-5)
    assert (regime_at(stroke, 0.0, speed) != 0) == (fraction == 0.2 and speed < 0.0)


def test_layer_is_met_on_the_way_down_only():
    press, stroke = press_constants(machine("compaction_press").parameters)
    for f in np.linspace(0.0, 2.0 * pi, 361):
        for direction in (1.0, -1.0):
            if regime_at(stroke, f, direction):
                height, rate = loaded_height(press, f)
                assert height <= press.load.contact_y_m + 1e-12
                assert rate * direction <= 1e-12


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"linkage.crank_m": 0.4}, r"fails: .*crank 0.4 m"),
        ({"linkage.pendulum_m": 0.05}, r"crank \+ ground <= coupler \+ rocker|fails"),
        ({"drive.kind": "kloss"}, "motor and gear"),
        ({"working_force.contact_fraction": 1.0}, "contact_fraction"),
    ],
)
def test_impossible_press_is_refused_with_its_numbers(overrides, words):
    with pytest.raises(ConfigurationError, match=words):
        machine("compaction_press", overrides=overrides)
