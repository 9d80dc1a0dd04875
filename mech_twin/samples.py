# SPDX-License-Identifier: Apache-2.0
"""The samples: what crosses a border, in one process, over topics and in a bag alike.

A sample is the *whole* state of what it describes at one coupling step.  No role keeps anything beside the
samples it has returned, so a run can be continued from its last samples, and a run over topics cannot differ
from a run in one process.

Positions are m or rad, velocities m/s or rad/s, efforts N or N m, as the joint is sliding or turning.
"""

from __future__ import annotations

from typing import NamedTuple


class Coordinate(NamedTuple):
    """One independent coordinate at one instant: position, velocity and the effort that drives it."""

    position: float
    velocity: float
    effort: float


class Event(NamedTuple):
    """Something that happened at an instant of its own, between two steps or on one.

    ``time_s`` is exact (never rounded to the step).  The velocities are those of the contact before and after,
    positive as the machine's page says; an event that is no impact has impulse 0.  ``period`` is the cycle the
    event belongs to, counted from 0.  ``pre`` and ``post`` hold the machine's independent coordinates on either
    side of the instant, in the order of ``LinkageRole.coordinates``; empty where no other role needs them.
    """

    time_s: float
    kind: str
    contact: str
    pre_velocity_m_per_s: float = 0.0
    post_velocity_m_per_s: float = 0.0
    impulse_ns: float = 0.0
    period: int = 0
    pre: tuple[Coordinate, ...] = ()
    post: tuple[Coordinate, ...] = ()


class Named(NamedTuple):
    """Named numbers; ``names`` is one shared tuple per role, each name ending in its unit."""

    names: tuple[str, ...] = ()
    values: tuple[float, ...] = ()

    def __getitem__(self, name: str) -> float:  # type: ignore[override]
        return self.values[self.names.index(name)]

    def as_dict(self) -> dict[str, float]:
        """Return the numbers by name."""
        return dict(zip(self.names, self.values, strict=True))


class EffortCommand(NamedTuple):
    """What a motor is asked for in place of a supply: an effort, and a spring and a damper that hold it at a position.

    At each step the motor gives ``effort + stiffness (position - q) - damping v`` at its first joint, within its limit.
    """

    effort: float = 0.0
    position: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0


class MotorSample(NamedTuple):
    """What the motor gives at a step: its joints, the supply fraction in force after rate limiting, the effort asked.

    With an effort asked the supply is off: its fraction is 0.
    """

    step: int
    time_s: float
    joints: tuple[str, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    effort: tuple[float, ...]
    command: float
    asked: EffortCommand | None = None


class LinkageSample(NamedTuple):
    """The linkage at a step: every joint (solved ones too), and all it needs to go on from here.

    ``memory`` is state that is no joint (works and losses, time origin).  ``residuals`` are
    numbers that are zero while the twin is right.  ``events`` are those of the step that ends here.
    """

    step: int
    time_s: float
    joints: tuple[str, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    effort: tuple[float, ...]
    regime: int
    command: float
    memory: Named
    residuals: Named
    events: tuple[Event, ...] = ()

    def joint(self, name: str) -> Coordinate:
        """Return position, velocity and effort of a joint by its name."""
        return _joint(self, name)


class Wrench(NamedTuple):
    """A planar pin reaction in the frame of the machine: N, N, N m."""

    force_x_n: float
    force_y_n: float
    moment_nm: float


class Load(NamedTuple):
    """The moment on the body on either side of an event, and the angular impulse it brings."""

    time_s: float
    kind: str
    contact: str
    moment_before_nm: float
    moment_after_nm: float
    impulse_nms: float


class ForceSample(NamedTuple):
    """Every pin reaction at a step, the derived quantities, and what loads the body during the step."""

    step: int
    time_s: float
    pins: tuple[str, ...]
    wrenches: tuple[Wrench, ...]
    quantities: Named
    body_moment_nm: float
    residuals: Named
    loads: tuple[Load, ...] = ()


class BodySample(NamedTuple):
    """The body at a step: its joints (effort is the spring's moment), its pressing force, its contact regime."""

    step: int
    time_s: float
    joints: tuple[str, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    effort: tuple[float, ...]
    regime: int
    pressing_force_n: float
    memory: Named
    residuals: Named
    events: tuple[Event, ...] = ()

    def joint(self, name: str) -> Coordinate:
        """Return position, velocity and effort of a joint by its name."""
        return _joint(self, name)


def _joint(sample: LinkageSample | BodySample, name: str) -> Coordinate:
    place = sample.joints.index(name)
    return Coordinate(sample.position[place], sample.velocity[place], sample.effort[place])


Sample = LinkageSample | MotorSample | ForceSample | BodySample


class Frame(NamedTuple):
    """All four roles at one step."""

    linkage: LinkageSample
    motor: MotorSample
    forces: ForceSample
    body: BodySample | None


class Shape(NamedTuple):
    """One element of a drawing: ``kind`` is ``line`` (a strip), ``points``, ``arrow`` (tail, head) or ``text``.

    ``points_m`` are (x, y) pairs in the machine's frame, ``colour`` a (red, green, blue) triple 0-255.  ``text`` is
    written at the element; one of kind ``text`` is the text alone, at its one point.
    """

    name: str
    kind: str
    points_m: tuple[tuple[float, float], ...]
    colour: tuple[int, int, int]
    width_m: float
    text: str = ""


class Drawing(NamedTuple):
    """The mechanism drawn at one step."""

    step: int
    time_s: float
    shapes: tuple[Shape, ...]
