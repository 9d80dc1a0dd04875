# SPDX-License-Identifier: Apache-2.0
"""An independent route: bodies in absolute coordinates, joints as constraints with multipliers, dense linear algebra.

Coordinates x, y, angle of each body's frame.  Only poses are shared with what is tested.
"""

from __future__ import annotations

import numpy as np

QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])


def turning(angle):
    """Return the matrix of a turn."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def constraint_rows(structure, poses, rates):
    """Return rows C and right-hand sides g of C a = g, with which joint and kind of equation each is of."""
    n = 3 * len(structure.bodies)
    rows, rights, owners = [], [], []

    def place(body, at):
        x, y, angle = poses[body]
        arm = turning(angle) @ at
        row = np.zeros((2, n))
        row[:, 3 * body : 3 * body + 2] = np.eye(2)
        row[:, 3 * body + 2] = QUARTER @ arm
        w = rates[body][2]
        return np.array([x, y]) + arm, row, -w * w * arm

    for i in range(3):  # the ground stands
        row = np.zeros(n)
        row[i] = 1.0
        rows.append(row)
        rights.append(0.0)
        owners.append((-1, "ground"))
    flat = np.concatenate(rates)
    for number, joint in enumerate(structure.joints):
        p, row_p, bent_p = place(joint.first, np.array(joint.first_at))
        q, row_q, bent_q = place(joint.second, np.array(joint.second_at))
        if joint.kind in ("revolute", "weld"):
            for i in range(2):
                rows.append((row_q - row_p)[i])
                rights.append((bent_p - bent_q)[i])
                owners.append((number, "xy"[i]))
        if joint.kind == "slider":
            w1 = rates[joint.first][2]
            normal = QUARTER @ turning(poses[joint.first][2]) @ np.array(joint.axis)
            row = normal @ (row_q - row_p)
            row[3 * joint.first + 2] += (QUARTER @ normal) @ (q - p)
            rows.append(row)
            apart = (row_q - row_p) @ flat
            rights.append(
                -(normal @ (bent_q - bent_p) + 2.0 * w1 * (QUARTER @ normal) @ apart - w1 * w1 * normal @ (q - p))
            )
            owners.append((number, "normal"))
        if joint.kind in ("slider", "weld"):
            row = np.zeros(n)
            row[3 * joint.second + 2], row[3 * joint.first + 2] = 1.0, -1.0
            rows.append(row)
            rights.append(0.0)
            owners.append((number, "angle"))
    return np.array(rows), np.array(rights), owners


def solve(structure, poses, rates, wrenches, gravity):
    """Return accelerations of the frames (n, 3) and the force of each joint on its second body at its second point.

    ``wrenches`` are (body, place, force, moment) that act beside weight and constraints.
    """
    count = len(structure.bodies)
    mass, force = np.zeros((3 * count, 3 * count)), np.zeros(3 * count)
    for k, body in enumerate(structure.bodies):
        arm = turning(poses[k][2]) @ np.array(body.centre)
        jacobian = np.zeros((3, 3))
        jacobian[:2, :2], jacobian[:2, 2], jacobian[2, 2] = np.eye(2), QUARTER @ arm, 1.0
        weight = np.diag([body.mass, body.mass, body.inertia]) if k else np.zeros((3, 3))
        bent = np.array([*(-(rates[k][2] ** 2) * arm), 0.0])
        s = slice(3 * k, 3 * k + 3)
        mass[s, s] = jacobian.T @ weight @ jacobian
        pull = np.array([*gravity, 0.0])
        force[s] += jacobian.T @ weight @ (pull - bent)
    for body, place, push, moment in wrenches:
        arm = np.array(place) - poses[body][:2]
        force[3 * body : 3 * body + 2] += push
        force[3 * body + 2] += arm[0] * push[1] - arm[1] * push[0] + moment
    rows, rights, owners = constraint_rows(structure, poses, rates)
    m = len(rows)
    matrix = np.block([[mass, rows.T], [rows, np.zeros((m, m))]])
    found = np.linalg.solve(matrix, np.concatenate([force, rights]))
    accelerations, multipliers = found[: 3 * count].reshape(count, 3), -found[3 * count :]
    held = np.zeros((len(structure.joints), 3))
    for (number, kind), lam in zip(owners, multipliers, strict=True):
        if number < 0:
            continue
        joint = structure.joints[number]
        if kind == "normal":
            normal = QUARTER @ turning(poses[joint.first][2]) @ np.array(joint.axis)
            held[number, :2] += lam * normal
        elif kind == "angle":
            held[number, 2] += lam
        else:
            held[number, "xy".index(kind)] += lam
    return accelerations, held
