# SPDX-License-Identifier: Apache-2.0
"""The command as a person types it: quick help, numbers for machines, how a run ends."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from command_line import mech_twin

from mech_twin.machines.catalog import CATALOGUE

pytestmark = [pytest.mark.usefixtures("ros_domain"), pytest.mark.slow]
COMMAND = [sys.executable, "-c", "from mech_twin.cli.main import main; main()"]
MOST_S = 1.5  # a second, and the start of a report on a busy machine


def document(*words: str) -> Any:
    done = mech_twin(*words)
    assert done.code == 0, done.err
    return json.loads(done.out)


def test_help_is_quick() -> None:
    """Best of five: the promise is about the command, not about a busy machine."""
    best = float("inf")
    for _ in range(5):
        before = time.monotonic()
        subprocess.run([*COMMAND, "--help"], capture_output=True, check=True)
        best = min(best, time.monotonic() - before)
    imports = subprocess.run(
        [sys.executable, "-X", "importtime", "-c", "import mech_twin.cli.main"],
        capture_output=True,
        text=True,
        check=True,
    ).stderr
    heavy = ("numba", "scipy", "rclpy", "matplotlib", "rerun", "pyarrow")
    assert not [line for line in imports.splitlines() if line.rsplit("|", 1)[-1].strip() in heavy]
    assert best < 1.0


def test_linear_algebra_of_a_program_starts_no_threads() -> None:
    code = (
        "import mech_twin.programs, os, numpy, scipy.linalg; full = numpy.eye(900) + 1e-3; full @ full; "
        "scipy.linalg.solve(full, full); print(len(os.listdir('/proc/self/task')))"
    )
    usual = {key: value for key, value in os.environ.items() if key != "OPENBLAS_NUM_THREADS"}
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, env=usual).stdout == b"1\n"


def test_list_names_every_machine() -> None:
    assert [machine["name"] for machine in document("list", "--json")["machines"]] == list(CATALOGUE)


def test_simulate_gives_summary_events_and_samples() -> None:
    result = document("simulate", "impact_mass", "--duration", "0.2", "--json", "--samples")
    assert set(result) == {"machine", "config", "summary", "shorter_steps", "residuals", "events", "samples"}
    assert result["shorter_steps"]["step_s"] < 0.5 * result["config"]["coupling"]["step_s"]
    assert set(result["shorter_steps"]["summary"]) <= set(result["summary"])
    assert {"time_s", "kind", "pre_velocity_m_per_s", "post_velocity_m_per_s", "impulse_ns", "period"} <= set(
        result["events"][0]
    )
    assert len({len(column) for column in result["samples"].values()}) == 1
    assert result["samples"]["time_s"][-1] == pytest.approx(0.2)


def test_one_step_leaves_the_second_run_out() -> None:
    assert "shorter_steps" not in document("simulate", "impact_mass", "--duration", "0.1", "--json", "--one-step")


def test_a_setting_changes_the_result() -> None:
    light = document("analyse", "winding_drum", "--json", "--set", "package_density_kg_per_m3=300.0")["summary"]
    heavy = document("analyse", "winding_drum", "--json")["summary"]
    assert light["package_mass_kg"] < heavy["package_mass_kg"]


def test_analyse_gives_one_position_or_a_cycle() -> None:
    one = document("analyse", "compaction_press", "--crank-deg", "225", "--json")
    assert one["crank_deg"] == 225.0
    cycle = document("analyse", "compaction_press", "--cycle", "12", "--json")["cycle"]
    assert {len(column) for column in cycle.values()} == {12}


def test_a_busy_port_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        done = mech_twin("run", "winding_drum", "--no-record", "--view-port", port)
    assert done.code == 2
    assert port in done.err
    assert "Traceback" not in done.err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("processes", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_signal_ends_a_run_and_closes_the_recording(number: signal.Signals, processes: bool, tmp_path: Path) -> None:
    words = ["run", "winding_drum", "--view", "none", "--json", *(["--processes"] if processes else [])]
    bag = tmp_path / "bag"
    out, took_s = ended_by(number, [*words, "--record", str(bag)], bag / "bag_0.mcap")
    assert took_s < MOST_S
    told, info = json.loads(out), document("info", str(bag), "--json")
    assert told["machine"] == "winding_drum"
    assert info["finished"] is True


def ended_by(number: signal.Signals, words: list[str], growing: Path) -> tuple[str, float]:
    """Return what a run writes that a signal ends once its recording grows, and the time from the signal on (s)."""
    run = subprocess.Popen(
        [sys.executable, "-m", "mech_twin", *words],  # as it is installed
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    try:
        wait_for_growth(growing)
        before = time.monotonic()
        run.send_signal(number)
        out, errors = run.communicate(timeout=20)
        took_s = time.monotonic() - before
    finally:
        run.kill()
    assert run.returncode == 0, errors
    return out, took_s


def wait_for_growth(file: Path) -> None:
    """Wait for steps: what nodes say of themselves before the first step is some kilobytes."""
    end = time.monotonic() + 60.0
    first: int | None = None
    while time.monotonic() < end:
        size = file.stat().st_size if file.exists() else 0
        first = size if first is None and size else first
        if first is not None and size > first + 200_000:
            return
        time.sleep(0.05)
    raise AssertionError(f"{file} does not grow")


def test_a_run_remarks_on_its_numbers_as_a_simulation_does() -> None:
    page = str(Path(__file__).resolve().parents[2] / "config" / "pages" / "four_bar.yaml")
    words = [page, "--duration", "0.1", "--set", "settle_s=0.5"]
    told = [
        subprocess.run([*COMMAND, *verb, *words], capture_output=True, text=True, check=True, timeout=120).stderr
        for verb in (["simulate", "--one-step"], ["run", "--view", "none", "--no-record", "--pace", "max"])
    ]
    remarks = [[line for line in each.splitlines() if line.startswith("warning: ")] for each in told]
    assert remarks[0] == remarks[1] == ["warning: settle_s = 0.5 s: the run is not longer, so it has no numbers"]
