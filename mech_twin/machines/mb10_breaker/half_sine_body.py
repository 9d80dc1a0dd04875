"""The breaker's body under the paper's half sine: samples off the exact chain of pieces.

The forces sample only says which step it is; moment and blow come from the excitation's own clock, whose origin is the
time the body was started.  A sample holds the running piece of the chain and the event that will end it, so what
happens, and when, does not depend on the coupling step.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from mech_twin.machines.mb10_breaker.pressed_body.collar_contact import (
    BLOW,
    CAUSES,
    CONTACT,
    FREE,
    ONSET,
    REGIMES,
    ContactPiece,
    PieceEnd,
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
from mech_twin.samples import BodySample, Event, ForceSample, Named

JOINTS = ("body",)
CONTACT_NAME = "collar"
RESIDUALS = ("penetration_rad", "energy_balance")
RESIDUAL_LIMITS: Mapping[str, float] = MappingProxyType({"penetration_rad": 1e-12, "energy_balance": 1e-9})


class HalfSineMemory(NamedTuple):
    """What the body's sample keeps beside angle and rate: the running piece of the chain.

    ``origin_s`` is the time at which cycle 0 began; the times of the piece count from the start of its cycle.
    ``blow_angle_rad`` is the angle at the last blow; ``constants_key`` marks the constants the piece was found with.
    """

    origin_s: float
    cycle: float
    piece_start_s: float
    piece_angle_rad: float
    piece_rate_rad_per_s: float
    piece_regime: float
    piece_loaded: float
    series_rad_per_s: float
    piece_end_s: float
    piece_cause: float
    blow_angle_rad: float
    constants_key: float

    @property
    def piece(self) -> ContactPiece:
        """The running piece."""
        return ContactPiece(
            cycle=int(self.cycle),
            start=self.piece_start_s,
            angle=self.piece_angle_rad,
            rate=self.piece_rate_rad_per_s,
            regime=int(self.piece_regime),
            loaded=int(self.piece_loaded),
            series=self.series_rad_per_s,
            end=self.piece_end_s,
            cause=int(self.piece_cause),
        )


def packed_memory(origin_s: float, piece: ContactPiece, blow_angle_rad: float, constants_key: float) -> HalfSineMemory:
    """Return the memory of a body on this piece of the chain."""
    return HalfSineMemory(
        origin_s=origin_s,
        cycle=float(piece.cycle),
        piece_start_s=piece.start,
        piece_angle_rad=piece.angle,
        piece_rate_rad_per_s=piece.rate,
        piece_regime=float(piece.regime),
        piece_loaded=float(piece.loaded),
        series_rad_per_s=piece.series,
        piece_end_s=piece.end,
        piece_cause=float(piece.cause),
        blow_angle_rad=blow_angle_rad,
        constants_key=constants_key,
    )


class HalfSineBody:
    """The body role for the excitation ``approximated``; with ``contact: none`` the published free swing.

    Parameters
    ----------
    body : BodyParameters
        Body, spring and collar.
    excitation : ExcitationParameters
        Half sine at the end of each cycle.
    coupling_step_s : float
        Macro step; only the times of the samples depend on it.
    """

    joints = JOINTS
    regimes = REGIMES
    residual_limits = RESIDUAL_LIMITS

    def __init__(self, body: BodyParameters, excitation: ExcitationParameters, coupling_step_s: float) -> None:
        self._constants = pressed_body(body, excitation)
        self._step_s = coupling_step_s
        self._key = float(zlib.crc32(struct.pack("<16d", *self._constants)))

    def start(self, forces: ForceSample) -> BodySample:
        """Return the body at rest on the tool, its cycle beginning at the step of these forces."""
        time_s = forces.step * self._step_s
        return self._sample(forces.step, time_s, time_s, resting_piece(self._constants, 0), 0.0, ())

    def follow(self, body: BodySample, forces: ForceSample) -> BodySample:
        """Return the body one coupling step later, with every event passed on the way."""
        constants = self._constants
        memory = HalfSineMemory(*body.memory.values)
        origin, blow_angle, piece = memory.origin_s, memory.blow_angle_rad, self._resumed(memory, body)
        time_s = forces.step * self._step_s
        events: list[Event] = []
        while piece.cycle * constants.period + piece.end <= time_s - origin:
            ended = piece
            piece, ending = next_piece(constants, ended)
            if ending.cause == BLOW:
                blow_angle = piece.angle
            if ending.cause != ONSET:
                _append_event(events, origin + ended.cycle * constants.period + ended.end, ended, piece, ending)
        return self._sample(forces.step, time_s, origin, piece, blow_angle, tuple(events))

    def _resumed(self, memory: HalfSineMemory, body: BodySample) -> ContactPiece:
        """Return the running piece; found anew from the last sample if the constants have changed."""
        if memory.constants_key == self._key:
            return memory.piece
        return _replanned(self._constants, memory.piece, body, body.time_s - memory.origin_s)

    def _sample(
        self, step: int, time_s: float, origin: float, piece: ContactPiece, blow_angle: float, events: tuple[Event, ...]
    ) -> BodySample:
        constants = self._constants
        local = time_s - origin - piece.cycle * constants.period
        angle, rate = state_at(constants, piece, local)
        force = constants.rate * (constants.arm * angle + constants.deflection)
        memory = packed_memory(origin, piece, blow_angle, self._key)
        return BodySample(
            step=step,
            time_s=time_s,
            joints=JOINTS,
            position=(angle,),
            velocity=(rate,),
            effort=(-force * constants.arm,),
            regime=piece.regime,
            pressing_force_n=force,
            memory=Named(HalfSineMemory._fields, tuple(memory)),
            residuals=Named(RESIDUALS, residuals_at(constants, piece, local, self._step_s)),
            events=events,
        )


def _replanned(constants: PressedBody, piece: ContactPiece, body: BodySample, elapsed: float) -> ContactPiece:
    """Return the piece that goes on from a sample under constants other than those its own piece was found with."""
    now = min(max(elapsed - piece.cycle * constants.period, 0.0), constants.period)
    (angle,), (rate,) = body.position, body.velocity
    resting = constants.one_sided and piece.regime == CONTACT
    loaded = int(now >= constants.onset)
    regime = CONTACT if resting else FREE
    return planned_piece(constants, piece.cycle, now, angle, rate, regime, loaded, piece.series)


def _append_event(
    events: list[Event], time_s: float, ended: ContactPiece, piece: ContactPiece, ending: PieceEnd
) -> None:
    """Append the event that ended a piece, and the lift-off if a blow has thrown up a body at rest."""
    cause, pre, post, impulse = ending
    events.append(Event(time_s, CAUSES[cause], CONTACT_NAME, pre, post, impulse, ended.cycle))
    if ended.regime == CONTACT and piece.regime != CONTACT and cause == BLOW:
        events.append(Event(time_s, "lift_off", CONTACT_NAME, 0.0, post, 0.0, ended.cycle))
