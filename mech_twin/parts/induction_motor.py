# SPDX-License-Identifier: Apache-2.0
r"""Three-phase induction motor: torque as a map of speed and supply fraction (Kloss).

::

    torque                      s_kr
      |                  _.-~-. |        M_max
      |  corrected  _.--'      `|.
      |~~~~~~~~~~~~~          . | \
      |   Kloss       __..--''      \  M_n
      |__..--''                      \
      +-------------------------------\-------> speed
      s = 1 (standstill)         s = 0 \        generating below the axis
                                (synchronous)

Torque is positive in the sense of the rotating field.  The slip is counted in the rated synchronous speed,
``s = (f w_0 - w)/w_0``: at constant ratio of voltage to frequency the flux is constant, so torque depends on the
slip *speed* alone.  At the rated supply (f = 1) this is the ordinary slip; at f < 1 the curve is moved along the
speed axis, with the same breakdown torque.  f = 0 is the supply switched off.

Source of the curve: KlossMotor1916, as used in LoveikinRoller2018 eq. (29) and (40).

With one line of the supply open its current is 0 and the other two are each other's opposite, so that the positive and
the negative sequence carry the same current and stand in series (FortescueSymmetrical1918)::

    I_1 = -I_2,      V = |I_1| |Z(s) + Z(2f - s)|,      M ~ |I_1|^2 (R/s - R/(2f - s))

With the impedance of Kloss, Z(s) = R/s + jX and R/X = s_kr at f = 1, and v = w/w_0::

    M = M_max s_kr v p/(p^2 + f^2 s_kr^2),      p = s (2f - s) = f^2 - v^2

A motor at rest stays there; one that turns keeps the slope of its working branch and about half its largest torque.
That is the mean torque; its swing at twice the frequency of the supply is left out.

The supply in force, a fraction of rated frequency, follows what was asked at a limited rate::

    fraction 1 |        ________   asked
               |       /           in force: at most rate_per_s
             0 |______/            0 is off: the motor gives no torque
"""

from __future__ import annotations

from math import pi, sqrt
from typing import Literal, NamedTuple

from pydantic import model_validator

from mech_twin.declarations.quantity import Parameters, choice, keep_at_most, quantity
from mech_twin.kernels.kernel import embedded_kernel, kernel

RPM = pi / 30.0
LONGEST_RUN_UP_S = 1e3  # of the rotor alone at rated power; motors take a fraction of a second
LEAST_RATED_SLIP, MOST_RATED_SLIP = 1e-4, 0.5
PRINTED_WITHIN = 1.25  # factor between a printed value and the one that follows from the name plate
KLOSS, CORRECTED, SINGLE_PHASE = range(3)
CURVES = ("kloss", "starting_corrected", "single_phase")  # in that order
PRINTED_SLIP_WITHIN = 2.0  # the same of the breakdown slip, which is no name plate value


class SupplyParameters(Parameters):
    """Supply of the drive: what is in force at the start, and how fast it follows the command."""

    initial_fraction: float = quantity("1", "fraction of rated supply frequency in force at the start", ge=0.0, le=1.0)
    rate_per_s: float = quantity("1/s", "largest change of the supply fraction per second", gt=0.0, live=True)


@kernel
def limited_change(value: float, wanted: float, reach: float) -> float:
    """Return ``value`` moved towards ``wanted`` by at most ``reach``, which it meets exactly."""
    if wanted > value + reach:
        return value + reach
    if wanted < value - reach:
        return value - reach
    return wanted


@kernel
def limited_command(command: float, target: float, rate_per_s: float, step_s: float) -> float:
    """Return the supply fraction one step later: ``command`` moved towards ``target`` by at most ``rate step``.

    Parameters
    ----------
    command : float
        Fraction in force at the step before.
    target : float
        Fraction asked for; kept within 0 and 1.
    rate_per_s : float
        Largest change per second, positive.
    step_s : float
        Length of the step, s.
    """
    return limited_change(command, min(max(target, 0.0), 1.0), rate_per_s * step_s)


