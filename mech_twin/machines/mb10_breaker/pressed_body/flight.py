# SPDX-License-Identifier: Apache-2.0
"""Exact motion of the body off its collar: one stretch of free swing, with or without the half sine.

::

    phi ^        ___
        |      .     .            phi'' + 2 zeta k phi' + k^2 (phi + phi0) = (load/J) sin(mu s + theta)
        |    .         .
      0 +---+-----------+---> s   s runs from the start of the stretch, theta is the phase of the load there
            start       touchdown

There is no time stepping.  The response to the load is written with (e^z - 1)/z, which has no singular point, so
k = mu is no special case.  Very short stretches are summed as a power series: the smallest bounce then keeps
its relative accuracy.
"""

import cmath
import math
from typing import NamedTuple

from mech_twin.errors import MotionError
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.pressed_body.parameters import PressedBody

SERIES_REACH = 0.25  # k s or mu s below which the power series is used: its 15th term is below 1e-16 of the first
SERIES_TERMS = 15
ROUNDING = 1e-9  # a net moment below this part of the load's peak is taken as balance
LONGEST_SEARCH = 100_000
PATIENCE = 200  # steps of a search after which each is worth the dearer bound that looks at the next derivative too


class SwingStretch(NamedTuple):
    """A stretch of free swing: state at its start, the load's amplitude (0 before the onset) and phase there."""

    angle: float
    rate: float
    load: float
    theta: float


@kernel
def _series(body: PressedBody, stretch: SwingStretch, s: float) -> tuple[float, float]:
    push = stretch.load / body.inertia
    sine, cosine = math.sin(stretch.theta), math.cos(stretch.theta)
    stiffness, drag = body.k * body.k, 2.0 * body.damping * body.k
    low, high = stretch.angle, stretch.rate
    angle, rate = low + high * s, high
    factor = push  # push mu^n / n!
    power = s  # s^(n+1)
    for n in range(SERIES_TERMS):
        turn = n % 4
        wave = sine if turn == 0 else cosine if turn == 1 else -sine if turn == 2 else -cosine
        term = factor * wave - stiffness * low - drag * (n + 1) * high
        if n == 0:
            term -= stiffness * body.rest_angle
        term /= (n + 1) * (n + 2)
        rate += (n + 2) * term * power
        power *= s
        angle += term * power
        low, high = high, term
        factor *= body.mu / (n + 1)
    return angle, rate


@kernel
def _mean_exponential(z: complex, s: float) -> complex:
    """Return (e^(z s) - 1)/z, which is s at z = 0."""
    growth, turn = z.real * s, z.imag * s
    if abs(growth) + abs(turn) < 1e-9:
        return s * (1.0 + 0.5 * z * s)
    half = math.sin(0.5 * turn)
    real = math.expm1(growth) * math.cos(turn) - 2.0 * half * half
    return complex(real, math.exp(growth) * math.sin(turn)) / z


@kernel
def _between(root: complex, drive: complex, s: float) -> complex:
    """Return (e^(drive s) - e^(root s))/(drive - root), the response of one root; s e^(root s) where they meet."""
    apart = drive - root
    if abs(apart.real) * s > 1.0:  # a strong decay: its inverse would overflow, and nothing cancels
        return (cmath.exp(drive * s) - cmath.exp(root * s)) / apart
    return cmath.exp(root * s) * _mean_exponential(apart, s)


@kernel
def ring_frequency(body: PressedBody) -> float:
    """Return k sqrt(1 - zeta^2), rad/s."""
    return body.k * math.sqrt((1.0 - body.damping) * (1.0 + body.damping))


@kernel
def load_response(body: PressedBody, s: float) -> tuple[complex, complex]:
    """Return displacement and rate, from rest, under the unit acceleration e^(i mu s).

    x(s) = int_0^s h(s - v) e^(i mu v) dv with h the impulse response; regular at k = mu.
    """
    ring = ring_frequency(body)
    root = complex(-body.damping * body.k, ring)
    mate = root.conjugate()
    drive = complex(0.0, body.mu)
    first, second = _between(root, drive, s), _between(mate, drive, s)
    scale = complex(0.0, -0.5 / ring)
    return scale * (first - second), scale * (root * first - mate * second)


@kernel
def motion(body: PressedBody, stretch: SwingStretch, s: float) -> tuple[float, float]:
    """Return angle and rate (rad, rad/s) a time ``s`` (s) into the stretch.

    The free part is e^(-zeta k s) [A cos(w s) + B sin(w s)] - phi0 with w = k sqrt(1 - zeta^2).
    """
    if max(body.k, body.mu if stretch.load > 0.0 else 0.0) * s < SERIES_REACH:
        return _series(body, stretch, s)
    ring = ring_frequency(body)
    decay = body.damping * body.k
    a = stretch.angle + body.rest_angle
    b = (stretch.rate + decay * a) / ring
    sine, cosine, fade = math.sin(ring * s), math.cos(ring * s), math.exp(-decay * s)
    angle = fade * (a * cosine + b * sine) - body.rest_angle
    rate = fade * ((b * ring - decay * a) * cosine - (a * ring + decay * b) * sine)
    if stretch.load > 0.0:
        x, v = load_response(body, s)
        phasor = cmath.exp(complex(0.0, stretch.theta)) * (stretch.load / body.inertia)
        angle += (phasor * x).imag
        rate += (phasor * v).imag
    return angle, rate


