# SPDX-License-Identifier: Apache-2.0
"""Draw the figure of docs/how-a-run-is-computed.md: python .ci/run_figure.py."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mech_twin.capabilities.plots import BLUE, GREY, INK, RED, Picture, house_style, sheet, written
from mech_twin.studies.named_rollouts import NamedRollOut, rollout

IMAGES = Path(__file__).parents[1] / "docs" / "images"
FROM_S, TO_S = 1.115, 1.195  # a blow of the breaker, and its body back on the collar
FINE_STEP_S = 5e-5


def within(run: NamedRollOut, column: str) -> tuple[np.ndarray, np.ndarray]:
    """Return time (ms from the start of the window) and a column within the window."""
    time_s = run["time_s"]
    shown = (time_s >= FROM_S) & (time_s <= TO_S)
    return 1e3 * (time_s[shown] - FROM_S), run[column][shown]


def picture() -> Picture:
    """Return speed of the crank and angle of the body around a blow: between samples, at samples, and events."""
    run = rollout("mb10_breaker", TO_S)
    fine = rollout("mb10_breaker", TO_S, {"coupling.step_s": FINE_STEP_S})
    figure, axes = sheet(2, 1, height=4.6, sharex=True)
    for panel, column, factor in ((axes[0], "crank.velocity", 1.0), (axes[1], "body.position", 1e3)):
        for line, style in (
            (fine, {"color": GREY, "linewidth": 1.0}),
            (run, {"color": BLUE, "marker": ".", "ls": "none"}),
        ):
            time_ms, values = within(line, f"linkage.{column}")
            panel.plot(time_ms, factor * values, label="sample, each 1 ms" if line is run else "motion", **style)
    for event in run.events:
        if FROM_S <= event.time_s <= TO_S:
            at_ms, blow = 1e3 * (event.time_s - FROM_S), event.kind == "blow"
            for panel in axes:
                panel.axvline(
                    at_ms, color=RED if blow else INK, linewidth=1.0 if blow else 0.5, alpha=1.0 if blow else 0.4
                )
    axes[0].set_ylabel("crank, rad/s")
    axes[1].set_ylabel("body from its collar, mrad")
    axes[1].set_xlabel("time, ms")
    axes[1].legend(loc="upper right", framealpha=1.0, frameon=True, edgecolor="none")
    return Picture("how_a_run_is_computed", "", figure)


if __name__ == "__main__":
    with house_style():
        vector, _ = written(picture(), IMAGES)
        vector.unlink()
