# SPDX-License-Identifier: Apache-2.0
"""Equations of motion of the breaker for the event loop: crank, body and tool under six laws, and the logged events.

Laws: the body on its collar, the wall that the tool goes into, the striker on the tool, and bearings and gear
(`joint_laws`).  Further signals: dead centres, a crank that stops as it presses on the tool, a motor torque of zero.
A blow of a tool in which waves run is an event of its own: `impacts` gives the velocities after it.
"""

import math
from typing import NamedTuple

from mech_twin.engine.addresses import record_at
from mech_twin.engine.hybrid import laws
from mech_twin.engine.hybrid.complementarity import CLOSED_M
from mech_twin.engine.hybrid.laws import HOLD, LOW, OPEN, Array, Equations, Indices
from mech_twin.engine.hybrid.motion import find_accelerations
from mech_twin.engine.sample_vectors import IMPULSE, KIND, POST_VELOCITY, PRE_VELOCITY
from mech_twin.kernels.kernel import borrowing_kernel, embedded_kernel, inline_kernel
from mech_twin.machines.mb10_breaker.dynamics import Breaker, masses, spring_moment, striker_travel
from mech_twin.machines.mb10_breaker.impacts import struck_tool
from mech_twin.machines.mb10_breaker.joint_laws import (
    Torques,
    begin_row,
    crank_shares,
    effect_of_impact,
    end_row,
    join_laws,
    log_bearings,
    log_contacts,
    log_row,
    on_collar,
    on_wall,
    project_contact,
    reported_torques,
    reseat_tool,
    striking,
    to_dead_centre,
)
from mech_twin.machines.mb10_breaker.state import (
    ANGULAR_IMPULSE,
    BODY,
    BODY_RATE,
    CRANK,
    CRANK_RATE,
    DAMPING_LOSS,
    DRIVE_WORK,
    EVENT,
    FREEDOMS,
    LAW,
    LAWS,
    MEMORY,
    TOOL,
    TOOL_RATE,
    WALL_WORK,
)
from mech_twin.parts.four_bar import coefficients, position
from mech_twin.parts.friction_and_gear import gear_split, gear_torque
from mech_twin.parts.induction_motor import (
    MotorInStep,
    command_in_step,
    motor_command_slope,
    motor_torque_slope,
    torque_in_step,
)

# own signals
DEAD_CENTRE, CRANK_STOPS, TORQUE_TURNS, BODY_TURNS = range(4)
OWN_SIGNALS = 4
# kept from piece to piece: of an instant the moment on the body, the crank's torque without the gear's loss and that,
# the slope of the striker's travel, the rocker's direction; the crank's next dead centre; the sense of the motor's
# torque, 0 within an impact; what is struck, and that before it the body was at rest, or the striker on the tool;
# torques before it; whether the striker stays on the tool, and goes forward as the crank does
MOMENT, BASE, LOSS, SLOPE, ROCKER_X, ROCKER_Y, DEAD_RAD, TORQUE_SENSE, STRUCK, RESTED, REBOUNDS = range(11)
DRIVE_BEFORE, THRUST_BEFORE, CRANK_BEFORE, BODY_BEFORE, TOGETHER, OWN_IMPACT, SIDE, KEPT = range(11, 19)
NOTHING, COLLAR_STRUCK, TOOL_STRUCK = range(3)
SLOWEST_REBOUND_M_PER_S = 1e-6  # a slower rebound of striker and tool, or of a pushing body, is taken as plastic
GAP_M = 2e-15  # twice a gap of the size of rounding: a rebound that stays within it is plastic, too
AT_EXTREME = 1e-9  # of the striker's arm: travel of its face over the crank's turn, next to an extreme
TOUCH_M_PER_S = 1e-12
SETTLED_IN_STEP = 1e-6  # of a step: with friction, bounces that last no longer are not resolved


@laws.of_size(FREEDOMS, LAWS)
class BreakerMotion(NamedTuple):
    """The system: constants, and the motor in this step.

    ``memory`` is that of the linkage row, ``kept`` is kept from piece to piece, ``at`` the instant of the loop's room.
    """

    breaker: Breaker
    motor: MotorInStep
    begin_s: float
    step_s: float
    memory: Array
    kept: Array
    at: Equations


