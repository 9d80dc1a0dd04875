# SPDX-License-Identifier: Apache-2.0
"""The roles of a page as kernels: drives, a coupling step, force analysis; compiled once for all pages."""

from typing import Any, NamedTuple

import numpy as np

from mech_twin.engine.compiled_steps import Work, copy_numbers, force_step, linkage_step, motor_step, step_of, work_room
from mech_twin.engine.hybrid.complementarity import SOLVED
from mech_twin.engine.hybrid.laws import OPEN, Array, Equations, Indices
from mech_twin.engine.hybrid.loop import CONTRADICTS, advance, let_open, room_sizes
from mech_twin.engine.hybrid.motion import find_accelerations, prepare_instant, settle_regimes
from mech_twin.engine.hybrid.type_erasure import declared
from mech_twin.engine.sample_vectors import COMMAND, LINKAGE_JOINTS, MOTOR_COMMAND, MOTOR_JOINTS, PINS, REGIME
from mech_twin.kernels.kernel import borrowing_kernel, kernel
from mech_twin.machines.page.system import (
    PageSystem,
    beyond_elements,
    close_drifted,
    driving_effort,
    energy_of,
    page_room,
    put_back,
    starting_regimes,
    tell_regimes,
)
from mech_twin.mechanics.code_generation import call_straight_line
from mech_twin.parts.induction_motor import (
    MotorConstants,
    limited_change,
    limited_command,
    motor_command_slope,
    motor_torque,
    motor_torque_slope,
)

SPEED, EFFORT, PROGRAM, DC, INDUCTION, TABLE = range(6)
KIND, COLUMN, RATIO, FIRST, SECOND, SWITCHED = range(6)  # of a row of the drives; then the induction motor's numbers
MOTOR_NUMBERS, DRIVE_WIDTH = 6, 14
ROUNDING = 1.0 + 1e-9
NEAR_DEAD_POINT = -10
ASKED = 1e-3  # of full effort: an effort without supply that differs more from the drive's own is commanded
UNLOADED = 1e-7  # of the greatest force: a joint with less carries rounding of the others
REGULAR = 1e-3  # least regularity of the closures: the sine of an angle between links


class PageDrives(NamedTuple):
    """Constants of the motor role: a row for each drive, rate of the supply (1/s), coupling step (s)."""

    drives: Array
    switches: int  # where their regimes begin in a linkage row
    tables: int  # where begins what drives by table give under full supply
    rate_per_s: float
    step_s: float


class PageMachine(NamedTuple):
    """Constants of the linkage role; places are of a linkage row and its memory."""

    system: PageSystem
    drives: Array
    columns: Indices  # of the joints of free, dependent and driven coordinates
    tolerance: Array
    reported: Array  # room
    joints: int
    books: int
    kept: int  # the books, and the amounts of gas
    tables: int
    motors: int
    step_s: float


class PageForces(NamedTuple):
    """Constants of the force analysis."""

    machine: PageMachine
    reactions: int
    found: Array  # work array of the reactions
    pins: int
    quantities: int


@borrowing_kernel
def induction_motor(row: Array) -> MotorConstants:
    """Return the constants of a row's motor."""
    m = row[MOTOR_NUMBERS:]
    return MotorConstants(m[0], m[1], m[2], m[3], m[4], m[5], m[6], int(m[7]))


@borrowing_kernel
def effort_of(row: Array, speed: float, command: float) -> float:
    """Return the effort that a motor or constant effort gives at the speed of its shaft."""
    if int(row[KIND]) == INDUCTION:
        return motor_torque(induction_motor(row), speed, command)
    if int(row[KIND]) == DC:
        return float(row[FIRST] * (command - speed / row[SECOND]))
    return float(command * row[FIRST])


@step_of(motor_step, PageDrives)
def page_drives(model: PageDrives, linkage: Array, target: float, out: Array) -> None:
    """Fill ``out`` with position, speed and effort of each drive at its shaft; a prescribed speed is the command."""
    command = limited_command(linkage[COMMAND], target, model.rate_per_s, model.step_s)
    out[MOTOR_COMMAND] = command
    for i in range(len(model.drives)):
        row = model.drives[i]
        joint, place = LINKAGE_JOINTS + 3 * int(row[COLUMN]), MOTOR_JOINTS + 3 * i
        position, speed, ratio, kind = linkage[joint], linkage[joint + 1], row[RATIO], int(row[KIND])
        if kind == SPEED:
            reach = abs(row[FIRST]) * model.rate_per_s * model.step_s * ROUNDING
            speed, effort = limited_change(speed, command * row[FIRST], reach), linkage[joint + 2]
        elif kind == PROGRAM:
            regime = int(linkage[model.switches + int(row[SWITCHED])])
            effort = command * (row[FIRST] if regime % 2 == 0 else row[SECOND])
        elif kind == TABLE:
            effort = command * linkage[model.tables + int(row[SWITCHED])]
        else:
            effort = effort_of(row, ratio * speed, command)
        out[place], out[place + 1], out[place + 2] = ratio * position, ratio * speed, effort


