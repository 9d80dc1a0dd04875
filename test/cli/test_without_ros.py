# SPDX-License-Identifier: Apache-2.0
"""The library, the verbs that need no topics, and the export of a unit work where there is no ROS at hand."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ROS = (
    "rclpy", "rcl_interfaces", "builtin_interfaces", "diagnostic_msgs", "geometry_msgs", "rosgraph_msgs", "sensor_msgs",
    "std_msgs", "std_srvs", "visualization_msgs",
)  # fmt: skip
WITHOUT = f"""
import sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {ROS!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Absent())
"""
VERBS = [
    ["simulate", "winding_drum", "--duration", "0.1"],
    ["analyse", "winding_drum"],
    ["study", "winding_drum", "sweep", "--over", "package_radius_m=0.1,0.12", "--no-picture", "--out", "out.csv"],
    ["compare", "winding_drum", "winding_drum", "--duration", "0.1"],
    ["reproduce", "winding_drum"],
    ["view", str(ROOT / "config" / "pages" / "four_bar.yaml"), "--duration", "0.1", "--save", "out.rrd"],
]
WITH_TOPICS = [
    ["run", "winding_drum"],
    ["info", str(ROOT / "bags" / "impact_mass")],
    ["replay", str(ROOT / "bags" / "impact_mass"), "--resimulate"],
]


def ended(code: str, place: Path) -> subprocess.CompletedProcess[str]:
    words = [sys.executable, "-c", WITHOUT + code]
    return subprocess.run(words, cwd=place, capture_output=True, text=True, check=False)


EACH = """
from mech_twin.cli.main import main
for words in {verbs!r}:
    sys.argv = ["mech-twin", *words]
    try:
        main()
    except SystemExit as ended:
        print("ended", words[0], ended.code)
"""


@pytest.mark.slow
def test_verbs_without_topics_need_no_ros(tmp_path: Path) -> None:
    done = ended(EACH.format(verbs=VERBS), tmp_path)
    endings = [line for line in done.stdout.splitlines() if line.startswith("ended ")]
    assert endings == [f"ended {words[0]} 0" for words in VERBS], done.stderr
    assert {"out.csv", "out.rrd"} <= {path.name for path in tmp_path.iterdir()}


@pytest.mark.slow
def test_a_unit_is_exported_without_ros(tmp_path: Path) -> None:
    done = ended(EACH.format(verbs=[["export", "fmu", "winding_drum"]]), tmp_path)
    assert "ended export 0" in done.stdout and list(tmp_path.iterdir()), done.stderr


def test_the_library_needs_no_ros(tmp_path: Path) -> None:
    runs = "mt.simulate('winding_drum', 0.1).sound, len(mt.rollout('impact_mass', 0.1).events)"
    code = f"import mech_twin as mt\nprint({runs})"
    done = ended(code, tmp_path)
    assert done.stdout.split()[0] == "True", done.stderr


@pytest.mark.parametrize("verb", WITH_TOPICS, ids=lambda words: words[0])
def test_a_verb_with_topics_says_in_one_line_what_it_lacks(verb: list[str], tmp_path: Path) -> None:
    done = ended(f"sys.argv = ['mech-twin', *{verb!r}]\nfrom mech_twin.cli.main import main\nmain()", tmp_path)
    assert done.returncode == 2
    assert "expected ROS 2 for Python, no module '" in done.stderr and "mech_twin[jazzy]" in done.stderr
    assert done.stderr.count("\n") == 1
