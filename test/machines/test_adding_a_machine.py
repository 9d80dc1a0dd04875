# SPDX-License-Identifier: Apache-2.0
"""The recipe of the documentation is true: a machine made from its blocks alone keeps every contract."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from recipes import checkout_by, ran

MACHINE = "flywheel_rig"

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return checkout_by("adding-a-machine.md", tmp_path_factory.mktemp("machine") / "checkout")


def test_a_machine_made_by_the_recipe_keeps_every_contract(checkout: Path) -> None:
    contracts = ("test/machines/test_catalogue_contract.py", "test/machines/test_rollout_contract.py")
    done = ran(checkout, "-m", "pytest", "-q", *contracts, "-k", MACHINE)
    assert done.returncode == 0, done.stdout + done.stderr
    assert int(re.search(r"(\d+) passed", done.stdout)[1]) >= 17, done.stdout


def test_topics_of_a_machine_made_by_the_recipe_equal_the_engine(checkout: Path, ros_domain: int) -> None:
    done = ran(checkout, "-m", "pytest", "-q", "test/nodes/test_topics_equal_engine.py", "-k", MACHINE)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 passed" in done.stdout


def test_the_command_runs_a_machine_made_by_the_recipe(checkout: Path) -> None:
    done = ran(checkout, "-m", "mech_twin", "simulate", MACHINE, "--duration", "2", "--json")
    assert done.returncode == 0, done.stderr
    # 2 N m on 0.5 kg m2: 0.25 s of it are lost while the supply comes on
    assert json.loads(done.stdout)["summary"]["largest_speed_rad_per_s"] == pytest.approx(4.0 * 1.75, abs=0.02)


def test_the_page_of_the_recipe_turns_as_the_package_does(checkout: Path) -> None:
    """But for half a step of 4 rad/s2: the page has the mean supply of a step, the package that at its end."""
    speeds = []
    for name, metric in ((MACHINE, "largest_speed_rad_per_s"), (f"{MACHINE}.yaml", "shaft_speed_max_rad_per_s")):
        done = ran(checkout, "-m", "mech_twin", "simulate", name, "--duration", "2", "--json")
        assert done.returncode == 0, done.stderr
        speeds.append(json.loads(done.stdout)["summary"][metric])
    assert speeds[0] - speeds[1] == pytest.approx(4.0 * 0.0005, rel=1e-9)


def test_a_question_the_machine_has_no_answer_to_is_one_line(checkout: Path) -> None:
    done = ran(checkout, "-m", "mech_twin", "study", MACHINE, "size")
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert "nothing to size" in done.stderr
    assert "Traceback" not in done.stderr
