# SPDX-License-Identifier: Apache-2.0
"""What every machine of the catalogue must keep, without ROS."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from itertools import islice, pairwise
from pathlib import Path

import pytest
from catalogue import NAMES, PAGES, built

from mech_twin.declarations.configuration_tree import ConfigurationError, configuration_tree
from mech_twin.engine.coupling import RESET, complete_frame, next_frame, restarted
from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import frame_numbers
from mech_twin.errors import StudyError
from mech_twin.machines.page.parameters import Page
from mech_twin.parameters.description import description, description_text
from mech_twin.parameters.load import catalogue_entry, machine_parameters
from mech_twin.roles import RESIDUALS
from mech_twin.samples import BodySample, Frame, LinkageSample

RUN_S = 0.4

machines = pytest.mark.parametrize("name", (*NAMES, *PAGES), ids=lambda name: Path(name).stem)


def run(name: str, duration_s: float = RUN_S) -> list[Frame]:
    return list(frames(built(name), duration_s))


def samples_with_state(frame: Frame) -> tuple[LinkageSample | BodySample, ...]:
    """Return the samples that carry memory and events: the linkage's and, where there is one, the body's."""
    return (frame.linkage,) if frame.body is None else (frame.linkage, frame.body)


def hidden_numbers(frame: Frame) -> Iterator[tuple[str, float]]:
    """Yield every number of a frame that is no column of a trajectory: memory, residuals, loads, events."""
    for sample in samples_with_state(frame):
        yield from sample.memory.as_dict().items()
        yield from sample.residuals.as_dict().items()
        for event in sample.events:
            yield f"{event.kind}.time_s", event.time_s
            yield f"{event.kind}.pre", event.pre_velocity_m_per_s
            yield f"{event.kind}.post", event.post_velocity_m_per_s
            yield f"{event.kind}.impulse", event.impulse_ns
            for coordinate in (*event.pre, *event.post):
                yield from zip((f"{event.kind}.{name}" for name in coordinate._fields), coordinate, strict=True)
    yield from frame.forces.residuals.as_dict().items()
    for load in frame.forces.loads:
        yield from ((f"load.{name}", value) for name, value in load._asdict().items() if isinstance(value, int | float))


@machines
def test_configuration_validates(name: str) -> None:
    assert isinstance(machine_parameters(name), catalogue_entry(name).parameters)


@machines
def test_unknown_key_is_refused_by_name(name: str) -> None:
    with pytest.raises(ConfigurationError, match="no_such_key"):
        machine_parameters(name, overrides={"no_such_key": 1.0})


@machines
def test_described_configuration_is_the_configuration(name: str) -> None:
    parameters = machine_parameters(name)
    described = description(description_text(catalogue_entry(name).name, parameters, revision=3, from_step=7))
    assert described.parameters == parameters
    assert (described.machine, described.revision, described.from_step) == (catalogue_entry(name).name, 3, 7)
    assert configuration_tree(described.parameters) == configuration_tree(parameters)


@machines
def test_every_number_of_a_run_is_finite(name: str) -> None:
    for frame in run(name):
        for column, value in (*frame_numbers(frame), *hidden_numbers(frame)):
            assert math.isfinite(value), f"{column} at {frame.linkage.time_s} s"


@machines
def test_residuals_stay_within_their_limits(name: str) -> None:
    machine = built(name)
    for frame in run(name):
        pairs = [(machine.linkage, frame.linkage), (machine.forces, frame.forces), (machine.body, frame.body)]
        for role, sample in pairs:
            if role is None or sample is None:
                assert role is None, "a body role gives a body sample with every frame"
                assert sample is None
                continue
            for residual, value in sample.residuals.as_dict().items():
                assert abs(value) <= role.residual_limits[residual], (residual, value, frame.linkage.time_s)


@machines
def test_every_residual_is_one_of_the_dictionary_and_has_a_limit(name: str) -> None:
    machine = built(name)
    roles = [machine.linkage, machine.forces, *([] if machine.body is None else [machine.body])]
    frame = run(name, 0.0)[0]
    samples = [frame.linkage, frame.forces, *([] if frame.body is None else [frame.body])]
    for role, sample in zip(roles, samples, strict=True):
        assert set(sample.residuals.names) == set(role.residual_limits)
        for residual, limit in role.residual_limits.items():
            assert residual in RESIDUALS
            assert limit > 0.0
            unit = RESIDUALS[residual].unit
            assert unit == "1" or residual.endswith("_" + unit.replace("/", "_per_"))


@machines
def test_a_repeated_run_is_identical_to_the_bit(name: str) -> None:
    assert run(name) == run(name)


@machines
def test_a_run_goes_on_from_its_samples_alone(name: str) -> None:
    """Nothing is hidden in a role: a machine built anew continues from the last frame to the same bits."""
    whole = run(name)
    middle = len(whole) // 2
    fresh = catalogue_entry(name).build(machine_parameters(name))
    frame = whole[middle]
    for expected in whole[middle + 1 :]:
        frame = next_frame(fresh, frame, 1.0)
        assert frame == expected


@machines
def test_time_is_the_step_times_its_length(name: str) -> None:
    machine = built(name)
    for frame in run(name, 0.1):
        for sample in (frame.linkage, frame.motor, frame.forces, frame.body):
            if sample is not None:
                assert sample.time_s == sample.step * machine.coupling_step_s
                assert sample.step == frame.linkage.step


@machines
def test_events_lie_in_the_step_that_ends_with_them(name: str) -> None:
    machine = built(name)
    for frame in islice(run(name), 1, None):
        for sample in samples_with_state(frame):
            times = [event.time_s for event in sample.events]
            assert times == sorted(times)
            for time_s in times:
                assert frame.linkage.time_s - machine.coupling_step_s <= time_s <= frame.linkage.time_s


@machines
def test_reset_returns_to_the_initial_state_while_time_goes_on(name: str) -> None:
    machine = built(name)
    last = run(name, 0.1)[-1]
    linkage = restarted(machine, last.linkage.step + 1)
    again = complete_frame(machine, linkage, last.body, 1.0)
    first = run(name, 0.0)[0]
    assert again.linkage.time_s > last.linkage.time_s
    assert again.linkage.position == first.linkage.position
    assert again.linkage.velocity == first.linkage.velocity
    assert again.linkage.events[0].kind == RESET
    if again.body is not None and first.body is not None:
        assert again.body.position == first.body.position


@machines
def test_supply_off_lets_the_command_fall_to_zero(name: str) -> None:
    machine = built(name)
    commands = [frame.motor.command for frame in frames(machine, RUN_S, lambda step: 0.0)]
    assert commands[-1] <= commands[0]
    assert all(later <= earlier for earlier, later in pairwise(commands))


@machines
def test_report_and_analysis_are_numbers_with_units_in_their_names(name: str) -> None:
    machine = built(name)
    report = machine.report()
    assert report
    assert all(isinstance(value, int | float) for value in report.values()), report
    page = machine.parameters if isinstance(machine.parameters, Page) else None
    if page is not None and {joint.kind for joint in page.joints.values()} == {"slider"}:
        with pytest.raises(StudyError, match="no turning joint"):
            machine.analyse(1.0)
    else:
        assert machine.analyse(1.0)


@machines
def test_drawing_is_finite_and_named(name: str) -> None:
    machine = built(name)
    frame = run(name, 0.05)[-1]
    shapes = machine.draw(frame.linkage, frame.body)
    assert shapes
    assert len({shape.name for shape in shapes}) == len(shapes)
    for shape in shapes:
        assert shape.kind in {"line", "points", "arrow", "text"}
        assert shape.text if shape.kind == "text" else shape.points_m
        assert all(math.isfinite(x) and math.isfinite(y) for x, y in shape.points_m)


# a scaled unit in a name would be a second dialect beside SI; deg and rpm are the two that engineers read
SCALED = re.compile(r"_(mm|cm|km|um|g|t|kn|kj|kw|mpa|kpa|bar|ms|us|min|h|mrad)(_per_\w+)?$")


@machines
def test_no_number_has_a_scaled_unit_in_its_name(name: str) -> None:
    machine, frame = built(name), run(name, 0.05)[-1]
    observer = machine.observer()
    observer.observe(frame)
    named = {*machine.report(), *observer.numbers(), *frame.linkage.memory.names, *frame.forces.quantities.names}
    assert named
    assert not [word for word in named if SCALED.search(word)]
