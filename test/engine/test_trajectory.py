# SPDX-License-Identifier: Apache-2.0
"""Every number of a frame has its own column, and the events of a step come in time order, whoever saw them."""

import pytest

from mech_twin.engine.trajectory import StepSamples, Trajectory, frame_events, frame_numbers
from mech_twin.samples import BodySample, Event, ForceSample, Frame, LinkageSample, MotorSample, Named, Wrench

NONE = Named()
LATE, EARLY, MIDDLE = (Event(time_s, "blow", "tool") for time_s in (0.9, 0.1, 0.5))
LINKAGE = LinkageSample(
    7, 0.07, ("crank", "rod"), (1.0, 2.0), (3.0, 4.0), (5.0, 6.0), 2, 0.75, NONE, NONE, (EARLY, LATE)
)
MOTOR = MotorSample(7, 0.07, ("rotor",), (11.0,), (12.0,), (13.0,), 0.5)
FORCES = ForceSample(
    7,
    0.07,
    ("left", "right"),
    (Wrench(21.0, 22.0, 23.0), Wrench(24.0, 25.0, 26.0)),
    Named(("drive_nm", "load_n"), (31.0, 32.0)),
    33.0,
    NONE,
)
BODY = BodySample(7, 0.07, ("body",), (41.0,), (42.0,), (43.0,), 1, 44.0, NONE, NONE, (MIDDLE,))
WITHOUT_BODY = {
    "time_s": 0.07,
    "linkage.crank.position": 1.0,
    "linkage.rod.position": 2.0,
    "linkage.crank.velocity": 3.0,
    "linkage.rod.velocity": 4.0,
    "linkage.crank.effort": 5.0,
    "linkage.rod.effort": 6.0,
    "motor.rotor.position": 11.0,
    "motor.rotor.velocity": 12.0,
    "motor.rotor.effort": 13.0,
    "linkage.regime": 2.0,
    "motor.command": 0.5,
    "forces.left.force_x_n": 21.0,
    "forces.left.force_y_n": 22.0,
    "forces.left.moment_nm": 23.0,
    "forces.right.force_x_n": 24.0,
    "forces.right.force_y_n": 25.0,
    "forces.right.moment_nm": 26.0,
    "forces.drive_nm": 31.0,
    "forces.load_n": 32.0,
}
OF_THE_BODY = {
    "body.body.position": 41.0,
    "body.body.velocity": 42.0,
    "body.body.effort": 43.0,
    "forces.body_moment_nm": 33.0,
    "body.pressing_force_n": 44.0,
    "body.regime": 1.0,
}


@pytest.mark.parametrize(
    ("body", "expected"), [(None, WITHOUT_BODY), (BODY, WITHOUT_BODY | OF_THE_BODY)], ids=["without", "with"]
)
def test_each_number_of_a_frame_stands_in_the_column_of_its_name(body, expected):
    numbers = list(frame_numbers(Frame(LINKAGE, MOTOR, FORCES, body)))
    assert dict(numbers) == expected
    assert len(numbers) == len(expected)


def test_a_trajectory_grows_by_one_number_a_column_and_frame():
    trajectory = Trajectory()
    assert trajectory.columns() == {}
    frames = [Frame(LINKAGE._replace(time_s=0.01 * n), MOTOR._replace(command=n), FORCES, BODY) for n in range(3)]
    for frame in frames:
        trajectory.append(frame)
    columns = trajectory.columns()
    assert set(columns) == set(WITHOUT_BODY | OF_THE_BODY)
    assert columns["time_s"] == [0.0, 0.01, 0.02]
    assert columns["motor.command"] == [0.0, 1.0, 2.0]
    assert columns["linkage.rod.effort"] == [6.0, 6.0, 6.0]


def test_a_wrench_without_a_pin_is_refused():
    with pytest.raises(ValueError, match="longer"):
        list(frame_numbers(Frame(LINKAGE, MOTOR, FORCES._replace(pins=("left",)), None)))


def test_a_frame_of_another_shape_is_refused():
    trajectory = Trajectory()
    trajectory.append(Frame(LINKAGE, MOTOR, FORCES, BODY))
    with pytest.raises(ValueError, match="shorter"):
        trajectory.append(Frame(LINKAGE, MOTOR, FORCES, None))


def test_events_of_a_step_come_in_time_order_whoever_saw_them():
    assert frame_events(Frame(LINKAGE, MOTOR, FORCES, BODY)) == (EARLY, MIDDLE, LATE)
    assert frame_events(Frame(LINKAGE, MOTOR, FORCES, None)) == (EARLY, LATE)
    assert StepSamples(7, LINKAGE, body=BODY).events == (EARLY, MIDDLE, LATE)
    assert StepSamples(7, body=BODY).events == (MIDDLE,)
    assert StepSamples(7).events == ()


def test_a_frame_is_whole_only_with_every_sample_its_machine_has():
    whole = StepSamples(7, LINKAGE, MOTOR, FORCES, BODY)
    assert whole.frame(True) == whole.frame(False) == Frame(LINKAGE, MOTOR, FORCES, BODY)
    assert whole._replace(body=None).frame(False) == Frame(LINKAGE, MOTOR, FORCES, None)
    assert whole._replace(body=None).frame(True) is None
    for field in ("linkage", "motor", "forces"):
        for has_body in (False, True):
            assert whole._replace(**{field: None}).frame(has_body) is None
