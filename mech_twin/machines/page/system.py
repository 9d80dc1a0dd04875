# SPDX-License-Identifier: Apache-2.0
"""A page as a system of the event loop: generated functions called by address, one set of kernels for all pages."""

from typing import Any, NamedTuple

from mech_twin.engine.compiled_steps import fill_event
from mech_twin.engine.hybrid import laws
from mech_twin.engine.hybrid.complementarity import CLOSED_M, STRUCK, halt, seek_impulses
from mech_twin.engine.hybrid.laws import HIGH, HOLD, LOW, OPEN, Array, Equations, Indices, declares
from mech_twin.engine.hybrid.loop import Room, clear, room_in
from mech_twin.engine.hybrid.motion import prepare_instant
from mech_twin.engine.integration import DORMAND_PRINCE_5, Workspace
from mech_twin.kernels.kernel import borrowing_kernel, inline_kernel
from mech_twin.machines.page.rods import rod_restitution
from mech_twin.mechanics.code_generation import call_straight_line

PHASE, PORT, TOUCH, BEND, RESET = range(5)  # what a switch is
IMPACT, CONTACT, RELEASE, STICK, SLIP, SWITCH = range(6)
KINDS = ("impact", "contact", "release", "stick", "slip", "switch")
BEYOND, LAST_BEYOND = -11, -99  # status of the first gas spring, -12 of the second; lines follow
LEAST_VOLUME = 1e-6  # of a gas spring, over that at the start
ROUNDS = 6  # of Newton that put the dependent coordinates back
CLOSED = 1e-15  # of a coordinate: a correction that is rounding


class PageSystem(NamedTuple):
    """A page for the event loop: functions by address, numbers, controls, work arrays; counts and indices.

    The first ``programs`` switches are time programs; their ``timing`` rows hold the number of instants in a period,
    then the instants (s).  The ``timing`` row of a reset holds position and speed at the start.
    ``kinds`` is the type of each switch, ``changes`` the gas spring of a port or the free coordinate of a reset.
    ``rods`` has a row for each rod, ``struck`` its law; ``marks`` (one for each law) is a work array.
    """

    instant: int
    correction: int
    numbers: Array
    controls: Array
    values: Array
    corrections: Array
    restitutions: Array
    timing: Array
    kinds: Indices
    changes: Indices
    free: int
    dependent: int
    driven: int
    law_count: int
    switches: int
    programs: int
    worked: int
    switch_controls: int
    law_values: int
    follow_values: int
    gases: int
    rods: Array
    struck: Indices
    marks: Indices
    report: int
    energies: int  # where they begin in the report
    resets: int


@inline_kernel
def page_room(system: PageSystem, size: int, numbers: Array, marks: Indices) -> Room:
    """Return the loop's work arrays; a stage is a full state, as rates depend on the dependent coordinates."""
    n, m, own = system.free, system.law_count, system.switches
    room = room_in(numbers[size:], marks, n, m, own, size, DORMAND_PRINCE_5)
    work = Workspace(room.work.rates, numbers[:size], room.work.end)
    return Room(
        room.at, work, room.search, room.candidates, room.struck, room.ended, room.past, room.cut,
        room.series, room.before, room.tolerance, room.method, room.steps,
    )  # fmt: skip


