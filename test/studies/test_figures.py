# SPDX-License-Identifier: Apache-2.0
"""The sources' figures: drawn for every machine, vector and raster, labelled, small enough for a page."""

import re

import pytest

from mech_twin.studies import draw_figures
from mech_twin.studies.declared_studies import machine_pictures, machines_with_published_values

pytestmark = pytest.mark.slow

LARGEST_BYTES = 120_000


@pytest.mark.parametrize("machine", machines_with_published_values())
def test_every_axis_has_a_name_with_its_unit(machine):
    pictures = machine_pictures(machine)
    assert len({picture.name for picture in pictures}) == len(pictures) > 0
    for picture in pictures:
        assert picture.caption.endswith(".")
        for axes in picture.figure.axes:
            across, beside = (
                group.get_siblings(axes) for group in (axes.get_shared_x_axes(), axes.get_shared_y_axes())
            )
            assert any(other.get_xlabel() for other in across) or axes.get_xticklabels()[0].get_text(), picture.name
            assert any(other.get_ylabel() for other in beside), picture.name


@pytest.mark.parametrize("machine", machines_with_published_values())
def test_every_figure_names_that_of_its_source_or_says_that_there_is_none_and_rings_are_published(machine):
    for picture in machine_pictures(machine):
        panels = picture.figure.axes
        words = " ".join([picture.caption, *(axes.get_title("left") for axes in panels)])
        none = "Not a figure of the source" in words or "has no figure" in words
        assert bool(re.search(r"Figs?\. \d", words)) != none, picture.name
        lines = [line for axes in panels for line in axes.get_lines()]
        rings = [line for line in lines if line.get_marker() == "o" and line.get_color() == "none"]
        legends = [axes.get_legend() for axes in panels if axes.get_legend() is not None]
        named = [text.get_text() for legend in legends for text in legend.get_texts()]
        claims = [name for name in named if name.startswith("published") and "maximum" not in name]
        assert bool(rings) == bool(claims), picture.name


@pytest.mark.parametrize("machine", ["winding_drum", "vibration_crank"])
def test_each_figure_is_a_vector_and_a_small_raster(machine, tmp_path):
    files = draw_figures(machine, tmp_path)
    assert {file.suffix for file in files} == {".svg", ".png"}
    for file in files:
        head = file.read_bytes()[:300]
        assert head.startswith(b"\x89PNG") if file.suffix == ".png" else b"<svg" in head or b"<?xml" in head
        assert file.suffix == ".svg" or file.stat().st_size < LARGEST_BYTES
