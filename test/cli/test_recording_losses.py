# SPDX-License-Identifier: Apache-2.0
"""A command whose recording lost messages says so, and ends with an exit code of its own."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest
from bag_cases import string_cdr, written
from small_disk import small_disk

from mech_twin.cli.console import LOSS_EXIT_CODE, report_losses
from mech_twin.cli.recording import show_info
from mech_twin.cli.run import ended_early
from mech_twin.cli.verbs import InfoVerb
from mech_twin.engine.run import frames
from mech_twin.parameters.load import machine as built_machine
from mech_twin.recording.bag_writer import BagWriter
from mech_twin.studies.simulation import RunMetrics


def test_a_recording_on_a_full_disk_is_not_called_complete(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    random = Random(1)  # what does not compress
    with small_disk(tmp_path / "disk", monkeypatch) as disk:
        with BagWriter(disk / "bag", configuration="", chunk_bytes=20_000) as writer:
            writer.add_topic("/n", "std_msgs/msg/String")
            for number in range(1000):
                writer.write("/n", string_cdr(random.randbytes(2000).hex()), number, number)
        with pytest.raises(SystemExit) as ended:
            report_losses(None, tmp_path / "none", disk / "bag")  # of a shadow's black boxes each is asked
        show_info(InfoVerb(bag=disk / "bag"))
    written = capsys.readouterr()
    assert ended.value.code == LOSS_EXIT_CODE
    assert f"{writer.dropped} messages lost" in written.err
    assert f"closed, but not complete; {writer.dropped} dropped" in written.out


def test_a_part_that_is_missing_is_the_reason_that_info_gives(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = tmp_path / "bag"
    with BagWriter(bag, configuration="", split_duration_s=0.1) as writer:
        writer.add_topic("/n", "std_msgs/msg/String")
        for number in range(300):
            writer.write("/n", string_cdr(str(number)), 1_000_000 * number, 1_000_000 * number)
    (bag / "bag_2.mcap").unlink()
    show_info(InfoVerb(bag=bag))
    assert "not complete: a part is missing" in capsys.readouterr().out


def test_a_run_that_recorded_nothing_lost_nothing(tmp_path: Path) -> None:
    report_losses(None)
    report_losses(tmp_path / "none")


@pytest.mark.parametrize(("run_steps", "said"), [(100, False), (102, False), (103, True)])
def test_a_recording_that_ends_before_its_run_is_said_in_both_times(run_steps: int, said: bool, tmp_path: Path) -> None:
    bag = written(tmp_path / "bag", 100)
    machine = built_machine("compaction_press")
    metrics = RunMetrics(lambda: machine)
    *_, metrics.last = frames(machine, (run_steps - 1) * machine.coupling_step_s)
    expected = f"{bag}: ends at 0.099 s, the run at {(run_steps - 1) * 1e-3:g} s: the recorder did not keep up"
    assert ended_early(bag, metrics) == [expected] * said
    assert ended_early(None, metrics) == ended_early(tmp_path / "none", metrics) == []
