"""Metrics of the roller former: one position, and those of a run as it goes."""

from __future__ import annotations

from math import cos, floor, inf, pi, sin, sqrt
from typing import Any

import numpy as np

from mech_twin.machines.roller_former.cart_parameters import OFFSET
from mech_twin.machines.roller_former.cart_statics import cart_load, cart_motion, shaft_terms, sides_of_travel
from mech_twin.machines.roller_former.dynamics import Former
from mech_twin.machines.roller_former.forces import QUANTITIES
from mech_twin.machines.roller_former.roles import CRANK_JOINT, TWIST_JOINT
from mech_twin.samples import Frame

TWIST_ACCELERATION = QUANTITIES.index("twist_acceleration_rad_per_s2")


def position_metrics(former: Former, crank_rad: float) -> dict[str, Any]:
    """Return each cart's angles, transfer functions, static forces and moment at a crank angle, and the totals."""
    bank = former.bank
    carts = []
    for index in range(bank.carts.shape[0]):
        psi = crank_rad + bank.carts[index, OFFSET]
        motion = cart_motion(bank, sin(psi), cos(psi))
        load = cart_load(bank, index, crank_rad, 1.0)
        carts.append(
            {
                "psi_rad": float(psi),
                "beta_rad": float(np.arcsin(motion.rod_sine)),
                "x_m": motion.x,
                "x1_m_per_rad": motion.x1,
                "x2_m_per_rad2": motion.x2,
                "rod_force_n": load.rod_force_n,
                "guide_front_n": load.front_n,
                "guide_rear_n": load.rear_n,
                "moment_nm": load.moment_nm,
            }
        )
    sides = np.empty(len(carts))
    sides_of_travel(bank, crank_rad + 1e-9, sides)
    inertia, slope, _ = shaft_terms(bank, crank_rad, sides, 1.0)
    return {
        "crank_rad": crank_rad,
        "carts": carts,
        "moment_nm": sum(cart["moment_nm"] for cart in carts),
        "reduced_inertia_kg_m2": inertia,
        "half_inertia_slope_kg_m2_per_rad": slope,
        "motor_inertia_kg_m2": former.motor_inertia_kg_m2,
    }


class FormerObserver:
    """Running metrics: those of the last whole turn, and extremes and events of the whole run."""

    def __init__(self) -> None:
        self._turn: int | None = None
        self._open = _empty_turn()
        self._closed: dict[str, float] = {}
        self._run = {"turns": 0.0, "stalls": 0.0, "coupling_moment_max_of_run_nm": -inf, "motor_torque_max_nm": -inf}

    def observe(self, frame: Frame) -> None:
        """Take one frame into account."""
        linkage, run = frame.linkage, self._run
        crank = linkage.position[CRANK_JOINT]
        turn = floor(crank / (2.0 * pi))
        if self._turn is not None and turn != self._turn:
            self._close(linkage.time_s)
        self._turn = turn
        self._add(frame)
        run["turns"] = crank / (2.0 * pi)
        run["stalls"] += sum(event.kind == "stall" for event in linkage.events)
        run["coupling_moment_max_of_run_nm"] = max(run["coupling_moment_max_of_run_nm"], linkage.effort[CRANK_JOINT])
        run["motor_torque_max_nm"] = max(run["motor_torque_max_nm"], frame.motor.effort[0])
        for event in linkage.events:
            if event.contact == "crank":
                run[f"{event.kind}_at_s"] = event.time_s

    def _add(self, frame: Frame) -> None:
        now, linkage = self._open, frame.linkage
        coupling = linkage.effort[CRANK_JOINT]
        for name, value in (
            ("elastic_moment_nm", linkage.effort[TWIST_JOINT]),
            ("coupling_moment_nm", coupling),
            ("twist_rad", linkage.position[TWIST_JOINT]),
            ("twist_rate_rad_per_s", linkage.velocity[TWIST_JOINT]),
            ("twist_acceleration_rad_per_s2", frame.forces.quantities.values[TWIST_ACCELERATION]),
        ):
            low, high = now[name]
            now[name] = (min(low, value), max(high, value))
        first, count = now["samples"]
        now["samples"] = (min(first, frame.linkage.time_s), count + 1.0)
        total, square = now["sums"]
        now["sums"] = (total + coupling, square + coupling * coupling)

    def _close(self, time_s: float) -> None:
        now = self._open
        first, count = now["samples"]
        figures = {}
        for name in ("elastic_moment", "coupling_moment"):
            figures[f"{name}_min_nm"], figures[f"{name}_max_nm"] = now[f"{name}_nm"]
        for name, unit in (("twist", "rad"), ("twist_rate", "rad_per_s"), ("twist_acceleration", "rad_per_s2")):
            low, high = now[f"{name}_{unit}"]
            figures[f"{name}_range_{unit}"] = high - low
        figures["coupling_moment_rms_nm"] = sqrt(now["sums"][1] / count)
        figures["turn_speed_rad_per_s"] = 2.0 * pi / (time_s - first) if time_s > first else 0.0
        self._closed = figures
        self._open = _empty_turn()

    def numbers(self) -> dict[str, float]:
        """Return the metrics so far; those of a turn are missing until the first is complete."""
        return {**self._run, **self._closed}


def _empty_turn() -> dict[str, tuple[float, float]]:
    names = (
        "elastic_moment_nm",
        "coupling_moment_nm",
        "twist_rad",
        "twist_rate_rad_per_s",
        "twist_acceleration_rad_per_s2",
    )
    return {**dict.fromkeys(names, (inf, -inf)), "samples": (inf, 0.0), "sums": (0.0, 0.0)}
