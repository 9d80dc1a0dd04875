# SPDX-License-Identifier: Apache-2.0
"""A value that changes a machine's figures out of all proportion is said with what follows from it."""

from __future__ import annotations

import pytest

from mech_twin.cli.run_summary import say_consequences


def test_a_preload_in_the_wrong_unit_is_said_with_the_force_it_makes(capsys):
    say_consequences("mb10_breaker", None, ["body.preload_deflection_m=4.0"])
    said = capsys.readouterr().err
    assert "rest force" in said and "2.132e+05 N" in said
    assert "288 times" in said


@pytest.mark.parametrize("settings", [[], ["body.preload_deflection_m=0.02"]])
def test_a_usual_value_is_not_commented_on(capsys, settings):
    say_consequences("mb10_breaker", None, settings)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("setting", ["linkage.pendulum_m=0.31", "linkage.crank_m=0.055"])
def test_a_figure_that_was_zero_but_for_rounding_is_no_measure_of_the_change(capsys, setting):
    """The plate lies level at the bottom of the installed press, so any other length tilts it by a degree or so."""
    say_consequences("compaction_press", None, [setting])
    assert capsys.readouterr().err == ""
