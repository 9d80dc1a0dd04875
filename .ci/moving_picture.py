# SPDX-License-Identifier: Apache-2.0
"""Draws a machine over one slowed cycle: for the README with pin reactions, for the gallery small and bare.

Usage: moving_picture.py MACHINE|PAGE FILE.gif [small]
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import frame_events
from mech_twin.files.output_file import written_file
from mech_twin.parameters.load import machine as built_machine
from mech_twin.roles import Machine
from mech_twin.samples import Event, Frame, Shape
from mech_twin.view.annotations import Annotations, lost_energy
from mech_twin.view.extent import ASPECT, MARGIN, Bounds, written_beside

RUN_S = 3.0  # by then the motion repeats itself
PICTURES, PICTURES_SMALL = 60, 30
SHOWN_S = 0.05  # of the reader's time, for each
FLASH_S = 0.02  # of the machine's time, after a blow; the live view, which is faster, shows it longer
SIZE_IN, DPI, COLOURS = (9.0, 4.6), 90, 48
SIZE_SMALL_IN, COLOURS_SMALL = (4.8, 3.0), 24
FORCES = ("#d55e00", "#0072b2", "#009e73", "#cc79a7")
PAPER = (244, 244, 240)
STYLES = ("-", (0, (4.0, 3.0)))  # reactions of a light link are nearly the same at both ends
LATE_BLOWS = 12
BLOWS = ("blow", "impact", "bottom")


def cycle(run: Sequence[Frame]) -> tuple[int, int]:
    """Return first and last index of a late whole cycle: the longest from blow to blow, else a turn of the crank."""
    struck = [i for i, frame in enumerate(run) if any(event.kind in BLOWS for event in frame_events(frame))]
    if len(struck) > 1:
        return max(pairwise(struck[-LATE_BLOWS:]), key=lambda ends: ends[1] - ends[0])  # not one of a chatter
    angles = np.array([frame.linkage.position[0] for frame in run])
    return int(np.argmin(np.abs(angles - angles[-1] + np.copysign(2.0 * np.pi, angles[-1])))), len(run) - 1


def extent(drawings: Sequence[Sequence[Shape]], below: float) -> Bounds:
    """Return the range that all drawings cover, with a share of its height free below, for values."""
    points = np.array([point for shapes in drawings for shape in shapes for point in shape.points_m])
    (left, low), (right, high) = points.min(axis=0), points.max(axis=0)
    margin = MARGIN * max(right - left, high - low)
    low -= below * (high - low)
    width = max(right - left + 2.0 * margin, ASPECT * (high - low + 2.0 * margin))
    middle = 0.5 * (left + right)
    return Bounds(middle - 0.5 * width, middle + 0.5 * width, low - margin, high + margin)


def draw(axes: Axes, shapes: Sequence[Shape], width_m: float) -> None:
    """Draw shapes as the live view does: widths are lengths, texts stand beside what they name."""
    points_per_m = 72.0 * 0.6 * SIZE_IN[0] / width_m
    for shape in shapes:
        colour = tuple(part / 255.0 for part in shape.colour)
        x, y = np.array(shape.points_m).T
        width = max(0.8, shape.width_m * points_per_m)
        if shape.kind == "line":
            axes.plot(x, y, color=colour, linewidth=width, solid_capstyle="round", solid_joinstyle="round")
        elif shape.kind == "points":
            axes.plot(x, y, "o", color=colour, markersize=max(3.0, width))
        elif shape.kind == "arrow":
            style = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.8, "shrinkA": 0.0, "shrinkB": 0.0}
            axes.annotate("", (x[1], y[1]), (x[0], y[0]), arrowprops=style, zorder=6)
        if shape.text:
            beside = written_beside(shape, width_m) if shape.kind in ("line", "arrow") else shape
            (x0, y0), *_ = beside.points_m
            left = "\n" in shape.text
            axes.annotate(
                shape.text,
                (x0, y0),
                (-60.0, 14.0) if left else (0.0, 0.0 if beside is not shape else -3.0),
                textcoords="offset points",
                color=colour,
                fontsize=8,
                ha="left" if left else "center",
                va="top",
                zorder=7,
            )


def prepared(machine: Machine) -> tuple[list[Frame], list[Event], Annotations]:
    """Return a run, its events, and what knows the greatest force of its last cycle."""
    assert machine.mechanism is not None
    run = list(frames(machine, RUN_S))
    first, last = cycle(run)
    notes = Annotations(machine.mechanism, machine.blow_energy or lost_energy)
    for frame in run[first : last + 1]:
        notes.add(frame.linkage, frame.forces)
    return run[first : last + 1], [event for frame in run[first : last + 1] for event in frame_events(frame)], notes


def pictures(machine: Machine) -> list[Image.Image]:
    """Return the pictures of one cycle."""
    assert machine.draw is not None
    run, events, notes = prepared(machine)
    chosen = [run[round(i * (len(run) - 1) / PICTURES)] for i in range(PICTURES)]
    drawings = [machine.draw(frame.linkage, frame.body) for frame in chosen]
    bounds = extent(drawings, below=0.42)
    made = []
    struck = 0
    for frame, shapes in zip(chosen, drawings, strict=True):
        while struck < len(events) and events[struck].time_s <= frame.linkage.time_s:
            notes.strike(events[struck])
            struck += 1
        over = notes.shapes(frame.linkage.time_s, bounds)
        if frame.linkage.time_s - run[0].linkage.time_s > FLASH_S:
            over = tuple(shape for shape in over if not shape.name.startswith("blow"))
        made.append(_picture(machine, run, frame, [*shapes, *over], bounds))
    return made


def small_pictures(machine: Machine) -> list[Image.Image]:
    """Return few and small pictures of one cycle, of the drawing alone."""
    assert machine.draw is not None
    run = list(frames(machine, RUN_S))
    first, last = cycle(run)
    chosen = [run[first + round(i * (last - first) / PICTURES_SMALL)] for i in range(PICTURES_SMALL)]
    drawings = [[s for s in machine.draw(f.linkage, f.body) if s.kind != "text"] for f in chosen]
    bounds = extent(drawings, below=0.0)
    return [_small_picture(shapes, bounds) for shapes in drawings]


def _small_picture(shapes: Sequence[Shape], bounds: Bounds) -> Image.Image:
    figure = Figure(figsize=SIZE_SMALL_IN, dpi=DPI, layout="constrained")
    figure.set_facecolor(tuple(part / 255.0 for part in PAPER))
    canvas: Any = FigureCanvasAgg(figure)
    axes = figure.subplots()
    _frame(axes, bounds)
    draw(axes, [shape._replace(text="") for shape in shapes], bounds.right_m - bounds.left_m)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


def _frame(axes: Axes, bounds: Bounds) -> None:
    axes.set_xlim(bounds.left_m, bounds.right_m)
    axes.set_ylim(bounds.low_m, bounds.high_m)
    axes.set_aspect("equal")
    axes.axis("off")


def _picture(
    machine: Machine, run: Sequence[Frame], now: Frame, shapes: Sequence[Shape], bounds: Bounds
) -> Image.Image:
    figure = Figure(figsize=SIZE_IN, dpi=DPI, layout="constrained")
    figure.set_facecolor(tuple(part / 255.0 for part in PAPER))
    canvas: Any = FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, width_ratios=(1.7, 1.0))
    _frame(left, bounds)
    draw(left, shapes, bounds.right_m - bounds.left_m)
    start = run[0].linkage.time_s
    time_ms = [1000.0 * (frame.linkage.time_s - start) for frame in run]
    right.set_facecolor("none")
    for i, (pin, colour) in enumerate(zip(machine.forces.pins, FORCES, strict=False)):
        sizes = [np.hypot(*frame.forces.wrenches[i][:2]) / 1000.0 for frame in run]
        right.plot(time_ms, sizes, color=colour, linestyle=STYLES[i % 2], linewidth=1.6, label=pin.replace("_", " "))
    right.axvline(1000.0 * (now.linkage.time_s - start), color="#2b2b2b", linewidth=1.0)
    right.set_xlabel("time since the blow, ms")
    right.set_ylabel("pin reaction, kN")
    right.spines[["top", "right"]].set_visible(False)
    right.legend(frameon=False, fontsize=8, loc="upper right")
    right.margins(x=0.0)
    canvas.draw()
    return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")


def write(made: Sequence[Image.Image], file: Path, colours: int = COLOURS) -> None:
    """Write the pictures as one that moves, in the colours of the first few."""
    strip = np.concatenate([np.asarray(picture) for picture in made[:: max(1, len(made) // 6)]])
    palette = Image.fromarray(strip).quantize(colours, dither=Image.Dither.NONE)
    drawn = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in made]
    changes = sum(np.any(np.asarray(one) != np.asarray(other)) for one, other in pairwise(drawn))
    if changes < len(drawn) // 2:
        raise SystemExit(f"{file}: the machine hardly moves in its last cycle")
    with written_file(file, force=True) as unfinished:
        options = {"save_all": True, "append_images": drawn[1:], "loop": 0, "optimize": True, "disposal": 1}
        drawn[0].save(unfinished, format="GIF", duration=round(1000.0 * SHOWN_S), **options)


def main() -> None:
    """Draw and write."""
    machine, file = built_machine(sys.argv[1]), Path(sys.argv[2])
    with mpl.rc_context({"font.size": 9, "font.family": "DejaVu Sans"}):
        if "small" in sys.argv[3:]:
            write(small_pictures(machine), file, COLOURS_SMALL)
        else:
            write(pictures(machine), file)


if __name__ == "__main__":
    main()
