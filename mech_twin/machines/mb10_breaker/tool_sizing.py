# SPDX-License-Identifier: Apache-2.0
"""Tool and striker for most energy in the wall: one blow at rated speed, the body at rest, over a grid of sizes.

The tool is a uniform rod; its diameter gives its impedance, diameter and length its mass.  The striker's mass is the
effective mass of crank and flywheel.  The stress is the largest in the tool; the power is the striker's energy loss in
a blow, over the time of a turn.  Stress, power and energy are the worst over the tolerance of both stiffnesses.
"""

from collections.abc import Iterator, Mapping
from itertools import product
from math import inf, pi
from typing import NamedTuple

import numpy as np

from mech_twin.capabilities.progress import tell
from mech_twin.capabilities.sizing import Constraint, Sizing, binding_of
from mech_twin.capabilities.variation import varied
from mech_twin.errors import StudyError
from mech_twin.machines.mb10_breaker.dynamics import Breaker, striker
from mech_twin.machines.mb10_breaker.impacts import impact_direction
from mech_twin.machines.mb10_breaker.metrics import rated_crank_speed, striking_angle
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.state import breaker
from mech_twin.parts.rod_waves.parameters import WaveTool, wave_grid
from mech_twin.parts.rod_waves.struck_tool import rod_blow

OBJECTIVE = "transmitted_energy_j"  # made large
ASSUMED = ("tool.wave.face.stiffness_n_per_m", "tool.wave.wall.stiffness_n_per_m")
# the power is at most that of the motor
LIMITS: dict[str, float] = {"peak_stress_pa": 2.5e8, "blow_power_w": inf, "tool_mass_kg": inf}
DIAMETERS_M = np.geomspace(0.025, 0.1, 9)
LENGTHS_M = np.geomspace(0.15, 1.2, 7)
STRIKERS = np.geomspace(0.5, 2.0, 7)  # of the configured inertia of crank and flywheel
NO_ROWS, NO_FORCES = np.empty((0, 2)), np.empty((0, 1))


class SizedBlow(NamedTuple):
    """Sizes, and what a blow with them gives."""

    rod_diameter_m: float
    rod_length_m: float
    crank_inertia_kg_m2: float
    tool_mass_kg: float
    striker_mass_kg: float
    striker_energy_j: float
    transmitted_energy_j: float
    blow_efficiency: float
    peak_stress_pa: float
    peak_tension_pa: float
    blow_power_w: float
    striker_rebound_m_per_s: float

    def keeps(self, limits: Mapping[str, float]) -> bool:
        """Return whether it keeps these limits."""
        return all(getattr(self, name) <= limit for name, limit in limits.items())


def as_rod(tool: WaveTool, diameter_m: float, length_m: float) -> WaveTool:
    """Return a tool with a rod of one section of another size; the gauge stays on it."""
    rod = tool.rod.model_copy(update={"diameter_m": diameter_m, "length_m": length_m})
    tip = tool.tip.model_copy(update={"length_m": 0.0})
    return tool.model_copy(update={"rod": rod, "tip": tip, "gauge_m": min(tool.gauge_m, length_m)})


def corners(tool: WaveTool, tolerance: float) -> list[WaveTool]:
    """Return the tool with its assumed stiffnesses, of face and wall, off by the tolerance each way."""
    if tolerance == 0.0:
        return [tool]
    found = []
    for of_face, of_wall in product((1.0 - tolerance, 1.0 + tolerance), repeat=2):
        face = tool.face.model_copy(update={"stiffness_n_per_m": of_face * tool.face.stiffness_n_per_m})
        wall = tool.wall.model_copy(update={"stiffness_n_per_m": of_wall * tool.wall.stiffness_n_per_m})
        found.append(tool.model_copy(update={"face": face, "wall": wall}))
    return found


