# SPDX-License-Identifier: Apache-2.0
"""The contents of a bench's page as a recording for rerun's viewer: drawing, curves, regimes, events, headline."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import rerun as rr
import rerun.blueprint as rrb

from mech_twin.samples import Shape
from mech_twin.view.curves import FIRST_COLOUR, send_rows, series_lines, times
from mech_twin.view.extent import Bounds
from mech_twin.view.layout import BANNER, EVENTS, banner_view, events_view, mechanism_view, page, plot
from mech_twin.view.mechanism import KINDS, Mechanism
from mech_twin.view.stream import set_time

REGIMES = "regimes"
WINDOW_S = 1.0  # shown in the plots
ROOM = 0.1  # share of the height added below the drawing
OWN_PLOTS = 3  # plots with a panel of their own; further ones share tabs
KIND_OF_LETTER = {kind[0]: kind for kind in KINDS}
Values = npt.NDArray[np.float64]


class RerunPictures:
    """The rerun recording of a run, extended with each picture.

    Parameters
    ----------
    name : str
        Name of the run.
    panels : sequence of mapping
        The plots, as sent to the page.
    """

    def __init__(self, name: str, panels: Sequence[Mapping[str, Any]]) -> None:
        self._stream = rr.RecordingStream(name)
        self._bytes = rr.binary_stream(self._stream)
        self._stream.set_log_time_enabled(False)
        self._stream.set_log_tick_enabled(False)
        self._mechanism = Mechanism(self._stream)
        self._lanes: set[str] = set()
        self._bounds: Bounds | None = None
        self._panels = panels
        self._names = {curve["path"]: curve["names"] for panel in panels for curve in panel["curves"]}
        for path, names in self._names.items():
            self._stream.log(path, series_lines(names, FIRST_COLOUR.get(path, 0)), static=True)

    def taken(self, pictures: Sequence[Mapping[str, Any]]) -> bytes:
        """Add pictures in the order of arrival; return the next bytes for the viewer."""
        curves: dict[str, list[list[str]]] = {}
        for picture in pictures:
            for path, packed in picture["curves"].items():
                curves.setdefault(path, []).append(packed)
            self._show(picture)
        for path, parts in curves.items():
            self._send(path, parts)
        return self._bytes.read() or b""

    def _show(self, picture: Mapping[str, Any]) -> None:
        set_time(self._stream, picture["time_s"])
        words = [f"**{picture['state']}**", f"t = {picture['time_s']:.2f} s"]
        words += [f"{card[0]} {card[1]}" for card in picture["cards"]]
        words += [f"**ALARM: {picture['alarm']}**"] if picture["alarm"] else []
        self._stream.log(BANNER, rr.TextDocument("  ·  ".join(words), media_type=rr.MediaType.MARKDOWN))
        if picture.get("shapes"):
            self._mechanism.place(unpacked_shapes(picture["shapes"]))
        if picture["events"]:
            time_s, text = zip(*picture["events"], strict=True)
            self._stream.send_columns(EVENTS, times(time_s), rr.TextLog.columns(text=list(text)))
        lanes = {name for name, *_ in picture["lanes"]}
        for name, begin_s, word, changes in picture["lanes"]:
            since = [] if name in self._lanes else [(begin_s, word)]
            time_s, states = zip(*(since + changes), strict=True) if since + changes else ((), ())
            if states:
                path = f"{REGIMES}/{name.replace(' ', '_')}"
                self._stream.send_columns(path, times(time_s), rr.StateChange.columns(state=list(states)))
        bounds = None if picture.get("bounds") is None else Bounds(*picture["bounds"])
        if bounds != self._bounds or not lanes <= self._lanes:
            self._bounds, self._lanes = bounds, self._lanes | lanes
            self._stream.send_blueprint(self._layout())

    def _send(self, path: str, parts: Sequence[Sequence[str]]) -> None:
        if path not in self._names:
            return
        time_s = np.concatenate([_unpacked(part[0], "<f8") for part in parts])
        values = np.concatenate([_unpacked(part[1], "<f4") for part in parts])
        send_rows(self._stream, path, values.reshape(len(time_s), len(self._names[path])), time_s)

    def _layout(self) -> rrb.Blueprint:
        plots = [
            plot(
                panel["title"],
                [curve["path"] for curve in panel["curves"]],
                WINDOW_S,
                [name for curve in panel["curves"] for name in curve["names"]],
            )
            for panel in self._panels
        ]
        rest = plots[OWN_PLOTS:]
        beside: list[rrb.View | rrb.Container] = [
            *plots[:OWN_PLOTS],
            *([rrb.Tabs(*rest, active_tab=0)] if rest else []),
        ]
        regimes = rrb.StateTimelineView(origin="/", contents=[f"/{REGIMES}/**"], name="Regimes")
        below = rrb.Tabs(*([regimes] if self._lanes else []), events_view(has_level=False), active_tab=0)
        bounds = self._bounds
        if bounds is not None:  # in a small panel the texts at the edge need more room
            bounds = bounds._replace(low_m=bounds.low_m - ROOM * (bounds.high_m - bounds.low_m))
        left = rrb.Vertical(mechanism_view(bounds), below, row_shares=[3, 1])
        middle = rrb.Horizontal(left, *([rrb.Vertical(*beside)] if beside else []))
        return page(rrb.Vertical(banner_view(), middle, row_shares=[5, 95]))


def unpacked_shapes(packed: Mapping[str, Any]) -> list[Shape]:
    """Return the shapes of a picture from its packed arrays."""
    points = _unpacked(packed["points"], "<f4").reshape(-1, 2)
    ends = np.cumsum(packed["counts"])
    fields = zip(
        packed["kinds"], packed["colours"], packed["widths"], packed["texts"], packed["counts"], ends, strict=True
    )
    return [
        Shape(
            "",
            KIND_OF_LETTER[letter],
            tuple(map(tuple, points[end - count : end].tolist())),
            tuple(colour),
            width,
            text,
        )
        for letter, colour, width, text, count, end in fields
    ]


def _unpacked(text: str, kind: str) -> Values:
    return np.frombuffer(base64.b64decode(text), dtype=kind).astype(np.float64)