class InductionMotorParameters(Parameters):
    """Name plate and catalogue data of a squirrel-cage motor.

    The optional values replace the derived ones where a source prints its own rounding of them.
    """

    catalogue_name: str | None = choice("motor of the table whose data these are", default=None)
    rated_power_w: float = quantity("W", "rated shaft power", gt=0.0)
    rated_speed_rpm: float = quantity("1/min", "speed at rated power", gt=0.0)
    synchronous_speed_rpm: float = quantity("1/min", "speed of the field at rated frequency", ge=1.0, le=1e5)
    breakdown_torque_ratio: float = quantity("1", "largest torque over rated torque", gt=1.0, le=20.0)
    starting_torque_ratio: float = quantity("1", "catalogue torque at standstill over rated torque", gt=0.0, le=20.0)
    rotor_inertia_kg_m2: float = quantity("kg m^2", "inertia of the rotor about its axis", gt=0.0)
    torque_curve: Literal["kloss", "starting_corrected", "single_phase"] = choice(
        "kloss: the one-cage curve; starting_corrected: raised below breakdown speed to the catalogue starting torque; "
        "single_phase: kloss with one line of the supply open",
        default="kloss",
    )
    rated_torque_nm: float | None = quantity(
        "N m", "rated torque where printed; else power over speed", gt=0.0, default=None
    )
    breakdown_torque_nm: float | None = quantity(
        "N m", "largest torque where printed; else from the ratio", gt=0.0, default=None
    )
    breakdown_slip: float | None = quantity(
        "1", "slip of the largest torque where printed", gt=0.0, lt=1.0, default=None
    )

    @model_validator(mode="after")
    def _plausible(self) -> InductionMotorParameters:
        if self.rated_speed_rpm >= self.synchronous_speed_rpm:
            raise ValueError(
                f"rated_speed_rpm < synchronous_speed_rpm needed, got {self.rated_speed_rpm} "
                f"and {self.synchronous_speed_rpm}"
            )
        constants = motor_constants(self)
        most = LONGEST_RUN_UP_S * self.rated_power_w / constants.synchronous_speed_rad_per_s**2
        why = f"which {self.rated_power_w:g} W bring to synchronous speed in {LONGEST_RUN_UP_S:g} s"
        keep_at_most("rotor_inertia_kg_m2", self.rotor_inertia_kg_m2, most, why)
        if not LEAST_RATED_SLIP <= constants.rated_slip <= MOST_RATED_SLIP:
            raise ValueError(
                f"rated slip {LEAST_RATED_SLIP:g} to {MOST_RATED_SLIP:g} needed, got {constants.rated_slip:.4g} of "
                f"rated_speed_rpm {self.rated_speed_rpm:g} and synchronous_speed_rpm {self.synchronous_speed_rpm:g}"
            )
        if not constants.rated_slip < constants.breakdown_slip < 1.0:
            raise ValueError(
                f"rated slip < breakdown slip < 1 needed, got {constants.rated_slip:.4g} and "
                f"{constants.breakdown_slip:.4g} (breakdown_slip, or of breakdown_torque_ratio)"
            )
        if constants.curve == CORRECTED and constants.starting_torque_nm > constants.breakdown_torque_nm:
            raise ValueError(
                f"starting torque <= breakdown torque needed for the corrected curve, got "
                f"{constants.starting_torque_nm:.4g} and {constants.breakdown_torque_nm:.4g} N m"
            )
        return self

    @model_validator(mode="after")
    def _printed_values_are_roundings(self) -> InductionMotorParameters:
        """Refuse a printed value that is not that of the same motor: it would be two motors in one."""
        torque = self.rated_power_w / (self.rated_speed_rpm * RPM)
        largest = self.breakdown_torque_ratio * (self.rated_torque_nm or torque)
        slip = breakdown_slip(1.0 - self.rated_speed_rpm / self.synchronous_speed_rpm, self.breakdown_torque_ratio)
        for key, printed, derived, within in (
            ("rated_torque_nm", self.rated_torque_nm, torque, PRINTED_WITHIN),
            ("breakdown_torque_nm", self.breakdown_torque_nm, largest, PRINTED_WITHIN),
            ("breakdown_slip", self.breakdown_slip, slip, PRINTED_SLIP_WITHIN),
        ):
            if printed is not None and not derived / within <= printed <= derived * within:
                raise ValueError(
                    f"{key} must be within a factor of {within:g} of {derived:.6g}, which follows from power, speeds "
                    f"and breakdown_torque_ratio; got {printed:g}"
                )
        return self


