# SPDX-License-Identifier: Apache-2.0
"""Laws of the winding drum: variable mass, area, energy, the end of the package."""

from itertools import islice
from math import copysign, cos, inf, isfinite, log, pi, sin, sqrt

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.hybrid.laws import HOLD
from mech_twin.engine.hybrid.loop import room_sizes
from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import frame_numbers
from mech_twin.machines.winding_drum.dynamics import (
    ANGLE,
    DRIVE_WORK,
    LAWS,
    OWN_SIGNALS,
    STATE_SIZE,
    DrumSystem,
    Package,
    advance_drum,
    package_inertia,
    speed_terms,
    tangent_arm,
    wound_after,
    wound_at,
)
from mech_twin.machines.winding_drum.parameters import package_constants
from mech_twin.parameters.load import machine


def last_frames(overrides, duration_s):
    """Return machine, all linkage samples and the worst residuals of a run."""
    drum = machine("winding_drum", overrides=overrides)
    samples, worst = [], {}
    for frame in frames(drum, duration_s):
        samples.append(frame.linkage)
        for named in (frame.linkage.residuals, frame.forces.residuals):
            for name, value in named.as_dict().items():
                worst[name] = max(worst.get(name, 0.0), abs(value))
    return drum, samples, worst


def turned(package, radius, phi, yarn, span):
    """Return the state of the drum after a span under yarn of a speed and an acceleration."""
    wound, (numbers, marks) = wound_at(package, radius), room_sizes(1, LAWS, OWN_SIGNALS, STATE_SIZE)
    y, regimes = np.zeros(STATE_SIZE), np.array([HOLD, 1])
    y[0] = phi
    motion = DrumSystem(package, wound, wound, *yarn, inf, 0.0)
    room = np.zeros(numbers), np.zeros(marks, dtype=np.int64)
    assert advance_drum(motion, span, y, regimes, np.zeros((8, 13)), *room) == 0
    return y


@pytest.mark.slow
@pytest.mark.parametrize("winding", [False, True])
def test_angular_acceleration_is_the_derivative_of_speed_along_the_motion(winding):
    parameters = machine("winding_drum").parameters
    package = package_constants(parameters, winding)
    start, theta, a, h = 0.2, 5.0, 0.4, 1e-4

    def after(phi, t):
        now = float(wound_after(package, wound_at(package, start), theta * t + 0.5 * a * t * t).radius_m)
        return now, float(turned(package, start, phi, (theta, a), t)[ANGLE]), theta + a * t

    def speed(phi, t):
        radius, later, yarn = after(phi, t)
        return yarn / tangent_arm(package, radius, later)

    for i in range(24):
        phi = i * pi / 12.0
        # four points about t = 2 h: the difference itself is then good to 1e-10
        near = (speed(phi, 3.0 * h) - speed(phi, h)) / (2.0 * h)
        far = (speed(phi, 4.0 * h) - speed(phi, 0.0)) / (4.0 * h)
        radius, later, yarn = after(phi, 2.0 * h)
        terms = speed_terms(package, radius, later, yarn, a)
        assert (4.0 * near - far) / 3.0 == pytest.approx(sum(terms), abs=1e-8 * max(abs(term) for term in terms))


@pytest.mark.parametrize(("direction", "kind"), [("unwinding", "empty"), ("winding", "full")])
def test_package_ends_at_the_time_the_area_gives(direction, kind):
    thick = {"layer_thickness_m": 0.02, "direction": direction, "supply.initial_fraction": 1.0}
    thick["gravity_m_per_s2"] = 0.0  # a full package that is let go would swing under its weight
    drum, samples, worst = last_frames(thick, 3.0)
    (event,) = [event for sample in samples for event in sample.events]
    assert event.kind == kind
    assert event.time_s == pytest.approx(pi * (0.3**2 - 0.08**2) / 0.02 / 5.0, rel=1e-12)
    assert samples[-1].position[2] == drum.linkage.model.end_radius_m
    assert drum.linkage.regimes[samples[-1].regime] == "ended"
    assert samples[-1].velocity[0] == event.post[0].velocity  # let go, it turns on
    assert worst["area_balance"] < 1e-12
    assert worst["energy_balance"] < 1e-9
    assert worst["drive_torque_routes"] < 1e-10


