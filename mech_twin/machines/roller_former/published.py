"""Published tables of the roller former."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mech_twin.capabilities.published import CHANGED, CONTRADICTS, Row, Source
from mech_twin.capabilities.variation import varied
from mech_twin.machines.roller_former.cart_statics import load_moments
from mech_twin.machines.roller_former.coupling_choice import (
    PUBLISHED_MAX_NM,
    PUBLISHED_MEAN_PER_CART_NM,
    PUBLISHED_TABLE_2,
    installation,
)
from mech_twin.machines.roller_former.elastic_drive import reduced_inertia
from mech_twin.machines.roller_former.parameters import RollerFormer, bank_of, former_of
from mech_twin.machines.roller_former.steady import moment_figures, steady_turn, turn_figures
from mech_twin.parts.induction_motor import breakdown_slip, motor_constants, motor_torque

PAPER = "Loveikin et al. 2018"
WORKED = "worked from the print"


# what the published tables come to: moment per cart (N m), twist (rad), its rate and acceleration
WORKED_TABLE_2 = {
    (2, 2000.0): (639.4, 0.00581, 0.1682, 5.64),
    (3, 2000.0): (774.8, 0.00775, 0.2490, 8.09),
    (4, 2000.0): (68.9, 0.000689, 0.0294, 1.259),
    (2, 8000.0): (320.6, 0.00291, 0.0761, 2.34),
    (3, 8000.0): (394.4, 0.00394, 0.1265, 4.07),
    (4, 8000.0): (33.0, 0.00033, 0.0141, 0.602),
}
COLUMNS = ("dM per cart, N m", "d(phi1 - phi2), rad", "d(phi1' - phi2'), rad/s", "d(phi1'' - phi2''), rad/s2")


def table_1_case(parameters: RollerFormer, count: int, load: str = "rectified") -> RollerFormer:
    """Return the case of Table 1: static moments of so many carts."""
    return varied(installation(parameters, count), {"load": load})


def table_2_case(parameters: RollerFormer, count: int, damping: float) -> RollerFormer:
    """Return the case of Table 2: no load, expanded kinematics, steady running."""
    changes = {"load": "none", "kinematics": "expanded", "drive.damping_nms_per_rad": damping}
    return varied(installation(parameters, count), changes)


def table_2_figures(parameters: RollerFormer, count: int, damping: float) -> tuple[float, float, float, float] | None:
    """Return the four peak-to-peak figures of a row of Table 2, the moment read as 2 c (phi1 - phi2)."""
    case = table_2_case(parameters, count, damping)
    former = former_of(case)
    turn = steady_turn(former)
    if turn is None:
        return None
    figures = turn_figures(turn, former)
    twist = figures["twist_range_rad"]
    return (
        2.0 * case.drive.stiffness_nm_per_rad * twist / count,
        twist,
        figures["twist_rate_range_rad_per_s"],
        figures["twist_acceleration_range_rad_per_s2"],
    )


def rows(parameters: RollerFormer) -> Iterator[Row]:
    """Yield the rows: the divisor, the doubled moment and the three-cart maximum first."""
    yield from _divisor(parameters)
    yield from _doubled(parameters)
    yield from _three_carts(parameters)
    yield from _table_1(parameters)
    yield from _table_2(parameters)
    yield from _reversing(parameters)
    yield from _motor(parameters)
    yield from _drive(parameters)


def _moments(parameters: RollerFormer, count: int, load: str = "rectified") -> dict[str, float]:
    return moment_figures(former_of(table_1_case(parameters, count, load)))


def _divisor(parameters: RollerFormer) -> Iterator[Row]:
    printed = varied(parameters, {"parameter_set": "printed"})
    paper = Source(PAPER, "Table 1", "printed loads F01, R01, G")
    computed = _moments(printed, 1)["moment_mean_per_cart_nm"]
    why = "the printed loads give 4.5 times the printed table; a smaller machine was evidently computed"
    yield paper.reported("mean moment per cart, N m", PUBLISHED_MEAN_PER_CART_NM, computed, CONTRADICTS, why)
    worked = Source(WORKED, "Table 1", "printed loads")
    yield worked.gated("mean moment per cart, N m", 2037.0, computed, "what (12) gives with them", relative=1e-3)
    named, other = parameters.load_sets.table, parameters.load_sets.printed
    yield worked.at("divisor", "both load sets").gated(
        "printed loads over those of the table",
        4.5,
        other.roller_force_x_n / named.roller_force_x_n,
        "F01, R01, G and m_B divided by it give the tables to their last digits",
        relative=1e-9,
        verdict=CHANGED,
    )


def _doubled(parameters: RollerFormer) -> Iterator[Row]:
    found = table_2_figures(parameters, 2, 2000.0)
    if found is not None:
        paper = Source(PAPER, "Table 2", "2 carts, k 2000 N m s/rad; the moment as c (phi1 - phi2)")
        why = "the printed moments are 2 c (phi1 - phi2): twice what the printed twist and stiffness give"
        yield paper.reported("dM per cart, N m", 630.0, 0.5 * found[0], CONTRADICTS, why)


def _three_carts(parameters: RollerFormer) -> Iterator[Row]:
    paper = Source(PAPER, "Table 1", "loads divided by 4.5, rectified")
    three = _moments(parameters, 3)["moment_max_nm"]
    why = "three even cranks give 1466.59; the print fits a crank at 239 degrees instead of 240"
    yield paper.reported("largest moment of 3 carts, N m", PUBLISHED_MAX_NM[3], three, CONTRADICTS, why)
    off = varied(table_1_case(parameters, 3), {"carts.offsets_deg": [0.0, 120.0, 239.0]})
    worked = Source(WORKED, "Table 1", "loads divided by 4.5, rectified")
    yield worked.at("Table 1", "cranks at 0, 120, 239 degrees").gated(
        "largest moment of 3 carts, N m",
        1475.79,
        moment_figures(former_of(off))["moment_max_nm"],
        "where the printed number would come from",
        relative=5e-4,
    )
    yield worked.gated("largest moment of 3 carts, N m", 1466.59, three, "even cranks", relative=5e-4)


def _table_1(parameters: RollerFormer) -> Iterator[Row]:
    paper = Source(PAPER, "Table 1", "loads divided by 4.5, rectified")
    worked = Source(WORKED, "Table 1", paper.inputs)
    one = _moments(parameters, 1)
    change = "with F01, R01, G divided by 4.5"
    mean = one["moment_mean_per_cart_nm"]
    yield paper.gated(
        "mean moment per cart, N m",
        PUBLISHED_MEAN_PER_CART_NM,
        one["moment_mean_per_cart_nm"],
        change,
        relative=1e-3,
        verdict=CHANGED,
    )
    bank = bank_of(table_1_case(parameters, 1))
    coarse = load_moments(bank, _degrees(5), 1.0)
    yield worked.at("Table 1", "5 degree grid").gated(
        "mean moment per cart, N m", 452.39, float(coarse.mean()), "the grid behind the printed mean", relative=5e-5
    )
    yield worked.gated("mean moment per cart, N m", 452.68, mean, "fine grid", relative=5e-5)
    for count in (1, 2, 4):
        yield paper.gated(
            f"largest moment of {count} cart{'s' * (count > 1)}, N m",
            PUBLISHED_MAX_NM[count],
            _moments(parameters, count)["moment_max_nm"],
            change,
            relative=5e-4,
            verdict=CHANGED,
        )


def _degrees(step: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.radians(np.arange(0, 360, step, dtype=np.float64))


def _reversing(parameters: RollerFormer) -> Iterator[Row]:
    worked = Source(WORKED, "reversing load", "loads divided by 4.5, force and friction against the travel")
    one = _moments(parameters, 1, "reversing")
    why = "eq. (40) as printed keeps a force of one sign, which drives the shaft half the time"
    yield worked.gated("mean moment per cart, N m", 453.404, one["moment_mean_per_cart_nm"], why, relative=1e-5)
    for count, value in ((1, 734.493), (2, 1187.906), (3, 1468.381), (4, 2014.074)):
        computed = _moments(parameters, count, "reversing")["moment_max_nm"]
        yield worked.gated(f"largest moment, {count} in all, N m", value, computed, why, relative=1e-5)


def _table_2(parameters: RollerFormer) -> Iterator[Row]:
    for (carts, damping), theirs in PUBLISHED_TABLE_2.items():
        found = table_2_figures(parameters, carts, damping)
        inputs = f"{carts} carts, k {damping:g} N m s/rad; no load, masses over 4.5, expanded kinematics"
        if found is None:
            yield Source(PAPER, "Table 2", inputs).unknown("steady turn", None, "the motor cannot keep it up")
            continue
        tolerance = 0.10 if carts == 2 else 0.03
        for column, printed, computed in zip(COLUMNS, theirs, found, strict=True):
            moment = column is COLUMNS[0]
            why = (
                "read as 2 c (phi1 - phi2) over the carts: the doubled moment"
                if moment
                else "peak to peak, steady turn"
            )
            yield Source(PAPER, "Table 2", inputs).gated(
                column, printed, computed, why, relative=tolerance, verdict=CHANGED
            )
        for column, value, computed in zip(COLUMNS, WORKED_TABLE_2[carts, damping], found, strict=True):
            yield Source(WORKED, "Table 2", inputs).gated(column, value, computed, "steady turn", relative=3e-3)


def _motor(parameters: RollerFormer) -> Iterator[Row]:
    motor = motor_constants(parameters.motor)
    paper = Source(PAPER, "motor data", "4A160S6U3")
    slip = motor.rated_slip
    start = parameters.motor.starting_torque_ratio * motor.rated_torque_nm
    for name, value, computed in (
        ("rated slip s_n", 0.025, slip),
        ("breakdown slip s_kr", 0.0933, breakdown_slip(slip, parameters.motor.breakdown_torque_ratio)),
        ("omega_kr, rad/s", 94.95, motor.synchronous_speed_rad_per_s * (1.0 - motor.breakdown_slip)),
        ("omega_n, rad/s", 102.1, motor.rated_speed_rad_per_s),
        ("M_start, N m", 129.24, start),
        ("M_n, N m", 107.7, parameters.motor.rated_power_w / motor.rated_speed_rad_per_s),
        ("M_kr, N m", 215.4, parameters.motor.breakdown_torque_ratio * motor.rated_torque_nm),
    ):
        yield paper.gated(name, value, computed, "from the name plate", relative=1.5e-3)
    still = float(motor_torque(motor, 0.0, 1.0))
    why = "the Kloss curve alone starts with a third of the catalogue torque: a loaded start stalls"
    yield paper.reported("torque at standstill, N m", 129.24, still, CONTRADICTS, why)
    yield Source(WORKED, "motor data", "Kloss curve").gated(
        "torque at standstill, N m", 39.85, still, why, relative=1e-3
    )


def _drive(parameters: RollerFormer) -> Iterator[Row]:
    worked = Source(WORKED, "J_p1", "delta 1.1 assumed")
    inertia = reduced_inertia(parameters.drive, parameters.motor.rotor_inertia_kg_m2)
    yield worked.gated("J_p1, kg m2", 48.385, inertia, "(J_rotor + J_coupling) delta u^2", relative=1e-5)
    paper = Source(PAPER, "Fig. 10", "2 carts, no load, expanded kinematics")
    figures = []
    for damping in (2000.0, 8000.0, 10000.0):
        former = former_of(table_2_case(parameters, 2, damping))
        turn = steady_turn(former)
        figures.append(turn_figures(turn, former)["coupling_moment_max_nm"] if turn is not None else float("nan"))
    first, later = figures[0] - figures[1], figures[1] - figures[2]
    yield paper.limit(
        "fall of the largest coupling moment from k 2000 to 8000 above that to 10000, N m",
        later,
        first,
        "falls with k, most of it before 8000",
        "above",
    )
    yield paper.unknown("optimal stiffness", None, "the published c are no unique minima of anything printed")
    per_cart = {count: _moments(parameters, count)["moment_max_nm"] / count for count in (2, 3, 4)}
    yield Source(PAPER, "Fig. 18", "loads divided by 4.5, rectified").limit(
        "largest moment per cart: 3 carts below the other two, N m",
        min(per_cart[2], per_cart[4]),
        per_cart[3],
        "the energetically balanced drive is the evenest",
        "below",
    )
