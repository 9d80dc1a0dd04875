# SPDX-License-Identifier: Apache-2.0
r"""Four-bar linkage: positions of its joints, velocities and accelerations, and pin reactions.

::

            B
           /  \                        O  crank bearing, origin            A = r (cos f, sin f)
       2  /     \  3                   C  bearing of link 3, C = (l, h)    f from +x, counter-clockwise positive
         /        \                    1  crank OA = r
    A  o            o C = (l, h)       2  coupler AB = R1
      1 \                              3  rocker (pendulum) CB = R
         o O = (0, 0)                  u = B - A,  v = B - C,  D = u x v

``along`` is measured from O along OA, from A along AB, from C along CB; ``across`` is along turned by +90 degrees.
Branch +1 puts B to the right of the way from A to C ("open", hanging where C lies to the right of A); -1 is its mirror.

Which body acts on which: R_O is the frame's force on the crank, R_A the crank's on the coupler, R_B the rocker's on
the coupler, R_C the frame's on the rocker; M is the drive's moment on the crank.
"""

import math
from typing import NamedTuple

from mech_twin.declarations.configuration_tree import at_least, at_most
from mech_twin.kernels.kernel import embedded_kernel, kernel

OPEN = 1.0
CROSSED = -1.0


SINGULAR = 1e-9  # of a length: closer to zero it decides nothing


class FourBar(NamedTuple):
    """The lengths (m), the bearing of link 3 (m) and the branch (+1 open, -1 crossed)."""

    crank_m: float
    coupler_m: float
    rocker_m: float
    pivot_x_m: float
    pivot_y_m: float
    branch: float


class Link(NamedTuple):
    """Mass (kg), inertia (kg m^2: crank about O, others about their centroid) and centroid (m, along and across)."""

    mass_kg: float
    inertia_kg_m2: float
    along_m: float
    across_m: float


class Position(NamedTuple):
    """Joints A and B, the vectors u = AB and v = CB, all in m, and D = u x v in m^2."""

    a_x: float
    a_y: float
    b_x: float
    b_y: float
    u_x: float
    u_y: float
    v_x: float
    v_y: float
    det: float


class Coefficients(NamedTuple):
    """dw/df of links 2 and 3 (w2/w1, w3/w1), and their first and second derivatives in the crank angle."""

    g2: float
    g3: float
    g2_1: float
    g3_1: float
    g2_2: float
    g3_2: float


class FourBarRates(NamedTuple):
    """Rates (rad/s) and accelerations (rad/s^2) of links 2 and 3; accelerations of the centroids (m/s^2)."""

    w2: float
    w3: float
    e2: float
    e3: float
    s1_ax: float
    s1_ay: float
    s2_ax: float
    s2_ay: float
    s3_ax: float
    s3_ay: float


class Reactions(NamedTuple):
    """Pin reactions (N, or N s for impulses) as the head of the file says, and the moment on the crank (N m)."""

    o_x: float
    o_y: float
    a_x: float
    a_y: float
    b_x: float
    b_y: float
    c_x: float
    c_y: float
    moment: float


@embedded_kernel
def position(bar: FourBar, f: float) -> Position:
    """Return the joints at crank angle ``f`` (rad): d = C - A, B = A + p d + q (d_y, -d_x).

    p = (R1^2 - R^2 + d^2)/(2 d^2), q = s sqrt(R1^2/d^2 - p^2); not a number where the linkage cannot be assembled.
    """
    a_x = bar.crank_m * math.cos(f)
    a_y = bar.crank_m * math.sin(f)
    d_x = bar.pivot_x_m - a_x
    d_y = bar.pivot_y_m - a_y
    dd = d_x * d_x + d_y * d_y
    coupler, share = bar.coupler_m * bar.coupler_m, 1.0 / dd
    p = 0.5 * (coupler - bar.rocker_m * bar.rocker_m + dd) * share
    whole = coupler * share
    square = whole - p * p
    if -1e-13 * whole < square < 0.0:  # stretched or folded, but for rounding
        square = 0.0
    q = bar.branch * math.sqrt(square) if square >= 0.0 else math.nan
    u_x = p * d_x + q * d_y
    u_y = p * d_y - q * d_x
    b_x = a_x + u_x
    b_y = a_y + u_y
    v_x = b_x - bar.pivot_x_m
    v_y = b_y - bar.pivot_y_m
    return Position(a_x, a_y, b_x, b_y, u_x, u_y, v_x, v_y, u_x * v_y - u_y * v_x)


