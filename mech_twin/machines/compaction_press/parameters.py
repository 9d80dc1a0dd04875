# SPDX-License-Identifier: Apache-2.0
"""Parameters of the press, the constants of its kernels, and the crank angles at which the layer is pressed."""

from __future__ import annotations

from math import degrees, pi
from operator import attrgetter
from typing import Literal

import numpy as np
from pydantic import model_validator

from mech_twin.declarations.quantity import Parameters, choice, keep_at_most, lower, quantity
from mech_twin.engine.sample_vectors import Array
from mech_twin.machines.compaction_press.dynamics import (
    TURN,
    Press,
    Stroke,
    StrokeLoad,
    loaded_height,
    loaded_heights,
)
from mech_twin.machines.drives import DrivenCrank, root_between
from mech_twin.parts.four_bar import CROSSED, OPEN, FourBar, Link, failing_inequality, smallest_transmission_angle

GRAVITY = 9.80665
SAMPLES = 720  # of a turn
EQUAL = 1e-12  # of the stroke: heights that close differ by rounding only
LEAST_TRANSMISSION_DEG = 1.0
MOST_REACH = 10.0  # of centroids and of the loaded point, in lengths of the longest link
LEAST_STROKE_M = 1e-5
LEAST_INERTIA = 1e-9  # kg m2
LEAST_DEPTH = 9e-4  # of the stroke
SMOOTH = 1.0  # exponent from which on a force sets in without a jump or a vertical tangent


class PressLinkage(Parameters):
    """Lengths of the four-bar and its branch."""

    crank_m: float = quantity("m", "crank OA", ge=1e-3, le=10.0)
    coupler_m: float = quantity("m", "plate AB", ge=1e-3, le=100.0)
    pendulum_m: float = quantity("m", "pendulum CB", ge=1e-3, le=100.0)
    pivot_x_m: float = quantity("m", "pendulum bearing C, to the right of the crank bearing O", ge=-100.0, le=100.0)
    pivot_y_m: float = quantity("m", "pendulum bearing C, above the crank bearing O", ge=-100.0, le=100.0)
    branch: Literal["open", "crossed"] = choice("hanging (open) or its mirror (crossed)")

    @property
    def four_bar(self) -> FourBar:
        """The constants of the kernels."""
        sign = OPEN if self.branch == "open" else CROSSED
        return FourBar(self.crank_m, self.coupler_m, self.pendulum_m, self.pivot_x_m, self.pivot_y_m, sign)

    @model_validator(mode="after")
    def _turns(self) -> PressLinkage:
        failing = failing_inequality(self.four_bar)
        if failing is not None:
            raise ValueError(failing)
        least = degrees(smallest_transmission_angle(self.four_bar))
        if least < LEAST_TRANSMISSION_DEG:
            raise ValueError(
                f"transmission angle >= {LEAST_TRANSMISSION_DEG:g} degree fails: {least:.3g} degrees, near a change "
                f"point (crank {self.crank_m:g}, coupler {self.coupler_m:g}, rocker {self.pendulum_m:g}, pivot "
                f"{self.pivot_x_m:g}, {self.pivot_y_m:g} m)"
            )
        return self


class PressLink(Parameters):
    """One link; the crank's inertia is about O, the others' about their centroids."""

    mass_kg: float = quantity("kg", "mass", ge=0.0, le=1e6)
    inertia_kg_m2: float = quantity(
        "kg m2", "moment of inertia: crank about O, others about their centroid", ge=0.0, le=1e6
    )
    centroid_along_m: float = quantity("m", "centroid along the link, from O, A or C", ge=-100.0, le=100.0)
    centroid_across_m: float = quantity("m", "centroid across the link, along turned +90 degrees", ge=-100.0, le=100.0)

    @property
    def link(self) -> Link:
        """The constants of the kernels."""
        return Link(self.mass_kg, self.inertia_kg_m2, self.centroid_along_m, self.centroid_across_m)


class PressLinks(Parameters):
    """The three moving links."""

    crank: PressLink = choice("link 1")
    plate: PressLink = choice("link 2")
    pendulum: PressLink = choice("link 3")


