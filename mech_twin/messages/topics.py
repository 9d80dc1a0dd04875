# SPDX-License-Identifier: Apache-2.0
"""Names, types and quality of service of every topic, relative to the machine's namespace.

Streams are decimated: samples keep those around impacts, scalar quantities the largest of each window::

    step      0  1  2  3  4  5  6  7  8  9 10 11 ...        window of 10 steps
    sent      o                 o  o        o               at step 7 an impact: 6 is before it, 7 after
"""

import math
from collections.abc import Sequence
from typing import Any, Generic, NamedTuple, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TransformStamped, Vector3Stamped, WrenchStamped
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from mech_twin.samples import Event, Load, Wrench

Kept = TypeVar("Kept")

STREAM_RATE_HZ = 100.0
DEPTH = 2000  # 2 s at 1000 steps/s: a subscriber may stall that long without loss

DATA = QoSProfile(depth=DEPTH, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.RELIABLE)
LATCHED = QoSProfile(
    depth=1,
    history=HistoryPolicy.KEEP_LAST,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)
EVERY = QoSProfile(history=HistoryPolicy.KEEP_ALL, depth=0, reliability=ReliabilityPolicy.RELIABLE)
EVERY_LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_ALL,
    depth=0,
    reliability=ReliabilityPolicy.RELIABLE,
    durability=DurabilityPolicy.TRANSIENT_LOCAL,
)


def steps_per_window(rate_hz: float, step_s: float) -> int:
    """Return the number of coupling steps per window of a stream; 1 if the rate (Hz) is that of the steps or higher."""
    return max(1, round(1.0 / (rate_hz * step_s)))


def has_impact(happenings: Sequence[Event] | Sequence[Load]) -> bool:
    """Return whether one of these events or loads has an impulse."""
    if not happenings:
        return False
    return any((each.impulse_ns if isinstance(each, Event) else each.impulse_nms) != 0.0 for each in happenings)


def wrench_size(wrench: Wrench) -> float:
    """Return the magnitude for comparing wrenches in decimation: force (N) plus moment (N m)."""
    return math.hypot(wrench.force_x_n, wrench.force_y_n) + abs(wrench.moment_nm)


class StreamWindow(Generic[Kept]):
    """Selects items of a stream: the first of each window, those around an impact, and the largest of the window.

    Items are returned in order, each at most once.

    Parameters
    ----------
    length : int
        Steps in a window; windows begin at its multiples.
    """

    def __init__(self, length: int) -> None:
        self._length = length
        self._before: Kept | None = None
        self._greatest: Kept | None = None
        self._largest = 0.0

    def offer(self, step: int, item: Kept, magnitude: float = 0.0, impact: bool = False) -> tuple[Kept, ...]:
        """Add the item of a step; return the items to publish now.

        Parameters
        ----------
        step : int
            Index of the step.
        item : Kept
            Item of the step.
        magnitude : float
            Magnitude for the largest of a window; if always 0, no largest is selected.
        impact : bool
            Whether an impact occurred in the step that ends here.
        """
        begins = step % self._length == 0
        if begins or impact:
            due = (*self.rest(), *(() if self._before is None or not impact else (self._before,)), item)
            self._before = None
            self._largest = magnitude if begins else max(self._largest, magnitude)
            return due
        if magnitude > self._largest:
            self._largest, self._greatest, self._before = magnitude, item, item
        else:
            self._before = item
        return ()

    def rest(self) -> tuple[Kept, ...]:
        """Return the largest item of the window so far, if not yet returned."""
        greatest, self._greatest = self._greatest, None
        if greatest is None:
            return ()
        if greatest is self._before:
            self._before = None
        return (greatest,)


class PeakHoldWindow(Generic[Kept]):
    """Selects items of a stream: the largest of each window, so that peaks are kept.

    Parameters
    ----------
    length : int
        Items in a window.
    """

    def __init__(self, length: int) -> None:
        self._length = length
        self._seen = 0
        self._largest = -1.0
        self._kept: tuple[Kept, ...] = ()

    def offer(self, magnitude: float, item: Kept) -> tuple[Kept, ...]:
        """Offer an item; at the end of a window return that of the largest magnitude."""
        if magnitude > self._largest:
            self._largest, self._kept = magnitude, (item,)
        self._seen += 1
        return self.rest() if self._seen >= self._length else ()

    def rest(self) -> tuple[Kept, ...]:
        """End the window here, and return its largest item if it has any."""
        kept = self._kept
        self._seen, self._largest, self._kept = 0, -1.0, ()
        return kept


class Topic(NamedTuple):
    """A topic: its name, its message type and the quality of service it is published with."""

    name: str
    type: Any
    qos: QoSProfile = DATA


