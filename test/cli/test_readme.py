# SPDX-License-Identifier: Apache-2.0
"""What the README, the quick start and the page on own nodes show works, and is, as it stands there."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import mech_twin as mt

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_integration_example_halves_the_speed_of_a_running_machine(ros_domain: int, tmp_path: Path) -> None:
    page = (ROOT / "docs" / "tutorials" / "own-node.md").read_text(encoding="utf-8")
    example = re.search(r"```python\n(.*?)```", page, re.DOTALL)
    assert example is not None
    (tmp_path / "example.py").write_text(example.group(1), encoding="utf-8")
    words = ["run", "vibration_crank", "--no-record", "--view", "none"]
    run = subprocess.Popen(
        [sys.executable, "-c", "from mech_twin.cli.main import main; main()", *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        done = subprocess.run(
            [sys.executable, str(tmp_path / "example.py")], capture_output=True, text=True, timeout=60, check=True
        )
    finally:
        run.terminate()
        run.wait(10)
    first, last = (float(number) for number in re.findall(r"([\d.]+) rad/s", done.stdout))
    assert last == pytest.approx(first / 2.0, rel=0.02)


@pytest.mark.parametrize("target", sorted(set(re.findall(r"\]\(([^)#:]+)\)", README))))
def test_every_link_leads_somewhere(target: str) -> None:
    assert (ROOT / target).exists()


def test_the_numbers_of_the_quick_start_are_those_of_its_run() -> None:
    page = (ROOT / "docs" / "quick-start.md").read_text(encoding="utf-8")
    told = re.findall(r"^\| `(\w+)` \| ([\d.]+) \|", page, re.MULTILINE)
    assert len(told) == 5
    found = mt.simulate("mb10_breaker", 3.0).summary
    assert {key: f"{found[key]:.{len(number.partition('.')[2])}f}" for key, number in told} == dict(told)