def test_start_from_rest_follows_the_yarn_acceleration():
    _, samples, _ = last_frames({}, 1.0)
    assert samples[1000].velocity[1] == pytest.approx(0.4, rel=1e-9)
    assert samples[1000].position[1] == pytest.approx(0.2, rel=1e-9)
    # the force analysis finds the same acceleration from the torque on the drum
    drum = machine("winding_drum")
    assert drum.forces.analyse(samples[500]).quantities["yarn_acceleration_m_per_s2"] == pytest.approx(0.4, rel=1e-9)


def test_winding_turns_the_sign_of_the_radius_terms_only():
    out = machine("winding_drum").analyse(1.0)
    into = machine("winding_drum", overrides={"direction": "winding"}).analyse(1.0)
    assert into["radius_torque_nm"] == -out["radius_torque_nm"]
    assert into["mass_torque_nm"] == -out["mass_torque_nm"]
    assert into["eccentric_torque_nm"] == out["eccentric_torque_nm"]
    assert into["acceleration_torque_nm"] == out["acceleration_torque_nm"]


def test_angle_converges_with_the_step():
    ends = []
    for step in (0.001, 0.0005):
        _, samples, _ = last_frames({"coupling.step_s": step, "supply.initial_fraction": 1.0}, 1.0)
        ends.append(samples[-1].position[0])
    assert ends[0] == pytest.approx(ends[1], rel=1e-12)


def test_repeat_is_identical():
    first = last_frames({}, 0.2)[1]
    assert first == last_frames({}, 0.2)[1]


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("core_radius_m", 0.4),
        ("eccentricity_m", 0.09),
        ("yarn_acceleration_m_per_s2", 0.0),
        ("layer_thickness_m", 0.5),
        ("drum_inertia_kg_m2", 0.0),
    ],
)
def test_impossible_drum_is_refused_with_the_inequality(key, value):
    with pytest.raises(ConfigurationError, match=r"fails|greater than or equal"):
        machine("winding_drum", overrides={key: value, "direction": "winding"})


def independent_motion(parameters, radius, phi, omega_or_theta, a, span, *, driven_by_yarn):
    """Return the state after a span by an integration that shares no code with the machine."""
    p = parameters
    sign = -1.0 if p.direction == "winding" else 1.0
    layer = sign * p.layer_thickness_m / (2.0 * pi)
    c, v = p.friction.coulomb_nm, p.friction.viscous_nms_per_rad

    def mass_and_inertia(r):
        mass = p.package_density_kg_per_m3 * p.package_width_m * pi * (r * r - p.core_radius_m**2)
        return mass, p.drum_inertia_kg_m2 + 0.5 * mass * (r * r + p.core_radius_m**2)

    if driven_by_yarn:

        def rates(t, y):
            yarn = omega_or_theta + a * t
            r = sqrt(radius**2 - 2.0 * layer * (omega_or_theta * t + 0.5 * a * t * t))
            omega = yarn / (r + p.eccentricity_m * cos(y[0]))
            mass, _ = mass_and_inertia(r)
            gravity = mass * p.gravity_m_per_s2 * p.eccentricity_m * sin(y[0])
            return [omega, gravity * omega, (c + v * omega) * omega]

        start = [phi, 0.0, 0.0]
    else:
        mass, inertia = mass_and_inertia(radius)

        def rates(t, y):
            gravity = mass * p.gravity_m_per_s2 * p.eccentricity_m * sin(y[0])
            return [y[1], (gravity - c * copysign(1.0, y[1]) - v * y[1]) / inertia]

        start = [phi, omega_or_theta]
    return solve_ivp(rates, (0.0, span), start, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]


WITH_FRICTION = {"friction.coulomb_nm": 1.5, "friction.viscous_nms_per_rad": 0.05, "supply.initial_fraction": 1.0}


def test_work_of_the_drive_is_kinetic_energy_less_gravity_and_plus_friction():
    """Angle, work of gravity and friction loss against an independent integration; the drive gives the rest."""
    drum, samples, worst = last_frames(WITH_FRICTION, 1.0)
    p = drum.parameters
    phi, gravity, loss = independent_motion(p, 0.3, 0.0, 5.0, 0.0, 1.0, driven_by_yarn=True)
    memory = samples[-1].memory
    assert samples[-1].position[0] == pytest.approx(phi, abs=1e-9)
    assert memory["gravity_work_j"] == pytest.approx(gravity, abs=1e-7)
    assert memory["friction_loss_j"] == pytest.approx(loss, abs=1e-7)
    assert worst["energy_balance"] < 1e-10