class WorkingForce(Parameters):
    """Force of the layer on the plate, vertically up."""

    peak_n: float = quantity("N", "force at the bottom of the stroke", ge=0.0, le=1e9, live=True)
    application_from_a_m: float = quantity("m", "where it acts, along the plate from A", ge=-100.0, le=100.0)
    application_across_m: float = quantity("m", "where it acts, across the plate", ge=-100.0, le=100.0)
    contact_fraction: float = quantity("1", "share of the stroke above first contact", ge=0.0, le=0.999)
    exponent: float = quantity("1", "power of depth in the force", ge=0.0, le=20.0)
    gives_back: bool = choice(
        "whether the layer springs back along its curve when the plate turns back in it, or stays compacted",
        default=True,
    )
    working_quarter: bool = choice(
        "first contact where the crank passes 180 degrees, where the working quarter starts, not by contact_fraction",
        default=False,
    )


class PressFlywheel(Parameters):
    """Flywheel on the crank shaft."""

    non_uniformity: float = quantity("1", "asked non-uniformity delta of the crank speed", ge=1e-4, lt=2.0)
    inertia_kg_m2: float = quantity("kg m2", "inertia of the flywheel fitted in a run", default=0.0, ge=0.0, le=1e6)


class CompactionPress(DrivenCrank):
    """Parameters of the compaction press."""

    linkage: PressLinkage = choice("four-bar")
    links: PressLinks = choice("masses")
    working_force: WorkingForce = choice("force of the layer")
    flywheel: PressFlywheel = choice("flywheel")

    @model_validator(mode="after")
    def _plate_strokes(self) -> CompactionPress:
        if self.links.crank.inertia_kg_m2 < LEAST_INERTIA:
            raise ValueError(
                f"links.crank.inertia_kg_m2 >= {LEAST_INERTIA:g} fails, got {self.links.crank.inertia_kg_m2:g}: "
                "a shaft without inertia has no speed of its own"
            )
        self._check_reach()
        press_constants(self)
        return self

    def _check_reach(self) -> None:
        """Raise for a part far from the linkage, and for an inertia impossible for these masses and sizes."""
        reach = MOST_REACH * max(self.linkage.crank_m, self.linkage.coupler_m, self.linkage.pendulum_m)
        why = f"{MOST_REACH:g} times the longest link"
        links = {"crank": self.links.crank, "plate": self.links.plate, "pendulum": self.links.pendulum}
        centroids = [f"links.{name}.centroid_{way}_m" for name in links for way in ("along", "across")]
        for key in ("working_force.application_from_a_m", "working_force.application_across_m", *centroids):
            keep_at_most(key, attrgetter(key)(self), reach, why, " m either way")
        most = max(LEAST_INERTIA, max(link.mass_kg for link in links.values()) * reach * reach)
        for name, link in links.items():
            keep_at_most(f"links.{name}.inertia_kg_m2", link.inertia_kg_m2, most, f"the largest mass at {why}")
        crank = links["crank"]
        own = crank.mass_kg * (crank.centroid_along_m**2 + crank.centroid_across_m**2)
        if crank.inertia_kg_m2 < own:
            raise ValueError(
                f"links.crank.inertia_kg_m2 is about the shaft and must be at least mass x centroid distance squared = "
                f"{lower(own)}; got {crank.inertia_kg_m2:g}"
            )


def _dead_centre(press: Press, guess: float, step: float) -> float:
    def rate(f: float) -> float:
        return loaded_height(press, f)[1]

    low, high = guess - step, guess + step
    return root_between(rate, low, high) if rate(low) * rate(high) < 0.0 else guess


def _first_lowest(angles: Array, heights: Array, after: float) -> float:
    """Return the angle (rad) of the lowest height; of lows that are equal, the first after an angle turning forward."""
    equal = np.flatnonzero(heights - heights.min() <= EQUAL * np.ptp(heights))
    way = (angles - after) % TURN
    near = equal[way[equal] - way[equal].min() <= TURN / SAMPLES]
    return float(angles[near[np.argmin(heights[near])]])


