"""The worst of each residual over a window, against its limit: what diagnostics and ``simulate`` judge a run by."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from mech_twin.roles import Machine
from mech_twin.samples import Frame, Named

NO_LIMIT = math.nan  # nothing is within it: a residual whose limit nobody declared counts as broken


class Residual(NamedTuple):
    """The greatest magnitude a residual had, and its limit, both in the residual's unit."""

    worst: float
    limit: float

    @property
    def broken(self) -> bool:
        """Whether the limit is exceeded; NaN, in the value or in the limit, is."""
        return not self.worst <= self.limit


class ResidualWindow:
    """Greatest magnitude of each residual since the window began.

    Parameters
    ----------
    limits : mapping of str to float
        Limit of each residual by name.
    """

    def __init__(self, limits: Mapping[str, float]) -> None:
        self.limits = dict(limits)
        self._worst: dict[str, float] = {}

    def observe(self, residuals: Named) -> None:
        """Take the residuals of one sample into account; once a residual was NaN, its worst is NaN."""
        for name, value in zip(residuals.names, residuals.values, strict=True):
            size = abs(value)
            if size > self._worst.get(name, -1.0) or math.isnan(size):
                self._worst[name] = size

    def residuals(self) -> dict[str, Residual]:
        """Return the worst of each residual observed, with its limit."""
        return {name: Residual(worst, self.limits.get(name, NO_LIMIT)) for name, worst in self._worst.items()}

    def close(self) -> dict[str, Residual]:
        """Return the worst of each residual, and begin a new window."""
        closed = self.residuals()
        self._worst.clear()
        return closed


class RunInvariants:
    """The worst residuals of a whole run, of all roles of a machine.

    Residuals are known by their names; where two roles give a residual the same name, by ``role.name``.
    """

    def __init__(self, machine: Machine) -> None:
        limits = {"linkage": machine.linkage.residual_limits, "forces": machine.forces.residual_limits}
        if machine.body is not None:
            limits["body"] = machine.body.residual_limits
        self._windows = {role: ResidualWindow(of_role) for role, of_role in limits.items()}

    def observe(self, frame: Frame) -> None:
        """Take one frame into account."""
        self._windows["linkage"].observe(frame.linkage.residuals)
        self._windows["forces"].observe(frame.forces.residuals)
        if frame.body is not None:
            self._windows["body"].observe(frame.body.residuals)

    def residuals(self) -> dict[str, Residual]:
        """Return the worst of each residual so far, with its limit."""
        found = [(role, n, r) for role, window in self._windows.items() for n, r in window.residuals().items()]
        names = [name for _, name, _ in found]
        return {name if names.count(name) == 1 else f"{role}.{name}": r for role, name, r in found}


def broken_lines(residuals: Mapping[str, Residual]) -> list[str]:
    """Return one line per residual that exceeds its limit."""
    return [f"{name} {r.worst:.3g} exceeds {r.limit:.3g}" for name, r in residuals.items() if r.broken]
