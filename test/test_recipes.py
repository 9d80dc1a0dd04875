# SPDX-License-Identifier: Apache-2.0
"""The recipes of the documentation are true: what is made by them alone works in nodes, recordings and commands."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from recipes import change, checkout_by, ran
from recordings import decoded_messages

from mech_twin.recording.bag_reader import BagReader

pytestmark = pytest.mark.slow
DRUM, TOPIC = "winding_drum", "/winding_drum/regime_name"


@pytest.fixture(scope="module")
def with_topic(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return checkout_by("adding-a-topic.md", tmp_path_factory.mktemp("topic") / "checkout")


@pytest.fixture(scope="module")
def with_metric(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return checkout_by("adding-a-metric.md", tmp_path_factory.mktemp("metric") / "checkout")


def assert_passes(checkout: Path, *words: str) -> None:
    done = ran(checkout, "-m", "pytest", "-q", "-p", "no:cacheprovider", *words)
    assert done.returncode == 0, done.stdout + done.stderr
    assert " passed" in done.stdout


def test_a_topic_made_by_the_recipe_passes_its_test_and_that_of_the_page(with_topic: Path) -> None:
    assert_passes(with_topic, "test/messages/test_regime_name.py")
    assert_passes(with_topic, "test/packaging/test_documentation.py", "-k", "topics_page")


def test_a_topic_without_its_row_is_found(with_topic: Path, tmp_path: Path) -> None:
    shutil.copytree(with_topic, tmp_path / "checkout")
    change(tmp_path / "checkout" / "docs" / "topics.md", "-| `regime_name` | std_msgs/String ...")
    done = ran(tmp_path / "checkout", "-m", "pytest", "-q", "test/packaging/test_documentation.py", "-k", "topics_page")
    assert done.returncode == 1
    assert "regime_name" in done.stdout


@pytest.mark.parametrize("verb", ["run", "simulate"])
def test_a_topic_made_by_the_recipe_is_sent_and_recorded(
    with_topic: Path, tmp_path: Path, verb: str, ros_domain: int
) -> None:
    bag = str(tmp_path / "bag")
    how = ("--pace", "max", "--view", "none", "--record", bag) if verb == "run" else ("--bag", bag)
    done = ran(with_topic, "-m", "mech_twin", verb, DRUM, "--duration", "0.2", *how)
    assert done.returncode == 0, done.stderr
    with BagReader(Path(bag)) as reader:
        assert reader.topics[TOPIC].type_name == "std_msgs/msg/String"
    assert [message.data for message in decoded_messages(Path(bag), TOPIC)] == ["running"]


def test_a_metric_made_by_the_recipe_keeps_its_law_and_the_contract(with_metric: Path) -> None:
    assert_passes(with_metric, "test/machines/winding_drum/test_drive_power_max.py")
    assert_passes(with_metric, "test/machines/test_catalogue_contract.py", "-k", f"{DRUM} and unit")


def test_a_metric_made_by_the_recipe_is_in_the_summary_and_in_a_sweep(with_metric: Path, tmp_path: Path) -> None:
    done = ran(with_metric, "-m", "mech_twin", "simulate", DRUM, "--duration", "1", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["summary"]["drive_power_max_w"] > 0.0
    table = tmp_path / "sweep.csv"
    words = ("study", DRUM, "sweep", "--over", "eccentricity_m=0,0.002", "--duration", "0.5", "--no-picture")
    done = ran(with_metric, "-m", "mech_twin", *words, "--number", "drive_power_max_w", "--out", str(table))
    assert done.returncode == 0, done.stderr
    assert "drive_power_max_w" in table.read_text().splitlines()[0]


@pytest.mark.parametrize("recipe", ["with_topic", "with_metric"])
def test_code_of_a_recipe_keeps_the_style_of_the_project(recipe: str, request: pytest.FixtureRequest) -> None:
    checkout: Path = request.getfixturevalue(recipe)
    for words in (("check",), ("format", "--check")):
        done = subprocess.run(
            [sys.executable, "-m", "ruff", *words, "mech_twin", "test"],
            cwd=checkout,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
