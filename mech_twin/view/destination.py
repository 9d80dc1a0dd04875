# SPDX-License-Identifier: Apache-2.0
"""Where a scene is sent, from the one word that the nodes are given."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from mech_twin.view.flow import Flow
from mech_twin.view.sending import AT_ONCE, LIVE, Sending
from mech_twin.view.viewer_process import graphics_file

LIGHT, FULL = "light", "full"


class Destination(NamedTuple):
    """A running viewer or a file, and how much of a scene goes there."""

    grpc_url: str | None
    rrd_path: str | None
    sending: Sending
    light: Callable[[], bool] | None = None
    flow: Flow | None = None


def destination(place: str) -> Destination:
    """Return where a scene goes: a file (``NAME.rrd``), or a running viewer.

    A viewer's address may end in ``#LAYOUT@FOLDER``: the layout is ``light``, ``full`` or ``web``, which is the full
    one on a graphics card and else the light one; in the folder the viewer notes what its pages say.
    """
    if place.endswith(".rrd"):
        return Destination(None, place, AT_ONCE)
    address, _, rest = place.partition("#")
    layout, _, folder = rest.partition("@")
    reports = Path(folder) if folder else None
    return Destination(address, None, LIVE, _light(layout, reports), Flow(reports))


def _light(layout: str, reports: Path | None) -> Callable[[], bool]:
    if layout in (LIGHT, FULL) or reports is None:
        return lambda: layout == LIGHT
    wanted = graphics_file(reports)
    return lambda: not wanted.exists()