class MotorConstants(NamedTuple):
    """What the torque kernel needs, derived once from the catalogue data."""

    synchronous_speed_rad_per_s: float
    rated_speed_rad_per_s: float
    rated_torque_nm: float
    rated_slip: float
    breakdown_torque_nm: float
    breakdown_slip: float
    starting_torque_nm: float
    curve: int  # KLOSS, CORRECTED or SINGLE_PHASE


def breakdown_slip(rated_slip: float, torque_ratio: float) -> float:
    """Return the slip of the largest torque, ``s_n (lambda + sqrt(lambda^2 - 1))``.

    It makes the Kloss curve pass through the rated point; ``torque_ratio`` is lambda = M_max/M_n >= 1.
    """
    return rated_slip * (torque_ratio + sqrt(torque_ratio**2 - 1.0))


def motor_constants(parameters: InductionMotorParameters) -> MotorConstants:
    """Return rated torque and slip, breakdown torque and slip, and starting torque of a catalogue motor."""
    p = parameters
    rated_slip = 1.0 - p.rated_speed_rpm / p.synchronous_speed_rpm
    rated_torque = p.rated_torque_nm or p.rated_power_w / (p.rated_speed_rpm * RPM)
    return MotorConstants(
        synchronous_speed_rad_per_s=p.synchronous_speed_rpm * RPM,
        rated_speed_rad_per_s=p.rated_speed_rpm * RPM,
        rated_torque_nm=rated_torque,
        rated_slip=rated_slip,
        breakdown_torque_nm=p.breakdown_torque_nm or p.breakdown_torque_ratio * rated_torque,
        breakdown_slip=p.breakdown_slip or breakdown_slip(rated_slip, p.breakdown_torque_ratio),
        starting_torque_nm=p.starting_torque_ratio * rated_torque,
        curve=CURVES.index(p.torque_curve),
    )


@kernel
def kloss_torque(motor: MotorConstants, slip: float) -> float:
    """Return ``2 M_max s s_kr/(s^2 + s_kr^2)``, N m: Kloss with the removable singularity at s = 0 removed."""
    s_kr = motor.breakdown_slip
    return 2.0 * motor.breakdown_torque_nm * slip * s_kr / (slip * slip + s_kr * s_kr)


@kernel
def _curve(motor: MotorConstants, slip: float) -> tuple[float, float]:
    """Return torque (N m) and its derivative in the slip (N m) on the whole curve."""
    s_kr, s_2 = motor.breakdown_slip, slip * slip
    torque = kloss_torque(motor, slip)
    below = s_2 + s_kr * s_kr
    slope = 2.0 * motor.breakdown_torque_nm * s_kr * (s_kr * s_kr - s_2) / (below * below)
    if motor.curve == CORRECTED and slip > s_kr:
        t = min((slip - s_kr) / (1.0 - s_kr), 1.0)
        missing = motor.starting_torque_nm - kloss_torque(motor, 1.0)
        torque += missing * t * t * (3.0 - 2.0 * t)
        slope += missing * 6.0 * t * (1.0 - t) / (1.0 - s_kr)
    return torque, slope


@kernel
def _single_phase(motor: MotorConstants, share: float, fraction: float) -> tuple[float, float]:
    """Return torque and its derivative in the share of synchronous speed (N m), one line of the supply open."""
    s_kr, square = motor.breakdown_slip, share * share
    p = fraction * fraction - square
    below = p * p + fraction * fraction * s_kr * s_kr
    largest = motor.breakdown_torque_nm * s_kr
    slope = ((p - 2.0 * square) * below + 4.0 * square * p * p) / (below * below)
    return largest * share * p / below, largest * slope


