# SPDX-License-Identifier: Apache-2.0
"""Measures speed, group by group, each beside its peers in the same run, and writes docs/proof/performance.md.

python benchmarks/performance.py [GROUP ...] [--print-only] [--list]

Each group runs in a process of its own.  One that cannot run, for want of a peer say, is a failure and is named at the
end: nothing is skipped.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path
from types import MappingProxyType

HERE = Path(__file__).resolve().parent
GROUPS = MappingProxyType(
    {
        "rollout": "roll-out of every machine beside its roles called one by one",
        "breaker_chain": "the whole breaker beside MuJoCo and Exudyn",
        "four_bar": "four-bar kernels beside pylinkage, numpy and MuJoCo",
        "wave_blow": "roll-out with the blow as a wave beside the rigid blow",
        "impact_mass": "impacts beside scipy's solve_ivp with events",
        "roller_former": "roller former beside scipy's DOP853 and MuJoCo",
        "recording": "writing, reading and recovering recordings beside mcap and rosbags",
        "round_trip": "a message there and back between two bare nodes of rclpy",
        "topic_loop": "steps over topics beside bare nodes, and where a step's time goes",
        "real_time": "a run by the wall clock: processor time and how late the latest step was",
        "cold_start": "from the command to the first step, share by share",
        "view_lag": "how far the view in the browser lags behind, and what its frames cost",
        "installation": "what an installation's size is made of",
    }
)
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
LONGEST_S = 1800.0  # of a group, kernels compiled on the way: what takes longer hangs


def run_group(group: str, *, write: bool) -> str | None:
    """Run one group; return what went wrong, None if nothing did."""
    begun = time.monotonic()
    print(f"\n== {group}: {GROUPS[group]}", flush=True)
    environment = {
        **dict.fromkeys(ONE_THREAD, "1"),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        **os.environ,
    }
    command = [sys.executable, str(HERE / f"{group}.py"), *(["--write"] if write else [])]
    try:
        code = subprocess.run(command, env=environment, timeout=LONGEST_S, check=False).returncode
    except subprocess.TimeoutExpired:
        return f"{group}: not done after {LONGEST_S:g} s"
    print(f"== {group}: {time.monotonic() - begun:.0f} s", flush=True)
    return f"{group}: ended with code {code}" if code else None


def main() -> int:
    """Run the groups asked for, or all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("groups", nargs="*", metavar="GROUP", choices=[*GROUPS, []], help=", ".join(GROUPS))
    parser.add_argument("--print-only", action="store_true", help="leave docs/proof/performance.md as it is")
    parser.add_argument("--list", action="store_true", help="name the groups")
    asked = parser.parse_args()
    if asked.list:
        print("\n".join(f"{name:15s} {what}" for name, what in GROUPS.items()))
        return 0
    found = [run_group(group, write=not asked.print_only) for group in asked.groups or GROUPS]
    broken = [line for line in found if line is not None]
    print("\n".join(["", *(broken or ["all groups measured"])]))
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
