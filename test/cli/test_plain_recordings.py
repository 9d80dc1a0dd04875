# SPDX-License-Identifier: Apache-2.0
"""A recording without a configuration is recomputed by a given one; a small bias is within a tolerance or not."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml
from command_line import Ended, mech_twin
from recordings import entries_of, simulated_bag, written_bag

from mech_twin.parameters.load import configuration_file

pytestmark = pytest.mark.usefixtures("ros_domain")
DRUM = "winding_drum"


def replay(*words: str | Path) -> Ended:
    return mech_twin("replay", *words, "--json")


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return a recording of the twin, and its step messages alone."""
    folder = tmp_path_factory.mktemp("bags")
    simulated_bag(DRUM, 0.1, folder / "whole")
    steps = [entry for entry in entries_of(folder / "whole") if "/step/" in entry.topic]
    return folder / "whole", written_bag(folder / "plain", steps)


def heavier(folder: Path) -> Path:
    """Write a configuration of the drum whose package is two percent heavier."""
    tree = yaml.safe_load(configuration_file(DRUM).read_text(encoding="utf-8"))
    tree["/**"]["ros__parameters"]["package_density_kg_per_m3"] *= 1.02
    file = folder / "heavier.yaml"
    file.write_text(yaml.safe_dump(tree), encoding="utf-8")
    return file


def test_a_recording_without_a_configuration_asks_for_one(bags: tuple[Path, Path]) -> None:
    found = replay(bags[1], "--analyse")
    assert found.code == 2
    assert found.err.count("\n") == 1
    assert "holds no configuration of the machine; expected --config FILE" in found.err


@pytest.mark.parametrize("mode", ["--analyse", "--resimulate"])
def test_with_a_configuration_it_is_recomputed_to_the_bit(bags: tuple[Path, Path], mode: str) -> None:
    found = replay(bags[1], mode, "--config", configuration_file(DRUM))
    assert found.code == 0, found.err
    document = json.loads(found.out)
    assert document["identical"]
    assert document["steps_compared"] == 101


def test_a_tolerance_lets_a_small_difference_of_the_forces_pass_and_no_larger_one(
    bags: tuple[Path, Path], tmp_path: Path
) -> None:
    config = heavier(tmp_path)
    assert replay(bags[1], "--analyse", "--config", config).code == 1
    assert replay(bags[1], "--analyse", "--config", config, "--tolerance", "0.03").code == 0
    found = replay(bags[1], "--analyse", "--config", config, "--tolerance", "0.01")
    assert found.code == 1
    first = json.loads(found.out)["first_difference"]
    assert abs(first["computed"] / first["recorded"] - 1.0) == pytest.approx(0.02, abs=2e-3)


def test_what_says_itself_what_ran_takes_no_other_configuration(bags: tuple[Path, Path]) -> None:
    found = replay(bags[0], "--analyse", "--config", configuration_file(DRUM))
    assert found.code == 2
    assert "holds its own configuration" in found.err


@pytest.mark.parametrize("words", [("--resimulate", "--tolerance", "0.1"), ("--config", "any.yaml")])
def test_options_that_mean_nothing_are_refused(bags: tuple[Path, Path], words: tuple[str, ...]) -> None:
    found = replay(bags[1], *words)
    assert found.code == 2
    assert "goes with --analyse" in found.err
