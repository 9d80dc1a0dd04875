# SPDX-License-Identifier: Apache-2.0
"""Random structures in a pose in which they are closed: bodies are thrown, then joined where they lie."""

from __future__ import annotations

import math

import numpy as np

from mech_twin.mechanics.structure import PlanarJoint, RigidBody, Structure


def thrown(rng, bodies, loops):
    """Return a structure with as many closed loops as can be had, and the absolute pose of each body (n, 3)."""
    poses = np.zeros((bodies + 1, 3))
    poses[1:, :2] = rng.uniform(-1.0, 1.0, (bodies, 2))
    poses[1:, 2] = rng.uniform(-math.pi, math.pi, bodies)
    parts = [RigidBody("ground")]
    for k in range(bodies):
        centre = tuple(rng.uniform(-0.3, 0.3, 2))
        parts.append(RigidBody(f"body_{k + 1}", rng.uniform(0.5, 3.0), rng.uniform(0.02, 0.3), centre))

    def local(body, place):
        c, s = math.cos(poses[body][2]), math.sin(poses[body][2])
        dx, dy = place[0] - poses[body][0], place[1] - poses[body][1]
        return (c * dx + s * dy, -s * dx + c * dy)

    joints = []

    def join(first, second, kind):
        place = rng.uniform(-1.0, 1.0, 2)
        by = poses[second][2] - poses[first][2]
        if kind == "slider":
            direction = rng.uniform(-math.pi, math.pi)
            axis = (math.cos(direction), math.sin(direction))
            travel, absolute = rng.uniform(-0.4, 0.4), direction + poses[first][2]
            end = place + travel * np.array([math.cos(absolute), math.sin(absolute)])
            ends = local(first, place), local(second, end)
            joints.append(
                PlanarJoint(f"j{len(joints)}", kind, first, second, *ends, axis, (by, math.cos(by), math.sin(by)))
            )
        elif kind == "free":
            other = place + rng.uniform(-0.4, 0.4, 2)
            joints.append(
                PlanarJoint(f"j{len(joints)}", kind, first, second, local(first, place), local(second, other))
            )
        else:
            turned = (by, math.cos(by), math.sin(by))
            ends = local(first, place), local(second, place)
            joints.append(PlanarJoint(f"j{len(joints)}", kind, first, second, *ends, (1.0, 0.0), turned))

    kinds = ["revolute", "revolute", "slider", "weld", "free"]
    for k in range(1, bodies + 1):
        other = int(rng.integers(0, k))
        pair = (other, k) if rng.random() < 0.5 else (k, other)
        join(*pair, str(rng.choice(kinds)))
    freedoms = sum({"revolute": 1, "slider": 1, "weld": 0, "free": 3}[joint.kind] for joint in joints)
    for _ in range(loops):
        kind = str(rng.choice(["revolute", "revolute", "slider"]))
        if freedoms - 2 < 1:
            break
        one, other = rng.choice(bodies + 1, 2, replace=False)
        welded = {(j.first, j.second) for j in joints if j.kind == "weld"}
        if (one, other) in welded or (other, one) in welded:
            continue
        join(int(one), int(other), kind)
        freedoms -= 2
    return Structure(parts, joints), poses


def coordinates_of(structure, poses):
    """Return the coordinates of the tree in these poses."""
    s = np.zeros(structure.size)
    for branch in structure.branches:
        joint = structure.joints[branch.joint]
        a, b = poses[joint.first], poses[joint.second]
        if joint.kind == "revolute":
            s[branch.coordinate] = b[2] - a[2]
        elif joint.kind in ("slider", "free"):
            p = a[:2] + turned(a[2], joint.first_at)
            q = b[:2] + turned(b[2], joint.second_at)
            d = turned(-a[2], q - p)
            if joint.kind == "slider":
                s[branch.coordinate] = joint.axis[0] * d[0] + joint.axis[1] * d[1]
            else:
                s[branch.coordinate : branch.coordinate + 3] = *d, b[2] - a[2]
    return s


def turned(angle, v):
    """Return a vector turned by an angle."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1]])
