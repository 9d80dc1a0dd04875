# SPDX-License-Identifier: Apache-2.0
"""Names of links stand beside their lines and not over each other."""

from itertools import combinations

import pytest

from mech_twin.engine.run import frames
from mech_twin.parameters.load import machine
from mech_twin.samples import Shape
from mech_twin.view.labels import LINE_PX, PANEL_PX, _box, apart, written_beside


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


@pytest.mark.parametrize("name", ["planar_linkage", "vibration_crank", "compaction_press"])
def test_the_names_of_the_links_of_a_machine_never_cover_each_other(name):
    made = machine(name)
    for frame in list(frames(made, 1.0))[::100]:
        shapes = made.draw(frame.linkage, frame.body)
        across = [x for shape in shapes for x, _ in shape.points_m]
        width_m = 1.5 * (max(across) - min(across))
        named = [written_beside(shape, width_m) for shape in shapes if shape.kind in ("line", "arrow") and shape.text]
        boxes = [_box(shape, width_m) for shape in apart(named, [], width_m)]
        assert all(one.overlap(other) == 0.0 for one, other in combinations(boxes, 2)), frame.linkage.time_s
