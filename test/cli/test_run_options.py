# SPDX-License-Identifier: Apache-2.0
"""How a run is run: an option of the command comes before the group `run`, which counts where there is none."""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path

import pytest
import yaml

from mech_twin.cli.live_view import hold_view
from mech_twin.cli.run import run_options
from mech_twin.cli.verbs import RunVerb
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.parameters.load import configuration_file

DRUM = "winding_drum"
BAD = ["run.pace=slow", "run.duration_s=-1", "run.duration_s=.inf", "run.stream_decimation=5"]


def options(
    *settings: str, pace: str | None = None, duration_s: float | None = None, config: Path | None = None
) -> RunOptions:
    request = RunVerb(machine=DRUM, pace=pace, duration_s=duration_s, config=config, settings=list(settings))
    return run_options(request, recorder=False, viewer=True)


def test_without_a_word_a_run_follows_the_wall_clock_until_it_is_stopped() -> None:
    assert (options().pace, options().duration_s) == ("realtime", 0.0)


def test_a_setting_counts() -> None:
    made = options("run.pace=max", "run.duration_s=2.5", "run.stream_rate_hz=50")
    assert (made.pace, made.duration_s, made.stream_rate_hz) == ("max", 2.5, 50.0)


def test_an_option_of_the_command_comes_first() -> None:
    made = options("run.pace=max", "run.duration_s=2.5", pace="realtime", duration_s=0.0)
    assert (made.pace, made.duration_s) == ("realtime", 0.0)


def test_a_file_counts_and_a_setting_comes_before_it(tmp_path: Path) -> None:
    tree = yaml.safe_load(configuration_file(DRUM).read_text(encoding="utf-8"))
    tree["/**"]["ros__parameters"]["run"] = {"pace": "max", "duration_s": 3.0}
    file = tmp_path / "drum.yaml"
    file.write_text(yaml.safe_dump(tree), encoding="utf-8")
    assert (options(config=file).pace, options(config=file).duration_s) == ("max", 3.0)
    assert options("run.pace=realtime", config=file).pace == "realtime"


@pytest.mark.parametrize("pace", [None, "max"])
@pytest.mark.parametrize("bad", BAD)
def test_a_bad_setting_is_refused_by_name_even_where_an_option_replaces_it(bad: str, pace: str | None) -> None:
    with pytest.raises(ConfigurationError, match=bad.partition("=")[0].removeprefix("run.")):
        options(bad, pace=pace, duration_s=1.0)


def test_recorder_and_viewer_are_what_the_command_starts() -> None:
    made = options("run.recorder=true", "run.viewer=false")
    assert (made.recorder, made.viewer) == (False, True)


def test_a_view_is_held_until_a_signal(capsys: pytest.CaptureFixture[str]) -> None:
    later = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
    later.start()
    hold_view("http://127.0.0.1:1/page")
    later.join()
    assert "until Ctrl-C: http://127.0.0.1:1/page" in capsys.readouterr().err
