# SPDX-License-Identifier: Apache-2.0
"""Force analysis of the impact mass: reaction of the stop, and contact estimates for a stop of finite stiffness.

A stop of finite stiffness has peak force, contact time and loss, as an estimate beside the impulse::

    F |        /|  loading: F = k d               d: penetration of the stop
      |      /  |  unloading: F = k/R^2 (d - d0)
      |    /   /   d0 = (1 - R^2) d_max stays when the mass leaves
      |  /    /
      |/_____/____ d
            d0

The force P of the generator acts on during the contact.  With w = sqrt(k/m), equation by equation in closed form:

Loading, m d'' = P - k d from d = 0, d' = v-: the peak force is F = P + sqrt(P^2 + m k v-^2).
Unloading, m d'' = P - k/R^2 (d - d0) from rest: the mass leaves with exactly R v-, whatever P is.
The coefficient of restitution is therefore kept, and the motion is that of the rigid stop.

Valid while the flight between impacts is long against the contact: below `merging_speed` the impacts of a series merge
into one contact.  Source: Walton and Braun, J. Rheology 30 (1986) 949, the hysteretic spring; the force is ours.
"""

import math
from typing import Any, NamedTuple

from mech_twin.engine.compiled_steps import Work, copy_numbers, force_step, step_of
from mech_twin.engine.sample_vectors import (
    KIND,
    LINKAGE_JOINTS,
    PERIOD,
    PINS,
    PRE_VELOCITY,
    TIME,
    Array,
    EventLayout,
    ForceLayout,
)
from mech_twin.kernels.kernel import borrowing_kernel, kernel
from mech_twin.machines.impact_mass.dynamics import IMPACT, KIND_NAMES, STUCK
from mech_twin.machines.impact_mass.step import CONTACTS, memory_of


class ContactEstimate(NamedTuple):
    """Estimates for one impact at a stop of finite stiffness.

    ``loss_j`` is the energy dissipated: loss of kinetic energy, and work of the force over the permanent penetration.
    """

    peak_force_n: float
    contact_time_s: float
    penetration_m: float
    loss_j: float


@kernel
def contact_estimate(
    mass_kg: float, speed_m_per_s: float, restitution: float, stiffness_n_per_m: float, force_n: float
) -> ContactEstimate:
    """Return peak force, contact time, largest penetration and loss of one impact.

    Parameters
    ----------
    mass_kg : float
        Mass.
    speed_m_per_s : float
        Speed v- before the impact, > 0.
    restitution : float
        R.
    stiffness_n_per_m : float
        Stiffness k of the stop when it is loaded.
    force_n : float
        Force P on the mass during the contact, positive towards the stop.
    """
    m, v, r, k, p = mass_kg, speed_m_per_s, restitution, stiffness_n_per_m, force_n
    inertial = math.sqrt(m * k) * v
    swing = math.hypot(p, inertial)
    peak = p + swing if p >= 0.0 else inertial * inertial / (swing - p)
    radians = math.atan2(inertial, -p) + r * math.acos(-p / swing)
    penetration = peak / k
    stays = (1.0 - r) * (1.0 + r) * penetration
    loss = 0.5 * m * v * v * (1.0 - r) * (1.0 + r) + p * stays
    return ContactEstimate(peak, radians * math.sqrt(m / k), penetration, loss)


def merging_speed(mass_kg: float, restitution: float, stiffness_n_per_m: float, force_n: float) -> float:
    """Return the impact speed (m/s) below which the next impact comes before this contact is over; 0 if never.

    The flight after an impact lasts 2 R v/A, A = P/m > 0; the contact is taken at small P: pi/2 (1 + R) sqrt(m/k).
    """
    if force_n <= 0.0:
        return 0.0
    contact_s = 0.5 * math.pi * (1.0 + restitution) * math.sqrt(mass_kg / stiffness_n_per_m)
    return force_n / mass_kg * contact_s / (2.0 * restitution)