@pytest.mark.slow
def test_full_package_let_go_swings_under_its_weight_and_comes_to_rest():
    full = {"layer_thickness_m": 0.05, "direction": "winding", "supply.initial_fraction": 1.0, **WITH_FRICTION}
    drum, samples, worst = last_frames({**full, "yarn_speed_m_per_s": 1.0, "friction.viscous_nms_per_rad": 5.0}, 30.0)
    p = drum.parameters
    kinds = [event.kind for sample in samples for event in sample.events]
    assert kinds[0] == "full"
    assert kinds[-1] == "stick"
    assert samples[-1].velocity[0] == 0.0
    assert worst["energy_balance"] < 1e-9
    (end,) = [event for sample in samples for event in sample.events if event.kind == "full"]
    step = next(sample for sample in samples if sample.time_s >= end.time_s + 0.2)
    phi, omega = independent_motion(
        p, 0.3, end.post[0].position, end.post[0].velocity, 0.0, step.time_s - end.time_s, driven_by_yarn=False
    )
    assert step.position[0] == pytest.approx(phi, abs=1e-9)
    assert step.velocity[0] == pytest.approx(omega, abs=1e-8)


def test_angular_acceleration_of_a_coasting_drum_is_the_derivative_of_its_speed():
    """The force analysis takes it from the torques, and loads the shaft by it; the motion knows it by its speeds."""
    full = {"layer_thickness_m": 0.05, "direction": "winding", "supply.initial_fraction": 1.0, **WITH_FRICTION}
    drum = machine("winding_drum", overrides={**full, "yarn_speed_m_per_s": 1.0, "friction.viscous_nms_per_rad": 5.0})
    seen = [frame for frame in frames(drum, 12.0) if drum.linkage.regimes[frame.linkage.regime] == "ended"][2:200]
    assert len(seen) > 50
    step_s = drum.coupling_step_s
    for before, now, after in zip(seen, seen[1:], seen[2:], strict=False):
        (early, _, _), (speed, _, _), (late, _, _) = (frame.linkage.velocity for frame in (before, now, after))
        if early * speed > 0.0 < speed * late:
            alpha = now.forces.quantities["angular_acceleration_rad_per_s2"]
            assert (late - early) / (2.0 * step_s) == pytest.approx(alpha, rel=1e-4, abs=1e-4)


@pytest.mark.parametrize(("coulomb", "viscous"), [(2.0, 0.0), (0.0, 0.7), (2.0, 0.7), (1e-3, 1e-6)])
def test_an_empty_drum_runs_down_as_integrated_independently(coulomb, viscous):
    keys = {"layer_thickness_m": 0.05, "supply.initial_fraction": 1.0}
    keys |= {"friction.coulomb_nm": coulomb, "friction.viscous_nms_per_rad": viscous}
    drum, samples, worst = last_frames(keys, 3.0)
    (end,) = [event for sample in samples for event in sample.events if event.kind == "empty"]
    later = next(sample for sample in samples if sample.time_s >= end.time_s + 0.5)
    omega = end.post[0].velocity
    phi, speed = independent_motion(
        drum.parameters, 0.08, end.post[0].position, omega, 0.0, later.time_s - end.time_s, driven_by_yarn=False
    )
    assert speed > 0.0
    assert later.position[0] == pytest.approx(phi, abs=1e-9)
    assert later.velocity[0] == pytest.approx(speed, abs=1e-9)
    assert worst["energy_balance"] < 1e-9
    sticks = [event.time_s for sample in samples for event in sample.events if event.kind == "stick"]
    # J u' = -c - v u from u0 rests after (J/v) ln(1 + v u0/c)
    if coulomb == 2.0:
        rests = 0.5 * omega / 2.0 if viscous == 0.0 else 0.5 / viscous * log(1.0 + viscous * omega / coulomb)
        assert sticks == ([pytest.approx(end.time_s + rests, abs=1e-12)] if end.time_s + rests < 3.0 else [])