# exchange of the roles: one complete sample per step, with rows besides the joints
STEP_LINKAGE = Topic("step/linkage", JointState)
STEP_MOTOR = Topic("step/motor", JointState)
STEP_FORCES = Topic("step/forces", JointState)
STEP_BODY = Topic("step/body", JointState)
# for display and other tools: joints and efforts only, decimated
JOINT_STATES = Topic("joint_states", JointState)
MOTOR_JOINT_STATES = Topic("motor/joint_states", JointState)
FORCE_JOINT_STATES = Topic("forces/joint_states", JointState)
BODY_JOINT_STATES = Topic("body/joint_states", JointState)
SPEED_COMMAND = Topic("motor/speed_command", Float64)
EFFORT_COMMAND = Topic("motor/effort_command", Float64)
POSITION_COMMAND = Topic("motor/position_command", Float64MultiArray)
PRESSING_FORCE = Topic("body/pressing_force", WrenchStamped)
IMPACTS = Topic("impacts", Vector3Stamped)
SCENE = Topic("scene", MarkerArray)
BLOW_GAUGE = Topic("blow/gauge", JointState)  # one message per blow, if there is a gauge on the struck part
BLOW_WAVE = Topic("blow/wave", JointTrajectory)  # if its curve is requested
DESCRIPTION = Topic("description", String, LATCHED)
FRAMES = Topic("frames", TransformStamped)  # one message per frame; also on /tf if tf2_msgs is installed
ROBOT_DESCRIPTION = Topic("robot_description", String, LATCHED)  # URDF
REJOIN = Topic("rejoin", String)  # "linkage", "body" or "motor" requests its last state
REJOIN_MOTOR = Topic("rejoin/motor", JointState)
REJOIN_LINKAGE = Topic("rejoin/linkage", JointState)
REJOIN_DESCRIPTION = Topic("rejoin/description", String)
REJOIN_BODY = Topic("rejoin/body", JointState)
WRENCHES = "forces"  # prefix of one topic per pin

# topics of a shadow, below a prefix of their own and never on the machine's topics
TWIN = "twin"
ESTIMATED = Topic(f"{TWIN}/estimated/joint_states", JointState)
RESIDUALS = Topic(f"{TWIN}/residuals/joint_states", JointState)
STANDARD_RESIDUALS = Topic(f"{TWIN}/residuals/standard", JointState)  # features of a cycle, in sigma
VIRTUAL = f"{TWIN}/virtual"  # prefix of one topic per pin
VIRTUAL_DRIVE = Topic(f"{VIRTUAL}/drive", WrenchStamped)
VIRTUAL_PRESSING_FORCE = Topic(f"{VIRTUAL}/pressing_force", WrenchStamped)
DETECTED_IMPACTS = Topic(f"{TWIN}/impacts", Vector3Stamped)
RECOMMENDATION = Topic(f"{TWIN}/recommendation", DiagnosticStatus, LATCHED)
DECISIONS = Topic(f"{TWIN}/decisions", DiagnosticStatus)
CLOCK = Topic("/clock", Clock)
OWN_CLOCK = Topic("clock", Clock)  # in the namespace; CLOCK may be of another machine
DIAGNOSTICS = Topic("/diagnostics", DiagnosticArray)


def pin_wrench(pin: str) -> Topic:
    """Return the topic of one pin's reaction."""
    return Topic(f"{WRENCHES}/{pin}", WrenchStamped)


def virtual_pin(pin: str) -> Topic:
    """Return the topic of the estimated reaction of one pin."""
    return Topic(f"{VIRTUAL}/{pin}", WrenchStamped)


def sigma_of(topic: Topic) -> Topic:
    """Return the topic with the standard deviation of an estimated topic."""
    return topic._replace(name=f"{topic.name}/sigma")


def shadow_topics(pins: tuple[str, ...], has_body: bool) -> tuple[Topic, ...]:
    """Return the topics that a shadow publishes."""
    body = (VIRTUAL_PRESSING_FORCE,) if has_body else ()
    estimated = (ESTIMATED, *map(virtual_pin, pins), VIRTUAL_DRIVE, *body)
    return (
        *estimated,
        *map(sigma_of, estimated),
        RESIDUALS,
        STANDARD_RESIDUALS,
        DETECTED_IMPACTS,
        RECOMMENDATION,
        DECISIONS,
    )


def step_topics(has_body: bool) -> tuple[Topic, ...]:
    """Return the topics with one complete sample per step."""
    always = (STEP_LINKAGE, STEP_MOTOR, STEP_FORCES)
    return (*always, STEP_BODY) if has_body else always


def joint_state_topics(has_body: bool) -> tuple[Topic, ...]:
    """Return the topics of plain joint states."""
    always = (JOINT_STATES, MOTOR_JOINT_STATES, FORCE_JOINT_STATES)
    return (*always, BODY_JOINT_STATES) if has_body else always


def run_topics(has_body: bool) -> tuple[Topic, ...]:
    """Return the topics that must have a single publisher each: step messages and joint states."""
    return (*step_topics(has_body), *joint_state_topics(has_body))


def recorded_topics(pins: tuple[str, ...], has_body: bool) -> tuple[Topic, ...]:
    """Return the topics of a recording."""
    body = (PRESSING_FORCE,) if has_body else ()
    wrenches = tuple(pin_wrench(pin) for pin in pins)
    commands = (SPEED_COMMAND, EFFORT_COMMAND, POSITION_COMMAND)
    rest = (*commands, IMPACTS, SCENE, DESCRIPTION, CLOCK, DIAGNOSTICS)
    return (*run_topics(has_body), *wrenches, *body, *rest)


def type_name(topic: Topic) -> str:
    """Return the full name of a topic's type, such as ``sensor_msgs/msg/JointState``."""
    package, folder, _ = topic.type.__module__.split(".", 2)
    return f"{package}/{folder}/{topic.type.__name__}"


def full_name(machine_name: str, topic: Topic) -> str:
    """Return the topic's name within a machine's namespace, which is empty for the root."""
    return topic.name if topic.name.startswith("/") else f"/{machine_name}/{topic.name}".replace("//", "/")
