# SPDX-License-Identifier: Apache-2.0
"""The four roles of a machine (motor, linkage, forces, body), and the machine that contains them.

A role is a pure function between samples.  It holds immutable parameters and nothing else: all state is in the samples,
so a role can be rebuilt, restarted in another process or given new parameters between any two steps.

A motion computed from its last event has its state in that event's memory, not in the joints (`AnchoredMotion`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, runtime_checkable

from mech_twin.declarations.quantity import Parameters
from mech_twin.samples import BodySample, Event, ForceSample, Frame, LinkageSample, MotorSample, Shape

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mech_twin.capabilities.blow_gauge import BlowGauge
    from mech_twin.capabilities.cycle import CycleFeatures
    from mech_twin.capabilities.design import DesignQuestion
    from mech_twin.capabilities.faults import MachineFault, OperatingVariable
    from mech_twin.capabilities.long_run import RegimeQuestion, SynthesisQuestion
    from mech_twin.capabilities.mechanism import FrameTree
    from mech_twin.capabilities.plots import Picture
    from mech_twin.capabilities.published import PublishedRow
    from mech_twin.capabilities.sizing import SizingQuestion


class AnchoredMotion(NamedTuple):
    """Columns of that state, and the function that moves its time origin.

    Attributes
    ----------
    later : mapping
        For each state column: the column that holds it one step later, and the sign.
    origin, tau : str
        Columns of the step at which the anchor's time is 0, which is a state too, and of that time (s).
    not_below_zero : tuple of str
        State columns that cannot be negative.
    anchor_at : callable
        ``anchor_at(model, row, step)`` moves the anchor of a linkage row to this step; the motion is unchanged.
    """

    later: Mapping[str, tuple[str, float]]
    origin: str
    tau: str
    not_below_zero: tuple[str, ...]
    anchor_at: Callable[[Any, NDArray[np.float64], int], None]


class Invariant(NamedTuple):
    """A residual that is 0 except for rounding if the twin is correct: its unit, and what it compares.

    One ``of_the_step`` measures how far the roles diverge within a coupling step: a shorter step lowers it and its
    limit, down to ``least_limit``.
    """

    unit: str
    meaning: str
    of_the_step: bool = False
    least_limit: float = math.inf


# all names of residuals in samples; a relative residual has the unit 1
RESIDUALS: Mapping[str, Invariant] = MappingProxyType(
    {
        "loop_closure_m": Invariant("m", "worst miss of a link's length by the joints solved for"),
        "rod_length": Invariant("1", "worst miss of a rod's length, over that length"),
        "energy_balance": Invariant("1", "energy held less work and losses booked, over the energy turned over"),
        "momentum_balance": Invariant("1", "momentum less impulses booked, over the momentum"),
        "coupling_defect": Invariant(
            "1", "energy by which a follower's own angle changes a step's start, over that held", True, 1e-5
        ),
        "drive_torque_routes": Invariant("1", "drive torque by pin forces less by the reduced machine, over its peak"),
        "body_moment_routes": Invariant("1", "moment on the body by pin forces less by the coupled motion"),
        "impulse_routes": Invariant("1", "impulse of a blow by pin impulses less by the jump of the coupled motion"),
        "penetration_rad": Invariant("rad", "angle by which a body lies beyond its stop", True, 1e-6),
        "area_balance": Invariant("1", "area the package lost less area of the yarn run, over that of all its yarn"),
    }
)


class MotorRole(Protocol):
    """Torque (or prescribed speed) of the drive at the present speed of the linkage."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the order of the samples' columns."""
        ...

    def respond(self, linkage: LinkageSample, target: float) -> MotorSample:
        """Return the drive at the linkage's step; ``target`` is the commanded fraction of rated supply frequency."""
        ...


@runtime_checkable
class EffortMotor(Protocol):
    """A motor that accepts effort commands: only its effort acts on the linkage."""

    @property
    def effort_limit(self) -> float:
        """Largest effort (N m, or N of a linear drive); 0 if this configuration accepts no effort command."""
        ...


class LinkageRole(Protocol):
    """Computes all state of mechanism and drive."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the order of the samples' columns."""
        ...

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the independent (generalised) coordinates, in the order of an event's ``pre`` and ``post``."""
        ...

    @property
    def regimes(self) -> tuple[str, ...]:
        """Names of the regimes; a sample holds the index."""
        ...

    @property
    def residual_limits(self) -> Mapping[str, float]:
        """Limit of each residual; more is an error of the twin itself."""
        ...

    def start(self, step: int = 0) -> LinkageSample:
        """Return the machine at rest (or in its configured initial state) at this step."""
        ...

    def advance(self, linkage: LinkageSample, motor: MotorSample, body: BodySample | None) -> LinkageSample:
        """Return the linkage one coupling step later, with its events located inside the step."""
        ...


class CrankState(NamedTuple):
    """Measured crank angle (rad), speed (rad/s), acceleration (rad/s2); and angle and speed of the body if measured."""

    crank_rad: float
    crank_rad_per_s: float
    crank_rad_per_s2: float
    body_rad: float | None = None
    body_rad_per_s: float = 0.0


@runtime_checkable
class GuidedLinkage(Protocol):
    """A linkage whose whole state follows from the motion of its crank (inverse dynamics)."""

    def guided(self, step: int, time_s: float, motion: CrankState) -> LinkageSample:
        """Return the linkage in this motion, with the crank torque that the motion requires."""
        ...