@kernel
def motor_torque(motor: MotorConstants, speed_rad_per_s: float, command: float) -> float:
    """Return the shaft torque at a rotor speed and a supply fraction, N m.

    Kloss on the slip ``s = (command w_0 - w)/w_0``, motoring (s > 0) and generating (s < 0) alike.  The corrected
    curve adds, between breakdown and standstill, ``(M_start - M_Kloss(1)) (3 t^2 - 2 t^3)`` with
    ``t = (s - s_kr)/(1 - s_kr)`` kept within 0 and 1: the working branch, the breakdown point and the slope there stay
    as they are, the torque at s = 1 is the catalogue's, and there is no kink.  (Our choice; the deep-bar effect it
    stands for is not in the one-cage curve.)

    Parameters
    ----------
    motor : MotorConstants
        From `motor_constants`.
    speed_rad_per_s : float
        Rotor speed.
    command : float
        Supply frequency over rated frequency; 0 is off and gives no torque, below 0 the phases are swapped and the
        curve is turned round: M(w, -c) = -M(-w, c).
    """
    if command == 0.0:
        return 0.0
    if motor.curve == SINGLE_PHASE:
        torque, _ = _single_phase(motor, speed_rad_per_s / motor.synchronous_speed_rad_per_s, command)
        return torque
    sign = 1.0 if command > 0.0 else -1.0
    slip = sign * (command - speed_rad_per_s / motor.synchronous_speed_rad_per_s)
    torque, _ = _curve(motor, slip)
    return sign * torque


@kernel
def motor_torque_slope(motor: MotorConstants, speed_rad_per_s: float, command: float) -> float:
    """Return dM/dw, the derivative of `motor_torque` in the rotor speed (N m s/rad); negative on the working branch."""
    if command == 0.0:
        return 0.0
    if motor.curve == SINGLE_PHASE:
        _, slope = _single_phase(motor, speed_rad_per_s / motor.synchronous_speed_rad_per_s, command)
        return slope / motor.synchronous_speed_rad_per_s
    sign = 1.0 if command > 0.0 else -1.0
    slip = sign * (command - speed_rad_per_s / motor.synchronous_speed_rad_per_s)
    _, slope = _curve(motor, slip)
    return -slope / motor.synchronous_speed_rad_per_s


@kernel
def motor_command_slope(motor: MotorConstants, speed_rad_per_s: float, command: float) -> float:
    """Return the derivative of `motor_torque` in the command (N m)."""
    if motor.curve != SINGLE_PHASE:
        return -motor.synchronous_speed_rad_per_s * motor_torque_slope(motor, speed_rad_per_s, command)
    share, s_2 = speed_rad_per_s / motor.synchronous_speed_rad_per_s, motor.breakdown_slip * motor.breakdown_slip
    p = command * command - share * share
    below = p * p + command * command * s_2
    if below == 0.0:
        return 0.0
    slope = 2.0 * command * (below - p * (2.0 * p + s_2)) / (below * below)
    return motor.breakdown_torque_nm * motor.breakdown_slip * share * slope


class MotorInStep(NamedTuple):
    """A motor during one coupling step: its torque as the step began, and its curve from there (`torque_in_step`).

    ``offset_nm`` is the torque as the step began less that of the curve (N m): 0 of the motor of this curve, and the
    torque of one that takes efforts (command 0).  The supply goes from ``begin_command`` at a rate (1/s) to the asked
    command, which it reaches as the step ends.
    """

    curve: MotorConstants
    command: float
    offset_nm: float
    begin_command: float
    command_per_s: float


@kernel
def supplied_motor(curve: MotorConstants, command: float, offset_nm: float = 0.0) -> MotorInStep:
    """Return a motor under a steady supply."""
    return MotorInStep(curve, command, offset_nm, command, 0.0)


@kernel
def motor_in_step(
    curve: MotorConstants, before: float, rotor_rad_per_s: float, torque_nm: float, command: float, step_s: float
) -> MotorInStep:
    """Return a motor during a step.

    Parameters
    ----------
    curve : MotorConstants
        Torque against slip.
    before : float
        Command of the step before.
    rotor_rad_per_s : float
        Speed of the rotor as the step begins, by the shaft that it drives.
    torque_nm, command : float
        The motor's answer then.
    step_s : float
        Coupling step (s).
    """
    if command == 0.0:
        return supplied_motor(curve, 0.0, torque_nm)
    offset_nm = torque_nm - motor_torque(curve, rotor_rad_per_s, command)
    return MotorInStep(curve, command, offset_nm, before, (command - before) / step_s)


@embedded_kernel
def command_in_step(motor: MotorInStep, t: float) -> float:
    """Return the command at a time of the step (s)."""
    return motor.begin_command + motor.command_per_s * t


@embedded_kernel
def torque_in_step(motor: MotorInStep, t: float, rotor_rad_per_s: float) -> float:
    """Return the torque (N m) at a time of the step (s) and a speed of the rotor."""
    return motor.offset_nm + motor_torque(motor.curve, rotor_rad_per_s, command_in_step(motor, t))
