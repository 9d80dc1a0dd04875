# SPDX-License-Identifier: Apache-2.0
"""A person runs the breaker and looks: the web view of the run, in a real browser, shows it and moves."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from browser import Page, changed_share, colours, region

pytestmark = [pytest.mark.browser, pytest.mark.slow, pytest.mark.usefixtures("ros_domain")]

MECHANISM = (0.0, 0.06, 0.55, 0.68)
CURVES = (0.57, 0.06, 1.0, 0.68)


def test_the_web_view_of_a_run_is_not_empty_and_changes(tmp_path: Path) -> None:
    command = [sys.executable, "-c", "from mech_twin.cli.main import main; main()"]
    words = [*command, "run", "--no-record"]
    run = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    assert run.stderr is not None
    try:
        url = next(line.split("view: ", 1)[1].strip() for line in run.stderr if line.startswith("view: "))
        assert url.startswith("http://127.0.0.1:")
        with Page(url, width=1400, height=900) as page:
            before = page.picture_when(lambda seen: colours(region(seen, *MECHANISM)) >= 4, limit_s=180.0)
            page.wait(3.0)
            after = page.picture_when(lambda seen: changed_share(before, seen) > 0.01, limit_s=90.0)
    finally:
        run.terminate()
        code = run.wait(20)
        run.stderr.close()
    assert code == 0
    assert colours(region(after, *MECHANISM)) >= 4
    assert changed_share(region(before, *MECHANISM), region(after, *MECHANISM)) > 0.002
    assert changed_share(region(before, *CURVES), region(after, *CURVES)) > 0.005