class ForceRole(Protocol):
    """Forces that follow from the motion (inverse dynamics); a function without state."""

    @property
    def pins(self) -> tuple[str, ...]:
        """Names of the pins, in the order of the wrenches."""
        ...

    @property
    def acts_on(self) -> tuple[str, ...]:
        """The link each wrench acts on."""
        ...

    @property
    def residual_limits(self) -> Mapping[str, float]:
        """Limit of each residual; more is an error of the twin itself."""
        ...

    def analyse(self, linkage: LinkageSample) -> ForceSample:
        """Return every pin reaction, the derived quantities, and the loads on the body during the step."""
        ...


class BodyRole(Protocol):
    """Computes the body's angle and contact state."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the order of the samples' columns."""
        ...

    @property
    def regimes(self) -> tuple[str, ...]:
        """Names of the regimes; a sample holds the index."""
        ...

    @property
    def residual_limits(self) -> Mapping[str, float]:
        """Limit of each residual; more is an error of the twin itself."""
        ...

    def start(self, forces: ForceSample) -> BodySample:
        """Return the body at rest on its stop at the step of these forces."""
        ...

    def follow(self, body: BodySample, forces: ForceSample) -> BodySample:
        """Return the body one coupling step later, under the loads of that step."""
        ...


class Observer(Protocol):
    """Metrics of a run, updated frame by frame in bounded memory."""

    def observe(self, frame: Frame) -> None:
        """Update with one frame."""
        ...

    def numbers(self) -> dict[str, float]:
        """Return the metrics so far, units in the names."""
        ...


def unchanged(observer: Observer) -> None:
    """Leave an observer that knows no parameters as it is."""


def no_remarks(numbers: Mapping[str, float]) -> Iterable[str]:
    """Return no remarks."""
    return ()


@dataclass(frozen=True)
class Machine:
    """Parameters, the four roles built from them, and functions for analysis, drawing and metrics.

    Attributes
    ----------
    name : str
        Catalogue name, of a page ``page``; `own_name` is that of its topics.
    parameters : Parameters
        The validated model the roles were built from.
    coupling_step_s : float
        Macro step of the coupling scheme (s).
    motor, linkage, forces, body
        The roles; ``body`` is None if nothing moves but the linkage.
    draw : callable
        Drawing of the mechanism in the machine's frame.
    report : callable
        Closed-form metrics of one cycle, units in the names (the ``summary`` of an analysis).
    analyse : callable
        ``analyse(crank_rad)``: every angle, speed, force and constant at one position.
    observer : callable
        Returns a new observer for one run.
    goes_on : callable
        ``goes_on(observer)``: the observer's run, begun with other parameters, goes on with this machine.
    mechanism : FrameTree
        Frames of the links and pins, for TF and the robot description (URDF); None if there are none.
    rests_when_supplied : bool
        Whether the drive stands still at times in normal operation, so that standstill does not indicate a stall.
    blow_energy : callable
        Energy of an impact from its event (J), 0 if it is not a blow; None if it equals the mechanism's energy loss.
    gauge : BlowGauge
        Strain gauge on the struck part; None if there is none.
    remarks : callable
        ``remarks(numbers)``: lines on numbers of a run outside the validity of the model, and on its approximations.
    """

    name: str
    parameters: Parameters
    coupling_step_s: float
    motor: MotorRole
    linkage: LinkageRole
    forces: ForceRole
    body: BodyRole | None
    draw: Callable[[LinkageSample, BodySample | None], tuple[Shape, ...]]
    report: Callable[[], dict[str, float]]
    analyse: Callable[[float], dict[str, Any]]
    observer: Callable[[], Observer]
    mechanism: FrameTree | None = None
    rests_when_supplied: bool = False
    blow_energy: Callable[[Event], float] | None = None
    gauge: BlowGauge | None = None
    remarks: Callable[[Mapping[str, float]], Iterable[str]] = no_remarks
    goes_on: Callable[[Observer], None] = unchanged


def own_name(machine: str, parameters: Parameters) -> str:
    """Return the name that a machine has on its topics and for its user: of a page the one that stands on it."""
    return str(getattr(parameters, "name", machine))


@dataclass(frozen=True)
class Capabilities:
    """Studies that a machine supports besides simulation; None for one that it does not support.

    Attributes
    ----------
    published : callable
        ``published(parameters)``: every published number with the computed one.
    pictures : callable
        ``pictures(parameters)``: the figures of the sources, redrawn.
    sizing : SizingQuestion
        Sizes of the machine's parts under limits.
    design : DesignQuestion
        Choice of the machine's dimensions within bounds, under limits.
    synthesis : SynthesisQuestion
        Synthesis of a cycle for a wanted blow.
    regimes : RegimeQuestion
        Long-run regimes over the values of a key.
    features : callable
        ``features(parameters)``: the numbers that describe one cycle from sensor signals.
    faults : callable
        ``faults(parameters)``: possible faults, as changes of parameters.
    operating : callable
        ``operating(parameters)``: variables that may differ from day to day on a healthy machine, and their ranges.
    anchored_motion : AnchoredMotion
        The state of a machine as continued from its last event, for the state observer.
    works_taken : tuple of str
        Works in the linkage's memory that are positive where they take energy from the machine.
    """

    published: Callable[[Any], Iterable[PublishedRow]] | None = None
    pictures: Callable[[Any], Iterable[Picture]] | None = None
    sizing: SizingQuestion | None = None
    design: DesignQuestion | None = None
    synthesis: SynthesisQuestion | None = None
    regimes: RegimeQuestion | None = None
    features: Callable[[Any], CycleFeatures] | None = None
    faults: Callable[[Any], tuple[MachineFault, ...]] | None = None
    operating: Callable[[Any], tuple[OperatingVariable, ...]] | None = None
    anchored_motion: AnchoredMotion | None = None
    works_taken: tuple[str, ...] = ()