@inline_kernel
def rotor_speed(b: Breaker, u: float, p: float) -> float:
    """Return the rotor's speed (rad/s) at rates of crank and body."""
    return b.ratio * (u - b.frame_drive * p)


@inline_kernel
def motor_at(motion: BreakerMotion, t: float, u: float, p: float) -> float:
    """Return the motor's torque (N m) at a time of the step (s) and rates of crank and body (rad/s)."""
    return torque_in_step(motion.motor, t, rotor_speed(motion.breaker, u, p))


@laws.declares(laws.evaluate, BreakerMotion)
def evaluate_breaker(motion: BreakerMotion, t: float, y: Array, regimes: Indices, at: Equations) -> None:
    """Fill masses, forces, and the laws of collar, wall, striker, bearings and gear."""
    b, kept, q, phi, u, p = motion.breaker, motion.kept, y[CRANK], y[BODY], y[CRANK_RATE], y[BODY_RATE]
    joints = position(b.bar, q)
    by = coefficients(joints)
    m = masses(b, joints, by, phi)
    slope, bend = b.striker_arm_m * by.g3, b.striker_arm_m * by.g3_1
    rests, pressed = on_collar(b, regimes), on_wall(regimes)
    motor = motor_at(motion, t, u, p)
    drive, loss = gear_split(b.ratio, b.efficiency, motor)
    loss *= -1.0 if kept[TORQUE_SENSE] * motor < 0.0 else 1.0  # beyond the torque's turn, which ends the piece
    if rests and pressed:
        drive, loss = gear_torque(b.ratio, b.efficiency, motor, 0.0), 0.0
    kept[BASE], kept[LOSS], kept[SLOPE] = drive, loss, kept[SIDE] * abs(slope)
    kept[ROCKER_X], kept[ROCKER_Y] = joints.v_x, joints.v_y
    at.mass[0, 0], at.mass[1, 1], at.mass[2, 2] = m.m11, m.m22, b.tool_mass_kg
    at.force[0] = drive - b.crank_viscous_nms_per_rad * u + m.g_q - 0.5 * m.m11_q * u * u + 0.5 * m.m22_q * p * p
    at.directions[LAW.collar, 1], at.directions[LAW.wall, 2], at.directions[LAW.tool, 2] = 1.0, 1.0, 1.0
    at.directions[LAW.tool, 0], at.bias[LAW.tool] = -slope, -bend * u * u
    at.high[LAW.collar] = at.high[LAW.tool] = at.gap[LAW.tool] = math.inf  # the gap is a signal below
    at.restitution[LAW.collar], at.restitution[LAW.tool] = b.collar_restitution, b.tool_restitution
    pressed_nm, flies = spring_moment(b, phi), regimes[LAW.collar] == OPEN
    at.low[LAW.collar] = 0.0 if flies else -b.body_coulomb_nm - pressed_nm  # the springs' moment is the collar's
    least = b.crank_coulomb_nm / max(abs(slope), 1e-12) if rests and pressed else 0.0
    at.low[LAW.wall], at.high[LAW.wall], at.low[LAW.tool] = -b.wall_force_n - least, least, -least
    shares = crank_shares(b, loss, kept[SLOPE], regimes)
    if b.held:
        at.directions[LAW.crank, 0] = 1.0
    else:
        at.mass[0, 1] = at.mass[1, 0] = m.m12
        kept[MOMENT] = m.g_phi - b.frame_drive * drive - b.body_damping_nms_per_rad * p
        kept[MOMENT] -= pressed_nm if flies else 0.0
        at.force[1] = kept[MOMENT] - m.m12_q * u * u - m.m22_q * u * p
        at.directions[LAW.tool, 1] = b.tool_radius_m
        at.gap[LAW.collar] = phi
        one = shares.whole == 0.0
        at.directions[LAW.crank, 0] = 1.0 if one else (shares.bearing + shares.gear) / shares.whole
        at.directions[LAW.crank, 1] = 0.0 if one else (shares.pivot - b.frame_drive * shares.gear) / shares.whole
        at.directions[LAW.pivot, 1], at.directions[LAW.gear, 0], at.directions[LAW.gear, 1] = 1.0, 1.0, -b.frame_drive
    at.low[LAW.crank], at.high[LAW.crank] = -shares.whole, shares.whole
    at.low[LAW.pivot], at.high[LAW.pivot] = -b.body_coulomb_nm, b.body_coulomb_nm
    at.low[LAW.gear], at.high[LAW.gear] = -loss, loss


