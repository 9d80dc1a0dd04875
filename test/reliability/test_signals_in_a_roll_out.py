# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C ends a compiled run of hours within a moment, called from plain Python, alone or on many threads."""

from __future__ import annotations

import subprocess
import sys

import pytest

HOURS_S = 8 * 3600.0  # at these machines' steps: minutes of real time at the least
# what is timed is the processor time of the process, which other work does not lengthen
SCRIPT = """
import os, signal, sys, threading, time
import mech_twin as mt

mt.rollout({machine!r}, 0.1)
sent = []
def send():
    sent.append(time.process_time())
    os.kill(os.getpid(), signal.SIGINT)
timer = threading.Timer(0.5, send)
timer.start()
try:
    {call}
    print("ended by itself")
except KeyboardInterrupt:
    print("interrupted", time.process_time() - sent[0])
"""
CALLS = {
    "one": "mt.rollout({machine!r}, {duration}, columns=[])",
    "many": "mt.rollouts({machine!r}, {duration}, [None] * 8, columns=[], cores=2)",
    "simulate": "mt.simulate({machine!r}, {duration})",
}


@pytest.mark.parametrize(
    ("call", "machine"),
    [
        pytest.param("one", "compaction_press", marks=pytest.mark.slow),
        pytest.param("many", "winding_drum", marks=pytest.mark.slow),
        ("simulate", "winding_drum"),
    ],
)
def test_ctrl_c_ends_a_long_roll_out_called_from_python(call: str, machine: str) -> None:
    script = SCRIPT.format(machine=machine, call=CALLS[call].format(machine=machine, duration=HOURS_S))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    word, _, taken_s = done.stdout.strip().partition(" ")
    assert word == "interrupted", done.stdout
    assert float(taken_s) < 5.0