@kernel
def closure_error(bar: FourBar, at: Position) -> float:
    """Return the larger length error of the two rods (m)."""
    coupler = abs(math.hypot(at.b_x - at.a_x, at.b_y - at.a_y) - bar.coupler_m)
    rocker = abs(math.hypot(at.b_x - bar.pivot_x_m, at.b_y - bar.pivot_y_m) - bar.rocker_m)
    return max(coupler, rocker)


@kernel
def link_angles(at: Position) -> tuple[float, float]:
    """Return the angles of coupler (A to B) and rocker (C to B) from +x (rad, -pi to pi)."""
    return math.atan2(at.u_y, at.u_x), math.atan2(at.v_y, at.v_x)


@kernel
def acute_angles(at: Position) -> tuple[float, float, float]:
    """Return alpha (crank to coupler), beta (transmission angle) and gamma (coupler to +x), rad, 0 to pi.

    alpha = atan2(|OA x u|, |OA . u|), beta = atan2(|D|, |u . v|), gamma = |atan2(u_y, u_x)|; alpha and beta are acute.
    """
    across = at.a_x * at.u_y - at.a_y * at.u_x
    along = at.a_x * at.u_x + at.a_y * at.u_y
    alpha = math.atan2(abs(across), abs(along))
    beta = math.atan2(abs(at.det), abs(at.u_x * at.v_x + at.u_y * at.v_y))
    return alpha, beta, abs(math.atan2(at.u_y, at.u_x))


@embedded_kernel
def dyad_rates(at: Position, t_x: float, t_y: float) -> tuple[float, float]:
    """Return (x2, x3) of k x (x2 u - x3 v) + t = 0: x2 = -(t . v)/D, x3 = -(t . u)/D.

    With t = V_A these are the rates, with t = a_A - w2^2 u + w3^2 v the angular accelerations.
    """
    share = -1.0 / at.det
    return (t_x * at.v_x + t_y * at.v_y) * share, (t_x * at.u_x + t_y * at.u_y) * share


@embedded_kernel
def coefficients(at: Position) -> Coefficients:
    """Return the velocity coefficients of links 2 and 3 and their first two derivatives in the crank angle.

    The loop A + u - v = C differentiated once, twice and three times in f.
    """
    g2, g3 = dyad_rates(at, -at.a_y, at.a_x)
    t_x = -at.a_x - g2 * g2 * at.u_x + g3 * g3 * at.v_x
    t_y = -at.a_y - g2 * g2 * at.u_y + g3 * g3 * at.v_y
    g2_1, g3_1 = dyad_rates(at, t_x, t_y)
    along2, turn2 = 3.0 * g2 * g2_1, g2 * g2 * g2
    along3, turn3 = 3.0 * g3 * g3_1, g3 * g3 * g3
    t_x = at.a_y - along2 * at.u_x + turn2 * at.u_y + along3 * at.v_x - turn3 * at.v_y
    t_y = -at.a_x - along2 * at.u_y - turn2 * at.u_x + along3 * at.v_y + turn3 * at.v_x
    g2_2, g3_2 = dyad_rates(at, t_x, t_y)
    return Coefficients(g2, g3, g2_1, g3_1, g2_2, g3_2)


@embedded_kernel
def offset(link: Link, x: float, y: float, length: float) -> tuple[float, float]:
    """Return the centroid of a link seen from its first pin (m); (x, y) is the link as a vector of that length."""
    share = 1.0 / length
    return (link.along_m * x - link.across_m * y) * share, (link.along_m * y + link.across_m * x) * share


@embedded_kernel
def point_acceleration(x: float, y: float, w: float, e: float) -> tuple[float, float]:
    """Return e k x (x, y) - w^2 (x, y): the acceleration of a point of a turning link seen from its pin (m/s^2)."""
    return -e * y - w * w * x, e * x - w * w * y


@embedded_kernel
def motion(
    bar: FourBar, crank: Link, coupler: Link, rocker: Link, at: Position, by: Coefficients, w1: float, e1: float
) -> FourBarRates:
    """Return rates, angular accelerations and centroid accelerations at crank rate w1 (rad/s) and e1 (rad/s^2)."""
    w2 = by.g2 * w1
    w3 = by.g3 * w1
    e2 = by.g2 * e1 + by.g2_1 * w1 * w1
    e3 = by.g3 * e1 + by.g3_1 * w1 * w1
    x, y = offset(crank, at.a_x, at.a_y, bar.crank_m)
    s1_ax, s1_ay = point_acceleration(x, y, w1, e1)
    a_ax, a_ay = point_acceleration(at.a_x, at.a_y, w1, e1)
    x, y = offset(coupler, at.u_x, at.u_y, bar.coupler_m)
    b_ax, b_ay = point_acceleration(x, y, w2, e2)
    x, y = offset(rocker, at.v_x, at.v_y, bar.rocker_m)
    s3_ax, s3_ay = point_acceleration(x, y, w3, e3)
    return FourBarRates(w2, w3, e2, e3, s1_ax, s1_ay, a_ax + b_ax, a_ay + b_ay, s3_ax, s3_ay)


