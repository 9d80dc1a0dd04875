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

from mech_twin.machines.mb10_breaker.pressed_body.collar_contact import (
    CAUSES,
    CONTACT,
    FREE,
    ONSET,
    REGIMES,
    Happening,
    Piece,
    following,
    planned,
    proofs_at,
    seated,
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
MEMORY = (
    "origin_s",  # time at which cycle 0 began
    "cycle",
    "piece_start_s",  # from the start of the cycle, as all times of the piece
    "piece_angle_rad",
    "piece_rate_rad_per_s",
    "piece_regime",
    "piece_loaded",
    "series_rad_per_s",
    "piece_end_s",
    "piece_cause",
    "constants_key",  # of the constants the piece was found with
)
RESIDUALS = ("penetration_rad", "energy_balance")
RESIDUAL_LIMITS: Mapping[str, float] = MappingProxyType({"penetration_rad": 1e-12, "energy_balance": 1e-9})


class ApproximatedBody:
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
        return self._sample(forces.step, time_s, time_s, seated(self._constants, 0), ())

    def follow(self, body: BodySample, forces: ForceSample) -> BodySample:
        """Return the body one coupling step later, with every event passed on the way."""
        constants = self._constants
        origin, piece = self._resumed(body)
        time_s = forces.step * self._step_s
        events: list[Event] = []
        while piece.cycle * constants.period + piece.end <= time_s - origin:
            ended = piece
            piece, happening = following(constants, ended)
            if happening.cause != ONSET:
                _tell(events, origin + ended.cycle * constants.period + ended.end, ended, piece, happening)
        return self._sample(forces.step, time_s, origin, piece, tuple(events))

    def _resumed(self, body: BodySample) -> tuple[float, Piece]:
        """Return time origin and running piece; found anew from the last sample if the constants have changed."""
        origin, cycle, start, angle, rate, regime, loaded, series, end, cause, key = body.memory.values
        piece = Piece(int(cycle), start, angle, rate, int(regime), int(loaded), series, end, int(cause))
        if key == self._key:
            return origin, piece
        return origin, _replanned(self._constants, piece, body, body.time_s - origin)

    def _sample(self, step: int, time_s: float, origin: float, piece: Piece, events: tuple[Event, ...]) -> BodySample:
        constants = self._constants
        local = time_s - origin - piece.cycle * constants.period
        angle, rate = state_at(constants, piece, local)
        force = constants.rate * (constants.arm * angle + constants.deflection)
        memory = (origin, *map(float, piece), self._key)  # the fields of Piece are in the order of MEMORY
        return BodySample(
            step=step,
            time_s=time_s,
            joints=JOINTS,
            position=(angle,),
            velocity=(rate,),
            effort=(-force * constants.arm,),
            regime=piece.regime,
            pressing_force_n=force,
            memory=Named(MEMORY, memory),
            residuals=Named(RESIDUALS, proofs_at(constants, piece, local)),
            events=events,
        )


def _replanned(constants: PressedBody, piece: Piece, body: BodySample, elapsed: float) -> Piece:
    """Return the piece that goes on from a sample under constants other than those its own piece was found with."""
    now = min(max(elapsed - piece.cycle * constants.period, 0.0), constants.period)
    angle, rate = body.position[0], body.velocity[0]
    resting = constants.one_sided and piece.regime == CONTACT
    loaded = int(now >= constants.onset)
    regime = CONTACT if resting else FREE
    return planned(constants, piece.cycle, now, angle, rate, regime, loaded, piece.series)


def _tell(events: list[Event], time_s: float, ended: Piece, piece: Piece, happening: Happening) -> None:
    """Append the event that ended a piece, and the lift-off if a blow has thrown up a body at rest."""
    cause, pre, post, impulse = happening
    events.append(Event(time_s, CAUSES[cause], CONTACT_NAME, pre, post, impulse, ended.cycle))
    if ended.regime == CONTACT and piece.regime != CONTACT and CAUSES[cause] == "blow":
        events.append(Event(time_s, "lift_off", CONTACT_NAME, 0.0, post, 0.0, ended.cycle))
