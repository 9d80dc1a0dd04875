# SPDX-License-Identifier: Apache-2.0
"""The recording of a spring that weakens: what a shadow said then is what the command says of it, and it is small."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from command_line import mech_twin

from mech_twin.messages.cdr import received_message
from mech_twin.recording.bag_reader import open_bag

STORY = Path(__file__).resolve().parents[2] / "bags" / "weak_spring"
GROUP, WEAKER = "preload_lost or spring_soft", -0.2


def test_the_command_names_the_fault_of_the_story() -> None:
    words = ("monitor", "mb10_breaker", STORY / "watched", "--json", "--skip", "0", "--map", STORY / "map.yaml")
    done = mech_twin(*words, "--baseline", STORY / "healthy.json", "--config", STORY / "mb10_breaker.yaml")
    assert done.code == 1
    (run,) = json.loads(done.out)["runs"]
    first = next(alarm for alarm in run["alarms"] if alarm["finding"])
    assert first["finding"] == GROUP
    spring = next(each for each in first["candidates"] if each["name"] == "spring_soft")
    assert spring["low_95"] <= WEAKER <= spring["high_95"]


def test_the_features_that_were_said_live_are_those_of_the_samples_beside_them() -> None:
    with open_bag(STORY / "watched") as reader:
        said = [received_message(each.raw) for each in reader.messages(["/mb10_breaker/twin/residuals/standard"])]
        decisions = [each.raw for each in reader.messages(["/mb10_breaker/twin/decisions"])]
    rows = np.array([message.position for message in said])
    assert len(rows) > 200
    assert any(b"kept" in raw for raw in decisions)
    assert np.nanmax(np.abs(rows[:30])) < 6.0 < np.nanmax(np.abs(rows))


def test_the_story_is_small() -> None:
    assert sum(file.stat().st_size for file in STORY.rglob("*") if file.is_file()) < 2_000_000
