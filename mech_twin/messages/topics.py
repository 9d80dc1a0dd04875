# SPDX-License-Identifier: Apache-2.0
"""Names, types and quality of service of every topic, relative to the machine's namespace."""

from __future__ import annotations

from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TransformStamped, Vector3Stamped, WrenchStamped
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

DEPTH = 2000  # two seconds at a thousand steps a second: a listener may stall that long and miss nothing

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


class Topic(NamedTuple):
    """A topic: its name, its message type and the quality of service it is published with."""

    name: str
    type: Any
    qos: QoSProfile = DATA


# what the roles exchange: one whole sample a step, with rows that are no joints
STEP_LINKAGE = Topic("step/linkage", JointState)
STEP_MOTOR = Topic("step/motor", JointState)
STEP_FORCES = Topic("step/forces", JointState)
STEP_BODY = Topic("step/body", JointState)
# what people and other tools read: joints and efforts alone, decimated
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
BLOW_GAUGE = Topic("blow/gauge", JointState)  # one message a blow; where a gauge is on what is struck
BLOW_WAVE = Topic("blow/wave", JointTrajectory)  # where its curve is asked for
DESCRIPTION = Topic("description", String, LATCHED)
FRAMES = Topic("frames", TransformStamped)  # one message a frame; the same on /tf where tf2_msgs is installed
ROBOT_DESCRIPTION = Topic("robot_description", String, LATCHED)  # URDF
REJOIN = Topic("rejoin", String)  # "linkage", "body" or "motor" asks where that one was
REJOIN_MOTOR = Topic("rejoin/motor", JointState)
REJOIN_LINKAGE = Topic("rejoin/linkage", JointState)
REJOIN_DESCRIPTION = Topic("rejoin/description", String)
REJOIN_BODY = Topic("rejoin/body", JointState)
WRENCHES = "forces"  # below it, one topic a pin
# what a shadow says of a machine, beside it and never on its own names
TWIN = "twin"
ESTIMATED = Topic(f"{TWIN}/estimated/joint_states", JointState)
RESIDUALS = Topic(f"{TWIN}/residuals/joint_states", JointState)
STANDARD_RESIDUALS = Topic(f"{TWIN}/residuals/standard", JointState)  # features of a cycle, in sigma
VIRTUAL = f"{TWIN}/virtual"  # below it, one topic a pin
VIRTUAL_DRIVE = Topic(f"{VIRTUAL}/drive", WrenchStamped)
VIRTUAL_PRESSING_FORCE = Topic(f"{VIRTUAL}/pressing_force", WrenchStamped)
DETECTED_IMPACTS = Topic(f"{TWIN}/impacts", Vector3Stamped)
RECOMMENDATION = Topic(f"{TWIN}/recommendation", DiagnosticStatus, LATCHED)
DECISIONS = Topic(f"{TWIN}/decisions", DiagnosticStatus)
CLOCK = Topic("/clock", Clock)
OWN_CLOCK = Topic("clock", Clock)  # in the namespace, where CLOCK may be another machine's
DIAGNOSTICS = Topic("/diagnostics", DiagnosticArray)


def pin_wrench(pin: str) -> Topic:
    """Return the topic of one pin's reaction."""
    return Topic(f"{WRENCHES}/{pin}", WrenchStamped)


def virtual_pin(pin: str) -> Topic:
    """Return the topic of the estimated reaction of one pin."""
    return Topic(f"{VIRTUAL}/{pin}", WrenchStamped)


def sigma_of(topic: Topic) -> Topic:
    """Return the topic of the standard deviation of what is estimated on a topic."""
    return topic._replace(name=f"{topic.name}/sigma")


def shadow_topics(pins: tuple[str, ...], has_body: bool) -> tuple[Topic, ...]:
    """Return the topics of a shadow."""
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
    """Return the topics that carry one whole sample each step."""
    always = (STEP_LINKAGE, STEP_MOTOR, STEP_FORCES)
    return (*always, STEP_BODY) if has_body else always


def joint_state_topics(has_body: bool) -> tuple[Topic, ...]:
    """Return the topics of plain joint states."""
    always = (JOINT_STATES, MOTOR_JOINT_STATES, FORCE_JOINT_STATES)
    return (*always, BODY_JOINT_STATES) if has_body else always


def run_topics(has_body: bool) -> tuple[Topic, ...]:
    """Return the topics of which there is one publisher each: step messages and joint states."""
    return (*step_topics(has_body), *joint_state_topics(has_body))


def recorded_topics(pins: tuple[str, ...], has_body: bool) -> tuple[Topic, ...]:
    """Return everything a recording holds."""
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
    """Return the topic's name within a machine's namespace."""
    return topic.name if topic.name.startswith("/") else f"/{machine_name}/{topic.name}"