@inline_kernel
def torques_of(motion: BreakerMotion, regimes: Indices, at: Equations) -> Torques:
    """Return the torques of drive and friction and the tool force at the instant evaluated last."""
    kept = motion.kept
    return reported_torques(motion.breaker, kept[BASE], kept[LOSS], kept[SLOPE], regimes, at.multiplier, at.low)


@borrowing_kernel
def torques_at(motion: BreakerMotion, t: float, y: Array, regimes: Indices, at: Equations) -> Torques:
    """Return the torques of drive and friction and the tool force in a state."""
    find_accelerations(motion, t, y, regimes, at)
    return torques_of(motion, regimes, at)


@laws.declares(laws.accumulate, BreakerMotion)
def accumulate_works(motion: BreakerMotion, t: float, y: Array, regimes: Indices, at: Equations, out: Array) -> None:
    """Fill the power of drive, of damping and friction, and of the wall (W), and the total external moment (N m)."""
    b, u, p, now = motion.breaker, y[CRANK_RATE], y[BODY_RATE], torques_of(motion, regimes, at)
    moment = motion.kept[MOMENT]
    for law in range(LAWS):
        moment += at.directions[law, 1] * at.multiplier[law]
    out[DRIVE_WORK] = now.drive_nm * (u - b.frame_drive * p)
    out[DAMPING_LOSS] = b.body_damping_nms_per_rad * p * p + b.crank_viscous_nms_per_rad * u * u
    out[DAMPING_LOSS] -= now.crank_nm * u + now.body_nm * p
    out[ANGULAR_IMPULSE], out[WALL_WORK] = moment, -at.multiplier[LAW.wall] * y[TOOL_RATE]


@laws.declares(laws.fill_signals, BreakerMotion)
def signal_events(
    motion: BreakerMotion, t: float, y: Array, regimes: Indices, at: Equations, values: Array, rates: Array
) -> None:
    """Fill angle left to the dead centre, crank speed up to a stop, reversal of the body, and signed motor torque."""
    kept, begin, b, motor = motion.kept, 2 * LAWS, motion.breaker, motion.motor
    for i in range(OWN_SIGNALS):
        values[begin + i], rates[begin + i] = math.inf, 0.0
    if regimes[LAW.tool] == OPEN:
        lift = 0.0 if motion.breaker.held else motion.breaker.tool_radius_m * y[BODY]
        values[2 * LAW.tool] = lift + y[TOOL] - striker_travel(b, kept[ROCKER_X], kept[ROCKER_Y])
    values[begin + DEAD_CENTRE], rates[begin + DEAD_CENTRE] = kept[DEAD_RAD] - y[CRANK], -y[CRANK_RATE]
    free = regimes[LAW.tool] == HOLD and regimes[LAW.crank] == OPEN
    if free and y[CRANK_RATE] > 0.0 and record_at(motion.memory, 0, MEMORY).stalled == 0.0:
        values[begin + CRANK_STOPS], rates[begin + CRANK_STOPS] = y[CRANK_RATE], at.acceleration[0]
    if on_wall(regimes) and motion.breaker.body_coulomb_nm > 0.0 and not on_collar(motion.breaker, regimes):
        turning = -at.bias[LAW.tool] / y[CRANK_RATE] if y[CRANK_RATE] != 0.0 else 0.0
        values[begin + BODY_TURNS] = -kept[SIDE] * at.directions[LAW.tool, 0]
        rates[begin + BODY_TURNS] = kept[SIDE] * turning
    if motor.command != 0.0 and b.efficiency < 1.0:
        u, p, faster = y[CRANK_RATE], y[BODY_RATE], rotor_speed(b, at.acceleration[0], at.acceleration[1])
        rotor, command = rotor_speed(b, u, p), command_in_step(motor, t)
        rate = motor_torque_slope(motor.curve, rotor, command) * faster
        if motor.command_per_s != 0.0:
            rate += motor_command_slope(motor.curve, rotor, command) * motor.command_per_s
        values[begin + TORQUE_TURNS] = kept[TORQUE_SENSE] * motor_at(motion, t, u, p)
        rates[begin + TORQUE_TURNS] = kept[TORQUE_SENSE] * rate


