# SPDX-License-Identifier: Apache-2.0
"""``mech-twin compare``: recordings and configurations side by side."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

BAGS = Path(__file__).parents[2] / "bags"
CONFIG = Path(__file__).parents[2] / "config"


def compare(*words: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "mech_twin", "compare", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


@pytest.fixture
def changed(tmp_path: Path) -> Path:
    text = (CONFIG / "compaction_press.yaml").read_text(encoding="utf-8")
    file = tmp_path / "changed.yaml"
    file.write_text(text.replace("peak_n: 10000.0", "peak_n: 12000.0"), encoding="utf-8")
    return file


def test_a_machine_equals_itself_and_a_changed_one_is_named_by_key_and_numbers(changed, tmp_path):
    assert compare("compaction_press", CONFIG / "compaction_press.yaml", "--duration", 0.2).returncode == 0
    picture = tmp_path / "apart.svg"
    words = ("compaction_press", changed, "--duration", 0.2, "--json", "--picture", picture)
    found = compare(*words, "--tolerance", 0.01)
    assert found.returncode == 1, found.stderr
    document = json.loads(found.stdout)
    assert [(item["name"], item["first"], item["second"]) for item in document["settings"]] == [
        ("working_force.peak_n", 10000.0, 12000.0)
    ]
    numbers = {item["name"]: item for item in document["numbers"]}
    assert numbers["work_per_cycle_j"]["second"] == pytest.approx(1.2 * numbers["work_per_cycle_j"]["first"])
    assert numbers["stroke_m"]["relative"] == 0.0
    assert "<svg" in picture.read_text(encoding="utf-8")
    again = compare(*words)
    assert again.returncode == 2
    assert "--force" in again.stderr


def test_a_recording_equals_the_configuration_it_was_made_with(ros_domain, tmp_path):
    bag = tmp_path / "bag"
    words = ["simulate", "compaction_press", "--duration", "0.3", "--bag", str(bag)]
    subprocess.run([sys.executable, "-m", "mech_twin", *words], check=True, capture_output=True, timeout=300)
    found = compare(bag, "compaction")  # the beginning of a machine's name, as everywhere
    assert found.returncode == 0, found.stdout + found.stderr
    assert "within a tolerance of 0" in found.stdout


@pytest.mark.parametrize(
    ("second", "said"),
    [("winding_drum", "expected one machine"), ("nowhere", "nowhere"), ("nowhere.yaml", "nowhere.yaml")],
)
def test_what_cannot_be_compared_is_one_line(second, said):
    found = compare("compaction_press", second, "--duration", 0.01)
    assert found.returncode == 2
    assert len(found.stderr.strip().splitlines()) == 1
    assert said in found.stderr
