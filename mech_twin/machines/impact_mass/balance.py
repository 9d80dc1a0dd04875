# SPDX-License-Identifier: Apache-2.0
"""Momentum and energy balance of one coupling step, summed piece by piece between events, per unit of mass.

Momentum: impulse of the force less the impulses of the stop.  Energy: work of the force less the losses at the stop.
Both are compared with the change between the velocities of the samples at both ends of the step.
"""

from __future__ import annotations

from typing import NamedTuple

from mech_twin.kernels.kernel import kernel

LEAST_MOMENTUM, LEAST_ENERGY = 1e-280, 1e-280  # m/s, m2/s2: below, doubles hold no digits to compare


class StepBalance(NamedTuple):
    """Sums of a step per unit of mass: impulses in m/s, work and loss in m2/s2, and the sums of magnitudes."""

    drive_impulse_m_per_s: float
    drive_work_m2_per_s2: float
    stop_impulse_m_per_s: float
    stop_loss_m2_per_s2: float
    momentum_size_m_per_s: float
    energy_size_m2_per_s2: float


class BalanceResiduals(NamedTuple):
    """Errors of the balances of a step, relative to the sums of magnitudes."""

    momentum_balance: float
    energy_balance: float


@kernel
def empty_balance() -> StepBalance:
    """Return the balance at the start of a step."""
    return StepBalance(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@kernel
def balance_after_piece(
    balance: StepBalance, a_m_per_s2: float, duration_s: float, begin_gap_m: float, end_gap_m: float
) -> StepBalance:
    """Return the balance after a piece of flight or rest under one acceleration."""
    impulse, work = a_m_per_s2 * duration_s, a_m_per_s2 * (begin_gap_m - end_gap_m)
    return StepBalance(
        balance.drive_impulse_m_per_s + impulse,
        balance.drive_work_m2_per_s2 + work,
        balance.stop_impulse_m_per_s,
        balance.stop_loss_m2_per_s2,
        balance.momentum_size_m_per_s + abs(impulse),
        balance.energy_size_m2_per_s2 + abs(a_m_per_s2) * (begin_gap_m + end_gap_m),
    )


@kernel
def balance_after_stop(balance: StepBalance, impulse_m_per_s: float, loss_m2_per_s2: float) -> StepBalance:
    """Return the balance after an impact at the stop or a rest against it."""
    return StepBalance(
        balance.drive_impulse_m_per_s,
        balance.drive_work_m2_per_s2,
        balance.stop_impulse_m_per_s + impulse_m_per_s,
        balance.stop_loss_m2_per_s2 + loss_m2_per_s2,
        balance.momentum_size_m_per_s + impulse_m_per_s,
        balance.energy_size_m2_per_s2 + loss_m2_per_s2,
    )


@kernel
def residuals(balance: StepBalance, begin_m_per_s: float, end_m_per_s: float) -> BalanceResiduals:
    """Return the relative errors of v_E - v_S = impulse - stop and of (v_E^2 - v_S^2)/2 = work - loss."""
    momentum = (end_m_per_s - begin_m_per_s) - (balance.drive_impulse_m_per_s - balance.stop_impulse_m_per_s)
    energy = 0.5 * (end_m_per_s - begin_m_per_s) * (end_m_per_s + begin_m_per_s) - (
        balance.drive_work_m2_per_s2 - balance.stop_loss_m2_per_s2
    )
    momentum_size = balance.momentum_size_m_per_s + abs(begin_m_per_s) + abs(end_m_per_s)
    energy_size = balance.energy_size_m2_per_s2 + 0.5 * (begin_m_per_s**2 + end_m_per_s**2)
    return BalanceResiduals(
        momentum / momentum_size if momentum_size > LEAST_MOMENTUM else 0.0,
        energy / energy_size if energy_size > LEAST_ENERGY else 0.0,
    )
