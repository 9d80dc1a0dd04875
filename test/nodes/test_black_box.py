# SPDX-License-Identifier: Apache-2.0
"""A black box keeps every fault's bag apart from those of earlier runs, and never ends the shadow it belongs to."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from mech_twin.cli.console import LOSS_EXIT_CODE, report_losses
from mech_twin.messages.topics import DIAGNOSTICS
from mech_twin.nodes.shadow.session import BlackBox, ShadowTopics
from mech_twin.recording.bag_contents import RecentMessage
from mech_twin.recording.bag_reader import BagReader

NAME, FAULT = "winding_drum", "belt: slack"


@pytest.fixture
def box(ros: None, tmp_path: Path) -> Iterator[BlackBox]:
    node = BlackBox(NAME, tmp_path, ShadowTopics((), ()))
    yield node
    node.close()
    node.destroy_node()


def test_a_fault_at_the_moment_of_one_of_an_earlier_run_gets_a_bag_of_its_own(box: BlackBox, tmp_path: Path) -> None:
    box.trigger(FAULT, 12.0)
    box.close()
    before = {path: path.read_bytes() for path in box.bags[0].iterdir()}
    box.trigger(FAULT, 12.0)
    box.close()
    assert [bag.name for bag in box.bags] == ["belt_slack-12000", "belt_slack-12000-2"]
    assert {path: path.read_bytes() for path in box.bags[0].iterdir()} == before
    with BagReader(box.bags[1]) as reader:
        assert reader.info.finished


def test_a_link_of_that_name_is_not_followed(box: BlackBox, tmp_path: Path) -> None:
    (tmp_path / "belt_slack-12000").symlink_to(tmp_path / "elsewhere")
    box.trigger(FAULT, 12.0)
    assert box.bags == [tmp_path / "belt_slack-12000-2"]
    assert not (tmp_path / "elsewhere").exists()


SECOND_NS = 10**9


def test_what_is_kept_and_written_is_of_the_machines_present_time_also_when_it_is_started_anew(box: BlackBox) -> None:
    def heard(seconds: range) -> None:
        for second in seconds:
            box.take(RecentMessage(DIAGNOSTICS.name, b"", second * SECOND_NS))

    heard(range(1000, 1030))
    assert [message.at_ns // SECOND_NS for message in box._recent.kept] == list(range(1019, 1030))
    heard(range(3))
    assert [message.at_ns // SECOND_NS for message in box._recent.kept] == [0, 1, 2]
    box.trigger(FAULT, 2.0)
    heard(range(3, 6))
    heard(range(500, 502))  # another time: the bag of the fault is over
    assert box.diagnostics.state.startswith("wrote ")
    with BagReader(box.bags[0]) as reader:
        assert [message.log_time_ns // SECOND_NS for message in reader.messages()] == list(range(6))


def test_a_bag_that_cannot_be_made_is_told_in_the_exit_code_and_nothing_ends(
    box: BlackBox, capsys: pytest.CaptureFixture[str]
) -> None:
    box._directory = Path("/proc/nowhere")
    box.trigger(FAULT, 12.0)
    assert box.bags == []
    with pytest.raises(SystemExit) as ended:
        report_losses(known=box.failed)
    assert ended.value.code == LOSS_EXIT_CODE
    assert "no black box: /proc/nowhere" in capsys.readouterr().err
