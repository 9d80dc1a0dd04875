# SPDX-License-Identifier: Apache-2.0
"""The topics on the wire and those of docs/topics.md are one list, for every machine."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from bench_run import BenchRun
from catalogue import NAMES, built

from mech_twin.nodes.roles.frames_node import FramesNode

PAGE = Path(__file__).resolve().parents[2] / "docs" / "topics.md"
BODY_ONLY = "with a moving body only"
GAUGE_ONLY = ("with a strain gauge only", "with `gauge_curve` only")
OF_ROS = {"rosout", "parameter_events", "tf"}  # /tf where tf2_msgs is installed


def documented(name: str) -> dict[str, str]:
    """Return name and type of every topic the page promises of a machine."""
    machine = built(name)
    section = PAGE.read_text(encoding="utf-8").split("\n## Topics\n")[1].split("\n## ")[0]
    found = {}
    for line in section.splitlines()[3:]:
        if not line.startswith("| `"):
            continue
        names, kinds, _, meaning = (cell.strip() for cell in line.strip("|").split(" | ", 3))
        if BODY_ONLY in meaning and machine.body is None:
            continue
        if machine.gauge is None and meaning.startswith(GAUGE_ONLY):
            continue
        types = [kind.split(",")[0].replace("/", "/msg/") for kind in kinds.split(", ") if "/" in kind]
        for topic in re.findall(r"`([^`]+)`", names):
            said = types[0] if len(types) == 1 else types[0] if topic in ("rejoin", "rejoin/description") else types[1]
            found |= {topic.replace("<pin>", pin): said for pin in (machine.forces.pins if "<pin>" in topic else [""])}
    return found


@pytest.mark.parametrize("name", NAMES)
def test_every_documented_topic_is_advertised_and_no_other(name: str, ros_domain: int) -> None:
    promised = documented(name)
    assert len(promised) > 15
    with BenchRun(name) as run:
        run.revive(FramesNode)
        run.steps(5)

        def on_the_graph() -> dict[str, str]:
            topics = dict(run.client.get_topic_names_and_types())
            short = {topic.removeprefix(f"/{name}/"): types for topic, types in topics.items()}
            return {t: types[0] for t, types in short.items() if t.strip("/") not in OF_ROS and len(types) == 1}

        run.until(lambda: on_the_graph().keys() >= promised.keys())
        assert on_the_graph() == promised
        received = {
            info.node_name for info in run.client.get_subscriptions_info_by_topic(f"/{name}/motor/speed_command")
        }
        assert received == {"motor"}
        for topic in promised.keys() - {f"motor/{kind}_command" for kind in ("speed", "effort", "position")}:
            full = topic if topic.startswith("/") else f"/{name}/{topic}"
            assert run.client.count_publishers(full) > 0, topic
