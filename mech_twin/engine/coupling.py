"""The one coupling scheme: what is computed from what at a step, in one process and over topics alike.

At step n::

    linkage(n) -> motor(n)
    linkage(n) -> forces(n) -> body(n)          body(n) from body(n-1)
    linkage(n), motor(n), body(n) -> linkage(n+1)

The linkage leads each step and locates its own events; the body follows under the loads of that step.  The nodes
call the same three functions, step index by step index, so a run over topics is bit for bit this one.
"""

from __future__ import annotations

from mech_twin.roles import BodyRole, Machine
from mech_twin.samples import BodySample, Event, ForceSample, Frame, LinkageSample

RESET = "reset"


def restarted(machine: Machine, step: int) -> LinkageSample:
    """Return the linkage back in its initial state at a later step; simulation time goes on."""
    sample = machine.linkage.start(step)
    return sample._replace(events=(Event(sample.time_s, RESET, "linkage"), *sample.events))


def next_body(role: BodyRole, body: BodySample | None, forces: ForceSample) -> BodySample:
    """Return the body at the step of these forces; it starts anew at the first step and after a reset."""
    if body is None or any(load.kind == RESET for load in forces.loads):
        return role.start(forces)
    return role.follow(body, forces)


def complete_frame(machine: Machine, linkage: LinkageSample, body: BodySample | None, target: float) -> Frame:
    """Return the frame that belongs to this linkage sample; ``body`` is the one of the step before."""
    motor = machine.motor.respond(linkage, target)
    forces = machine.forces.analyse(linkage)
    followed = None if machine.body is None else next_body(machine.body, body, forces)
    return Frame(linkage, motor, forces, followed)


def next_frame(machine: Machine, frame: Frame, target: float) -> Frame:
    """Return the frame one coupling step later."""
    linkage = machine.linkage.advance(frame.linkage, frame.motor, frame.body)
    return complete_frame(machine, linkage, frame.body, target)