class StopQuantities(NamedTuple):
    """Quantities of a step: impulse and force of the stop, force of the generator, the last full period, energies."""

    stop_impulse_ns: float
    stop_force_n: float
    drive_force_n: float
    last_period_impulse_ns: float
    last_period_mean_force_n: float
    last_period_impacts_1: float
    period_1: float
    drive_work_j: float
    stop_loss_j: float
    change_work_j: float
    change_momentum_ns: float
    peak_contact_force_n: float
    contact_time_s: float
    contact_loss_j: float


class Stop(NamedTuple):
    """Constants of the force analysis; ``stiff``: a contact stiffness is given, ``waves``: the stop is a rod.

    For a rod also the largest force over the impact speed (N s/m), and the contact time (s).
    """

    period_s: float
    phase1_s: float
    step_s: float
    stiff: bool
    stiffness_n_per_m: float
    waves: bool
    force_over_speed: float
    contact_s: float


@kernel
def hardest_contact(model: Stop, memory: Any, log: Array, count: int) -> ContactEstimate:
    """Return the contact of the fastest impact among the events."""
    hardest = -1
    for i in range(count):
        if log[i, KIND] == IMPACT and (hardest < 0 or log[i, PRE_VELOCITY] > log[hardest, PRE_VELOCITY]):
            hardest = i
    if not (model.stiff or model.waves) or hardest < 0:
        return ContactEstimate(0.0, 0.0, 0.0, 0.0)
    event = log[hardest]
    if model.waves:
        speed, r = event[PRE_VELOCITY], memory.restitution_1
        loss = 0.5 * memory.mass_kg * speed * speed * (1.0 - r) * (1.0 + r)
        return ContactEstimate(model.force_over_speed * speed, model.contact_s, 0.0, loss)
    tau_s = event[TIME] - memory.origin_step_1 * model.step_s - event[PERIOD] * model.period_s
    acting = memory.phase1_acceleration_m_per_s2 if tau_s <= model.phase1_s else memory.phase2_acceleration_m_per_s2
    mass_kg = memory.mass_kg
    return contact_estimate(
        mass_kg, event[PRE_VELOCITY], memory.restitution_1, model.stiffness_n_per_m, acting * mass_kg
    )


@step_of(force_step, Stop, borrowing_kernel)
def stop_reaction(
    model: Stop, step: int, linkage: Array, log: Array, count: int, out: Array, loads: Array, work: Work
) -> int:
    """Fill ``out`` with the stop's reaction on the mass, its impulse in this step and its mean over the last period.

    The stop can only push, along -x.  Over a periodic motion its mean force equals the mean force of the generator,
    since the momentum of the mass is periodic.  With a contact stiffness the quantities hold peak force, contact time
    and loss of the hardest impact of the step; 0 without an impact, or at a rigid stop.  Mass and restitution are those
    of the step, from the memory: a live change is not applied in retrospect.
    """
    memory, force = memory_of(linkage), linkage[LINKAGE_JOINTS + 2]
    reaction = max(force, 0.0) if memory.mode_1 == STUCK else 0.0
    last_impulse_ns = memory.last_period_impulse_m_per_s * memory.mass_kg
    contact = hardest_contact(model, memory, log, count)
    values = StopQuantities(
        memory.step_impulse_m_per_s * memory.mass_kg,
        reaction,
        force,
        last_impulse_ns,
        last_impulse_ns / model.period_s,
        memory.last_period_impacts_1,
        memory.anchor_period_1,
        memory.step_drive_work_j,
        memory.step_stop_loss_j,
        memory.step_change_work_j,
        memory.step_change_momentum_ns,
        contact.peak_force_n,
        contact.contact_time_s,
        contact.loss_j,
    )
    for i in range(len(out)):
        out[i] = 0.0
    out[PINS] = -reaction if reaction != 0.0 else 0.0
    copy_numbers(values, out[PINS + 3 :])
    return 0


def force_layout(reads_events: bool) -> ForceLayout:
    """Return the row of the force analysis; events matter where they have a contact."""
    return ForceLayout(("stop",), StopQuantities._fields, (), EventLayout(KIND_NAMES, CONTACTS), reads_events)
