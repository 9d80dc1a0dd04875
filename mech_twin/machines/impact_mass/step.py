"""One coupling step of the impact mass: its events, the sample at its end, and its books.

The state never leaves its anchor at the last event, so the answer does not depend on the coupling step: a finer grid
only looks more often.  Books are kept piece by piece (between events), per unit of mass: momentum by the impulse of
the force against the impulses of the stop, energy by the work of the force against the losses at the blows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernel import kernel
from mech_twin.machines.impact_mass.events import (
    CHATTER_END,
    IMPACT,
    PHASE,
    SERIES,
    STUCK,
    Drive,
    Happening,
    Motion,
    acceleration,
    elapsed,
    gap_after,
    next_event,
    phase_end,
    placed,
)

FREE_REGIME, IMPACT_REGIME, CHATTER_REGIME, STUCK_REGIME = 0, 1, 2, 3
COLUMNS = 6  # of an event row: kind, period, tau, velocity before, velocity after, impulse per unit of mass


class Count(NamedTuple):
    """Running counts since the start; impulses of the stop per unit of mass (m/s)."""

    impacts: float
    chatter_ends: float
    period_impacts: float
    last_period_impacts: float
    period_impulse: float
    last_period_impulse: float
    step_impulse: float


class Books(NamedTuple):
    """Sums of a step per unit of mass: impulse and work of the force, impulse and loss at the stop, and their size."""

    impulse: float
    work: float
    stop_impulse: float
    loss: float
    momentum_size: float
    energy_size: float


class Residuals(NamedTuple):
    """What the books of a step leave over, as a share of what was summed."""

    momentum: float
    energy: float


@kernel
def pieced(books: Books, a: float, duration_s: float, begin_gap: float, end_gap: float) -> Books:
    """Return the books after a piece of flight or rest under one acceleration."""
    impulse, work = a * duration_s, a * (begin_gap - end_gap)
    return Books(
        books.impulse + impulse,
        books.work + work,
        books.stop_impulse,
        books.loss,
        books.momentum_size + abs(impulse),
        books.energy_size + abs(a) * (begin_gap + end_gap),
    )


@kernel
def struck_books(books: Books, impulse: float, loss: float) -> Books:
    """Return the books after a blow (or a rest) against the stop."""
    return Books(
        books.impulse,
        books.work,
        books.stop_impulse + impulse,
        books.loss + loss,
        books.momentum_size + impulse,
        books.energy_size + loss,
    )


@kernel
def residuals(books: Books, begin_m_per_s: float, end_m_per_s: float) -> Residuals:
    """Return v_E - v_S = impulse - stop and (v_E^2 - v_S^2)/2 = work - loss, what is left over each time."""
    momentum = (end_m_per_s - begin_m_per_s) - (books.impulse - books.stop_impulse)
    energy = 0.5 * (end_m_per_s - begin_m_per_s) * (end_m_per_s + begin_m_per_s) - (books.work - books.loss)
    momentum_size = books.momentum_size + abs(begin_m_per_s) + abs(end_m_per_s)
    energy_size = books.energy_size + 0.5 * (begin_m_per_s**2 + end_m_per_s**2)
    return Residuals(
        momentum / momentum_size if momentum_size > 0.0 else 0.0, energy / energy_size if energy_size > 0.0 else 0.0
    )


@kernel
def counted(count: Count, event: Happening, rest_impulse: float) -> Count:
    """Return the counts after an event; ``rest_impulse`` is what the stop gave while the mass lay against it."""
    hit = 1.0 if event.kind == IMPACT else 0.0
    impulse, hits = count.period_impulse + event.impulse_per_mass + rest_impulse, count.period_impacts + hit
    last_impulse, last_hits = count.last_period_impulse, count.last_period_impacts
    if event.kind == PHASE and event.tau_s == 0.0:
        last_impulse, last_hits, impulse, hits = impulse, hits, 0.0, 0.0
    ends = count.chatter_ends + (1.0 if event.kind == CHATTER_END else 0.0)
    return Count(count.impacts + hit, ends, hits, last_hits, impulse, last_impulse, 0.0)


@kernel
def rested(count: Count, impulse: float) -> Count:
    """Return the counts after a rest that goes on."""
    return Count(count[0], count[1], count[2], count[3], count[4] + impulse, count[5], count[6])


@kernel
def stepped(count: Count, impulse: float) -> Count:
    """Return the counts with the stop's impulse of this step."""
    return Count(count[0], count[1], count[2], count[3], count[4], count[5], impulse)