@kernel
def net_acceleration(body: PressedBody, stretch: SwingStretch) -> float:
    """Return the angular acceleration (rad/s2) of a body on the collar without the collar's force."""
    return stretch.load / body.inertia * math.sin(stretch.theta) - body.k * body.k * body.rest_angle


@kernel
def _steady_bounds(body: PressedBody, stretch: SwingStretch) -> tuple[float, float, float]:
    """Return bounds of |phi''|, |phi'''|, |phi''''| from the steady response to the load and the free swing about it.

    Steady X e^(i (mu s + theta)), X = (load/J)/(k^2 - mu^2 + 2 i zeta k mu), free C e^(lambda s), |lambda| = k: sharp
    where a stiff body follows the load, without bound at k = mu undamped.
    """
    answer = complex(body.k * body.k - body.mu * body.mu, 2.0 * body.damping * body.k * body.mu)
    steady = complex(0.0, 0.0)
    if stretch.load > 0.0:
        if abs(answer) < 1e-6 * body.k * body.k:
            return math.inf, math.inf, math.inf
        steady = stretch.load / body.inertia * cmath.exp(complex(0.0, stretch.theta)) / answer
    ring = ring_frequency(body)
    a = stretch.angle + body.rest_angle - steady.imag
    b = (stretch.rate - body.mu * steady.real + body.damping * body.k * a) / ring
    free, forced = math.hypot(a, b), abs(steady)
    return (
        free * body.k**2 + forced * body.mu**2,
        free * body.k**3 + forced * body.mu**3,
        free * body.k**4 + forced * body.mu**4,
    )


@kernel
def bounds(body: PressedBody, stretch: SwingStretch, room: float) -> tuple[float, float, float]:
    """Return upper bounds of |phi''|, |phi'''|, |phi''''| within ``room`` (s) of the stretch's start."""
    ring = ring_frequency(body)
    stiffness, drag = body.k * body.k, 2.0 * body.damping * body.k
    a = stretch.angle + body.rest_angle
    b = (stretch.rate + body.damping * body.k * a) / ring
    push = stretch.load / body.inertia
    # the unit load moves a resting body by less than s^2/2 at less than 1.4 s
    second = stiffness * math.hypot(a, b) + push * (1.0 + 1.4 * drag * room + 0.5 * stiffness * room * room)
    third = push * body.mu + stiffness * (abs(stretch.rate) + second * room) + drag * second
    fourth = push * body.mu * body.mu + stiffness * second + drag * third
    sharp = _steady_bounds(body, stretch)
    return min(second, sharp[0]), min(third, sharp[1]), min(fourth, sharp[2])


@kernel
def _value_and_slope(body: PressedBody, stretch: SwingStretch, s: float, order: int) -> tuple[float, float]:
    angle, rate = motion(body, stretch, s)
    if order == 0:
        return angle, rate
    force = stretch.load / body.inertia * math.sin(stretch.theta + body.mu * s)
    drag = 2.0 * body.damping * body.k
    return rate, force - body.k * body.k * (angle + body.rest_angle) - drag * rate


@kernel
def _window(body: PressedBody, stretch: SwingStretch, s: float, room: float, order: int) -> tuple[float, float, float]:
    """Return the end of a window that begins at ``s``, and bounds in it.

    The bounds are those of the searched function's second and third derivative.  A window is a radian of the faster of
    swing and load: beyond that the bounds grow without need.
    """
    fastest = max(body.k, body.mu) if stretch.load > 0.0 else body.k
    length = min(room - s, 1.0 / fastest)
    angle, rate = motion(body, stretch, s)
    found = bounds(body, SwingStretch(angle, rate, stretch.load, stretch.theta + body.mu * s), length)
    return s + length, found[order], found[order + 1]


@kernel
def _bend(body: PressedBody, stretch: SwingStretch, s: float, order: int) -> float:
    """Return the second derivative of the searched function at ``s``."""
    rate, acceleration = _value_and_slope(body, stretch, s, 1)
    if order == 0:
        return acceleration
    push = stretch.load / body.inertia * body.mu * math.cos(stretch.theta + body.mu * s)
    return push - body.k * body.k * rate - 2.0 * body.damping * body.k * acceleration


@kernel
def _safe_step(height: float, rise: float, bend: float) -> float:
    """Return the h > 0 at which height + rise h - bend h^2/2 has its first root, or inf; height >= 0, bend >= 0.

    The two forms of the root, each without cancellation.
    """
    root = math.sqrt(rise * rise + 2.0 * bend * height)
    if rise < 0.0:
        return 2.0 * height / (root - rise)
    return (rise + root) / bend if bend > 0.0 else math.inf


