# SPDX-License-Identifier: Apache-2.0
"""Laws of a structure's equations: against absolute coordinates with multipliers, closed forms, and on symbols."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from mechanics.absolute_coordinates import solve
from mechanics.random_structures import coordinates_of, thrown

from mech_twin.kernels.kernel import kernel
from mech_twin.mechanics.code_generation import Recording, call_straight_line, generated
from mech_twin.mechanics.dynamics import AppliedLoad, JointEffort, ReducedSystem
from mech_twin.mechanics.kinematics import Kinematics, Scalar
from mech_twin.mechanics.linear_solve import solution
from mech_twin.mechanics.structure import (
    COORDINATES,
    FirmGear,
    PlanarJoint,
    RigidBody,
    Split,
    Structure,
    StructureError,
    split_of,
)

GRAVITY = (0.3, -9.81)


def regular_split(structure, s, driven=()):
    """Return a split whose dependent coordinates are well determined at a pose."""
    rows = np.array([c.row for c in Kinematics(structure, list(s)).closures()], dtype=float).reshape(-1, structure.size)

    def regular(rest):
        if not len(rows):
            return True
        values = np.linalg.svd(rows[:, list(rest)], compute_uv=False)
        return len(rest) >= len(rows) and values[len(rows) - 1] > 0.05

    return split_of(structure.size, structure.closures, driven, range(structure.size), regular)


def random_case(seed, loops=0):
    """Return a random structure with a pose, a split and speeds: the first draw that is not near a dead point."""
    rng = np.random.default_rng(seed)
    while True:
        structure, poses = thrown(rng, int(rng.integers(1, 7)), int(rng.integers(loops, 4)))
        if structure.size <= structure.closures or (loops and not structure.closures):
            continue
        s = coordinates_of(structure, poses)
        structure = geared(structure, s, rng)
        if structure.size <= structure.closures:
            continue
        try:
            split = regular_split(structure, s)
        except StructureError:
            continue
        return structure, poses, s, split, rng.uniform(-5.0, 5.0, len(split.led)), rng


def geared(structure, s, rng):
    """Return a structure with gears at random, which mesh where it stands."""
    able = [number for number, joint in enumerate(structure.joints) if joint.kind in ("revolute", "slider")]
    gears = []
    for _ in range(int(rng.integers(0, 3)) if len(able) > 1 else 0):
        first, second = (int(j) for j in rng.choice(able, 2, replace=False))
        gear = FirmGear(first, second, float(rng.uniform(0.3, 2.0) * rng.choice([-1.0, 1.0])))
        gears.append(gear._replace(offset=float(Kinematics(structure, list(s)).geared(gear).value)))
    return replace(structure, gears=gears)


@pytest.mark.parametrize("seed", range(500))
def test_accelerations_and_joint_forces_are_those_of_absolute_coordinates(seed):
    structure, poses, s, split, speeds, rng = random_case(seed)
    driven = split.free[:1] if len(split.free) > 1 and seed % 3 == 0 else ()
    split = Split(tuple(j for j in split.free if j not in driven), driven, split.dependent)
    drive = rng.uniform(-3.0, 3.0, len(driven))
    at = ReducedSystem(structure, split, list(s), list(speeds), list(drive))
    assert np.allclose([c.value for c in at.closures], 0.0, atol=1e-12)
    body = len(structure.bodies) - 1
    push, spot, moment = rng.uniform(-20.0, 20.0, 2), (0.1, -0.2), 4.0
    point = at.motion.point(body, spot)
    efforts = [
        JointEffort(Scalar(point.x, point.row_x, lambda r: 0.0), push[0]),
        JointEffort(Scalar(point.y, point.row_y, lambda r: 0.0), push[1]),
        JointEffort(at.motion.angle(0, body), moment),
    ]
    mass, force = at.equations(efforts, GRAVITY)
    n = len(split.free)
    free = np.linalg.solve(np.array(mass, dtype=float)[:n, :n], np.array(force, dtype=float)[:n])
    accelerations = at.accelerations(list(free))
    rates = np.array(
        [
            [sum(a * b for a, b in zip(row, at.rates.speeds, strict=True)) for row in (f.row_x, f.row_y, f.row_angle)]
            for f in at.motion.frames
        ],
        dtype=float,
    )
    wrenches = [(body, (point.x, point.y), push, moment)]
    loads = [AppliedLoad(body, point.x, point.y, push[0], push[1], moment)]
    if driven:  # the reference has no drive: its torque or force acts as a wrench
        torque = np.array(mass, dtype=float)[n, :n] @ free - force[n]
        number = joint_of(structure, driven[0])
        added = joint_loads(structure, at, number, driven[0] - structure.first_coordinate[number], torque)
        loads += added
        wrenches += [(w.body, (w.x, w.y), np.array([w.force_x, w.force_y]), w.moment) for w in added]
    expected, held, teeth = solve(structure, poses, rates, wrenches, GRAVITY)
    scale = 1.0 + np.abs(expected).max()
    for frame, left, (ax, ay, aa) in zip(at.motion.frames, at.rates.origin, expected, strict=True):
        found = [sum(a * b for a, b in zip(row, accelerations, strict=True)) for row in (frame.row_x, frame.row_y)]
        assert found[0] + left[0] == pytest.approx(ax, abs=1e-9 * scale)
        assert found[1] + left[1] == pytest.approx(ay, abs=1e-9 * scale)
        assert sum(a * b for a, b in zip(frame.row_angle, accelerations, strict=True)) == pytest.approx(
            aa, abs=1e-9 * scale
        )
    found = at.joint_wrenches(accelerations, loads, GRAVITY)
    peak = 1.0 + max(np.abs(held).max(), np.abs(teeth).max(initial=0.0))
    for wrench, reference in zip(found.wrenches, held, strict=True):
        assert [wrench.x, wrench.y, wrench.moment] == pytest.approx(reference, abs=1e-8 * peak)
    assert found.gears == pytest.approx(teeth, abs=1e-8 * peak)
    assert np.abs(found.lack).max() <= 1e-12 + 1e-8 * max(found.sizes)


def joint_of(structure, coordinate):
    """Return the joint of a coordinate of the tree."""
    for branch in structure.branches:
        count = COORDINATES[structure.joints[branch.joint].kind]
        if branch.coordinate <= coordinate < branch.coordinate + count:
            return branch.joint
    raise AssertionError


def joint_loads(structure, at, number, part, size):
    """Return what an effort of a joint does to both bodies."""
    joint = structure.joints[number]
    p = at.motion.point(joint.second, joint.second_at)
    if joint.kind == "revolute" or part == 2:
        return [
            AppliedLoad(joint.second, 0.0, 0.0, 0.0, 0.0, size),
            AppliedLoad(joint.first, 0.0, 0.0, 0.0, 0.0, -size),
        ]
    axis = joint.axis if joint.kind == "slider" else ((1.0, 0.0), (0.0, 1.0))[part]
    x, y = at.motion.frames[joint.first].turned(axis)
    return [
        AppliedLoad(joint.second, p.x, p.y, size * x, size * y, 0.0),
        AppliedLoad(joint.first, p.x, p.y, -size * x, -size * y, 0.0),
    ]


@pytest.mark.parametrize("seed", range(0, 60, 7))
def test_second_derivatives_are_those_of_the_motion(seed):
    """Closures and speeds a little later, along the motion, are as first and second derivatives say."""
    structure, _, s, split, speeds, _ = random_case(seed, loops=1)
    at = ReducedSystem(structure, split, list(s), list(speeds), [])
    a = np.array(at.accelerations([0.0] * len(split.free)))
    v = np.array(at.rates.speeds)
    for dt in (1e-4, 5e-5):
        later = Kinematics(structure, list(s + dt * v + 0.5 * dt * dt * a)).closures()
        assert np.abs([c.value for c in later]).max() <= 50.0 * (1.0 + np.abs(v).max() ** 3) * dt**3


@pytest.mark.parametrize("seed", [1, 4, 9, 22])
def test_symbols_give_the_numbers_to_rounding(seed):
    structure, _, s, split, speeds, _ = random_case(seed, loops=1)
    n, m = structure.size, len(split.led)
    numbers = ReducedSystem(structure, split, list(s), list(speeds), [])
    mass, force = numbers.equations([], GRAVITY)
    recording = Recording()
    leaves = [recording.leaf(f"state[{i}]") for i in range(n + m)]
    symbols = ReducedSystem(structure, split, leaves[:n], leaves[n:], [])
    rows, pull = symbols.equations([], GRAVITY)
    outputs = [x for row in rows for x in row] + pull
    made = generated({"equations": outputs})["equations"]
    out = [0.0] * len(outputs)
    made.function([], [], 0.0, [*s, *speeds], out)
    expected = [x for row in mass for x in row] + force
    assert out == pytest.approx(expected, rel=1e-12, abs=1e-12 * max(map(abs, expected)))


def test_compiled_code_gives_the_bits_of_its_source():
    structure, _, s, split, speeds, _ = random_case(9, loops=1)
    n = structure.size
    recording = Recording()
    leaves = [recording.leaf(f"state[{i}]") for i in range(n + len(speeds))]
    rows, pull = ReducedSystem(structure, split, leaves[:n], leaves[n:], []).equations([], GRAVITY)
    made = generated({"equations": [x for row in rows for x in row] + pull})["equations"]

    @kernel
    def called(address, state, out):
        call_straight_line(address, state, state, 0.0, state, out)

    state, out = np.array([*s, *speeds]), np.zeros(made.size)
    called(made.address(), state, out)
    expected = [0.0] * made.size
    made.function([], [], 0.0, state.tolist(), expected)
    assert out.tolist() == expected


def test_pendulum_has_its_closed_form():
    length, mass, inertia, angle = 0.7, 2.0, 0.05, 0.4
    rod = RigidBody("rod", mass, inertia, (length, 0.0))
    structure = Structure([RigidBody("ground"), rod], [PlanarJoint("bearing", "revolute", 0, 1)])
    at = ReducedSystem(structure, Split((0,), (), ()), [angle], [3.0], [])
    mass_matrix, force = at.equations([], (0.0, -9.81))
    assert mass_matrix[0][0] == pytest.approx(inertia + mass * length**2, rel=1e-15)
    assert force[0] == pytest.approx(-mass * 9.81 * length * math.cos(angle), rel=1e-15)


def test_slider_crank_has_its_closed_form():
    r, rod, angle, w = 0.1, 0.35, 0.8, 50.0
    bodies = [
        RigidBody("ground"),
        RigidBody("crank", 1.0, 0.01),
        RigidBody("rod", 0.0, 0.0),
        RigidBody("piston", 3.0, 0.0),
    ]
    joints = [
        PlanarJoint("bearing", "revolute", 0, 1),
        PlanarJoint("guide", "slider", 0, 3),
        PlanarJoint("pin", "revolute", 1, 2, (r, 0.0)),
        PlanarJoint("wrist", "revolute", 2, 3, (rod, 0.0)),
    ]
    structure = Structure(bodies, joints)
    slope = -math.asin(r / rod * math.sin(angle))
    travel = r * math.cos(angle) + rod * math.cos(slope)
    coordinates = {0: angle, 1: travel, 2: slope - angle}
    s = [0.0] * 3
    for branch in structure.branches:
        s[branch.coordinate] = coordinates[branch.joint]
    first = structure.first_coordinate
    split = Split((first[0],), (), tuple(j for j in range(3) if j != first[0]))
    at = ReducedSystem(structure, split, s, [w], [])
    assert [c.value for c in at.closures] == pytest.approx([0.0, 0.0], abs=1e-15)
    slope_rate = -r * math.cos(angle) / (rod * math.cos(slope))
    lever = -r * math.sin(angle) - rod * math.sin(slope) * slope_rate
    slope_bend = (r * math.sin(angle) + rod * math.sin(slope) * slope_rate**2) / (rod * math.cos(slope))
    lever_rate = -r * math.cos(angle) - rod * math.cos(slope) * slope_rate**2 - rod * math.sin(slope) * slope_bend
    mass, force = at.equations([], (0.0, 0.0))
    assert mass[0][0] == pytest.approx(0.01 + 3.0 * lever**2, rel=1e-14)
    assert force[0] == pytest.approx(-3.0 * lever * lever_rate * w**2, rel=1e-13)


def test_a_body_that_nothing_joins_is_named():
    structure = Structure([RigidBody("ground"), RigidBody("ram", 1.0)], [])
    with pytest.raises(StructureError, match="ram"):
        structure.branches  # noqa: B018


def test_loops_that_hang_on_the_same_loop_are_blocks_of_their_own():
    """Two blocks of two columns, woven into each other, need nothing but the same first block."""
    rng = np.random.default_rng(1)
    a, b = np.zeros((6, 6)), rng.uniform(-1.0, 1.0, (6, 1))
    first, second, third = (0, 1), (2, 4), (3, 5)
    for block, columns in ((first, first), (second, first + second), (third, first + third)):
        a[np.ix_(block, columns)] = rng.uniform(0.5, 1.0, (2, len(columns))) + np.eye(2, len(columns))
    recording = Recording()
    symbols = [
        [recording.leaf(f"numbers[{6 * i + j}]") if x else 0.0 for j, x in enumerate(row)] for i, row in enumerate(a)
    ]
    found, _ = solution(symbols, b.tolist())
    made = generated({"solution": [row[0] for row in found]})["solution"]
    out = np.zeros(6)
    made.function(a.ravel(), np.zeros(1), 0.0, np.zeros(1), out)
    assert out == pytest.approx(np.linalg.solve(a, b)[:, 0], rel=1e-9)