@kernel
def grown(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a table twice as long with the same first rows."""
    longer = np.empty((2 * len(rows), COLUMNS))
    longer[: len(rows)] = rows
    return longer


@kernel
def write_row(row: NDArray[np.float64], event: Happening) -> None:
    """Write an event into a row of the table."""
    row[0], row[1], row[2] = event.kind, event.period, event.tau_s
    row[3], row[4], row[5] = event.pre_m_per_s, event.post_m_per_s, event.impulse_per_mass


@kernel
def regime_at(motion: Motion, coming: Happening, struck: bool) -> int:
    """Return the regime of a sample: stuck, chatter (the series goes on in this phase), impact (in the step), free."""
    if motion.mode == STUCK:
        return STUCK_REGIME
    if motion.mode == SERIES and coming.kind != PHASE:
        return CHATTER_REGIME
    return IMPACT_REGIME if struck else FREE_REGIME


@kernel
def booked(
    books: Books, motion: Motion, acting: Drive, event: Happening, begin_gap: float, passed_s: float
) -> tuple[Books, float]:
    """Return the books after the piece that ends with this event and after its blow, and the impulse of a rest."""
    a = acceleration(motion, acting)
    until = phase_end(motion, acting) if event.kind == PHASE else event.tau_s
    duration = max(until - motion.tau_s - passed_s, 0.0)
    end_gap = gap_after(motion, acting, until - motion.tau_s)[0] if event.kind == PHASE else 0.0
    books = pieced(books, a, duration, begin_gap, end_gap)
    loss = 0.5 * (event.pre_m_per_s**2 - event.post_m_per_s**2)
    if event.kind == CHATTER_END:
        loss = 0.5 * motion.velocity_m_per_s**2  # what the last listed blow left, booked with the end
    rest = a * duration if motion.mode == STUCK else 0.0
    return struck_books(books, event.impulse_per_mass + rest, loss), rest


@kernel
def window(
    motion: Motion, acting: Drive, count: Count, steps: float, step_s: float
) -> tuple[Motion, Count, Residuals, tuple[float, float], int, NDArray[np.float64]]:
    """Return the mass one coupling step later.

    Parameters
    ----------
    motion : Motion
        Anchor at the last event (or the last change of a parameter).
    acting : Drive
        Forces per unit of mass and restitution during the step.
    count : Count
        Running counts.
    steps : float
        Number of the step that ends the window, counted from the origin of time.
    step_s : float
        Coupling step, s.

    Returns
    -------
    tuple
        Anchor, counts, residuals, (gap m, velocity m/s) at the end, regime, event rows (n, 6).
    """
    rows = np.empty((8, COLUMNS))
    found, struck = 0, False
    books = Books(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    passed = elapsed(motion, acting, steps - 1.0, step_s)
    gap, first = gap_after(motion, acting, passed)
    coming, after = next_event(motion, acting)
    while coming.period * acting.period_s + coming.tau_s <= steps * step_s:
        books, rest = booked(books, motion, acting, coming, gap, passed)
        count = counted(count, coming, rest)
        struck = struck or coming.kind == IMPACT
        if found == len(rows):
            rows = grown(rows)
        write_row(rows[found], coming)
        found += 1
        motion, passed, gap = after, 0.0, after.gap_m
        coming, after = next_event(motion, acting)
    now = elapsed(motion, acting, steps, step_s)
    end = gap_after(motion, acting, now)
    a, duration = acceleration(motion, acting), max(now - passed, 0.0)
    books = pieced(books, a, duration, gap, end[0])
    if motion.mode == STUCK:
        books = struck_books(books, a * duration, 0.0)
        count = rested(count, a * duration)
    count = stepped(count, books.stop_impulse)
    regime = regime_at(motion, coming, struck)
    return motion, count, residuals(books, first, end[1]), end, regime, rows[:found]


@kernel
def replanted(motion: Motion, before: Drive, after: Drive, steps: float, step_s: float) -> Motion:
    """Return the motion anchored at a coupling step, where what acts on the mass changes.

    A series under way is over: what follows under the new forces is a flight, and its impacts a new series.
    """
    tau = min(motion.tau_s + elapsed(motion, before, steps, step_s), phase_end(motion, before))
    gap, velocity = gap_after(motion, before, tau - motion.tau_s)
    if motion.mode == STUCK:
        return Motion(motion.period, tau, motion.phase, 0.0, 0.0, STUCK, 0.0, 0.0, 0.0)
    return placed(motion.period, tau, motion.phase, gap, velocity, acceleration(motion, after))
