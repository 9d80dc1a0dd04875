# SPDX-License-Identifier: Apache-2.0
"""A filmed drop tells the restitution, in any unit and direction, and its missed bounces are named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from command_line import mech_twin

from mech_twin.errors import MeasurementError
from mech_twin.studies.identification.bounces import Bounces, bounces, restitution

G = 9.81


def dropped(share: float, count: int = 9, rate_hz: float = 240.0) -> tuple[np.ndarray, np.ndarray]:
    """Return times and heights of a ball that is let go at 1 m and keeps a share of its speed at each bounce."""
    times = np.arange(0.0, 6.0, 1.0 / rate_hz)
    fall = (2.0 / G) ** 0.5
    starts, speeds = [-fall], [G * fall]
    for _ in range(count):
        starts.append(starts[-1] + 2.0 * speeds[-1] / G)
        speeds.append(share * speeds[-1])
    starts = np.array(starts) + 0.0
    place = np.searchsorted(starts, times, side="right") - 1
    passed = times - starts[place]
    heights = np.array(speeds)[place] * passed - 0.5 * G * passed**2
    kept = times < starts[-1]
    return times[kept], heights[kept]


@pytest.mark.parametrize(("scale", "offset"), [(1.0, 0.0), (-412.0, 700.0)])
@pytest.mark.parametrize("share", [0.9, 0.7])
def test_the_restitution_is_told_whatever_the_unit_and_the_direction(share: float, scale: float, offset: float) -> None:
    times, heights = dropped(share)
    noise = 0.001 * np.random.default_rng(2).standard_normal(len(times))
    sideways = 0.05 * times
    found = bounces(Path("drop"), times, {"across": sideways, "high": scale * (heights + noise) + offset})
    assert found.column == "high"
    assert found.found.value == pytest.approx(share, abs=0.01)


def test_bounces_are_counted_down_to_three_hundredths_of_the_first_height() -> None:
    times, heights = dropped(0.8, count=12)
    assert len(bounces(Path("drop"), times, {"y": heights}).times_s) == int(np.log(0.03) / np.log(0.8**2))


def test_a_bounce_that_was_not_filmed_is_named_and_runs_without_flaws_count_alone() -> None:
    times, heights = dropped(0.9)
    whole = bounces(Path("whole"), times, {"y": heights})
    gap = whole.times_s[4]
    kept = np.abs(times - gap) > 0.2
    cut = bounces(Path("cut"), times[kept], {"y": heights[kept]})
    assert whole.clean
    assert not cut.clean
    assert cut.flaws.endswith(" s")
    other = Bounces(Path("other"), "y", whole.times_s, whole.found._replace(value=0.91))
    told = restitution([whole, cut, other])
    assert told.used == (Path("whole"), Path("other"))
    assert abs(told.value - 0.905) < 0.005
    assert told.half_width >= 0.01  # two runs: what they differ by, with Student's t


def test_a_column_without_bounces_is_refused_in_one_line() -> None:
    times = np.linspace(0.0, 1.0, 50)
    with pytest.raises(MeasurementError, match="no column shows bounces"):
        bounces(Path("line"), times, {"y": times})


def test_apexes_that_come_down_are_no_bounces() -> None:
    """Held at 1 m and let go, a ball that keeps half its speed shows two bounces, and three apexes above them."""
    times, heights = dropped(0.5)
    held = np.arange(-0.2, -1e-9, 1.0 / 240.0)
    noise = 0.003 * np.random.default_rng(1).standard_normal(len(held) + len(times))
    rise = np.concatenate([np.full(len(held), heights.max()), heights]) + noise
    with pytest.raises(MeasurementError, match="at least three"):
        bounces(Path("drop"), np.concatenate([held, times]), {"y": rise})


def test_three_bounces_fix_the_restitution_and_leave_nothing_for_its_error() -> None:
    times, heights = dropped(0.9)
    whole = bounces(Path("whole"), times, {"y": heights})
    kept = times < whole.times_s[2] + 0.3
    three = bounces(Path("three"), times[kept], {"y": heights[kept]})
    assert len(three.times_s) == 3
    assert restitution([three]).half_width == np.inf
    both = restitution([three, whole])
    assert 0.0 < both.half_width < 0.2


def test_a_restitution_that_the_run_leaves_open_is_not_written_and_ends_with_1(tmp_path: Path) -> None:
    times, heights = dropped(0.8)
    kept = times < bounces(Path("drop"), times, {"y": heights}).times_s[2] + 0.2
    run, out = tmp_path / "three.csv", tmp_path / "found.yaml"
    np.savetxt(run, np.column_stack([times, heights])[kept], delimiter=",", header="t,y", comments="")
    ended = mech_twin("identify", "impact_mass", run, "--out", out)
    assert ended.code == 1
    assert "nothing is written" in ended.err
    assert not out.exists()
