# SPDX-License-Identifier: Apache-2.0
"""Energy flow over a cycle: what elements give and take, against a closed form and the energy that is held."""

from __future__ import annotations

import math

import numpy as np
import pytest
from catalogue import PAGES, built
from machines.page.pages import page
from typer.testing import CliRunner

from mech_twin.cli.main import app
from mech_twin.engine.run import frames
from mech_twin.errors import StudyError
from mech_twin.machines.page import build
from mech_twin.parameters.load import catalogue_entry
from mech_twin.studies.energy_flow import EnergyBooks, drawn_flow, last_turn

SPRING_HAMMER = next(path for path in PAGES if path.endswith("spring_hammer.yaml"))
WHEEL = """
gravity_m_per_s2: [0, 0]
bodies: {wheel: {inertia_kg_m2: 0.5}}
joints: {shaft: {kind: revolute, between: [ground, wheel]}}
drives: {motor: {kind: constant_speed, joint: shaft, speed_rpm: -120}}
dampers: {oil: {joint: shaft, rate_nms_per_rad: 0.3}}
friction: {rub: {joint: shaft, coulomb_nm: 2}}
"""


def flow_of(machine, name, duration_s):
    books = EnergyBooks(catalogue_entry(name), machine)
    for frame in frames(machine, duration_s):
        books.observe(frame)
    return books.flow()


def test_a_turn_costs_what_oil_and_friction_take():
    found = flow_of(build(page(WHEEL)), "page", 1.3)
    speed = 4.0 * math.pi
    taken = {name: float(work[-1]) for name, work in found.works_j.items()}
    assert taken == pytest.approx(
        {"motor": 2.0 * math.pi * (0.3 * speed + 2.0), "oil": -2.0 * math.pi * 0.3 * speed, "rub": -4.0 * math.pi}
    )
    assert found.times_s[-1] - found.times_s[0] == pytest.approx(0.5, rel=1e-9)


@pytest.mark.parametrize(
    "name", ["mb10_breaker", "compaction_press", "vibration_crank", "roller_former", SPRING_HAMMER]
)
def test_the_books_of_a_turn_balance_with_what_is_held(name):
    found = flow_of(built(name), name, 2.0)
    largest = max(float(np.abs(work).max()) for work in found.works_j.values())
    assert found.phase[0] == 0.0
    assert found.phase[-1] == 1.0
    assert largest > 1.0
    given = sum(float(work[-1]) for work in found.works_j.values())
    assert found.held_j[-1] == pytest.approx(given, abs=1e-6 * largest)


def test_the_last_turn_begins_between_samples():
    angle = np.linspace(0.5, 15.0, 100)
    rows = last_turn(np.column_stack((2.0 * angle, angle, -3.0 * angle)), "drum")
    assert rows[-1, 1] - rows[0, 1] == pytest.approx(2.0 * math.pi, rel=1e-12)
    assert rows[0] == pytest.approx([2.0 * rows[0, 1], rows[0, 1], -3.0 * rows[0, 1]], rel=1e-12)
    within = last_turn(np.column_stack((2.0 * angle, angle % (2.0 * math.pi), -3.0 * angle)), "drum")
    assert within == pytest.approx(rows, rel=1e-12)
    with pytest.raises(StudyError, match=r"^joint drum makes 0\.1\d+ of a turn"):
        last_turn(rows[rows[:, 1] <= rows[0, 1] + 1.0], "drum")


@pytest.mark.slow
def test_the_diagram_names_each_element_and_is_written(tmp_path):
    found = flow_of(build(page(WHEEL)), "page", 1.3)
    figure = drawn_flow("wheel", found)
    names = [label.get_text() for label in figure.axes[1].get_yticklabels()]
    assert names == ["motor", "rub", "oil", "out of the machine"]
    bars = [bar.get_width() for bar in figure.axes[1].patches]
    assert bars[-1] == -found.held_j[-1]  # what a machine that slows down gives is positive, as that of a motor
    assert sum(bars) == pytest.approx(0.0, abs=1e-6 * max(bars))
    file = tmp_path / "flow.svg"
    words = ["simulate", "compaction_press", "--duration", "1.5", "--one-step", "--energy", str(file)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert "held by the machine" in file.read_text(encoding="utf-8")
    refused = CliRunner().invoke(app, ["simulate", "impact_mass", "--duration", "1", "--energy", str(file), "--force"])
    assert isinstance(refused.exception, StudyError)
    assert str(refused.exception) == "impact_mass: its linkage keeps no work of its elements"