def sized_blow(parameters: BreakerParameters, b: Breaker, tool: WaveTool, tolerance: float) -> SizedBlow | None:
    """Return the blow at rated speed on a tool, the body at rest, the worst over the tolerance.

    None where it has no end within the window.
    """
    q, u = striking_angle(b), rated_crank_speed(parameters)
    mass, closing = impact_direction(b, q, 0.0, True, b.held).effective_kg, striker(b, q)[1] * u
    grids = [wave_grid(each, b.wall_force_n) for each in corners(tool, tolerance)]
    blows = [rod_blow(grid, mass, closing, 0.0, True, NO_ROWS, NO_FORCES) for grid in grids]
    if not all(blow.parted for blow in blows):
        return None
    left = min(closing - blow.impulse_ns / mass for blow in blows)  # the fastest rebound
    energy = min(blow.transmitted_energy_j for blow in blows)
    given = max(blow.impulse_ns * (closing - 0.5 * blow.impulse_ns / mass) for blow in blows)
    return SizedBlow(
        tool.rod.diameter_m,
        tool.rod.length_m,
        parameters.linkage.crank_inertia_kg_m2,
        grids[0].tool_mass_kg,
        mass,
        blows[0].striker_energy_j,
        energy,
        energy / blows[0].striker_energy_j,
        max(blow.peak_stress_pa for blow in blows),
        max(blow.peak_tension_pa for blow in blows),
        given * u / (2.0 * pi),
        -left,
    )


def sized_blows(parameters: BreakerParameters, tolerance: float) -> Iterator[SizedBlow]:
    """Yield the blows over the grid of sizes."""
    for done, factor in enumerate(STRIKERS.tolist()):
        inertia = factor * parameters.linkage.crank_inertia_kg_m2
        own = varied(parameters, {"linkage.crank_inertia_kg_m2": inertia})
        b = breaker(own)
        for diameter in DIAMETERS_M.tolist():
            for length in LENGTHS_M.tolist():
                found = sized_blow(own, b, as_rod(own.tool.wave, diameter, length), tolerance)
                if found is not None:
                    yield found
        tell(done + 1, len(STRIKERS))


def tool_sizing(parameters: BreakerParameters, limits: Mapping[str, float], tolerance: float) -> Sizing:
    """Return the tool and the flywheel that give the wall most energy within the limits.

    Raises
    ------
    StudyError
        The wall yields, or is rigid or free: its energy is not that of the blow; no size keeps the limits.
    """
    wave = parameters.tool.wave
    if wave.wall.kind != "loading":
        raise StudyError(
            f"objective {OBJECTIVE}: tool.wave.wall.kind is {wave.wall.kind}; expected loading, a wall that takes its "
            "energy within the blow"
        )
    base = varied(parameters, {"tool.model": "wave"})
    asked = {**limits, "blow_power_w": min(limits["blow_power_w"], base.motor.rated_power_w)}
    blows = list(sized_blows(base, tolerance))
    good = [blow for blow in blows if blow.keeps(asked)]
    if not good:
        best = {name: min(getattr(blow, name) for blow in blows) for name in asked if asked[name] < inf}
        text = "; ".join(f"{name} <= {asked[name]:.4g} (has {least:.4g})" for name, least in best.items())
        raise StudyError(f"no tool and striker meet the limits: {text}")
    chosen = max(good, key=lambda blow: blow.transmitted_energy_j)
    sizes: dict[str, float | str] = {
        "tool.wave.rod.diameter_m": chosen.rod_diameter_m,
        "tool.wave.rod.length_m": chosen.rod_length_m,
        "tool.wave.tip.length_m": 0.0,
        "tool.wave.gauge_m": min(wave.gauge_m, chosen.rod_length_m),
        "tool.mass_kg": chosen.tool_mass_kg,
        "linkage.crank_inertia_kg_m2": chosen.crank_inertia_kg_m2,
    }
    constraints = tuple(Constraint(name, getattr(chosen, name), limit) for name, limit in asked.items() if limit < inf)
    return Sizing(
        "mb10_breaker",
        OBJECTIVE,
        sizes,
        varied(base, dict(sizes)),
        {name: value for name, value in chosen._asdict().items() if name not in ("rod_diameter_m", "rod_length_m")},
        constraints,
        binding_of(constraints, "none within the sizes tried"),
        tuple(trade_off(blows, asked)),
        tolerance,
        ASSUMED,
    )


def trade_off(blows: list[SizedBlow], limits: Mapping[str, float]) -> Iterator[dict[str, float | str]]:
    """Yield the best blow of each diameter: within the limits, else without them."""
    for diameter in sorted({blow.rod_diameter_m for blow in blows}):
        own = [blow for blow in blows if blow.rod_diameter_m == diameter]
        good = [blow for blow in own if blow.keeps(limits)]
        best = max(good or own, key=lambda blow: blow.transmitted_energy_j)
        names = ("rod_length_m", "tool_mass_kg", "striker_mass_kg", "transmitted_energy_j", "peak_stress_pa")
        columns = {name: getattr(best, name) for name in names}
        yield {
            "rod_diameter_m": diameter,
            **columns,
            "blow_power_w": best.blow_power_w,
            "kept": "yes" if good else "no",
        }
