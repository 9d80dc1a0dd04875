"""Four-bar shock-vibration compaction press: exact kinematics, every pin force, gain and flywheel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mech_twin.engine.crank_linkage import Boundary, CrankKernels, CrankLinkage, Transmission
from mech_twin.machines.compaction_press.cycle import POSITIONS, gains, press_cycle, regime_at
from mech_twin.machines.compaction_press.dynamics import (
    CONTACT,
    CONTACT_REVERSED,
    FREE,
    Press,
    driven_step,
    prescribed_step,
    press_pins,
    press_reduced,
    press_state,
)
from mech_twin.machines.compaction_press.metrics import PressObserver, cycle_report, loaded_point, position_figures
from mech_twin.machines.compaction_press.parameters import CompactionPress, Stroke, press_constants
from mech_twin.machines.drives import KlossDrive, PrescribedSpeed
from mech_twin.parts.four_bar import acute_angles, coefficients, motion, position
from mech_twin.parts.induction_motor import motor_constants
from mech_twin.quantity import Parameters
from mech_twin.roles import Capabilities, Machine, MotorRole
from mech_twin.samples import ForceSample, LinkageSample, Named, Shape, Wrench

PARAMETERS = CompactionPress
KERNELS = CrankKernels(press_state, prescribed_step, driven_step)
REGIMES = ("free", "contact", "contact_reversed")
QUANTITIES = (
    "alpha_rad",
    "beta_rad",
    "gamma_rad",
    "plate_acceleration_rad_per_s2",
    "pendulum_acceleration_rad_per_s2",
    "crank_acceleration_rad_per_s2",
    "reduced_inertia_kg_m2",
    "reduced_inertia_slope_kg_m2_per_rad",
    "reduced_moment_nm",
    "drive_torque_nm",
    "drive_power_w",
    "working_force_n",
    "loaded_point_height_m",
    "loaded_point_speed_m_per_s",
    "gain_k1",
    "gain_k2",
    "gain_paper",
    "gain_normal",
    "gain_vertical",
    "shaking_force_x_n",
    "shaking_force_y_n",
)


@dataclass(frozen=True)
class PressForces:
    """Every pin force from one equilibrium of the dyad, then the crank; e1 is found by the reduced route."""

    press: Press
    moment_scale: float
    pins: tuple[str, ...] = ("pin_o", "pin_a", "pin_b", "pin_c")
    acts_on: tuple[str, ...] = ("crank", "plate", "plate", "pendulum")

    @property
    def residual_limits(self) -> Mapping[str, float]:
        """Limit of the running proof: the two routes to the drive torque, over the peak torque."""
        return {"drive_torque_routes": 1e-10}

    def analyse(self, linkage: LinkageSample) -> ForceSample:
        """Return the pin forces at the joint angles, rates and crank torque of the sample."""
        press = self.press
        f, w, torque = linkage.position[0], linkage.velocity[0], linkage.effort[0]
        now = press_reduced(press, f, linkage.regime)
        e = (torque + now.moment - 0.5 * w * w * now.slope) / now.inertia
        at = position(press.bar, f)
        by = motion(press.bar, press.crank, press.plate, press.pendulum, at, coefficients(at), w, e)
        pins = press_pins(press, f, w, e, now.force)
        k1, k2, normal, vertical = gains(press, f)
        values = (
            *acute_angles(at),
            by.e2,
            by.e3,
            e,
            now.inertia,
            now.slope,
            now.moment,
            torque,
            torque * w,
            now.force,
            now.y,
            now.y1 * w,
            k1,
            k2,
            k1 * k2,
            normal,
            vertical,
            -pins.o_x - pins.c_x,
            -pins.o_y - pins.c_y,
        )
        wrenches = (
            Wrench(pins.o_x, pins.o_y, 0.0),
            Wrench(pins.a_x, pins.a_y, 0.0),
            Wrench(pins.b_x, pins.b_y, 0.0),
            Wrench(pins.c_x, pins.c_y, 0.0),
        )
        scale = max(self.moment_scale, abs(torque), now.inertia * abs(e))
        return ForceSample(
            linkage.step,
            linkage.time_s,
            self.pins,
            wrenches,
            Named(QUANTITIES, values),
            0.0,
            Named(("drive_torque_routes",), ((pins.moment - torque) / scale,)),
        )


def press_boundaries(stroke: Stroke, contact_fraction: float) -> tuple[Boundary, ...]:
    """Return where the layer is met, left at the bottom, or let go when the crank turns back."""
    first = "contact" if contact_fraction > 0.0 else "top"
    return (
        Boundary(stroke.contact, 1.0, FREE, CONTACT, first),
        Boundary(stroke.bottom, 1.0, CONTACT, FREE, "bottom"),
        Boundary(stroke.contact, -1.0, CONTACT, FREE, "release"),
        Boundary(stroke.contact_reversed, -1.0, FREE, CONTACT_REVERSED, first),
        Boundary(stroke.bottom, -1.0, CONTACT_REVERSED, FREE, "bottom"),
        Boundary(stroke.contact_reversed, 1.0, CONTACT_REVERSED, FREE, "release"),
    )


def press_linkage(
    press: Press,
    stroke: Stroke,
    step_s: float,
    speed: float,
    command: float,
    direction: float,
    contact_fraction: float,
    transmission: Transmission | None,
) -> CrankLinkage:
    """Return the linkage role: crank at angle 0 and this speed (rad/s), the layer's boundaries along its turn."""
    return CrankLinkage(
        press,
        KERNELS,
        step_s,
        0.0,
        speed,
        command,
        ("crank", "plate", "pendulum"),
        "plate",
        REGIMES,
        regime_at(stroke, 0.0, direction),
        press_boundaries(stroke, contact_fraction),
        transmission,
    )