@kernel
def _dearer_step(height: float, rise: float, curve: float, third: float, room: float) -> float:
    """Return a step within ``room`` over which height + rise h + curve h^2/2 - third h^3/6 keeps its sign.

    Within L the second derivative is at least curve - third L.  L is halved until the step which that allows fills it:
    a body that has hardly left the collar, and is being lifted, then doubles its steps.
    """
    length, best = room, 0.0
    while length > best:
        best = max(best, min(_safe_step(height, rise, max(third * length - curve, 0.0)), length))
        length *= 0.5
    return best


@kernel
def first_root(body: PressedBody, stretch: SwingStretch, order: int, start: float, room: float) -> float:
    """Return the first zero of phi (order 0) or phi' (order 1) in (start, room], or inf.

    Marches from the left by the largest step over which value + slope h - bend h^2/2 keeps its sign, ``bend`` being a
    bound of the second derivative of the searched function within the present window.  No root can lie within such a
    step, so none is stepped over, and near a root the steps are Newton's, from one side.

    Raises
    ------
    MotionError
        If the march does not come to an end; the bounds of the parameters keep it from that.
    """
    s = start
    value, slope = _value_and_slope(body, stretch, s, order)
    sign = 1.0 if value > 0.0 or (value == 0.0 and slope > 0.0) else -1.0
    if order == 0:
        sign = 1.0
    end, bend, third = _window(body, stretch, s, room, order)
    for done in range(LONGEST_SEARCH):
        height, rise = sign * value, sign * slope
        if height < 0.0:
            return s
        step = _safe_step(height, rise, bend)
        if done >= PATIENCE and third < math.inf and step < end - s:
            curve = sign * _bend(body, stretch, s, order)
            step = max(step, _dearer_step(height, rise, curve, third, end - s))
        if not step > 4e-16 * s:
            return s
        s += step
        if s > end:
            if end >= room:
                return math.inf
            s = end
            end, bend, third = _window(body, stretch, s, room, order)
        value, slope = _value_and_slope(body, stretch, s, order)
    raise MotionError("mb10_breaker: no end to the search for the body's next event; lower body.spring_rate_n_per_m")


@kernel
def _clear_of_collar(body: PressedBody, stretch: SwingStretch, room: float) -> float:
    """Return a time (s) up to which a body that leaves the collar without speed cannot have returned to it."""
    length = min(room, 1.0 / max(body.k, body.mu))
    _, third, fourth = bounds(body, stretch, length)
    net = net_acceleration(body, stretch)
    push = stretch.load / body.inertia
    if net > ROUNDING * push:
        return min(1.5 * net / third, length)
    return min(2.0 * push * body.mu * max(math.cos(stretch.theta), 0.0) / fourth, length)


@kernel
def touchdown(body: PressedBody, stretch: SwingStretch, room: float) -> tuple[float, float]:
    """Return time (s) and approach speed (rad/s) of the first return to the collar within ``room``; (inf, 0) if none.

    Without load and damping k s = atan2(B, A) + atan2(sqrt(A^2 + B^2 - phi0^2), phi0), A = phi + phi0, B = phi'/k,
    which from the collar is the bounce (2/k) atan(w/(k phi0)).  Otherwise the first root is searched.
    """
    if stretch.load == 0.0 and body.damping == 0.0:
        a, b = stretch.angle + body.rest_angle, stretch.rate / body.k
        reach = math.sqrt(max(stretch.angle * (a + body.rest_angle) + b * b, 0.0))
        s = (math.atan2(b, a) + math.atan2(reach, body.rest_angle)) / body.k
        return (s, body.k * reach) if s <= room else (math.inf, 0.0)
    start = _clear_of_collar(body, stretch, room) if stretch.angle == 0.0 and stretch.rate == 0.0 else 0.0
    if start > room:
        return math.inf, 0.0
    s = first_root(body, stretch, 0, start, room)
    if s == math.inf:
        return math.inf, 0.0
    return s, max(-motion(body, stretch, s)[1], 0.0)


@kernel
def highest(body: PressedBody, stretch: SwingStretch, duration: float) -> tuple[float, float]:
    """Return time and angle (s, rad) of the largest angle within the stretch, its ends included.

    Every turning point (zero of phi') is located; the smallest angle is limited by the collar.
    """
    best_at, best = 0.0, stretch.angle
    end = motion(body, stretch, duration)[0]
    if end > best:
        best_at, best = duration, end
    s = 0.0
    for _ in range(LONGEST_SEARCH):
        s = first_root(body, stretch, 1, s, duration)
        if s == math.inf:
            break
        angle = motion(body, stretch, s)[0]
        if angle > best:
            best_at, best = s, angle
        # beyond the turning point the rate keeps its new sign at least this long
        curvature = abs(_value_and_slope(body, stretch, s, 1)[1])
        third = _window(body, stretch, s, duration, 1)[1]
        s += max(curvature / third if third > 0.0 else 0.0, 1e-9 * duration)
        if s >= duration:
            break
    return best_at, best
