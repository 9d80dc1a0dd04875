# SPDX-License-Identifier: Apache-2.0
"""The samples: data exchanged between roles, the same within one process, over topics and in a bag.

A sample is the *complete* state of a role at one coupling step.  No role keeps state besides the samples it has
returned, so a run can be continued from its last samples, and a run over topics gives the same results as a run in
one process.

Positions are m or rad, velocities m/s or rad/s, efforts N or N m, for prismatic or revolute joints.
"""

from typing import NamedTuple


class Coordinate(NamedTuple):
    """One independent (generalised) coordinate at one time: position, velocity and driving effort."""

    position: float
    velocity: float
    effort: float


class Event(NamedTuple):
    """An event, such as an impact, at its own time between two steps or at one.

    ``time_s`` is exact (never rounded to the step).  The velocities are those of the contact before and after; the
    machine's page defines their sign.  An event that is not an impact has impulse 0.  ``period`` is the cycle of the
    event, counted from 0.  ``pre`` and ``post`` hold the machine's independent coordinates before and after the event,
    in the order of ``LinkageRole.coordinates``; empty if no other role needs them.
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
    """Named numbers; ``names`` is one shared tuple per role, and each name ends in its unit."""

    names: tuple[str, ...] = ()
    values: tuple[float, ...] = ()

    def __getitem__(self, name: str) -> float:  # type: ignore[override]
        return self.values[self.names.index(name)]

    def as_dict(self) -> dict[str, float]:
        """Return the numbers by name."""
        return dict(zip(self.names, self.values, strict=True))


class EffortCommand(NamedTuple):
    """Command to a motor in place of the supply: a feedforward effort, and stiffness and damping about a position.

    At each step the motor gives ``effort + stiffness (position - q) - damping v`` at its first joint, within its limit.
    """

    effort: float = 0.0
    position: float = 0.0
    stiffness: float = 0.0
    damping: float = 0.0


class MotorSample(NamedTuple):
    """The motor at a step: its joints, the supply fraction after rate limiting, and the effort command if any.

    With an effort command the supply is off: its fraction is 0.
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
    """The linkage at a step: every joint (dependent ones too), and all state needed to continue from here.

    ``memory`` is state other than joints (work and losses, time origin).  ``residuals`` are numbers that are zero if
    the twin is correct.  ``events`` are those of the step that ends here.
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
    """The moment on the body before and after an event, and the angular impulse of the event."""

    time_s: float
    kind: str
    contact: str
    moment_before_nm: float
    moment_after_nm: float
    impulse_nms: float


class ForceSample(NamedTuple):
    """Every pin reaction at a step, the derived quantities, and the loads on the body during the step."""

    step: int
    time_s: float
    pins: tuple[str, ...]
    wrenches: tuple[Wrench, ...]
    quantities: Named
    body_moment_nm: float
    residuals: Named
    loads: tuple[Load, ...] = ()


class BodySample(NamedTuple):
    """The body at a step: its joints (effort is the moment of the spring), pressing force, contact regime."""

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
    """One element of a drawing: ``kind`` is ``line`` (a polyline), ``points``, ``arrow`` (tail, head) or ``text``.

    ``points_m`` are (x, y) pairs in the machine's frame, ``colour`` a (red, green, blue) triple 0-255.  ``text`` is
    written at the element; an element of kind ``text`` is the text alone, at its only point.
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