@borrowing_kernel
def motor_controls(model: PageMachine, linkage: Array, motor: Array) -> None:
    """Fill the controls of the drives for the step: forces at mean supply with slopes by speed, or accelerations.

    Without supply, an effort that the drive does not give by itself is a commanded one, and held.
    """
    controls, command = model.system.controls, motor[MOTOR_COMMAND]
    place, led, mean = model.system.driven, 0, 0.5 * (linkage[COMMAND] + command)
    for i in range(len(model.drives)):
        row, at = model.drives[i], MOTOR_JOINTS + 3 * i
        ratio, kind, speed = row[RATIO], int(row[KIND]), linkage[LINKAGE_JOINTS + 3 * int(row[COLUMN]) + 1]
        if kind == SPEED:
            controls[led] = (motor[at + 1] - speed) / model.step_s
            led += 1
            continue
        first, slope = ratio * motor[at + 2], 0.0
        if kind == TABLE:
            first = ratio * mean
        elif kind == PROGRAM:
            first, slope = mean * row[FIRST], mean * row[SECOND]
        elif command != 0.0 or abs(motor[at + 2] - effort_of(row, motor[at + 1], 0.0)) < ASKED * abs(row[FIRST]):
            lead = row[FIRST]
            if kind == DC:
                slope = -ratio * ratio * row[FIRST] / row[SECOND]
            elif kind == INDUCTION:
                lead = motor_command_slope(induction_motor(row), ratio * speed, command)
                slope = ratio * ratio * motor_torque_slope(induction_motor(row), ratio * speed, command)
            first += ratio * lead * (mean - command)
        controls[place], controls[place + 1], controls[place + 2] = first, slope, speed
        place += 3


@borrowing_kernel
def memory_place(model: PageMachine) -> int:
    """Return the index in a linkage row where the memory begins."""
    return LINKAGE_JOINTS + 3 * model.joints


@borrowing_kernel
def fill_state(model: PageMachine, linkage: Array, y: Array, regimes: Indices) -> None:
    """Fill state and regimes from a linkage row."""
    s = model.system
    n, nz, nr = s.free, s.dependent, s.driven
    for i in range(n):
        joint = LINKAGE_JOINTS + 3 * model.columns[i]
        y[i], y[n + i] = linkage[joint], linkage[joint + 1]
    for i in range(nz):
        y[2 * n + i] = linkage[LINKAGE_JOINTS + 3 * model.columns[n + i]]
    for i in range(nr):
        joint = LINKAGE_JOINTS + 3 * model.columns[n + nz + i]
        y[2 * n + nz + i], y[2 * n + nz + nr + i] = linkage[joint], linkage[joint + 1]
    place = memory_place(model)
    for i in range(len(regimes)):
        regimes[i] = int(linkage[place + i])
    place += len(regimes)
    for i in range(model.kept):
        y[2 * n + nz + 2 * nr + i] = linkage[place + i]


@borrowing_kernel
def restore_solution(model: PageMachine, linkage: Array) -> None:
    """Fill the controls with accelerations, law forces and drive efforts from the memory of a linkage row."""
    s = model.system
    place = memory_place(model) + s.law_count + s.switches + model.kept
    begin = s.switch_controls + 2 * s.switches
    for i in range(s.free + s.law_count + s.driven):
        s.controls[begin + i] = linkage[place + i]
    place += s.free + s.law_count + s.driven
    for i in range(s.driven + 3 * model.motors):
        s.controls[i] = linkage[place + i]


@borrowing_kernel
def fill_efforts(
    model: PageMachine, regimes: Indices, acceleration: Array, multiplier: Array, place: int, out: Array
) -> None:
    """Write the efforts of the drives to their joints, and to the memory from index ``place`` on."""
    s, nr, led = model.system, model.system.driven, 0
    for i in range(len(model.drives)):
        if int(model.drives[i, KIND]) == SPEED:
            effort = driving_effort(s, led, acceleration, multiplier)
            out[place + led] = effort
            out[LINKAGE_JOINTS + 3 * int(model.drives[i, COLUMN]) + 2] += effort
            led += 1
    place += nr
    for i in range(nr + 3 * model.motors):
        out[place + i] = s.controls[i]
    given = nr
    for i in range(len(model.drives)):
        kind, joint = int(model.drives[i, KIND]), LINKAGE_JOINTS + 3 * int(model.drives[i, COLUMN])
        if kind == SPEED:
            continue
        effort = s.controls[given] + s.controls[given + 1] * (out[joint + 1] - s.controls[given + 2])
        if kind == PROGRAM:
            regime = regimes[s.law_count + int(model.drives[i, SWITCHED])]
            effort = s.controls[given] if regime % 2 == 0 else s.controls[given + 1]
        elif kind == EFFORT:
            effort = s.controls[given]
        elif kind == TABLE:
            effort = s.controls[given] * model.reported[2 * model.joints + 2 + int(model.drives[i, SWITCHED])]
        out[joint + 2] += effort
        given += 3