def press_stroke(press: Press, contact_fraction: float | None) -> Stroke:
    """Return top and bottom of the loaded point's path, and first contact with the layer on the way down.

    Without a ``contact_fraction`` first contact is at the height of the loaded point at 180 degrees of the crank.
    """
    angles, heights = _path(press)
    top = _first_lowest(angles, -heights, 0.0)
    bottom = _first_lowest(angles, heights, top)
    y_t, y_b = loaded_height(press, top)[0], loaded_height(press, bottom)[0]
    if y_t - y_b < LEAST_STROKE_M:
        raise ValueError(
            f"stroke of the loaded point (linkage, working_force.application_from_a_m) >= {LEAST_STROKE_M:g} m fails: "
            f"{y_t - y_b:.3g} m"
        )
    if contact_fraction is None:
        contact_fraction = (y_t - loaded_height(press, pi)[0]) / (y_t - y_b)
    y_c = y_t - contact_fraction * (y_t - y_b)
    if contact_fraction <= 0.0:
        return Stroke(top, bottom, top, top, y_t, y_b, y_c)
    met, risen = [], 0.0
    for last in (top + (bottom - top) % TURN, top - (top - bottom) % TURN):
        about, rise = _first_contact(angles, heights - y_c, top, last)
        met.append(root_between(lambda f: loaded_height(press, f)[0] - y_c, *about))
        risen = max(risen, rise)
    return Stroke(top, bottom, met[0] % TURN, met[1] % TURN, y_t, y_b, y_c, risen)


def _path(press: Press) -> tuple[Array, Array]:
    """Return crank angles (rad) of a turn, rising, and the heights (m) of the loaded point there.

    A local maximum or minimum of the path between two equally spaced angles is added to the angles.
    """
    step = TURN / SAMPLES
    even = np.linspace(0.0, TURN, SAMPLES, endpoint=False)
    heights = loaded_heights(press, even)
    before, after = heights - np.roll(heights, 1), heights - np.roll(heights, -1)
    extremes = [_dead_centre(press, i * step, step) % TURN for i in np.flatnonzero(before * after >= 0.0).tolist()]
    angles, order = np.unique(np.append(even, extremes), return_index=True)
    return angles, np.append(heights, [loaded_height(press, f)[0] for f in extremes])[order]


def _first_contact(angles: Array, above: Array, top: float, bottom: float) -> tuple[tuple[float, float], float]:
    """Return crank angles (rad) about the first contact on the way from the top, and how far the point rises after it.

    Parameters
    ----------
    angles, above : ndarray
        Angles of a turn (rad), rising, and heights (m) over that of the contact there.
    top, bottom : float
        Crank angles (rad) at either end of the way, in the sense in which the crank turns.
    """
    every, over = np.concatenate([angles - TURN, angles, angles + TURN]), np.tile(above, 3)
    on = (every >= min(top, bottom)) & (every <= max(top, bottom))
    sense = 1 if bottom > top else -1
    places, way = every[on][::sense], over[on][::sense]
    if not np.any(way <= 0.0):
        return (min(top, bottom), max(top, bottom)), 0.0
    first = int(np.argmax(way <= 0.0))
    rise = max(0.0, float(way[first:].max()))
    if rise == 0.0:
        return (min(top, bottom), max(top, bottom)), 0.0
    before = top if first == 0 else float(places[first - 1])
    return (min(before, float(places[first])), max(before, float(places[first]))), rise


def press_constants(parameters: CompactionPress, fitted: bool = True) -> tuple[Press, Stroke]:
    """Return the constants of the kernels and the stroke; ``fitted`` counts the fitted flywheel into the crank."""
    p, force = parameters, parameters.working_force
    crank = p.links.crank.link
    if fitted:
        crank = crank._replace(inertia_kg_m2=crank.inertia_kg_m2 + p.flywheel.inertia_kg_m2)
    press = Press(
        p.linkage.four_bar,
        crank,
        p.links.plate.link,
        p.links.pendulum.link,
        force.application_from_a_m,
        force.application_across_m,
        StrokeLoad(0.0, 1.0, 0.0, 1.0),
        GRAVITY,
    )
    stroke = press_stroke(press, None if force.working_quarter else force.contact_fraction)
    depth = stroke.contact_y_m - stroke.bottom_y_m
    least = LEAST_DEPTH * (stroke.top_y_m - stroke.bottom_y_m)
    if depth < least:
        key = "working_quarter" if force.working_quarter else "contact_fraction"
        raise ValueError(
            f"working_force.{key}: the layer has no depth; expected its first contact at least {lower(least, 3)} m "
            f"above the bottom, found {depth:.3g} m"
        )
    if stroke.risen_m > 0.0 and force.exponent < SMOOTH:
        raise ValueError(
            f"working_force.exponent must be at least {SMOOTH:g} where the loaded point rises above its first contact "
            f"again on its way to the bottom, here by {stroke.risen_m:.3g} m; got {force.exponent:g}"
        )
    return press._replace(load=StrokeLoad(force.peak_n, stroke.contact_y_m, stroke.bottom_y_m, force.exponent)), stroke