@embedded_kernel
def dyad_reactions(
    at: Position,
    force2_x: float,
    force2_y: float,
    moment2: float,
    force3_x: float,
    force3_y: float,
    moment3: float,
) -> tuple[float, float, float, float, float, float]:
    """Return R_A on the coupler, R_B on the coupler and R_C on the rocker as (x, y) pairs (N; N s for impulses).

    ``force2``, ``force3`` are the sums of all loads on links 2 and 3, inertia included; ``moment2`` is theirs about A,
    ``moment3`` theirs about C.  u x R_B = -moment2 = K2, v x R_B = moment3 = K3, R_B = (K2 v - K3 u)/D.
    """
    b_x = (-moment2 * at.v_x - moment3 * at.u_x) / at.det
    b_y = (-moment2 * at.v_y - moment3 * at.u_y) / at.det
    return -b_x - force2_x, -b_y - force2_y, b_x, b_y, b_x - force3_x, b_y - force3_y


@embedded_kernel
def pin_forces(
    bar: FourBar,
    crank: Link,
    coupler: Link,
    rocker: Link,
    at: Position,
    by: FourBarRates,
    e1: float,
    g_x: float,
    g_y: float,
    q_x: float,
    q_y: float,
    p_x: float,
    p_y: float,
) -> Reactions:
    """Return every pin reaction and the drive's moment on the crank under gravity and a force Q on the coupler.

    K2 = I2 e2 - (P - A) x Q - (S2 - A) x f2,  K3 = (S3 - C) x f3 - I3 e3,  f_i = m_i (g - a_i),
    M = J1O e1 + A x R_A - S1 x (m1 g).

    Parameters
    ----------
    e1 : float
        Angular acceleration of the crank (rad/s^2), the one ``by`` was computed with.
    g_x, g_y : float
        Gravity (m/s^2).
    q_x, q_y, p_x, p_y : float
        Working force (N) and its point of application (m), both in the frame of O.
    """
    f1_x, f1_y = crank.mass_kg * (g_x - by.s1_ax), crank.mass_kg * (g_y - by.s1_ay)
    f2_x, f2_y = coupler.mass_kg * (g_x - by.s2_ax), coupler.mass_kg * (g_y - by.s2_ay)
    f3_x, f3_y = rocker.mass_kg * (g_x - by.s3_ax), rocker.mass_kg * (g_y - by.s3_ay)
    x, y = offset(coupler, at.u_x, at.u_y, bar.coupler_m)
    load2 = x * f2_y - y * f2_x - coupler.inertia_kg_m2 * by.e2 + (p_x - at.a_x) * q_y - (p_y - at.a_y) * q_x
    x, y = offset(rocker, at.v_x, at.v_y, bar.rocker_m)
    load3 = x * f3_y - y * f3_x - rocker.inertia_kg_m2 * by.e3
    a_x, a_y, b_x, b_y, c_x, c_y = dyad_reactions(at, f2_x + q_x, f2_y + q_y, load2, f3_x, f3_y, load3)
    x, y = offset(crank, at.a_x, at.a_y, bar.crank_m)
    weight = crank.mass_kg * (x * g_y - y * g_x)
    moment = crank.inertia_kg_m2 * e1 + at.a_x * a_y - at.a_y * a_x - weight
    return Reactions(a_x - f1_x, a_y - f1_y, a_x, a_y, b_x, b_y, c_x, c_y, moment)


@embedded_kernel
def reduced_inertia(
    bar: FourBar, crank: Link, coupler: Link, rocker: Link, at: Position, by: Coefficients
) -> tuple[float, float]:
    """Return the inertia reduced to the crank (kg m^2) and its derivative in the crank angle (kg m^2/rad).

    I_pr = J1O + sum over links 2, 3 of m_i (V_i/w1)^2 + I_i (w_i/w1)^2; with w1 = 1 and e1 = 0 half its derivative is
    the sum of m_i V_i . a_i + I_i w_i e_i.
    """
    x, y = offset(coupler, at.u_x, at.u_y, bar.coupler_m)
    v_x, v_y = -at.a_y - by.g2 * y, at.a_x + by.g2 * x
    p_x, p_y = point_acceleration(x, y, by.g2, by.g2_1)
    w_x, w_y = p_x - at.a_x, p_y - at.a_y
    third = rocker.inertia_kg_m2 + rocker.mass_kg * (rocker.along_m**2 + rocker.across_m**2)
    second = coupler.mass_kg * (v_x * v_x + v_y * v_y) + coupler.inertia_kg_m2 * by.g2 * by.g2
    inertia = crank.inertia_kg_m2 + second + third * by.g3 * by.g3
    half = coupler.mass_kg * (v_x * w_x + v_y * w_y) + coupler.inertia_kg_m2 * by.g2 * by.g2_1
    return inertia, 2.0 * (half + third * by.g3 * by.g3_1)