@laws.declares(laws.begin_piece, BreakerMotion)
def look_ahead(motion: BreakerMotion, t: float, y: Array, regimes: Indices) -> None:
    """Store the next dead centre (rad), the direction of the striker, and the sense of the motor's torque."""
    b, kept = motion.breaker, motion.kept
    kept[DEAD_RAD] = y[CRANK] + to_dead_centre(b, y[CRANK])
    turn = coefficients(position(b.bar, y[CRANK])).g3
    kept[SIDE] = math.copysign(1.0, turn) if abs(turn) > AT_EXTREME or kept[SIDE] == 0.0 else kept[SIDE]
    sense = 1.0 if motor_at(motion, t, y[CRANK_RATE], y[BODY_RATE]) >= 0.0 else -1.0
    kept[TORQUE_SENSE] = kept[TORQUE_SENSE] or sense


@laws.declares(laws.end_piece, BreakerMotion)
def put_back(motion: BreakerMotion, t: float, before: Array, y: Array, regimes: Indices) -> None:
    """Remove drift by rounding from holding joints and contacts."""
    b = motion.breaker
    if regimes[LAW.crank] == HOLD or (on_collar(b, regimes) and on_wall(regimes)):
        y[CRANK_RATE] = 0.0
    if regimes[LAW.gear] == HOLD:
        y[CRANK_RATE] = b.frame_drive * y[BODY_RATE]
    if regimes[LAW.tool] == HOLD:
        project_contact(b, y, regimes)


@laws.declares(laws.pass_signal, BreakerMotion)
def pass_event(motion: BreakerMotion, which: int, t: float, y: Array, regimes: Indices, log: Array, count: int) -> int:
    """Reseat the tool where the rocker begins its pass; log a pass without a blow, and a stop."""
    b, memory, kept = motion.breaker, record_at(motion.memory, 0, MEMORY), motion.kept
    kind = EVENT.stalled
    if which == TORQUE_TURNS:
        kept[TORQUE_SENSE] = -kept[TORQUE_SENSE]
        return count
    if which == BODY_TURNS:  # with the rocker, at its extreme
        was = torques_at(motion, t, y, regimes, motion.at)
        kept[SIDE], memory.body_sense = -kept[SIDE], -memory.body_sense
        now = torques_at(motion, t, y, regimes, motion.at)
        return log_row(b, motion.begin_s + t, EVENT.body_reversed, memory.cycle, y, was, now, log, count)
    if which == DEAD_CENTRE:
        memory.stalled, kind = 0.0, EVENT.missed
        if not striking(b, y[CRANK]):  # for the next pass the tool is taken back to its seat
            reseat_tool(b, y, regimes, memory)
            return count
        if memory.pass_done != 0.0:
            return count
    else:
        memory.stalled = 1.0
    now = torques_at(motion, t, y, regimes, motion.at)
    count = log_row(b, motion.begin_s + t, kind, memory.cycle, y, now, now, log, count)
    if kind == EVENT.missed:
        memory.pass_done, memory.cycle = 1.0, memory.cycle + 1.0
    return count


