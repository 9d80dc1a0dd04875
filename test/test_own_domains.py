# SPDX-License-Identifier: Apache-2.0
"""Tests that run beside each other, in whatever checkouts, share no ROS domain."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

from domains import DOMAINS, own_domain

HOLDER = "from domains import own_domain\nwith own_domain() as domain:\n    print(domain, flush=True)\n    input()\n"


def test_no_two_holders_have_one_domain() -> None:
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    with ExitStack() as held:
        found = [held.enter_context(own_domain()) for _ in range(DOMAINS // 3)]
        for _ in range(3):
            words = [sys.executable, "-c", HOLDER]
            other = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)
            held.callback(other.communicate, "\n")
            assert other.stdout is not None
            found.append(int(other.stdout.readline()))
        assert len(set(found)) == len(found)


def test_a_domain_is_free_again_once_its_holder_ended() -> None:
    for _ in range(2 * DOMAINS):
        with own_domain():
            pass
