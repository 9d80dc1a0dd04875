# SPDX-License-Identifier: Apache-2.0
"""Restitution of a real ball from filmed drops: flights that shorten, missed and false bounces named.

    python benchmarks/identification/ball_drops.py DIRECTORY

The directory holds drop_1.csv to drop_9.csv of the public repository BenHagenau/ASEN2003 (pixel x, pixel y, time in s;
bounce and apex in turn); it is not part of this project.  Ends with exit code 1 where the restitution of a drop without
a missed or false bounce is not between 0.90 and 0.92, or where fewer than three drops are such.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from data_directory import given_directory

from mech_twin.measurements.blocks import Array
from mech_twin.studies.identification.bounces import restitution_from_flights

DROPS = ("drop_1.csv", "drop_3.csv", "drop_5.csv", "drop_7.csv", "drop_9.csv")
LEAST, MOST, LEAST_CLEAN = 0.90, 0.92, 3
LEAST_RISE_PX = 12.0  # of an apex over the bounce before it: lower flights are lost in the places of the pictures


def bounces(path: Path) -> Array:
    """Return the times (s) at which the ball is lower than in the pictures before and after, while it flies high."""
    _, height, time_s = np.loadtxt(path, delimiter=",").T
    around = np.concatenate([[np.inf], height, [-np.inf]])
    low = np.flatnonzero((height < around[:-2]) & (height < around[2:]))
    high = np.flatnonzero(height[low + 1] - height[low] >= LEAST_RISE_PX)
    return np.asarray(time_s[low[: high[-1] + 1]])


def main() -> None:
    """Print what each drop shows."""
    folder = given_directory(__doc__, DROPS)
    clean = []
    for name in DROPS:
        times_s = bounces(folder / name)
        found = restitution_from_flights(times_s)
        if not found.missed and not found.false:
            clean.append(found.value)
        wrong = [("missed before", found.missed), ("false", found.false)]
        words = "; ".join(f"{what} {', '.join(f'{times_s[i]:.3f} s' for i in which)}" for what, which in wrong if which)
        print(
            f"{name}: {found.value:.4f} +- {found.standard_deviation:.4f}, {found.used} of {len(times_s)} bounces",
            end="",
        )
        print(f"; {words}" if words else "; clean")
    sys.exit(int(len(clean) < LEAST_CLEAN or not all(LEAST <= value <= MOST for value in clean)))


if __name__ == "__main__":
    main()