def test_a_drum_at_rest_sticks_while_its_friction_holds_the_weight():
    light = {"layer_thickness_m": 0.05, "direction": "winding", "supply.initial_fraction": 1.0}
    held = {**light, "friction.coulomb_nm": 1000.0}
    _, samples, _ = last_frames(held, 4.0)
    ended = [sample for sample in samples if sample.regime == 2]
    assert ended
    assert all(sample.velocity[0] == 0.0 for sample in ended)
    # without friction it swings for ever: its energy and its height stay those it was let go with
    _, samples, worst = last_frames(light, 8.0)
    assert samples[-1].regime == 1
    assert worst["energy_balance"] < 1e-9


def test_the_shaft_carries_what_accelerates_the_offset_package():
    """At 30 m/s the 142 kg package 4 mm off its axis asks for 5.7 kN that turn with it, besides its weight."""
    fast = {"yarn_speed_m_per_s": 30.0, "supply.initial_fraction": 1.0}
    drum, samples, _ = last_frames(fast, 0.2)
    p = drum.parameters
    sample = samples[150]
    wrench = drum.forces.analyse(sample).wrenches[0]
    # the path of the centre, differenced in time by hand
    radius, phi0 = sample.position[2], sample.position[0]
    mass = 450.0 * 1.2 * pi * (radius**2 - 0.08**2)

    def centre(phi):
        return complex(-p.eccentricity_m * sin(phi), p.eccentricity_m * cos(phi))

    before, after = samples[149].position[0], samples[151].position[0]
    acceleration = (centre(after) - 2.0 * centre(phi0) + centre(before)) / 1e-6
    assert wrench.force_x_n == pytest.approx(mass * acceleration.real, abs=10.0)
    assert wrench.force_y_n == pytest.approx(mass * acceleration.imag + mass * 9.80665, abs=10.0)
    assert mass * abs(acceleration) == pytest.approx(5.7e3, rel=0.03)
    assert drum.report()["package_mass_kg"] == pytest.approx(141.8, abs=0.1)


def test_angle_is_as_exact_at_a_long_step_with_a_fast_yarn():
    ends = []
    for step in (0.01, 0.0005):
        _, samples, worst = last_frames(
            {"coupling.step_s": step, "supply.initial_fraction": 1.0, "yarn_speed_m_per_s": 30.0}, 0.5
        )
        assert worst["energy_balance"] < 1e-9
        ends.append(samples[-1].position[0])
    assert ends[0] == pytest.approx(ends[1], rel=1e-11)
    assert ends[0] > 40.0


def test_a_step_of_radians_is_as_exact_from_every_angle():
    """Where the fifth-order errors of all that is integrated are zero together, the estimate says nothing of a step."""
    package = Package(0.55, 1e-6, 0.0275, 6.57e-4, 5.8, 100.0, gravity=0.0)
    radius, theta = 1.56, 3000.0
    h = 2.04 * radius / theta

    def energy(now, phi):
        return (
            0.5
            * float(package_inertia(package, wound_at(package, now)))
            * (theta / float(tangent_arm(package, now, phi))) ** 2
        )

    after = float(wound_after(package, wound_at(package, radius), theta * h).radius_m)
    for phi in np.linspace(0.0, 2.0 * pi, 2_000):
        end = turned(package, radius, float(phi), (theta, 0.0), h)
        given = energy(after, end[ANGLE]) - energy(radius, phi)
        assert end[DRIVE_WORK] == pytest.approx(given, rel=0.0, abs=1e-11 * energy(radius, 0.0)), phi


@pytest.mark.parametrize("speed", [0.75, 30.0])
def test_energy_balances_on_a_drum_that_is_nearly_bare(speed):
    """The first turns onto a light drum of metres: a rounding of its radius is many times what the drum holds."""
    keys = {"package_radius_m": 3.0354, "core_radius_m": 3.0323, "package_width_m": 0.945, "eccentricity_m": 0.109}
    keys |= {"layer_thickness_m": 6.8e-4, "package_density_kg_per_m3": 1e5, "drum_inertia_kg_m2": 1.0}
    keys |= {"yarn_speed_m_per_s": speed, "direction": "winding", "supply.initial_fraction": 1.0}
    _, _, worst = last_frames({**keys, "gravity_m_per_s2": 0.0, "coupling.step_s": 3.3e-4}, 0.3)
    assert worst["energy_balance"] < 1e-10
    assert worst["area_balance"] < 1e-10  # the radius is rounded in each step