@laws.declares(laws.begin_impact, BreakerMotion)
def meet(motion: BreakerMotion, t: float, y: Array, regimes: Indices, at: Equations) -> None:
    """Store the state before an impact; a slow one is plastic, and the tool's is postponed after the collar's."""
    b, kept = motion.breaker, motion.kept
    now, kept[TORQUE_SENSE] = torques_of(motion, regimes, at), 0.0
    parting = -b.tool_restitution * at.velocity[LAW.tool]
    regimes[LAW.wall] = HOLD if regimes[LAW.wall] == OPEN else regimes[LAW.wall]
    kept[DRIVE_BEFORE], kept[THRUST_BEFORE], kept[CRANK_BEFORE], kept[BODY_BEFORE] = now
    kept[RESTED], kept[STRUCK], kept[REBOUNDS] = 1.0 if on_collar(b, regimes) else 0.0, TOOL_STRUCK, 1.0
    if regimes[LAW.collar] == OPEN and at.gap[LAW.collar] <= CLOSED_M and at.velocity[LAW.collar] < 0.0:
        kept[STRUCK], at.gap[LAW.tool] = COLLAR_STRUCK, math.inf
        e, fall = b.collar_restitution, -at.law_acceleration[LAW.collar]
        if b.body_coulomb_nm > 0.0 and -2.0 * e * y[BODY_RATE] <= SETTLED_IN_STEP * motion.step_s * fall * (1.0 - e):
            at.restitution[LAW.collar] = 0.0
        if regimes[LAW.tool] == HOLD:
            regimes[LAW.tool] = OPEN
            if -e * b.tool_radius_m * y[BODY_RATE] <= SLOWEST_REBOUND_M_PER_S:
                at.restitution[LAW.collar] = 0.0
    elif -at.velocity[LAW.tool] < TOUCH_M_PER_S and at.law_acceleration[LAW.tool] > 0.0:
        kept[STRUCK], at.gap[LAW.tool] = NOTHING, math.inf  # a touch within rounding that already opens
    elif parting <= SLOWEST_REBOUND_M_PER_S or parting * parting <= -GAP_M * at.law_acceleration[LAW.tool]:
        at.restitution[LAW.tool] = kept[REBOUNDS] = 0.0


@laws.declares(laws.note_impact, BreakerMotion)
def tell_impact(motion: BreakerMotion, t: float, before: Array, y: Array, at: Equations, log: Array, count: int) -> int:
    """Add the losses and impulses of an impact, and write the first half of its event row."""
    b, kept, memory, begin_s = motion.breaker, motion.kept, record_at(motion.memory, 0, MEMORY), motion.begin_s
    if kept[STRUCK] == NOTHING:
        return count
    if kept[RESTED] == 1.0 and at.multiplier[LAW.collar] > 0.0:
        y[BODY_RATE] = 0.0
    was = Torques(kept[DRIVE_BEFORE], kept[THRUST_BEFORE], kept[CRANK_BEFORE], kept[BODY_BEFORE])
    loss, turned, closing, closes = effect_of_impact(at, before, y)
    if kept[STRUCK] == COLLAR_STRUCK:
        y[BODY] = 0.0
        begin_row(b, begin_s + t, EVENT.touchdown, memory.cycle, before, was, log, count)
        log[count, PRE_VELOCITY] = b.tool_radius_m * before[BODY_RATE]
        log[count, POST_VELOCITY] = b.tool_radius_m * y[BODY_RATE]
        log[count, IMPULSE] = at.multiplier[LAW.collar] / b.tool_radius_m
        memory.collar_loss_j += loss
    else:
        first, rested, struck = memory.pass_done == 0.0, kept[RESTED] == 1.0, at.multiplier[LAW.tool]
        if first and not rested:  # the body is off its collar: the tool is not pressed on the wall
            count = log_row(b, begin_s + t, EVENT.off_collar, memory.cycle, before, was, was, log, count)
        begin_row(b, begin_s + t, EVENT.blow if first else EVENT.catch_up, memory.cycle, before, was, log, count)
        wave, slow = b.waves and kept[REBOUNDS] == 1.0, 0.0 < b.tool_radius_m * y[BODY_RATE] <= SLOWEST_REBOUND_M_PER_S
        kept[OWN_IMPACT] = 0.0
        if wave or (rested and kept[REBOUNDS] == 0.0 and slow):
            hit = struck_tool(b, before, rested, wave)
            y[CRANK_RATE], y[BODY_RATE], y[TOOL_RATE] = hit.u, hit.p, hit.tool_speed
            y[TOOL] = before[TOOL] + hit.tool_travel
            loss, struck, closes, turned = hit.loss, hit.impulse, hit.closing, hit.collar_nms
            turned += b.tool_radius_m * hit.impulse
            kept[OWN_IMPACT], kept[TOGETHER] = 1.0, 1.0 if hit.together else 0.0
        log[count, PRE_VELOCITY], log[count, POST_VELOCITY], log[count, IMPULSE] = closing, closes, struck
        memory.blow_loss_j += loss
        memory.pass_done, memory.cycle = 1.0, memory.cycle + (1.0 if first else 0.0)
    memory.impact_impulse_nms += turned
    return count + 1


