# SPDX-License-Identifier: Apache-2.0
"""The option ``--view`` of what runs live: a page in the browser, a file, or nothing."""

from __future__ import annotations

import time
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from mech_twin.cli.console import say
from mech_twin.cli.failure import CommandError
from mech_twin.dependencies import require_extra
from mech_twin.output_file import check_output_file
from mech_twin.stop_signal import StopSignal

WEB_VIEWS = ("web", "light", "full")
NO_VIEW = "none"
LIVE_HISTORY = "4MiB"  # a page opened later has to take all of it in before it shows the present
LOOK_S = 0.1


class OpenedView(NamedTuple):
    """Where the view is sent - a viewer started here, a file, or nowhere - and the address of its page."""

    destination: str | None
    page: str = ""


def check_view(view: str, port: int, *, force: bool) -> None:
    """Check the option before anything begins.

    Raises
    ------
    CommandError
        It is no view, has no page for the port, or its file exists and may not be overwritten.
    """
    if view not in (*WEB_VIEWS, NO_VIEW) and not view.endswith(".rrd"):
        raise CommandError(f"--view {view}: expected web, light, full, none or a file NAME.rrd")
    if port and view not in WEB_VIEWS:
        raise CommandError(
            f"--view-port {port}: expected --view {', '.join(WEB_VIEWS[:-1])} or {WEB_VIEWS[-1]} beside it"
        )
    if view.endswith(".rrd"):
        check_output_file(Path(view), force=force)


def opened_view(view: str, port: int, stack: ExitStack, *, open_to_other_hosts: bool = False) -> OpenedView:
    """Return where the view goes, its viewer started and left to the stack."""
    if view == NO_VIEW:
        return OpenedView(None)
    require_extra("view")
    if view not in WEB_VIEWS:
        return OpenedView(view)
    from mech_twin.view.viewer_process import ViewerProcess

    viewer = stack.enter_context(
        ViewerProcess(
            port or None,
            open_to_other_hosts=open_to_other_hosts,
            memory_limit=LIVE_HISTORY,
            newest_first=True,
            announce=say,
        )
    )
    say(f"view: {viewer.web_url}")
    return OpenedView(f"{viewer.grpc_url}#{view}@{viewer.reports_directory}", viewer.web_url)


def hold_view(page: str) -> None:
    """Keep the view open until a signal."""
    say(f"the view stays open until Ctrl-C: {page}")
    with StopSignal() as stop:
        while not stop.asked:
            time.sleep(LOOK_S)