@kernel
def weight_moments(bar: FourBar, crank: Link, coupler: Link, rocker: Link, at: Position) -> tuple[float, float]:
    """Return the first moments of the links' masses about O (kg m)."""
    x1, y1 = offset(crank, at.a_x, at.a_y, bar.crank_m)
    x2, y2 = offset(coupler, at.u_x, at.u_y, bar.coupler_m)
    x3, y3 = offset(rocker, at.v_x, at.v_y, bar.rocker_m)
    x = crank.mass_kg * x1 + coupler.mass_kg * (at.a_x + x2) + rocker.mass_kg * (bar.pivot_x_m + x3)
    y = crank.mass_kg * y1 + coupler.mass_kg * (at.a_y + y2) + rocker.mass_kg * (bar.pivot_y_m + y3)
    return x, y


def smallest_transmission_angle(bar: FourBar) -> float:
    """Return the smallest angle between the lines of coupler and rocker over a turn of the crank (rad, 0 to pi/2).

    cos mu = (R1^2 + R^2 - d^2)/(2 R1 R) with d = |AC|, whose extremes over a full turn are |ground - crank| and
    ground + crank.  At 0 the linkage is at a change point: the next position is not determined, pin forces are not
    bounded.
    """
    ground = math.hypot(bar.pivot_x_m, bar.pivot_y_m)
    found = []
    for d in (abs(ground - bar.crank_m), ground + bar.crank_m):
        cosine = (bar.coupler_m**2 + bar.rocker_m**2 - d * d) / (2.0 * bar.coupler_m * bar.rocker_m)
        found.append(math.acos(min(1.0, abs(cosine))))
    return min(found)


def failing_inequality(bar: FourBar, crank_rocker: bool = False) -> str | None:
    """Return why the crank cannot turn fully, with numbers and a length that would do; None for one that can.

    r + |OC| <= R1 + R and ||OC| - r| >= |R1 - R|; for a crank-rocker the crank is the shortest link besides, and these
    two are Grashof's inequality then.  Where both sides of the second are zero the crank pin falls on the pivot, and
    the position is not determined: that is refused too.
    """
    r, r1, r3 = bar.crank_m, bar.coupler_m, bar.rocker_m
    ground = math.hypot(bar.pivot_x_m, bar.pivot_y_m)
    shortest = min(r1, r3, ground)
    meets = abs(ground - r) <= SINGULAR * (ground + r) and abs(r1 - r3) <= SINGULAR * (r1 + r3)
    failures = [
        (r + ground > r1 + r3, f"crank + ground <= coupler + rocker fails: {r + ground:g} > {r1 + r3:g}"),
        (
            abs(ground - r) < abs(r1 - r3),
            f"|ground - crank| >= |coupler - rocker| fails: {abs(ground - r):g} < {abs(r1 - r3):g}",
        ),
        (meets, "crank pin and pivot must not meet: crank = ground and coupler = rocker"),
        (crank_rocker and r > shortest, f"crank <= every other link fails: {r:g} > {shortest:g}"),
    ]
    failing = next((text for fails, text in failures if fails), None)
    if failing is None:
        return None
    numbers = f"crank {r:g} m, coupler {r1:g} m, rocker {r3:g} m, ground {ground:g} m"
    return f"the crank cannot make a full turn: {failing} ({numbers}){_proposal(bar, ground, crank_rocker)}"


def _proposal(bar: FourBar, ground: float, crank_rocker: bool) -> str:
    """Return a length (m), of the crank or else of the coupler, with which the crank turns fully, with a margin."""
    r, r1, r3 = bar.crank_m, bar.coupler_m, bar.rocker_m
    longest = min(r1 + r3 - ground, ground - abs(r1 - r3), *((r1, r3, ground) if crank_rocker else ()))
    if longest > SINGULAR * (r + ground):
        return f"; try crank <= {at_most(longest):g} m"
    if crank_rocker and r > min(r3, ground):
        return ""
    lower = at_least(max(r + ground - r3, r3 - abs(ground - r), r if crank_rocker else 0.0))
    upper = at_most(r3 + abs(ground - r))
    return f"; try coupler {lower:g} to {upper:g} m" if lower <= upper else ""