@embedded_kernel
def follow_impact(motion: BreakerMotion, t: float, y: Array, regimes: Indices, at: Equations) -> None:
    """Fill the regimes after an impact on the tool that `impacts.struck_tool` computes."""
    b, kept, memory = motion.breaker, motion.kept, record_at(motion.memory, 0, MEMORY)
    regimes[LAW.collar] = HOLD if kept[RESTED] == 1.0 and y[BODY_RATE] <= 0.0 and not b.held else OPEN
    regimes[LAW.wall] = LOW if y[TOOL_RATE] > 0.0 else HOLD
    regimes[LAW.tool] = HOLD if kept[TOGETHER] == 1.0 else OPEN
    regimes[LAW.crank] = regimes[LAW.pivot] = regimes[LAW.gear] = OPEN
    join_laws(b, y, regimes, memory.crank_sense, memory.body_sense)
    if kept[TOGETHER] == 1.0 and torques_at(motion, t, y, regimes, at).tool_force_n <= 0.0:
        regimes[LAW.tool] = OPEN


@laws.declares(laws.change_regimes, BreakerMotion)
def change_motion(
    motion: BreakerMotion, t: float, y: Array, past: Indices, regimes: Indices, at: Equations, log: Array, count: int
) -> int:
    """Activate or merge the laws of bearings and gear, and log the changes of regime."""
    b, kept, memory = motion.breaker, motion.kept, record_at(motion.memory, 0, MEMORY)
    struck, kept[STRUCK] = kept[STRUCK], NOTHING
    was = Torques(kept[DRIVE_BEFORE], kept[THRUST_BEFORE], kept[CRANK_BEFORE], kept[BODY_BEFORE])
    if struck == NOTHING:
        was = torques_at(motion, t, y, past, at)
    elif struck == TOOL_STRUCK and kept[OWN_IMPACT] == 1.0:
        follow_impact(motion, t, y, regimes, at)
    crank, body = memory.crank_sense, memory.body_sense
    if struck == NOTHING and past[LAW.collar] == HOLD:
        body = 1.0  # it leaves its collar
    if on_collar(b, past) and on_wall(past):  # what stood sets off the way it was pressed
        crank = 1.0 if regimes[LAW.tool] == HOLD else -1.0 if b.crank_coulomb_nm > 0.0 else 0.0
    join_laws(b, y, regimes, crank, body)
    if regimes[LAW.collar] == HOLD:
        y[BODY] = y[BODY_RATE] = 0.0
    now = torques_at(motion, t, y, regimes, at)
    if struck != NOTHING:
        end_row(b, y, now, log, count - 1)
        if struck == COLLAR_STRUCK and regimes[LAW.collar] == HOLD:
            log[count - 1, KIND] = EVENT.settled
        elif struck == TOOL_STRUCK and regimes[LAW.tool] == HOLD and log[count - 1, KIND] == EVENT.catch_up:
            log[count - 1, KIND] = EVENT.push_begins
    else:
        count = log_contacts(b, memory, motion.begin_s + t, y, past, regimes, was, now, log, count)
    return log_bearings(b, memory, motion.begin_s + t, struck == NOTHING, y, past, regimes, was, now, log, count)
