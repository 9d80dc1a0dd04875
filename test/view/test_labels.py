# SPDX-License-Identifier: Apache-2.0
"""Names of links stand beside their lines and not over each other."""

from itertools import combinations

import pytest
from catalogue import NAMES

from mech_twin.engine.run import frames
from mech_twin.parameters.load import machine
from mech_twin.samples import Shape
from mech_twin.view.annotations import Annotations, lost_energy
from mech_twin.view.extent import LINE_PX, PANEL_PX, _box, apart, with_placed_texts
from mech_twin.view.rerun_pictures import Mechanism


def text(name, x, y):
    return Shape(name, "text", ((x, y),), (0, 0, 0), 0.02, name)


def test_texts_in_one_place_come_apart_and_a_fixed_one_stays_free():
    placed = apart([text("first", 0.0, 0.0), text("second", 0.0, 0.0)], [text("A", 0.0, 0.0)], 1.0)
    boxes = [_box(shape, 1.0) for shape in (*placed, text("A", 0.0, 0.0))]
    assert all(one.overlap(other) == 0.0 for one, other in combinations(boxes, 2))


def test_a_text_that_covers_nothing_stays_where_it_is():
    texts = [text("first", 0.0, 0.0), text("second", 0.5, 0.0)]
    assert apart(texts, [], 1.0) == texts


def test_no_text_goes_further_than_a_few_lines():
    crowd = [text(f"text {i}", 0.0, 0.0) for i in range(12)]
    for before, after in zip(crowd, apart(crowd, [], 1.0), strict=True):
        assert abs(after.points_m[0][1] - before.points_m[0][1]) < 4.0 * LINE_PX / PANEL_PX


class _Nowhere:
    def log(self, *_: object, **__: object) -> None:
        pass


@pytest.mark.parametrize("name", NAMES)
def test_no_name_of_a_machine_covers_another_a_letter_or_a_value(name):
    made = machine(name)
    run = list(frames(made, 1.0))[::100]
    figure, notes = Mechanism(_Nowhere()), Annotations(made.mechanism, made.blow_energy or lost_energy)
    drawn = [made.draw(frame.linkage, frame.body) for frame in run]
    for shapes in drawn:
        figure.widen(shapes)
    bounds = figure.bounds()
    width_m = bounds.width_m
    for frame, shapes in zip(run, drawn, strict=True):
        notes.add(frame.linkage, frame.forces)
        shown = with_placed_texts(shapes, notes.shapes(frame.linkage.time_s, bounds), bounds)
        texts = [shape for shape in shown if shape.kind == "text"]
        assert len(texts) > 2
        for one, other in combinations(texts, 2):
            covered = _box(one, width_m).overlap(_box(other, width_m))
            assert covered == 0.0, (frame.linkage.time_s, one.text, other.text)
