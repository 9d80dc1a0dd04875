# SPDX-License-Identifier: Apache-2.0
"""The breaker as MuJoCo has it: the same masses, lengths, motor and gear, its laws of contact in MuJoCo's terms.

Crank with the rotor as armature (its axis is the body's pivot, the drive stands on the frame), coupler and rocker with
their centroids and inertias, the loop closed by a connect of sites; the body on its spring, with the collar as a limit
of its hinge; the tool as a slide with dry friction of the wall's force.  The striker's gap is linear in the joints, so
that a fixed tendon with a lower limit is the contact, its geometry without error.  Restitution is a damping of the
contact's oscillation.  MuJoCo's contacts take time, a rigid blow cannot be had: as few steps as keep the run stable.

Motor torque (Kloss) and gear losses are set each step; the tool is put back at the rocker's return, as in the machine.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import mujoco
import numpy as np

from mech_twin.machines.mb10_breaker.dynamics import Breaker
from mech_twin.parts.contact import damping_ratio_without_pull
from mech_twin.parts.four_bar import position
from mech_twin.parts.friction_and_gear import gear_torque
from mech_twin.parts.induction_motor import MotorConstants, motor_torque

STIFF = ".9999 .9999 .001"  # of MuJoCo's impedance: the constraint takes this share of the acceleration
LOOP_STEPS = 2.0  # time constant of the loop's constraint; MuJoCo takes none shorter
STRUCK_M_PER_S = 0.1  # a tool that got less was not struck


class Peer(NamedTuple):
    """A setting of MuJoCo: integrator, step (s), and how many steps a blow takes."""

    integrator: str
    step_s: float
    contact_steps: float


class Told(NamedTuple):
    """What a run showed: greatest opening of the loop (m), and time (s) and energy (J) of each blow."""

    loop_m: float
    blows: np.ndarray


def _bounce(restitution: float, peer: Peer) -> str:
    """Return stiffness and damping of a contact that lasts the setting's steps, in MuJoCo's direct form."""
    rate = math.pi / (peer.contact_steps * peer.step_s)
    return f"{-rate * rate} {-2.0 * damping_ratio_without_pull(restitution) * rate}"


def _inertial(mass_kg: float, inertia_kg_m2: float, x: float = 0.0, y: float = 0.0) -> str:
    spin = f"{inertia_kg_m2} {inertia_kg_m2} {inertia_kg_m2}"
    return f"<inertial pos='{x} {y} 0' mass='{mass_kg}' diaginertia='{spin}'/>"


def breaker_model(b: Breaker, crank_rad: float, peer: Peer) -> mujoco.MjModel:
    """Return the breaker, assembled at a crank angle, the body on its collar."""
    at, end = position(b.bar, float(crank_rad)), position(b.bar, b.striking_crank_rad)
    rocker, coupler = math.atan2(at.v_y, at.v_x), math.atan2(at.u_y, at.u_x)
    reach = math.remainder(math.atan2(end.v_y, end.v_x) - rocker, 2.0 * math.pi)
    closed_m = b.overtravel_m - b.striker_arm_m * reach
    spring = b.spring_rate_n_per_m * b.spring_arm_m**2
    crank, rod, lever = b.crank, b.coupler, b.rocker
    return mujoco.MjModel.from_xml_string(f"""<mujoco><compiler angle='radian'/>
      <option timestep='{peer.step_s}' gravity='0 0 0' integrator='{peer.integrator}' iterations='100'
        tolerance='1e-12' jacobian='dense'/>
      <worldbody>
        <body><joint name='crank' axis='0 0 1' armature='{b.rotor_11_kg_m2}'/>
          {_inertial(crank.mass_kg, crank.inertia_kg_m2)}
          <body pos='{at.a_x} {at.a_y} 0' euler='0 0 {coupler}'><joint axis='0 0 1'/>
            {_inertial(rod.mass_kg, rod.inertia_kg_m2, rod.along_m, rod.across_m)}
            <site name='coupler_b' pos='{b.bar.coupler_m} 0 0'/></body></body>
        <body><joint name='body' axis='0 0 -1' stiffness='{spring}' springref='{-b.preload_m / b.spring_arm_m}'
            damping='{b.body_damping_nms_per_rad}' limited='true' range='0 10'
            solreflimit='{_bounce(b.collar_restitution, peer)}' solimplimit='{STIFF}'/>
          {_inertial(1.0, b.body_inertia_kg_m2)}
          <body pos='{b.bar.pivot_x_m} {b.bar.pivot_y_m} 0' euler='0 0 {rocker}'><joint name='rocker' axis='0 0 1'/>
            {_inertial(lever.mass_kg, lever.inertia_kg_m2, lever.along_m, lever.across_m)}
            <site name='rocker_b' pos='{b.bar.rocker_m} 0 0'/></body></body>
        <body><joint name='tool' type='slide' axis='1 0 0' frictionloss='{b.wall_force_n}'/>
          {_inertial(b.tool_mass_kg, 1.0)}</body>
      </worldbody>
      <tendon><fixed limited='true' range='{closed_m} 100' solreflimit='{_bounce(b.tool_restitution, peer)}'
          solimplimit='{STIFF}'><joint joint='body' coef='{b.tool_radius_m}'/><joint joint='tool' coef='1'/>
        <joint joint='rocker' coef='{-b.striker_arm_m}'/></fixed></tendon>
      <equality><connect site1='coupler_b' site2='rocker_b' solref='{LOOP_STEPS * peer.step_s} 1'
        solimp='{STIFF}'/></equality></mujoco>""")


def followed(b: Breaker, motor: MotorConstants, model: mujoco.MjModel, duration_s: float) -> tuple[Told, mujoco.MjData]:
    """Run from standstill with all of its rules; return what was seen, and the state at the end."""
    state = mujoco.MjData(model)
    mujoco.mj_forward(model, state)
    crank, rocker, tool = (model.joint(name).dofadr[0] for name in ("crank", "rocker", "tool"))
    speeds, forces, (one, other) = state.qvel, state.qfrc_applied, state.site_xpos
    opening, quickest, struck_s, before, blows = 0.0, 0.0, 0.0, 0.0, []
    for _ in range(round(duration_s / model.opt.timestep)):
        speed = float(speeds[crank])
        forces[crank] = gear_torque(b.ratio, b.efficiency, motor_torque(motor, speed * b.ratio, 1.0), speed)
        mujoco.mj_step(model, state)
        opening = max(opening, (one[0] - other[0]) ** 2 + (one[1] - other[1]) ** 2)
        if speeds[tool] > quickest:
            quickest, struck_s = float(speeds[tool]), state.time
        now = float(speeds[rocker])
        if before < 0.0 <= now:  # the rocker returns: the tool is put back
            if quickest > STRUCK_M_PER_S:
                blows.append((struck_s, 0.5 * b.tool_mass_kg * quickest**2))
            state.qpos[tool] = speeds[tool] = quickest = 0.0
        before = now
    return Told(math.sqrt(opening), np.array(blows).reshape(-1, 2)), state
