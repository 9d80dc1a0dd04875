# SPDX-License-Identifier: Apache-2.0
"""What a blow led as a wave costs.  ``python benchmarks/wave_blow.py [--write]`` measures it beside the rigid blow.

Each machine is rolled out with the blow as a wave and with the rigid blow, in turn.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path

from comparison import Table, in_turn, measure, ratio

from mech_twin.engine.rollout import roll_out
from mech_twin.parameters.load import machine
from mech_twin.roles import Machine

PAGES = Path(__file__).resolve().parents[1] / "config" / "pages"
SIMULATED_S, ROUNDS, LIMIT = 4.0, 7, 2.0
WAVE: Mapping[str, object] = {"tool.model": "wave"}
LOADING = WAVE | {"tool.wave.wall.kind": "loading"}
PRESSED: Mapping[str, object] = {"body.preload_deflection_m": 0.2}
SOFT = LOADING | PRESSED | {"tool.wave.wall.stiffness_n_per_m": 5e6}
Source = tuple[str, Mapping[str, object]]
BREAKER: Source = ("mb10_breaker", {})
PAIRS: Mapping[str, tuple[Source, Source]] = {
    "breaker, yielding wall": (("mb10_breaker", WAVE), BREAKER),
    "breaker, Hertz face": (("mb10_breaker", WAVE | {"tool.wave.face.kind": "hertz"}), BREAKER),
    "breaker, 64 cells": (("mb10_breaker", WAVE | {"tool.wave.cells": 64}), BREAKER),
    "breaker, wall of 5e7 N/m": (("mb10_breaker", LOADING), BREAKER),
    "breaker pressed by 0.2 m, wall of 5e6 N/m": (("mb10_breaker", SOFT), ("mb10_breaker", PRESSED)),
    "impact mass": (("impact_mass", {"stop.model": "wave"}), ("impact_mass", {})),
    "page `rock_hammer`, rigid `electropneumatic_hammer`": (
        (str(PAGES / "rock_hammer.yaml"), {}),
        (str(PAGES / "electropneumatic_hammer.yaml"), {}),
    ),
}


def struck(built: Machine) -> int:
    """Return how many blows a roll-out has on what may be a rod."""
    events = roll_out(built, SIMULATED_S, columns=["time_s"]).events
    return sum(
        event.kind in {"blow", "impact"} and event.contact != "body" and event.impulse_ns > 0.0 for event in events
    )


def row(name: str, sources: tuple[Source, Source]) -> tuple[object, ...]:
    """Return the measurements of a machine."""
    wave, rigid = (machine(source, None, dict(overrides)) for source, overrides in sources)
    tasks = {
        label: partial(roll_out, built, SIMULATED_S, columns=["time_s"])
        for label, built in (("wave", wave), ("rigid", rigid))
    }
    times = in_turn(tasks, ROUNDS)
    found = ratio(times, "wave", "rigid")
    if found.median > LIMIT:
        sys.exit(f"{name}: {found} times the rigid run; at most {LIMIT:g}")
    spent = [f"{1e3 * min(times[label]):.1f}" for label in ("wave", "rigid")]
    return name, *spent, struck(wave), struck(rigid), found


def measured() -> list[Table]:
    """Return the table."""
    how = f"One core, processor time, {SIMULATED_S:g} s from the start, best of {ROUNDS} rounds in turn."
    columns = ("machine", "wave, ms", "rigid, ms", "blows by wave", "rigid blows", "ratio (spread)")
    return [Table(how, columns, [row(name, sources) for name, sources in PAIRS.items()])]


if __name__ == "__main__":
    measure("wave_blow", measured)
