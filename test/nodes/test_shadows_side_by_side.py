# SPDX-License-Identifier: Apache-2.0
"""Shadows of several machines of one kind in one domain: each below a name of its own."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytestmark = [pytest.mark.usefixtures("ros_domain"), pytest.mark.slow]
SHADOW = [sys.executable, "-c", "from mech_twin.cli.main import main; main()", "shadow", "winding_drum", "--from"]
LIMIT_S = 180.0


def test_shadows_of_one_kind_run_side_by_side_and_a_name_is_given_once() -> None:
    def ended(name: str) -> subprocess.CompletedProcess[str]:
        words = [*SHADOW, "hall/drum_2", "--namespace", name, "--duration", "0.5"]
        return subprocess.run(words, capture_output=True, text=True, timeout=LIMIT_S, check=False)

    first = subprocess.Popen([*SHADOW, "hall/drum_1", "--namespace", "drum_1"], stderr=subprocess.PIPE, text=True)
    try:
        assert first.stderr is not None
        assert any("following /hall/drum_1; estimates below /drum_1/twin" in line for line in first.stderr)
        second, again = ended("drum_2"), ended("drum_1")
        assert first.poll() is None
    finally:
        first.terminate()
        first.communicate(timeout=LIMIT_S)
    assert second.returncode == 0 and "below /drum_2/twin" in second.stderr
    assert again.returncode != 0 and "/drum_1/twin" in again.stderr
