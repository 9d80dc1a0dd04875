# SPDX-License-Identifier: Apache-2.0
"""Smoothed estimate of the current operating point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mech_twin.capabilities.cycle import Array
from mech_twin.studies.monitoring.operating import MOVES, SIGNIFICANT, SMOOTHED, OperatingSurface, OperatingValue


@dataclass
class OperatingTrack:
    """Follows the operating point from cycle to cycle: smooths it and bounds the error of y.

    Parameters
    ----------
    surface : OperatingSurface
        The fitted surface.
    """

    surface: OperatingSurface

    def __post_init__(self) -> None:
        self._recent: list[Array] = []
        self._smooth: Array | None = None
        self._weight = 1.0

    def advance(self, u: Array) -> Array:
        """Take the operating point (q,) of a cycle; return the error of y in that cycle, shape (d - q,)."""
        surface = self.surface
        self._recent = [*self._recent[1 - surface.hold :], u] if surface.hold > 1 else [u]
        span = np.ptp(self._recent, axis=0)
        is_moving = span > MOVES * surface.moved
        if self._smooth is None or is_moving.any():
            self._smooth, self._weight = u, 1.0
        else:
            self._weight = max(self._weight / (1.0 + self._weight), SMOOTHED)
            self._smooth = self._smooth + self._weight * (u - self._smooth)
        far = float(np.linalg.norm(self._smooth))
        return surface.drift + far * surface.doubt + np.where(is_moving, span, 0.0) @ surface.transient

    def values(self) -> tuple[OperatingValue, ...]:
        """Return the smoothed variables with their 95 % intervals."""
        if self._smooth is None:
            return ()
        surface = self.surface
        half = 1.96 * surface.wander * max(1.0, (self._weight / SMOOTHED) ** 0.5)
        return tuple(
            OperatingValue(name, float(u * share), float((u - h) * share), float((u + h) * share), float(share), beyond)
            for name, u, h, share, beyond in zip(
                surface.variables, self._smooth, half, surface.ranges, surface.beyond, strict=True
            )
        )

    def changed(self) -> tuple[OperatingValue, ...]:
        """Return the variables that differ from the baseline significantly."""
        if self._smooth is None or self._weight > 2.0 * SMOOTHED:
            return ()
        far = np.abs(self._smooth) > SIGNIFICANT * self.surface.wander
        return tuple(value for value, is_far in zip(self.values(), far, strict=True) if is_far)
