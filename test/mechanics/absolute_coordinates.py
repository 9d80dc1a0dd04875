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

    def along(joint, direction):
        """Return the row of how far the second point lies along a direction that turns with the first body."""
        p, row_p, bent_p = place(joint.first, np.array(joint.first_at))
        q, row_q, bent_q = place(joint.second, np.array(joint.second_at))
        w, across = rates[joint.first][2], QUARTER @ direction
        row = direction @ (row_q - row_p)
        row[3 * joint.first + 2] += across @ (q - p)
        apart = (row_q - row_p) @ flat
        return row, -(direction @ (bent_q - bent_p) + 2.0 * w * across @ apart - w * w * direction @ (q - p))

    def turned(joint):
        row = np.zeros(n)
        row[3 * joint.second + 2], row[3 * joint.first + 2] = 1.0, -1.0
        return row

    flat = np.concatenate(rates)

    def told(row, right, *owner):
        rows.append(row)
        rights.append(right)
        owners.append(owner)

    for i in range(3):  # the ground stands
        told(np.eye(n)[i], 0.0, -1, "ground")
    for number, joint in enumerate(structure.joints):
        if joint.kind in ("revolute", "weld"):
            _, row_p, bent_p = place(joint.first, np.array(joint.first_at))
            _, row_q, bent_q = place(joint.second, np.array(joint.second_at))
            for i in range(2):
                told((row_q - row_p)[i], (bent_p - bent_q)[i], number, "xy"[i])
        if joint.kind == "slider":
            told(*along(joint, QUARTER @ turning(poses[joint.first][2]) @ np.array(joint.axis)), number, "normal")
        if joint.kind in ("slider", "weld"):
            told(turned(joint), 0.0, number, "angle")
    for number, gear in enumerate(structure.gears):
        row, right = np.zeros(n), 0.0
        for joint, share in ((structure.joints[gear.first], -gear.ratio), (structure.joints[gear.second], 1.0)):
            if joint.kind == "revolute":
                row += share * turned(joint)
            else:
                ahead, rest = along(joint, turning(poses[joint.first][2]) @ np.array(joint.axis))
                row, right = row + share * ahead, right + share * rest
        told(row, right, number, "gear")
    return np.array(rows), np.array(rights), owners


def solve(structure, poses, rates, wrenches, gravity):
    """Return accelerations of the frames (n, 3), each joint's force on its second body at its second point, gears'.

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
    held, teeth = np.zeros((len(structure.joints), 3)), np.zeros(len(structure.gears))
    for (number, kind), lam in zip(owners, multipliers, strict=True):
        if number < 0:
            continue
        if kind == "gear":
            teeth[number] = lam
            continue
        joint = structure.joints[number]
        if kind == "normal":
            normal = QUARTER @ turning(poses[joint.first][2]) @ np.array(joint.axis)
            held[number, :2] += lam * normal
        elif kind == "angle":
            held[number, 2] += lam
        else:
            held[number, "xy".index(kind)] += lam
    return accelerations, held, teeth
