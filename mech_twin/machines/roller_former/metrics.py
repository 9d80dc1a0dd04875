# SPDX-License-Identifier: Apache-2.0
"""Metrics of the roller former (one position, static moments, steady turn, run), and what a monitor asks of it."""

from math import cos, floor, inf, isfinite, sin, sqrt
from typing import Any, NamedTuple

import numpy as np

from mech_twin.capabilities.cycle import CycleFeatures, CycleReference, crank_features, harmonic, mean, swing
from mech_twin.capabilities.faults import (
    EITHER,
    MachineFault,
    OperatingVariable,
    beyond_range,
    motor_changes,
    motor_variables,
    share_of_key,
    varying_key,
)
from mech_twin.machines.crank_run import Extremes, on_cubic, share_at
from mech_twin.machines.roller_former.cart_statics import (
    LOOK_AHEAD_RAD,
    cart_load,
    cart_motion,
    load_moments,
    shaft_terms,
    sides_of_travel,
)
from mech_twin.machines.roller_former.dynamics import Former, at_motor
from mech_twin.machines.roller_former.parameters import RollerFormer, longest_step_s
from mech_twin.machines.roller_former.roles import QUANTITIES, FormerMemory, FormerQuantities
from mech_twin.machines.roller_former.steady import TURN, SteadyTurn, closed_extremes, start_up, steady_turn
from mech_twin.samples import Frame

CRANK, TORQUE, TWIST = "linkage.crank.position", "motor.rotor.effort", "linkage.twist.position"
SETTLING_TURNS = 4
RUN_UP_S = 5.0
GRID = 7200


def features(parameters: RollerFormer) -> CycleFeatures:
    """Return the features of a turn of the crank shaft."""
    return CycleFeatures(
        CycleReference(CRANK),
        (
            *crank_features(CRANK, TORQUE),
            harmonic("torque_cos_4_nm", "N.m", TORQUE, 4, "cos", "driving torque, cosine of a quarter of a turn"),
            harmonic("torque_sin_4_nm", "N.m", TORQUE, 4, "sin", "driving torque, sine of a quarter of a turn"),
            mean("twist_mean_rad", "rad", TWIST, "mean twist of the coupling"),
            swing("twist_range_rad", "rad", TWIST, "range of the coupling's twist"),
            harmonic("twist_cos_2_rad", "rad", TWIST, 2, "cos", "twist, cosine of half a turn"),
            harmonic("twist_sin_2_rad", "rad", TWIST, 2, "sin", "twist, sine of half a turn"),
            harmonic("twist_cos_4_rad", "rad", TWIST, 4, "cos", "twist, cosine of a quarter of a turn"),
            harmonic("twist_sin_4_rad", "rad", TWIST, 4, "sin", "twist, sine of a quarter of a turn"),
        ),
        SETTLING_TURNS,
        RUN_UP_S,
    )


LESS = (-0.6, -0.4, -0.2, -0.1)
LESS_TORQUE = (-0.4, -0.3, -0.2, -0.1)


def faults(parameters: RollerFormer) -> tuple[MachineFault, ...]:
    """Return the faults of coupling, carts, guides, motor and supply."""

    def weaker_motor(parameters: RollerFormer, size: float) -> dict[str, Any]:
        return motor_changes(parameters, torque=1.0 + size)

    found = [
        share_of_key("coupling_stiffness", "the coupling has gone soft", "drive.stiffness_nm_per_rad", LESS),
        share_of_key("coupling_damping", "the coupling damps less or more", "drive.damping_nms_per_rad", EITHER),
        share_of_key("cart_load", "the mix is stiffer or softer", "carts.roller_force_x_n", EITHER),
        share_of_key("guide_friction", "the guide rollers run hard", "carts.friction", (0.25, 0.5, 1.0, 2.0)),
        MachineFault("phase_loss", "the motor has lost torque, as of a phase", "1", LESS_TORQUE, weaker_motor),
        beyond_range(motor_variables()[0]),
    ]
    states = parameters.carts.cart_states
    return (*found, *(_empty(cart, states) for cart, state in enumerate(states) if state == "loaded"))


