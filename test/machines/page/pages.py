# SPDX-License-Identifier: Apache-2.0
"""Pages for tests: small machines whose motion has a closed form, and a way to run one."""

from __future__ import annotations

import yaml

from mech_twin.engine.run import frames
from mech_twin.machines.page import build
from mech_twin.machines.page.parameters import Page
from mech_twin.studies.simulation import Simulation

BALL = """
gravity_m_per_s2: [0, -10]
ground: {points_m: {floor: [0, 0]}}
bodies: {ball: {mass_kg: 2}}
joints: {fall: {kind: slider, between: [ground, ball], direction_deg: 90, start_m: 1}}
contacts: {bounce: {point: ball, line: ground.floor, normal_deg: 90, restitution: 0.5}}
"""

PENDULUM = """
gravity_m_per_s2: [0, -9.81]
bodies: {rod: {mass_kg: 2, inertia_kg_m2: 0.1, centre_m: [0.5, 0]}}
joints: {pivot: {kind: revolute, between: [ground, rod], start_deg: -60}}
"""

SLIDER_CRANK = """
gravity_m_per_s2: [0, 0]
bodies:
  crank: {mass_kg: 5, inertia_kg_m2: 0.05, points_m: {pin: [0.1, 0]}}
  rod: {mass_kg: 1, inertia_kg_m2: 0.02, centre_m: [0.2, 0], points_m: {end: [0.4, 0]}}
  piston: {mass_kg: 3}
joints:
  bearing: {kind: revolute, between: [ground, crank], start_deg: 30}
  pin: {kind: revolute, between: [crank.pin, rod]}
  wrist: {kind: revolute, between: [rod.end, piston]}
  guide: {kind: slider, between: [ground, piston], start_m: 0.5}
drives: {motor: {kind: constant_speed, joint: bearing, speed_rpm: 600}}
outputs: {path: {point: rod.end}}
"""


def page(text, **changes):
    """Return a page, with groups laid over it."""
    tree = yaml.safe_load(text)
    for key, value in changes.items():
        if isinstance(value, dict) and isinstance(tree.get(key), dict):
            for name, element in value.items():
                there = tree[key].get(name)
                tree[key][name] = {**there, **element} if isinstance(there, dict) else element
        else:
            tree[key] = value
    return Page.model_validate(tree)


def run(text, duration_s, **changes):
    """Return the frames of a run and what was gathered of it."""
    machine = build(page(text, **changes))
    simulation = Simulation(machine)
    told = []
    for frame in frames(machine, duration_s):
        simulation.observe(frame)
        told.append(frame)
    return told, simulation
