"""Laws of the winding drum: variable mass, area, energy, the end of the package."""

from math import pi

import pytest

from mech_twin.configuration_tree import ConfigurationError
from mech_twin.engine.run import frames
from mech_twin.machines.winding_drum.wound_package import (
    package_constants,
    radius_after,
    speed_terms,
    tangent_arm,
    turned,
)
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


@pytest.mark.parametrize("winding", [False, True])
def test_angular_acceleration_is_the_derivative_of_speed_along_the_motion(winding):
    parameters = machine("winding_drum").parameters
    package = package_constants(parameters, winding)
    radius, theta, a, h = 0.2, 5.0, 0.4, 1e-5

    def speed(phi, t):
        later = turned(package, radius, phi, theta, a, t)[0]
        now = radius_after(package, radius, theta * t + 0.5 * a * t * t)
        return (theta + a * t) / tangent_arm(package, now, later)

    for i in range(24):
        phi = i * pi / 12.0
        # four points: the difference itself is then good to 1e-11
        near = (speed(phi, h) - speed(phi, -h)) / (2.0 * h)
        far = (speed(phi, 2.0 * h) - speed(phi, -2.0 * h)) / (4.0 * h)
        exact = sum(speed_terms(package, radius, phi, theta, a))
        scale = max(abs(term) for term in speed_terms(package, radius, phi, theta, a))
        assert (4.0 * near - far) / 3.0 == pytest.approx(exact, abs=1e-8 * scale)


@pytest.mark.parametrize(("direction", "kind"), [("unwinding", "empty"), ("winding", "full")])
def test_package_ends_at_the_time_the_area_gives(direction, kind):
    thick = {"layer_thickness_m": 0.02, "direction": direction, "supply.initial_fraction": 1.0}
    drum, samples, worst = last_frames(thick, 3.0)
    (event,) = [event for sample in samples for event in sample.events]
    assert event.kind == kind
    assert event.time_s == pytest.approx(pi * (0.3**2 - 0.08**2) / 0.02 / 5.0, rel=1e-12)
    assert samples[-1].position[2] == drum.linkage.end_radius_m
    assert drum.linkage.regimes[samples[-1].regime] == "ended"
    assert samples[-1].velocity[0] == event.post[0].velocity  # let go, it turns on
    assert worst["rolling_m_per_s"] < 1e-12
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
    ("key", "value"), [("core_radius_m", 0.4), ("eccentricity_m", 0.09), ("yarn_acceleration_m_per_s2", 0.0)]
)
def test_impossible_drum_is_refused_with_the_inequality(key, value):
    with pytest.raises(ConfigurationError, match=r"fails"):
        machine("winding_drum", overrides={key: value})