@borrowing_kernel
def fill_linkage(
    model: PageMachine, system: Any, t: float, y: Array, regimes: Indices, at: Equations, out: Array
) -> float:
    """Fill joints and memory of a linkage row at a state; return the kinetic and potential energy (J)."""
    s = model.system
    n, nz, nr, m = s.free, s.dependent, s.driven, s.law_count
    tell_regimes(s, regimes)
    find_accelerations(system, t, y, regimes, at)
    energy = energy_of(s, t, y, model.reported)
    out[REGIME] = 0.0
    for i in range(m):
        if s.restitutions[i] >= 0.0 and regimes[i] != OPEN:
            out[REGIME] = 1.0
    for i in range(model.joints):
        joint = LINKAGE_JOINTS + 3 * i
        out[joint], out[joint + 1], out[joint + 2] = model.reported[2 * i], model.reported[2 * i + 1], 0.0
    for i in range(n):  # as the loop has them, to the bit
        joint = LINKAGE_JOINTS + 3 * model.columns[i]
        out[joint], out[joint + 1] = y[i], y[n + i]
    place = memory_place(model)
    for i in range(len(regimes)):
        out[place + i] = regimes[i]
    place += len(regimes)
    for i in range(model.kept):
        out[place + i] = y[2 * n + nz + 2 * nr + i]
    place += model.kept
    for i in range(n):
        out[place + i] = at.acceleration[i]
    for i in range(m):
        out[place + n + i] = at.multiplier[i]
    place += n + m
    fill_efforts(model, regimes, at.acceleration, at.multiplier, place, out)
    tables = len(out) - 5 - nr - model.tables
    for i in range(model.tables):
        out[tables + i] = model.reported[2 * model.joints + 2 + i]
    return energy


@borrowing_kernel
def fill_residuals(model: PageMachine, y: Array, energy: float, begun: float, turned: float, out: Array) -> float:
    """Fill the largest loop closure error (m) and the relative energy error; return the first.

    ``begun`` (J) is the initial energy and that added by live changes of parameters, ``turned`` (J) the scale.
    """
    s = model.system
    books, misses, place = 0.0, 0.0, len(out) - 2
    for i in range(model.books):
        books += y[len(y) - model.kept + i]
    for i in range(s.dependent):
        misses = max(misses, abs(s.corrections[s.dependent + i]))
    out[place] = misses
    out[place + 1] = (energy - begun - books) / max(turned, 1e-9)
    return misses


@step_of(work_room, PageMachine, borrowing_kernel)
def room_of_step(model: PageMachine) -> tuple[int, int]:
    """Return the lengths of the work arrays of `page_step`."""
    s, size = model.system, len(model.tolerance)
    length, places = room_sizes(s.free, s.law_count, s.switches, size)
    return 2 * size + length, s.law_count + s.switches + places


