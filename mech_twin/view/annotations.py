# SPDX-License-Identifier: Apache-2.0
"""Annotations of a mechanism's drawing: pin reactions as arrows, their values, scale bars, blows.

::

        B  <----- force         A  crank bearing  1.73 kN
       /                        B  crank pin      1.73 kN
      o A                       |---|  100 mm   --->  1 kN

The line above the picture has state, time, speed, rate and energy of the blows or power, and alarm.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from mech_twin.capabilities.blow_gauge import RECENT_S, RecentBlows
from mech_twin.capabilities.figure import FORCE, STEEL, Point, label, measure, millimetres
from mech_twin.capabilities.mechanism import FrameTree, Pose, poses
from mech_twin.engine.trajectory import StepSamples
from mech_twin.measurements.units import TURN
from mech_twin.roles import Machine
from mech_twin.samples import Coordinate, Event, ForceSample, Frame, LinkageSample, Shape
from mech_twin.view.extent import Bounds, round_above, with_prefix

AnyStep = Frame | StepSamples
LETTERS = "ABCDEFGHJKLMNPQRSTUVWXYZ"
KEPT_STEPS = 256  # steps by which a drawing may lag behind its forces
ARROW_SHARE = 0.20  # length of the arrow at full scale, in widths of the figure
FLASH_S = 0.15
FLASH = (225, 130, 0)
RAYS = 9
SAME_PLACE = 0.01  # pins closer than this share of the width share a label
SLOWEST_S = 20.0  # a turn that takes longer is no cycle of the power
AGAIN_S = 1.0  # a step so much before the last begins a new run, one so much after it follows a gap
AT_REST = 1e-3  # rad/s or m/s
ROUNDING = 1e-6  # a smaller speed (rad/s) is shown as 0
STALLED = ("stalled", "stalled_1")
POWER = "drive_power_w"
RESET = "reset"  # kind of the event with which a run returns to its initial state; its time goes on
REST = "rest"  # regime of a body in contact with the surface it is pressed on


class BlowMark(NamedTuple):
    """A blow: its time (s), the frame of its contact, and its energy (J)."""

    time_s: float
    frame: str
    energy_j: float


class Annotations:
    """Shapes that go over a drawing; needs the frames of the machine.

    Parameters
    ----------
    energy : callable
        Returns the energy of an impact (J).

    Attributes
    ----------
    largest_n : float
        Largest pin reaction so far (N), which sets the scale of the arrows.
    """

    def __init__(self, tree: FrameTree, energy: Callable[[Event], float]) -> None:
        self._tree = tree
        self._energy = energy
        self._recent: deque[tuple[LinkageSample, ForceSample | None]] = deque(maxlen=KEPT_STEPS)
        self.largest_n = 0.0
        self._blow: BlowMark | None = None

    def add(self, linkage: LinkageSample, forces: ForceSample | None) -> None:
        """Update with a step."""
        self._recent.append((linkage, forces))
        for wrench in () if forces is None else forces.wrenches:
            size_n = math.hypot(wrench.force_x_n, wrench.force_y_n)
            if size_n > self.largest_n and math.isfinite(size_n):
                self.largest_n = size_n

    def strike(self, event: Event) -> None:
        """Update with an event: the hardest of the latest blows is shown."""
        energy_j = self._energy(event)
        if energy_j <= 0.0 or event.contact not in self._tree.frames:
            return
        last = self._blow
        if last is None or event.time_s - last.time_s > FLASH_S or energy_j > last.energy_j:
            self._blow = BlowMark(event.time_s, event.contact, energy_j)

    def shapes(self, time_s: float, bounds: Bounds | None) -> tuple[Shape, ...]:
        """Return the shapes to add to the drawing at a time (s); none before the first step."""
        if bounds is None or not self._recent:
            return ()
        linkage, forces = min(self._recent, key=lambda step: abs(step[0].time_s - time_s))
        at = poses(self._tree, dict(zip(linkage.joints, linkage.position, strict=True)))
        width_m = bounds.width_m
        return (
            *(() if forces is None else self._pins(forces, at, bounds, width_m)),
            *self._flash(time_s, at, width_m),
            _length_bar(bounds, width_m),
        )

    def _pins(self, forces: ForceSample, at: dict[str, Pose], bounds: Bounds, width_m: float) -> list[Shape]:
        known = [(pin, wrench) for pin, wrench in zip(forces.pins, forces.wrenches, strict=True) if pin in at]
        full_n = round_above(self.largest_n)
        reach_m = ARROW_SHARE * width_m
        shapes, rows = [], []
        for letter, (pin, wrench) in zip(LETTERS, known, strict=False):
            size_n = math.hypot(wrench.force_x_n, wrench.force_y_n)
            rows.append(f"{letter}  {pin.replace('_', ' ')}  {with_prefix(size_n, 'N')}")
            scale = reach_m / full_n
            tail = (at[pin].x_m, at[pin].y_m)
            head = (tail[0] + scale * wrench.force_x_n, tail[1] + scale * wrench.force_y_n)
            if size_n > 0.01 * full_n and math.isfinite(size_n):
                shapes.append(Shape(f"force_{pin}", "arrow", (tail, head), FORCE, 0.008 * width_m))
        shapes += _letters([pin for pin, _ in known], at, width_m)
        if rows:
            place = (bounds.left_m + 0.16 * width_m, bounds.low_m + _rows_m(len(rows), bounds))
            shapes.append(label("pin_forces", place, "\n".join(rows), FORCE))
            shapes.append(_force_bar(bounds, width_m, reach_m, full_n))
        return shapes

    def _flash(self, time_s: float, at: dict[str, Pose], width_m: float) -> list[Shape]:
        blow = self._blow
        if blow is None or not 0.0 <= time_s - blow.time_s <= FLASH_S:
            return []
        x, y = at[blow.frame].x_m, at[blow.frame].y_m
        radius = 0.05 * width_m * (1.0 - 0.5 * (time_s - blow.time_s) / FLASH_S)
        rays: list[Point] = [(x, y)]
        for i in range(RAYS):
            angle = 2.0 * math.pi * i / RAYS
            rays += [(x + radius * math.cos(angle), y + radius * math.sin(angle)), (x, y)]
        return [
            Shape("blow", "line", tuple(rays), FLASH, 0.006 * width_m),
            label("blow_energy", (x, y + 1.9 * radius), with_prefix(blow.energy_j, "J"), FLASH),
        ]


def lost_energy(event: Event) -> float:
    """Return the energy lost by the mechanism in an impact (J): impulse times mean contact velocity."""
    return abs(event.impulse_ns * 0.5 * (event.pre_velocity_m_per_s + event.post_velocity_m_per_s))


def _letters(pins: Sequence[str], at: dict[str, Pose], width_m: float) -> list[Shape]:
    """Return the letters of the pins as labels; coincident pins share one."""
    places: list[tuple[Pose, str]] = []
    for letter, pin in zip(LETTERS, pins, strict=False):
        pose = at[pin]
        for i, (other, written) in enumerate(places):
            if math.hypot(pose.x_m - other.x_m, pose.y_m - other.y_m) < SAME_PLACE * width_m:
                places[i] = (other, f"{written}, {letter}")
                break
        else:
            places.append((pose, letter))
    return [label(f"pin_{written}", (pose.x_m, pose.y_m - 0.012 * width_m), written, STEEL) for pose, written in places]


def _rows_m(count: int, bounds: Bounds) -> float:
    """Return the height of a text of this many rows (m) in a figure that fills a panel of usual size."""
    return (count + 1) * 0.034 * (bounds.high_m - bounds.low_m)


def _length_bar(bounds: Bounds, width_m: float) -> Shape:
    length = round_above(0.08 * width_m)
    x, y = bounds.right_m - 0.06 * width_m - length, bounds.low_m + 0.05 * width_m
    return measure("length_scale", (x, y), (x + length, y), millimetres(length), 0.03 * width_m)


def _force_bar(bounds: Bounds, width_m: float, reach_m: float, full_n: float) -> Shape:
    x, y = bounds.right_m - 0.34 * width_m, bounds.low_m + 0.05 * width_m
    ends = ((x, y), (x + 0.5 * reach_m, y))
    return Shape("force_scale", "arrow", ends, FORCE, 0.008 * width_m, with_prefix(0.5 * full_n, "N"))


class Card(NamedTuple):
    """A headline number.

    Attributes
    ----------
    name, shown : str
        Name and value as displayed.
    key : str
        The constant part of the name; empty for a card without a number.
    value : float or None
        Value in ``unit``.
    unit : str
        SI, or ``sigma``.
    most : float or None
        Rated value of the machine, or limit; None if unknown.
    """

    name: str
    shown: str
    key: str = ""
    value: float | None = None
    unit: str = ""
    most: float | None = None


class Banner:
    """Status line of a run, from the latest samples.

    Parameters
    ----------
    tree : FrameTree, optional
        Tells whether the leading joint turns or slides; without it its speed has no unit and is left out.
    """

    def __init__(self, tree: FrameTree | None, energy: Callable[[Event], float] = lost_energy) -> None:
        self._rated_power_w: float | None = None
        self._body_regimes: tuple[str, ...] = ()
        self._command = math.nan
        self._linkage: LinkageSample | None = None
        self.know(tree, energy)
        self._begin()

    def know(self, tree: FrameTree | None, energy: Callable[[Event], float]) -> None:
        """Take the features that need the machine's frames; see the class."""
        self._energy = energy
        self._slides: frozenset[str] = frozenset() if tree is None else tree.sliding_joints
        self._known = tree is not None
        self._leading = "" if tree is None else tree.leading  # the first where it is empty

    def watch(self, machine: Machine) -> None:
        """Take the motor's rated power, at its shaft, and the body's regimes from the configuration."""
        rated = getattr(getattr(machine.parameters, "motor", None), "rated_power_w", None)
        self._rated_power_w = rated if isinstance(rated, float) and rated > 0.0 else None
        self._body_regimes = () if machine.body is None else tuple(machine.body.regimes)

    def _begin(self) -> None:
        """Clear what is known of a run."""
        self._blows = RecentBlows()
        self._power: deque[tuple[float, float, float]] = deque()  # time, angle of the leading joint, work of the drive
        self._power_w = self._turned_rad = 0.0
        self._shaft_w: float | None = None  # of a rated motor whose samples are there
        self._body: deque[tuple[float, float, bool]] = deque()  # time, pressing force, whether it is in contact
        self._broken = ""
        self._begin_s: float | None = None
        self._last_blow: tuple[float, float] | None = None

    def add(self, step: AnyStep) -> None:
        """Update with a step."""
        linkage, motor, forces, body = step.linkage, step.motor, step.forces, step.body
        if motor is not None:
            self._command = motor.command
        if linkage is not None:
            self._follow(linkage)
            self._begin_s = linkage.time_s if self._begin_s is None else self._begin_s
            self._note_broken(linkage)
        if motor is not None and self._rated_power_w is not None:
            self._shaft_w = motor.velocity[0] * motor.effort[0]
        if forces is not None and POWER in forces.quantities.names:
            self._drive(forces.time_s, forces.quantities.as_dict()[POWER] if self._shaft_w is None else self._shaft_w)
        if body is not None and REST in self._body_regimes:
            self._body.append((body.time_s, body.pressing_force_n, self._body_regimes[body.regime] == REST))
            _forget(self._body, body.time_s)

    def _follow(self, linkage: LinkageSample) -> None:
        """Note a step of the linkage, and what its leading joint has turned; it may wrap at one turn."""
        before, self._linkage = self._linkage, linkage
        kinds = [event.kind for event in linkage.events]
        if before is not None and (RESET in kinds or linkage.time_s < before.time_s - AGAIN_S):
            self._begin()
        elif before is not None and linkage.time_s > before.time_s + AGAIN_S:
            self._power.clear()
            self._begin_s = None
        elif before is not None:
            moved = self._leader(linkage).position - self._leader(before).position
            self._turned_rad += math.remainder(moved, TURN) if math.isfinite(moved) else 0.0

    def _drive(self, time_s: float, power_w: float) -> None:
        """Add the work since the last step, and forget what is older than the recent time, or than a slower turn."""
        former_s, _, work_j = self._power[-1] if self._power else (time_s, 0.0, 0.0)
        work_j += 0.5 * (power_w + self._power_w) * (time_s - former_s)
        self._power.append((time_s, self._turned_rad, work_j))
        self._power_w, linkage = power_w, self._linkage
        slow = linkage is not None and self._turns(linkage) and abs(self._leader(linkage).velocity) * SLOWEST_S > TURN
        while len(self._power) > 2:
            next_s, next_rad, _ = self._power[1]
            within_a_turn = slow and abs(self._turned_rad - next_rad) < TURN
            if next_s > time_s - (SLOWEST_S if within_a_turn else RECENT_S):
                break
            self._power.popleft()

    def _mean_power_w(self) -> float:
        """Return the mean power over the whole turns of the recent time, or the last turn; without one over all."""
        now_s, now_rad, now_j = self._power[-1]
        first_s, first_rad, first_j = self._power[0]
        linkage = self._linkage
        turns = 0 if linkage is None or not self._turns(linkage) else math.floor(abs(now_rad - first_rad) / TURN)
        if turns > 0:
            before, after = next(pair for pair in pairwise(self._power) if abs(now_rad - pair[1][1]) < turns * TURN)
            share = (abs(now_rad - before[1]) - turns * TURN) / (abs(now_rad - before[1]) - abs(now_rad - after[1]))
            first_s = before[0] + share * (after[0] - before[0])
            first_j = before[2] + share * (after[2] - before[2])
        return (now_j - first_j) / (now_s - first_s) if now_s > first_s else self._power_w

    def _turns(self, linkage: LinkageSample) -> bool:
        return self._known and (self._leading or linkage.joints[0]) not in self._slides

    def _leader(self, linkage: LinkageSample) -> Coordinate:
        return linkage.joint(self._leading or linkage.joints[0])

    def strike(self, event: Event) -> None:
        """Update with an event."""
        energy_j = self._energy(event)
        if energy_j > 0.0 and self._blows.is_blow(event.time_s, energy_j):
            self._last_blow = (event.time_s, energy_j)

    def text(self) -> str:
        """Return the line in Markdown."""
        linkage = self._linkage
        if linkage is None:
            return "waiting for the first step"
        words = [f"{card.name} {card.shown}" for card in self.cards()]
        alarm = self.alarm()
        parts = [f"**{self.state()}**", f"t = {linkage.time_s:.2f} s", *words]
        return "  ·  ".join([*parts, f"**ALARM: {alarm}**" if alarm else "no alarm"])

    def state(self) -> str:
        """Return the state of the machine in one or two words."""
        linkage = self._linkage
        if linkage is None:
            return "waiting for the first step"
        if is_stalled(linkage):
            return "stalled"
        if self._command > 0.0:
            return "running"
        return "running down" if abs(self._leader(linkage).velocity) > AT_REST else "stopped"

    @property
    def command(self) -> float | None:
        """The supply command as a share of rated frequency; None before the first step."""
        return None if math.isnan(self._command) else self._command

    def alarm(self) -> str:
        """Return the alarm text; empty if there is none."""
        linkage = self._linkage
        return self._broken or ("the machine is stalled" if linkage is not None and is_stalled(linkage) else "")

    def cards(self) -> list[Card]:
        """Return the headline numbers: speed, rate, last blow, pressing force, contact share, power."""
        linkage = self._linkage
        return [] if linkage is None else [*self._speed(linkage), *self._work(linkage)]

    def _speed(self, linkage: LinkageSample) -> list[Card]:
        joint, speed = self._leading or linkage.joints[0], self._leader(linkage).velocity
        if not self._known:
            return []
        name = joint.replace("_", " ")
        if joint in self._slides:
            return [Card(name, f"{speed:+.2f} m/s", name, speed, "m/s")]
        shown = "0" if abs(speed) < ROUNDING else f"{speed:.4g}"
        return [Card(name, f"{shown} rad/s", name, speed, "rad/s")]  # unit of terminal and topics

    def _work(self, linkage: LinkageSample) -> list[Card]:
        self._blows.forget(linkage.time_s)
        found = []
        if (rate_hz := self._blow_rate(linkage.time_s)) > 0.0:
            found.append(Card("blow rate", f"{rate_hz:.1f}/s", "blow rate", rate_hz, "1/s"))
        if self._last_blow is not None:
            time_s, energy_j = self._last_blow
            found.append(Card(f"last blow at {time_s:.2f} s", with_prefix(energy_j, "J"), "last blow", energy_j, "J"))
        if self._body:
            count = len(self._body)
            mean_n = sum(force for _, force, _ in self._body) / count
            percent = 100.0 * sum(rests for *_, rests in self._body) / count
            found.append(Card("mean pressing force", with_prefix(mean_n, "N"), "mean pressing force", mean_n, "N"))
            found.append(Card("contact share", f"{percent:.0f} %", "contact share", percent, "%"))
        if self._power:
            at_drive, mean_w = self._shaft_w is None, self._mean_power_w()
            name, most_w = ("mean drive power", None) if at_drive else ("mean motor power", self._rated_power_w)
            found.append(Card(name, with_prefix(mean_w, "W"), name, mean_w, "W", most_w))
        return found

    def _blow_rate(self, now_s: float) -> float:
        """Return the blows per second of the recent time: from first to last blow where that is most of it."""
        span_s = min(RECENT_S, now_s - (now_s if self._begin_s is None else self._begin_s))
        struck_s = self._blows.times_s()
        if not struck_s or span_s <= 0.0:
            return 0.0
        apart_s = struck_s[-1] - struck_s[0]
        return (len(struck_s) - 1) / apart_s if apart_s > 0.5 * span_s else len(struck_s) / span_s

    def _note_broken(self, linkage: LinkageSample) -> None:
        for joint, position, speed in zip(linkage.joints, linkage.position, linkage.velocity, strict=True):
            if not self._broken and not (math.isfinite(position) and math.isfinite(speed)):
                self._broken = f"{joint} is not finite at {linkage.time_s:.3f} s"


def is_stalled(linkage: LinkageSample) -> bool:
    """Return whether a memory of the linkage marks it as stalled."""
    memory = linkage.memory.as_dict()
    return any(memory.get(name, 0.0) > 0.0 for name in STALLED)


def _forget(values: deque[Any], now_s: float) -> None:
    while values and values[0][0] < now_s - RECENT_S:
        values.popleft()
