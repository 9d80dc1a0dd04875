# SPDX-License-Identifier: Apache-2.0
"""The breaker's body under the paper's half sine: samples of the exact event-driven motion.

The forces sample only gives the step.  Moment and blow follow the excitation's own clock, which starts with the body.
A sample holds the current piece of motion and the event that will end it, so events and their times do not depend on
the coupling step.
"""

import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from mech_twin.engine.addresses import record_at, record_of
from mech_twin.engine.compiled_roles import CompiledBody
from mech_twin.engine.compiled_steps import LOG_FULL, body_step, fill_event, step_of
from mech_twin.engine.sample_vectors import BODY_JOINTS, PRESSING_FORCE, REGIME, Array, BodyLayout, EventLayout
from mech_twin.kernels.kernel import borrowing_kernel, kernel
from mech_twin.machines.mb10_breaker.pressed_body.collar_contact import (
    BLOW,
    CAUSES,
    CONTACT,
    FREE,
    LIFT_OFF,
    ONSET,
    REGIMES,
    ContactPiece,
    next_piece,
    planned_piece,
    residuals_at,
    resting_piece,
    state_at,
)
from mech_twin.machines.mb10_breaker.pressed_body.parameters import (
    BodyParameters,
    ExcitationParameters,
    PressedBody,
    pressed_body,
)
from mech_twin.samples import BodySample, ForceSample

JOINTS = ("body",)
CONTACT_NAME = "collar"
MEMORY_AT = BODY_JOINTS + 3
RESIDUALS = ("penetration_rad", "energy_balance")
RESIDUAL_LIMITS: Mapping[str, float] = MappingProxyType({"penetration_rad": 1e-12, "energy_balance": 1e-9})


# state of the body besides angle and rate: when cycle 0 began; the current piece of motion, whose times count from the
# start of its cycle; the angle at the last blow; a mark of the constants the piece was found with
MEMORY_NAMES = (
    "origin_s", "cycle", "piece_start_s", "piece_angle_rad", "piece_rate_rad_per_s", "piece_regime", "piece_loaded",
    "series_rad_per_s", "piece_end_s", "piece_cause", "blow_angle_rad", "constants_key",
)  # fmt: skip
MEMORY = record_of(MEMORY_NAMES)
RESIDUALS_AT = MEMORY_AT + len(MEMORY_NAMES)


class HalfSine(NamedTuple):
    """Constants of the body role: the body's, the coupling step (s), the mark of the body's constants."""

    body: PressedBody
    step_s: float
    key: float


@borrowing_kernel
def memory_of(row: Array) -> Any:
    """Return the memory of a row as a record that shares its numbers."""
    return record_at(row, MEMORY_AT, MEMORY)


@kernel
def piece_of(row: Array) -> ContactPiece:
    """Return the current piece of motion: the numbers of the memory after the first."""
    m = row[MEMORY_AT + 1 :]
    return ContactPiece(int(m[0]), m[1], m[2], m[3], int(m[4]), int(m[5]), m[6], m[7], int(m[8]))


@kernel
def replanned(body: PressedBody, piece: ContactPiece, angle: float, rate: float, elapsed: float) -> ContactPiece:
    """Return the piece of motion that continues from a sample after a change of constants."""
    now = min(max(elapsed - piece.cycle * body.period, 0.0), body.period)
    resting = body.one_sided and piece.regime == CONTACT
    loaded = 1 if now >= body.onset else 0
    return planned_piece(body, piece.cycle, now, angle, rate, CONTACT if resting else FREE, loaded, piece.series)


@kernel
def fill_body(
    model: HalfSine, time_s: float, origin: float, piece: ContactPiece, blow_angle: float, out: Array
) -> None:
    """Fill the row of the body at a time (s) within a piece of the chain."""
    body = model.body
    local = time_s - origin - piece.cycle * body.period
    angle, rate = state_at(body, piece, local)
    force = body.rate * (body.arm * angle + body.deflection)
    out[REGIME], out[PRESSING_FORCE] = piece.regime, force
    out[BODY_JOINTS], out[BODY_JOINTS + 1], out[BODY_JOINTS + 2] = angle, rate, -force * body.arm
    memory = memory_of(out)
    memory.origin_s, memory.blow_angle_rad, memory.constants_key = origin, blow_angle, model.key
    memory.cycle, memory.piece_start_s, memory.piece_angle_rad = piece.cycle, piece.start, piece.angle
    memory.piece_rate_rad_per_s, memory.piece_regime, memory.piece_loaded = piece.rate, piece.regime, piece.loaded
    memory.series_rad_per_s, memory.piece_end_s, memory.piece_cause = piece.series, piece.end, piece.cause
    out[RESIDUALS_AT], out[RESIDUALS_AT + 1] = residuals_at(body, piece, local, model.step_s)


@step_of(body_step, HalfSine)
def follow_half_sine(
    model: HalfSine, step: int, body: Array, forces: Array, loads: Array, count: int, out: Array, log: Array
) -> int:
    """Fill ``out`` with the body one step later, and log the events in between."""
    constants, memory, found, time_s = model.body, memory_of(body), 0, step * model.step_s
    origin, blow_angle, piece = memory.origin_s, memory.blow_angle_rad, piece_of(body)
    if memory.constants_key != model.key:
        elapsed = (step - 1) * model.step_s - origin
        piece = replanned(constants, piece, body[BODY_JOINTS], body[BODY_JOINTS + 1], elapsed)
    while piece.cycle * constants.period + piece.end <= time_s - origin:
        ended = piece
        piece, ending = next_piece(constants, ended)
        if ending.cause == BLOW:
            blow_angle = piece.angle
        if ending.cause != ONSET:
            at = origin + ended.cycle * constants.period + ended.end
            fill_event(log, found, at, ending.cause, 0, ending.pre, ending.post, ending.impulse, ended.cycle)
            found += 1
            if ended.regime == CONTACT and piece.regime != CONTACT and ending.cause == BLOW:
                fill_event(log, found, at, LIFT_OFF, 0, 0.0, ending.post, 0.0, ended.cycle)
                found += 1
    fill_body(model, time_s, origin, piece, blow_angle, out)
    return found if found <= len(log) else LOG_FULL


@dataclass(frozen=True)
class HalfSineBody(CompiledBody):
    """The body role for the excitation ``approximated``; with ``contact: none`` the published free swing.

    Only the times of the samples depend on the coupling step ``step_s``.
    """

    model: HalfSine
    step_s: float
    joints = JOINTS
    regimes = REGIMES
    residual_limits = RESIDUAL_LIMITS
    layout = BodyLayout(JOINTS, MEMORY_NAMES, RESIDUALS, EventLayout(CAUSES, (CONTACT_NAME,)))
    force_layout = None  # the forces only say which step it is

    def start(self, forces: ForceSample) -> BodySample:
        """Return the body at rest on the tool, its cycle beginning at the step of these forces."""
        out, time_s = np.empty(self.layout.size), forces.step * self.step_s
        fill_body(self.model, time_s, time_s, resting_piece(self.model.body, 0), 0.0, out)
        return self.layout.sample(forces.step, time_s, out.tolist(), ())


def half_sine_body(body: BodyParameters, excitation: ExcitationParameters, step_s: float) -> HalfSineBody:
    """Return the body role of a body, its spring and collar, under a half sine at the end of each cycle."""
    constants = pressed_body(body, excitation)
    return HalfSineBody(HalfSine(constants, step_s, float(zlib.crc32(struct.pack("<16d", *constants)))), step_s)
