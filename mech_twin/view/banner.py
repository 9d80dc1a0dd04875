# SPDX-License-Identifier: Apache-2.0
"""The line above the picture: state, time, speed, rate and energy of the blows or power, alarm."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

from mech_twin.capabilities.mechanism import FrameTree
from mech_twin.samples import BodySample, Event, ForceSample, LinkageSample, MotorSample, Named
from mech_twin.view.annotations import lost_energy
from mech_twin.view.scale import with_prefix

RECENT_S = 2.0  # time window of blow rate, energy and power
WEAK_SHARE = 0.05  # blows below this share of the hardest recent one are bounces
AT_REST = 1e-3  # rad/s or m/s
STALLED = ("stalled", "stalled_1")
POWER = "drive_power_w"
REST = "rest"  # regime of a body in contact with the surface it is pressed on


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
    energy : callable
        Returns the energy of an impact (J).
    """

    def __init__(self, tree: FrameTree | None, energy: Callable[[Event], float] = lost_energy) -> None:
        self._energy = energy
        self.rated_power_w: float | None = None
        self.body_regimes: tuple[str, ...] = ()
        self._slides = sliding_joints(tree)
        self._known = tree is not None
        self._command = math.nan
        self._linkage: LinkageSample | None = None
        self._blows: deque[tuple[float, float]] = deque()
        self._power: deque[tuple[float, float]] = deque()
        self._body: deque[tuple[float, float, bool]] = deque()  # time, pressing force, whether it is in contact
        self._broken = ""
        self._last_blow: tuple[float, float] | None = None

    def add(
        self,
        motor: MotorSample | None,
        linkage: LinkageSample | None,
        forces: ForceSample | None,
        body: BodySample | None = None,
    ) -> None:
        """Update with a step."""
        if motor is not None:
            self._command = motor.command
        if linkage is not None:
            self._linkage = linkage
            self._note_broken(linkage)
        if forces is not None and POWER in forces.quantities.names:
            self._power.append((forces.time_s, _named(forces.quantities, POWER)))
            _forget(self._power, forces.time_s)
        if body is not None and REST in self.body_regimes:
            self._body.append((body.time_s, body.pressing_force_n, self.body_regimes[body.regime] == REST))
            _forget(self._body, body.time_s)

    def strike(self, event: Event) -> None:
        """Update with an event."""
        energy_j = self._energy(event)
        if energy_j > 0.0:
            self._blows.append((event.time_s, energy_j))
            _forget(self._blows, event.time_s)
            if energy_j > WEAK_SHARE * max(energy for _, energy in self._blows):
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
        if self._stalled(linkage):
            return "stalled"
        if self._command > 0.0:
            return "running"
        return "running down" if abs(linkage.velocity[0]) > AT_REST else "stopped"

    @property
    def command(self) -> float | None:
        """The supply command as a share of rated frequency; None before the first step."""
        return None if math.isnan(self._command) else self._command

    def alarm(self) -> str:
        """Return the alarm text; empty if there is none."""
        linkage = self._linkage
        return self._broken or ("the machine is stalled" if linkage is not None and self._stalled(linkage) else "")

    def cards(self) -> list[Card]:
        """Return the headline numbers: speed, rate, last blow, pressing force, contact share, power."""
        linkage = self._linkage
        return [] if linkage is None else [*self._speed(linkage), *self._work(linkage)]

    def _stalled(self, linkage: LinkageSample) -> bool:
        memory = linkage.memory
        return any(name in memory.names and _named(memory, name) > 0.0 for name in STALLED)

    def _speed(self, linkage: LinkageSample) -> list[Card]:
        joint, speed = linkage.joints[0], linkage.velocity[0]
        if not self._known:
            return []
        name = joint.replace("_", " ")
        if joint in self._slides:
            return [Card(name, f"{speed:+.2f} m/s", name, speed, "m/s")]
        return [Card(name, f"{speed:.4g} rad/s", name, speed, "rad/s")]  # unit of terminal and topics

    def _work(self, linkage: LinkageSample) -> list[Card]:
        _forget(self._blows, linkage.time_s)
        found = []
        hardest = max((energy for _, energy in self._blows), default=0.0)
        real = [(time_s, energy) for time_s, energy in self._blows if energy > WEAK_SHARE * hardest]
        if len(real) > 1:
            rate_hz = (len(real) - 1) / (real[-1][0] - real[0][0])
            found.append(Card("blow rate", f"{rate_hz:.1f}/s", "blow rate", rate_hz, "1/s"))
        if self._last_blow is not None:
            time_s, energy_j = self._last_blow
            found.append(Card(f"last blow at {time_s:.2f} s", with_prefix(energy_j, "J"), "last blow", energy_j, "J"))
        if self._body:
            count = len(self._body)
            mean_n = sum(force for _, force, _ in self._body) / count
            percent = 100.0 * sum(rests for *_, rests in self._body) / count
            found.append(Card("pressing force", with_prefix(mean_n, "N"), "pressing force", mean_n, "N"))
            found.append(Card("contact share", f"{percent:.0f} %", "contact share", percent, "%"))
        if self._power:
            mean_w = sum(power for _, power in self._power) / len(self._power)
            name, rated_w = "mean drive power", self.rated_power_w
            found.append(Card(name, with_prefix(mean_w, "W"), name, mean_w, "W", rated_w))
        return found

    def _note_broken(self, linkage: LinkageSample) -> None:
        values = zip(linkage.joints, linkage.position, linkage.velocity, strict=True)
        for joint, position, speed in values:
            if not (math.isfinite(position) and math.isfinite(speed)):
                self._broken = f"{joint} is not finite at {linkage.time_s:.3f} s"


def sliding_joints(tree: FrameTree | None) -> frozenset[str]:
    """Return the names of the prismatic joints, whose positions are in m."""
    if tree is None:
        return frozenset()
    return tree.sliding_joints


def _named(numbers: Named, name: str) -> float:
    return numbers.values[numbers.names.index(name)]


def _forget(values: deque[Any], now_s: float) -> None:
    while values and values[0][0] < now_s - RECENT_S:
        values.popleft()