def _drawing(press: Press, linkage: LinkageSample) -> tuple[Shape, ...]:
    at = position(press.bar, linkage.position[0])
    load = loaded_point(press, linkage.position[0])
    o, a, b = (0.0, 0.0), (at.a_x, at.a_y), (at.b_x, at.b_y)
    c = (press.bar.pivot_x_m, press.bar.pivot_y_m)
    shapes = [
        Shape("crank", "line", (o, a), (200, 60, 40), 0.02),
        Shape("plate", "line", (a, b), (60, 90, 180), 0.025),
        Shape("pendulum", "line", (c, b), (90, 140, 60), 0.015),
        Shape("pins", "points", (o, a, b, c), (0, 0, 0), 0.012),
    ]
    force = press_reduced(press, linkage.position[0], linkage.regime).force
    if force > 0.0:
        length = 0.2 * force / press.load.peak_n
        shapes.append(Shape("working_force", "arrow", ((load[0], load[1] - length), load), (220, 120, 0), 0.01))
    return tuple(shapes)


def build(parameters: Parameters) -> Machine:
    """Return the compaction press of these parameters."""
    if not isinstance(parameters, CompactionPress):
        raise TypeError(f"expected CompactionPress parameters, got {type(parameters).__name__}")
    p = parameters
    press, stroke = press_constants(p)
    speed, fraction, step_s = p.drive.speed_rad_per_s, p.supply.initial_fraction, p.coupling.step_s
    motor: MotorRole = PrescribedSpeed(speed, p.supply.rate_per_s, step_s)
    transmission = None
    if p.drive.kind == "kloss" and p.motor is not None and p.gear is not None:
        motor = KlossDrive(motor_constants(p.motor), p.gear.ratio, p.supply.rate_per_s, step_s)
        transmission = Transmission(p.gear.ratio, p.gear.efficiency, p.motor.rotor_inertia_kg_m2)
    direction = 1.0 if transmission is not None or speed > 0.0 else -1.0
    first = 0.0 if transmission is not None else fraction * speed
    linkage = press_linkage(
        press, stroke, step_s, first, fraction, direction, p.working_force.contact_fraction, transmission
    )
    torque = press_cycle(press, stroke, speed, POSITIONS, kinks=False).drive_torque_nm

    def analyse(crank_rad: float) -> dict[str, Any]:
        return position_figures(p, crank_rad)

    return Machine(
        "compaction_press",
        p,
        step_s,
        motor,
        linkage,
        PressForces(press, float(abs(torque).max())),
        None,
        lambda sample, _: _drawing(press, sample),
        lambda: cycle_report(p),
        analyse,
        PressObserver,
    )


def capabilities() -> Capabilities:
    """Return what the machine answers beside running."""
    from mech_twin.capabilities.sizing import SizingQuestion
    from mech_twin.machines.compaction_press import plots, published, sizing

    return Capabilities(
        published=published.rows,
        pictures=plots.pictures,
        sizing=SizingQuestion(sizing.LIMITS, sizing.OBJECTIVES, sizing.sizing),
    )