@borrowing_kernel
def next_change(timing: Array, program: int, phase: int) -> float:
    """Return the time (s) at which a phase of a program ends; phases count from 0, one for each instant of a period."""
    count = int(timing[program, 0])
    if phase < count:
        return float(timing[program, 1 + phase])
    return float((phase // count) * timing[program, count] + timing[program, 1 + phase % count])


@borrowing_kernel
def tell_regimes(system: PageSystem, regimes: Indices) -> None:
    """Write the regimes of the switches, and the times of the next changes (s), to the controls."""
    for i in range(system.switches):
        regime = regimes[system.law_count + i]
        place = system.switch_controls + 2 * i
        system.controls[place] = regime % 2
        system.controls[place + 1] = next_change(system.timing, i, regime) if i < system.programs else 0.0


@borrowing_kernel
def put_back(system: PageSystem, y: Array) -> float:
    """Solve the loop closures for the dependent coordinates by Newton's method; return their regularity (1: best)."""
    n, nz = system.free, system.dependent
    least = 1.0
    for _ in range(ROUNDS if nz else 0):
        call_straight_line(system.correction, system.numbers, system.controls, 0.0, y, system.corrections)
        reach = 0.0
        for i in range(nz):
            change = system.corrections[i]
            y[2 * n + i] += change
            reach = max(reach, abs(change) / (1.0 + abs(y[2 * n + i])))
        if not reach > CLOSED:
            break
    for i in range(2 * nz, len(system.corrections) if nz else 0):
        least = min(least, system.corrections[i])
    return least


@borrowing_kernel
def close_drifted(page: PageSystem, system: Any, t: float, y: Array, regimes: Indices, room: Room) -> bool:
    """Put closed contacts back to gap and velocity 0 where they drifted by integration; return whether one had.

    The laws that hold move by the least change in the metric of the mass matrix, as by an impulse.
    """
    at, drifted = room.at, False
    for i in range(page.law_count):
        closed = regimes[i] == HOLD and page.restitutions[i] >= 0.0
        drifted = drifted or (closed and abs(at.gap[i]) > CLOSED_M)
    if not drifted:
        return False
    prepare_instant(system, t, y, regimes, at)
    for i in range(page.law_count):
        gap = at.gap[i] if regimes[i] == HOLD and page.restitutions[i] >= 0.0 else 0.0
        at.drift[i], at.velocity[i], room.struck[i] = gap, gap, 0
    clear(room.before)
    halt(room.before, regimes, at, room.struck, at.multiplier)
    for k in range(page.free):
        y[k] += room.before[page.free + k]
    put_back(page, y)
    prepare_instant(system, t, y, regimes, at)
    halt(y, regimes, at, room.struck, at.multiplier)
    return True


@declares(laws.evaluate, PageSystem)
def evaluate_page(system: PageSystem, t: float, y: Array, regimes: Indices, at: Equations) -> None:
    """Fill masses, forces and laws from the generated function."""
    values = system.values
    call_straight_line(system.instant, system.numbers, system.controls, t, y, values)
    n = system.free
    for i in range(n):
        for j in range(n):
            at.mass[i, j] = values[i * n + j]
        at.force[i] = values[n * n + i]
    width = n + system.driven + 5
    for i in range(system.law_count):
        place = system.law_values + i * width
        for j in range(n):
            at.directions[i, j] = values[place + j]
        place += n + system.driven
        at.drift[i], at.bias[i], at.gap[i] = values[place], values[place + 1], values[place + 2]
        at.low[i], at.high[i] = values[place + 3], values[place + 4]
        at.restitution[i] = system.restitutions[i]


@borrowing_kernel
def driving_effort(system: PageSystem, which: int, acceleration: Array, multiplier: Array) -> float:
    """Return the effort (N m or N) that drives a driven coordinate, at the instant evaluated last."""
    n = system.free
    place = n * n + n + which * (n + 1)
    total = -system.values[place + n]
    for j in range(n):
        total += system.values[place + j] * acceleration[j]
    width = n + system.driven + 5
    for i in range(system.law_count):
        total -= system.values[system.law_values + i * width + n + which] * multiplier[i]
    return float(total)


@borrowing_kernel
def gas_values(system: PageSystem) -> int:
    """Return the index in the values of the gas springs: rates of the amounts, then the amounts with an open port."""
    return system.follow_values + system.dependent + system.worked + 2 * system.switches


@declares(laws.accumulate, PageSystem)
def accumulate_page(system: PageSystem, t: float, y: Array, regimes: Indices, at: Equations, out: Array) -> None:
    """Fill rates of dependent and driven coordinates, powers (W) of drives, elements and laws, and gas rates."""
    n, nz, nr = system.free, system.dependent, system.driven
    place = 2 * n
    for i in range(nz):
        out[place + i] = system.values[system.follow_values + i]
    place += nz
    for i in range(nr):
        out[place + i], out[place + nr + i] = y[place + nr + i], system.controls[i]
    speeds, place = place + nr, place + 2 * nr
    for i in range(nr):
        out[place + i] = driving_effort(system, i, at.acceleration, at.multiplier) * y[speeds + i]
    place += nr
    for i in range(system.worked):
        out[place + i] = system.values[system.follow_values + nz + i]
    place += system.worked
    for i in range(system.law_count):
        out[place + i] = at.multiplier[i] * at.velocity[i]
    place += system.law_count
    for i in range(1 + system.resets):
        out[place + i] = 0.0
    place += 1 + system.resets
    for i in range(system.gases):
        out[place + i] = system.values[gas_values(system) + i]


@declares(laws.fill_signals, PageSystem)
def signal_switches(
    system: PageSystem, t: float, y: Array, regimes: Indices, at: Equations, values: Array, rates: Array
) -> None:
    """Fill the event functions of the switches, such as the time to a program's next change or a compliant gap."""
    place = system.follow_values + system.dependent + system.worked
    for i in range(system.switches):
        values[2 * system.law_count + i] = system.values[place + 2 * i]
        rates[2 * system.law_count + i] = system.values[place + 2 * i + 1]


@declares(laws.begin_piece, PageSystem)
def begin_page(system: PageSystem, t: float, y: Array, regimes: Indices) -> None:
    """Pass the regimes to the generated functions."""
    tell_regimes(system, regimes)


@declares(laws.end_piece, PageSystem)
def end_page(system: PageSystem, t: float, before: Array, y: Array, regimes: Indices) -> None:
    """Restore the loop closures, see `put_back`."""
    put_back(system, y)


@borrowing_kernel
def energy_of(system: PageSystem, t: float, y: Array, out: Array) -> float:
    """Return kinetic and potential energy of a state (J); ``out`` is filled with the report."""
    call_straight_line(system.report, system.numbers, system.controls, t, y, out)
    return float(out[system.energies] + out[system.energies + 1])


@borrowing_kernel
def beyond_elements(system: PageSystem, t: float, y: Array, tables: int, begun: Array) -> int:
    """Return the status of a gas spring beyond zero volume, or of a line that turned over; 0 without.

    ``begun`` is the report at the beginning of the step: ends that pass each other turn their line over within it.
    """
    place = system.energies + 2 + tables
    if place < len(begun):
        energy_of(system, t, y, system.values)
    for k in range(system.gases):
        if not system.values[place + k] > LEAST_VOLUME:
            return BEYOND - k
    for k in range((len(begun) - place - system.gases) // 2):
        x = place + system.gases + 2 * k
        if system.values[x] * begun[x] + system.values[x + 1] * begun[x + 1] < 0.0:
            return max(BEYOND - system.gases - k, LAST_BEYOND)
    return 0


@borrowing_kernel
def reset_joint(system: PageSystem, which: int, t: float, y: Array, regimes: Indices) -> None:
    """Reset a free coordinate to its start, add the energy change to its work; reset the regimes of its laws."""
    n, k, before = system.free, system.changes[which], energy_of(system, t, y, system.values)
    y[k], y[n + k] = system.timing[which, 0], system.timing[which, 1]
    put_back(system, y)
    books = len(y) - system.gases - system.resets
    y[books + which - (system.switches - system.resets)] += energy_of(system, t, y, system.values) - before
    call_straight_line(system.instant, system.numbers, system.controls, t, y, system.values)
    for i in range(system.law_count):
        place = system.law_values + i * (n + system.driven + 5)
        if system.values[place + k] != 0.0:
            v = system.values[place + n + system.driven]
            for j in range(n):
                v += system.values[place + j] * y[n + j]
            regimes[i] = OPEN if system.restitutions[i] >= 0.0 else LOW if v > 0.0 else HIGH if v < 0.0 else HOLD


@declares(laws.pass_signal, PageSystem)
def pass_switch(system: PageSystem, which: int, t: float, y: Array, regimes: Indices, log: Array, count: int) -> int:
    """Switch to the next phase of a program, reset a joint, or switch a contact, port or segment of a table."""
    place, kind = system.law_count + which, system.kinds[which]
    regimes[place] = regimes[place] + 1 if kind == PHASE else 1 - regimes[place]
    if kind == BEND:
        return count
    if kind == PORT and regimes[place] == 0:
        call_straight_line(system.instant, system.numbers, system.controls, t, y, system.values)
        gas = system.changes[which]
        y[len(y) - system.gases + gas] = system.values[gas_values(system) + system.gases + gas]
    if kind == RESET:
        reset_joint(system, which, t, y, regimes)
    contact_event = CONTACT if regimes[place] == 1 else RELEASE
    fill_event(log, count, t, contact_event if kind == TOUCH else SWITCH, place, 0.0, 0.0, 0.0, 0.0)
    return count + 1


@declares(laws.change_regimes, PageSystem)
def log_changes(
    system: PageSystem, t: float, y: Array, past: Indices, regimes: Indices, at: Equations, log: Array, count: int
) -> int:
    """Log contacts that close or separate, and joints that stick or slip."""
    for i in range(system.law_count):
        if past[i] == regimes[i]:
            continue
        if system.restitutions[i] >= 0.0:
            kind = CONTACT if regimes[i] == HOLD else RELEASE
            if past[i] == OPEN and regimes[i] != HOLD:
                continue
        elif regimes[i] == HOLD:
            kind = STICK
        elif past[i] == HOLD:
            kind = SLIP
        else:
            continue
        fill_event(log, count, t, kind, i, 0.0, 0.0, 0.0, 0.0)
        count += 1
    return count


@declares(laws.begin_impact, PageSystem)
def begin_blow(system: PageSystem, t: float, y: Array, regimes: Indices, at: Equations) -> None:
    """Fill the restitution of each struck rod; the striker's effective mass is plastic impulse over closing speed."""
    if len(system.struck) == 0:
        return
    seek_impulses(regimes, at, system.marks, 0.0)
    for i in range(len(system.struck)):
        law = system.struck[i]
        closing, impulse = -at.velocity[law], at.multiplier[law]
        if system.marks[law] == STRUCK and impulse > 0.0:
            e = rod_restitution(system.rods, i, impulse / closing, closing)
            at.restitution[law] = system.restitutions[law] = e


@borrowing_kernel
def kinetic_change(system: PageSystem, before: Array, y: Array, at: Equations) -> float:
    """Return the change of kinetic energy (J) by the change of the free coordinates' speeds."""
    n, nr = system.free, system.driven
    w = 2 * n + system.dependent + nr
    total = 0.0
    for i in range(n):
        moved = y[n + i] - before[n + i]
        for j in range(n):
            total += 0.5 * at.mass[i, j] * moved * (y[n + j] + before[n + j])
        for k in range(nr):
            total += moved * system.values[n * n + n + k * (n + 1) + i] * y[w + k]
    return total


@declares(laws.note_impact, PageSystem)
def note_page_impact(
    system: PageSystem, t: float, before: Array, y: Array, at: Equations, log: Array, count: int
) -> int:
    """Log the impulses, with approach speeds positive; add the impact's loss and the drives' work to the integrals."""
    n, nr, nz = system.free, system.driven, system.dependent
    change = kinetic_change(system, before, y, at)
    books, speeds = 2 * n + nz + 2 * nr, 2 * n + nz + nr
    width = n + nr + 5
    for k in range(nr):
        impulse = 0.0
        for j in range(n):
            impulse += system.values[n * n + n + k * (n + 1) + j] * (y[n + j] - before[n + j])
        for i in range(system.law_count):
            impulse -= system.values[system.law_values + i * width + n + k] * at.multiplier[i]
        y[books + k] += impulse * y[speeds + k]
        change -= impulse * y[speeds + k]
    y[books + nr + system.worked + system.law_count] += change
    for i in range(system.law_count):
        if at.multiplier[i] != 0.0:
            v, past = at.drift[i], at.drift[i]
            for j in range(n):
                v += at.directions[i, j] * y[n + j]
                past += at.directions[i, j] * before[n + j]
            fill_event(log, count, t, IMPACT, i, -past, -v, at.multiplier[i], 0.0)
            count += 1
    return count


@borrowing_kernel
def starting_regimes(velocity: Array, gap: Array, restitution: Array, regimes: Indices, candidates: Indices) -> None:
    """Fill the regimes of moving and open laws; mark those at rest as candidates for `settle_regimes`."""
    for i in range(len(gap)):
        candidates[i] = 0
        still = abs(velocity[i]) <= 1e-12
        if restitution[i] >= 0.0:
            regimes[i] = OPEN
            if gap[i] <= 1e-12 and still:
                regimes[i], candidates[i] = HOLD, 1
        elif still:
            regimes[i], candidates[i] = HOLD, 1
        else:
            regimes[i] = LOW if velocity[i] > 0.0 else HIGH