def test_energy_balances_where_a_layer_is_less_than_the_radius_resolves():
    """Yarn a micrometre thick wound onto a light drum of metres: the radius' last digit is 1e-9 of what turns."""
    keys = {"package_radius_m": 12.5, "core_radius_m": 1.65, "package_width_m": 4.55, "eccentricity_m": 1.6e-5}
    keys |= {"layer_thickness_m": 1e-6, "package_density_kg_per_m3": 8e4, "drum_inertia_kg_m2": 0.5}
    keys |= {"yarn_speed_m_per_s": 560.0, "yarn_acceleration_m_per_s2": 171.5, "direction": "winding"}
    drum, samples, worst = last_frames({**keys, "supply.initial_fraction": 0.0, "coupling.step_s": 3.8e-3}, 0.2)
    package, last = drum.linkage.model.package, samples[-1]
    told = package_inertia(package, wound_at(package, last.position[2])) - package.drum_inertia
    layers = 1e-6 * last.position[1] / pi  # R^2 - c^2, by hand
    wound = 0.5 * pi * 8e4 * 4.55 * layers * (layers + 2.0 * 1.65**2)
    assert told != pytest.approx(wound, rel=1e-10)  # the radius does not tell it
    assert worst["energy_balance"] < 1e-13
    assert 0.0 < worst["area_balance"] < 1e-10  # the radius is followed beside the yarn
    assert drum.forces.analyse(last).quantities["package_inertia_kg_m2"] == pytest.approx(0.5 + wound, rel=1e-14)


def test_a_step_in_which_the_drum_would_spin_away_is_refused():
    with pytest.raises(ConfigurationError, match=r"shorten coupling\.step_s"):
        machine("winding_drum", overrides={"yarn_speed_m_per_s": 9000.0, "coupling.step_s": 1.0})


LEGAL = st.fixed_dictionaries(
    {
        "core_radius_m": st.floats(1e-3, 1.0),
        "package_width_m": st.floats(1e-3, 10.0),
        "yarn_speed_m_per_s": st.floats(1e-3, 100.0),
        "yarn_acceleration_m_per_s2": st.floats(1e-3, 100.0),
        "package_density_kg_per_m3": st.floats(1.0, 2e4),
        "drum_inertia_kg_m2": st.sampled_from([1e-12, 1e-3, 0.5, 1e4]),
        "direction": st.sampled_from(["winding", "unwinding"]),
        "supply.initial_fraction": st.sampled_from([0.0, 0.3, 1.0]),
        "coupling.step_s": st.sampled_from([1e-4, 1e-3, 1e-2, 0.1]),
        "friction.coulomb_nm": st.sampled_from([0.0, 1e-3, 10.0, 1e5]),
        "friction.viscous_nms_per_rad": st.sampled_from([0.0, 1e-3, 10.0, 1e5]),
        "gravity_m_per_s2": st.sampled_from([0.0, 9.80665]),
    }
)


@pytest.mark.slow
@settings(max_examples=30, phases=[Phase.explicit, Phase.reuse, Phase.generate])
@given(keys=LEGAL, thick=st.floats(1e-3, 1.0), over=st.floats(1.0001, 10.0), off=st.floats(0.0, 1.0))
def test_legal_drums_run_within_their_limits_or_are_refused_in_a_line(keys, thick, over, off):
    core = keys["core_radius_m"]
    keys = {
        **keys,
        "package_radius_m": core * over,
        "eccentricity_m": 0.9 * core * off,
        "layer_thickness_m": thick * core * (over - 1.0) * 0.999,
    }
    try:
        drum = machine("winding_drum", overrides=keys)
    except ConfigurationError as error:
        assert "\n" not in str(error)
        return
    assert all(isfinite(value) for value in drum.report().values())
    for frame in islice(frames(drum, 0.5), 200):
        assert all(isfinite(value) for _, value in frame_numbers(frame))
        for role, sample in ((drum.linkage, frame.linkage), (drum.forces, frame.forces)):
            for name, value in sample.residuals.as_dict().items():
                assert abs(value) <= role.residual_limits[name], (name, frame.linkage.time_s)