def _empty(cart: int, states: tuple[Any, ...]) -> MachineFault:
    """Return the fault of a cart without mix; its size is 1."""
    changed, meaning = [*states[:cart], "empty", *states[cart + 1 :]], f"cart {cart + 1} has no mix under its rollers"
    return MachineFault(f"cart_{cart + 1}_empty", meaning, "1", (1.0,), lambda _, size: {"carts.states": changed})


MIX_X, MIX_Y = "carts.roller_force_x_n", "carts.roller_force_y_n"


def operating(parameters: RollerFormer) -> tuple[OperatingVariable, ...]:
    """Return supply, motor temperature and mix, whose force on a roller keeps its direction."""
    return (*motor_variables(), varying_key("mix", "force of the mix on the rollers", MIX_X, 0.1, "cart_load", MIX_Y))


def position_metrics(former: Former, crank_rad: float) -> dict[str, Any]:
    """Return each cart's angles, transfer functions, static forces and moment at a crank angle, and the totals."""
    bank = former.bank
    carts = []
    for index, offset in enumerate(bank.offset_rad.tolist()):
        psi = crank_rad + offset
        motion = cart_motion(bank, sin(psi), cos(psi))
        load = cart_load(bank, index, crank_rad, 1.0)
        carts.append(
            {
                "psi_rad": psi,
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
    sides_of_travel(bank, crank_rad + LOOK_AHEAD_RAD, sides)
    inertia, slope, _ = shaft_terms(bank, crank_rad, sides, 1.0)
    return {
        "crank_rad": crank_rad,
        "carts": carts,
        "moment_nm": sum(cart["moment_nm"] for cart in carts),
        "reduced_inertia_kg_m2": inertia,
        "half_inertia_slope_kg_m2_per_rad": slope,
        "motor_inertia_kg_m2": former.motor_inertia_kg_m2,
    }


def moment_metrics(former: Former) -> dict[str, float]:
    """Return mean and largest load moment over a turn, in all and per cart of the shaft (N m)."""
    angles = np.linspace(0.0, TURN, GRID, endpoint=False)
    moments = load_moments(former.bank, angles, 1.0)
    mean, count = float(np.mean(moments)), former.bank.offset_rad.size
    most = closed_extremes(moments)[1]
    return {
        "moment_mean_nm": mean,
        "moment_max_nm": most,
        "moment_mean_per_cart_nm": mean / count,
        "moment_max_per_cart_nm": most / count,
    }


def turn_metrics(turn: SteadyTurn, former: Former) -> dict[str, float]:
    """Return the dynamic metrics of a steady turn; means from the works, which are integrated with the motion."""
    columns = turn.columns
    elastic = [former.stiffness_nm_per_rad * twist for twist in closed_extremes(columns.twist_rad)]
    twist, rate, bend = (
        float(np.ptp(closed_extremes(column)))
        for column in (columns.twist_rad, columns.twist_rate_rad_per_s, columns.twist_acceleration_rad_per_s2)
    )
    coupling = columns.coupling_nm
    low, high = closed_extremes(coupling)
    return {
        "elastic_moment_min_nm": elastic[0],
        "elastic_moment_max_nm": elastic[1],
        "elastic_moment_rms_nm": float(np.sqrt(np.mean((former.stiffness_nm_per_rad * columns.twist_rad) ** 2))),
        "coupling_moment_min_nm": low,
        "coupling_moment_max_nm": high,
        "coupling_moment_mean_nm": (turn.works.load_work_j + turn.works.friction_work_j) / TURN,
        "coupling_moment_rms_nm": float(np.sqrt(np.mean(coupling**2))),
        "coupling_moment_rms_about_mean_nm": float(np.std(coupling)),
        "coupling_moment_at_motor_max_nm": max(abs(at_motor(former, end, 1.0)) for end in (low, high)),
        "twist_range_rad": twist,
        "twist_rate_range_rad_per_s": rate,
        "twist_acceleration_range_rad_per_s2": bend,
        "steady_speed_rad_per_s": turn.mean_speed_rad_per_s,
        "steady_turns_taken": float(turn.turns_taken),
        "drive_power_mean_w": turn.works.motor_work_j / turn.turn_time_s,
        **motor_metrics(turn, former),
    }


def motor_metrics(turn: SteadyTurn, former: Former) -> dict[str, float]:
    """Return the root mean square of the motor's torque over a steady turn, and its rotor loss, against rated.

    The copper loss of the rotor is the slip power ``M s w_0``; the rated one is ``M_n s_n w_0``.  Stator, magnetising
    and iron losses do not follow from rating and speeds and are left out.
    """
    motor, columns = former.motor, turn.columns
    torque = columns.motor_nm
    speed = (columns.crank_speed_rad_per_s + columns.twist_rate_rad_per_s) * former.ratio
    slip = 1.0 - speed / motor.synchronous_speed_rad_per_s
    rms = float(np.sqrt(np.mean(torque**2)))
    return {
        "motor_torque_rms_nm": rms,
        "motor_torque_rms_of_rated_1": rms / motor.rated_torque_nm,
        "motor_rotor_loss_of_rated_1": float(np.mean(torque * slip)) / (motor.rated_torque_nm * motor.rated_slip),
    }


def power_at_rated_speed_w(parameters: RollerFormer, moment_nm: float) -> float:
    """Return the power (W) that a mean moment of the carts (N m) and the friction of the shaft take at rated speed."""
    speed, friction = parameters.rated_crank_speed_rad_per_s, parameters.friction
    drag = friction.coulomb_nm + friction.viscous_nms_per_rad * speed
    return (moment_nm + drag) * speed / parameters.drive.efficiency


def former_metrics(parameters: RollerFormer, former: Former) -> dict[str, float]:
    """Return the summary: static moments, power, and, where the motor keeps the load up, the steady turn and the start.

    ``steady_1``, ``start_stalls_1`` and ``start_steady_1`` are 1 for yes; metrics that do not exist are left out.
    """
    metrics = moment_metrics(former)
    metrics["power_required_w"] = power_at_rated_speed_w(parameters, metrics["moment_mean_nm"])
    metrics["longest_coupling_step_s"] = longest_step_s(parameters)
    turn = steady_turn(former)
    metrics["steady_1"] = float(turn is not None)
    if turn is not None:
        metrics.update(turn_metrics(turn, former))
        rated = parameters.drive.coupling_rated_moment_nm
        metrics["coupling_load_of_rated_1"] = metrics["coupling_moment_at_motor_max_nm"] / rated
    goal = turn.mean_speed_rad_per_s if turn is not None else parameters.rated_crank_speed_rad_per_s
    start = start_up(parameters, former, goal)
    metrics["start_stalls_1"] = float(start.stalled)
    metrics["start_steady_1"] = float(start.steady)
    for name, time_s in (
        ("startup_time_s", start.time_s),
        ("start_steady_after_s", start.steady_time_s),
        ("start_stall_at_s", start.stall_time_s),
    ):
        if isfinite(time_s):
            metrics[name] = time_s
    return metrics


WHOLE_TURN = 0.95 * TURN  # what is less was begun within a turn, or went to and fro


class TurnSums(NamedTuple):
    """Sums since the start of a run, or their rates: angle (rad), works (J), the coupling's squared moment."""

    crank_rad: float
    motor_work_j: float
    load_work_j: float
    coupling_square_n2m2s: float


class Instant(NamedTuple):
    """Time (s), sums since the start of the run, and their rates."""

    time_s: float
    sums: TurnSums
    rates: TurnSums


class FormerObserver:
    """Metrics of a run: those of its last whole turn (``last_turn_``), extremes and events of the whole.

    The means of a turn are its works over its time and angle, from one passage of the starting angle to the next; both
    lie between samples.
    """

    def __init__(self) -> None:
        self._turn: int | None = None
        self._first: Instant | None = None
        self._now: Instant | None = None
        self._moments, self._ranges = Extremes(), Extremes()
        self._closed: dict[str, float] = {}
        self._run = {"turns": 0.0, "stalls": 0.0, "coupling_moment_max_of_run_nm": -inf, "motor_torque_max_nm": -inf}

    def observe(self, frame: Frame) -> None:
        """Update with one frame; the coupling's moment is linear between two."""
        linkage, run, before = frame.linkage, self._run, self._now
        (crank, twist), (speed, rate), (coupling, elastic) = (
            values[1:3] for values in (linkage.position, linkage.velocity, linkage.effort)
        )
        told = FormerQuantities(*frame.forces.quantities.values[:QUANTITIES])
        memory = FormerMemory(*linkage.memory.values)
        rates, squares = TurnSums(speed, told.drive_power_w, told.load_power_w, coupling * coupling), 0.0
        if before is not None:
            mean = (before.rates.coupling_square_n2m2s + rates.coupling_square_n2m2s) / 2.0
            squares = before.sums.coupling_square_n2m2s + mean * (linkage.time_s - before.time_s)
        sums = TurnSums(crank, memory.motor_work_j, memory.load_work_j, squares)
        self._now = Instant(linkage.time_s, sums, rates)
        turn = floor(crank / TURN)
        if turn != self._turn:
            self._begin_turn(TURN * turn, before, self._now)
        self._turn = turn
        self._moments.take("elastic_moment_{}_nm", elastic)
        self._moments.take("coupling_moment_{}_nm", coupling)
        self._ranges.take("twist_range_rad", twist)
        self._ranges.take("twist_rate_range_rad_per_s", rate)
        self._ranges.take("twist_acceleration_range_rad_per_s2", told.twist_acceleration_rad_per_s2)
        run["turns"] = crank / TURN
        run["stalls"] += sum(event.kind == "stall" for event in linkage.events)
        run["coupling_moment_max_of_run_nm"] = max(run["coupling_moment_max_of_run_nm"], coupling)
        run["motor_torque_max_nm"] = max(run["motor_torque_max_nm"], *frame.motor.effort)
        for event in linkage.events:
            if event.contact == "crank":
                run[f"{event.kind}_at_s"] = event.time_s

    def _begin_turn(self, angle: float, before: Instant | None, now: Instant) -> None:
        """Finish the present turn, if it was a whole one, and start the next at an angle passed since ``before``."""
        first = now if before is None else passage(max(angle, TURN * (self._turn or 0)), before, now)
        if self._first is not None:
            way, *works = (b - a for a, b in zip(self._first.sums, first.sums, strict=True))
            if way > WHOLE_TURN:
                self._closed = self._metrics_of_turn(first.time_s - self._first.time_s, way, *works)
        self._first = first
        self._moments, self._ranges = Extremes(), Extremes()

    def _metrics_of_turn(
        self, time_s: float, angle: float, motor_j: float, load_j: float, squares: float
    ) -> dict[str, float]:
        metrics = {
            **self._moments.numbers(""),
            **{name: most - least for name, (least, most) in self._ranges.found.items()},
            "coupling_moment_rms_nm": sqrt(squares / time_s),
            "speed_rad_per_s": angle / time_s,
            "drive_power_mean_w": motor_j / time_s,
            "load_moment_mean_nm": load_j / angle,
        }
        return {f"last_turn_{name}": value for name, value in metrics.items()}

    def numbers(self) -> dict[str, float]:
        """Return the metrics so far; those of a turn are missing until the first is complete."""
        return {**self._run, **self._closed}


def passage(angle: float, before: Instant, now: Instant) -> Instant:
    """Return time and sums at which the crank passed an angle between two frames, by cubic Hermite interpolation."""
    span = now.time_s - before.time_s
    sums, rates = (zip(*pair, strict=True) for pair in ((before.sums, now.sums), (before.rates, now.rates)))
    ends = list(zip(sums, rates, strict=True))
    share = share_at(angle, span, *ends[0])
    found = TurnSums(*(on_cubic(span, *each, share) for each in ends))
    return Instant(before.time_s + share * span, found, now.rates)