@step_of(linkage_step, PageMachine, borrowing_kernel)
def page_step(
    model: PageMachine, step: int, linkage: Array, motor: Array, body: Array, out: Array, log: Array, work: Work
) -> int:
    """Fill ``out`` with the machine one coupling step later; events are located within the step."""
    s, t, size = model.system, step * model.step_s, len(model.tolerance)
    motor_controls(model, linkage, motor)
    y, regimes = work.numbers[:size], work.marks[: s.law_count + s.switches]
    room = page_room(s, size, work.numbers[size:], work.marks[len(regimes) :])
    copy_numbers(model.tolerance, room.tolerance)
    fill_state(model, linkage, y, regimes)
    forces = memory_place(model) + len(regimes) + model.kept + s.free
    for i in range(s.law_count):  # friction follows the force of its contact
        s.controls[s.switch_controls + 2 * s.switches + s.free + i] = linkage[forces + i]
    begun = linkage[len(out) - 5] + energy_of(s, t, y, model.reported) - linkage[len(out) - 3]
    system = declared(s, room.at)
    t = (step + 1) * model.step_s
    count = advance(system, step * model.step_s, t - step * model.step_s, y, regimes, room, log, 0)
    if count < 0:
        return count
    led, i = 2 * s.free + s.dependent + s.driven, 0
    for k in range(len(model.drives)):
        if int(model.drives[k, KIND]) == SPEED:  # compensated summation (Kahan)
            joint, kept = LINKAGE_JOINTS + 3 * int(model.drives[k, COLUMN]), len(out) - 5 - s.driven + i
            before, after = linkage[joint + 1], motor[MOTOR_JOINTS + 3 * k + 1]
            way = 0.5 * (before + after) * model.step_s - linkage[kept]
            y[led - s.driven + i] = linkage[joint] + way
            out[kept] = (y[led - s.driven + i] - linkage[joint]) - way
            y[led + i] = after
            i += 1
    if not put_back(s, y) > REGULAR:
        return NEAR_DEAD_POINT
    out[COMMAND] = motor[MOTOR_COMMAND]
    beyond = beyond_elements(s, t, y, model.tables, model.reported)
    if beyond < 0:
        return beyond
    energy = fill_linkage(model, system, t, y, regimes, room.at, out)
    if close_drifted(s, system, t, y, regimes, room):
        energy = fill_linkage(model, system, t, y, regimes, room.at, out)
    for k in range(s.law_count):
        if s.restitutions[k] >= 0.0 and regimes[k] != OPEN and room.at.gap[k] < -1e-6:  # given speeds press through
            return CONTRADICTS
    held, turned = len(out) - 5, linkage[len(out) - 4]
    for k in range(model.books):
        turned += abs(y[len(y) - model.kept + k] - linkage[memory_place(model) + len(regimes) + k])
    kinetic, potential = model.reported[2 * model.joints], model.reported[2 * model.joints + 1]  # may cancel
    turned = max(turned, kinetic, abs(potential))
    out[held], out[held + 1], out[held + 2] = begun, turned, energy
    fill_residuals(model, y, energy, begun, max(turned, abs(begun)), out)
    return count


@kernel
def start_page(model: PageMachine, t: float, y: Array, regimes: Indices, out: Array) -> int:
    """Fill a linkage row at the start with consistent regimes; return `SOLVED`, or less if laws are inconsistent."""
    s = model.system
    length, places = room_sizes(s.free, s.law_count, s.switches, len(y))
    room = page_room(s, len(y), np.zeros(len(y) + length), np.zeros(places, dtype=np.int64))
    system = declared(s, room.at)
    candidates = np.zeros(s.law_count, dtype=np.int64)
    put_back(s, y)
    tell_regimes(s, regimes)
    answer, found = SOLVED, s.switch_controls + 2 * s.switches + s.free
    for _ in range(2):  # friction follows the force of its contact
        prepare_instant(system, t, y, regimes, room.at)
        starting_regimes(room.at.velocity, room.at.gap, s.restitutions, regimes, candidates)
        answer = settle_regimes(system, t, y, regimes, candidates, room.at)
        for i in range(s.law_count):
            s.controls[found + i] = room.at.multiplier[i]
    let_open(room.at, regimes)
    energy = fill_linkage(model, system, t, y, regimes, room.at, out)
    held = len(out) - 5
    out[held], out[held + 1], out[held + 2] = energy, 0.0, energy
    fill_residuals(model, y, energy, energy, 1.0, out)
    return min(answer, SOLVED)


@borrowing_kernel
def fill_forces(model: PageForces, t: float, linkage: Array, y: Array, regimes: Indices, out: Array) -> None:
    """Fill the forces from a linkage row; ``y`` and ``regimes`` are work arrays."""
    machine, s = model.machine, model.machine.system
    fill_state(machine, linkage, y, regimes)
    tell_regimes(s, regimes)
    restore_solution(machine, linkage)
    call_straight_line(model.reactions, s.numbers, s.controls, t, y, model.found)
    out[0] = 0.0
    for i in range(3 * model.pins + model.quantities):
        out[PINS + i] = model.found[i]
    place, size, worst, greatest = 3 * model.pins + model.quantities, s.free + s.dependent + s.driven, 0.0, 0.0
    for i in range(size):
        greatest = max(greatest, model.found[place + size + i])
    for i in range(size):
        worst = max(worst, abs(model.found[place + i]) / max(model.found[place + size + i], UNLOADED * greatest, 1e-9))
    out[PINS + place] = worst


@step_of(work_room, PageForces, borrowing_kernel)
def room_of_forces(model: PageForces) -> tuple[int, int]:
    """Return the lengths of the work arrays of `page_forces`."""
    return len(model.machine.tolerance), model.machine.system.law_count + model.machine.system.switches


@step_of(force_step, PageForces, borrowing_kernel)
def page_forces(
    model: PageForces, step: int, linkage: Array, log: Array, count: int, out: Array, loads: Array, work: Work
) -> int:
    """Fill the forces in joints and elements, and the difference of the two routes to an effort."""
    fill_forces(model, step * model.machine.step_s, linkage, work.numbers, work.marks, out)
    return 0
