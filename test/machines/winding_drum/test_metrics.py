# SPDX-License-Identifier: Apache-2.0
"""Metrics of the winding drum against what they are defined by: closed forms of one package, frames of one run."""

from __future__ import annotations

from math import hypot, pi

import numpy as np
import pytest

from mech_twin.engine.run import frames
from mech_twin.machines.winding_drum.metrics import sign_changes
from mech_twin.parameters.load import machine


def test_sign_changes_of_a_closed_curve_count_each_crossing_once() -> None:
    angles = np.arange(360) * 2.0 * pi / 360 + 0.01
    assert [sign_changes(np.sin(n * angles)) for n in (1, 2, 5)] == [2, 4, 10]
    assert sign_changes(np.sin(angles) + 2.0) == 0
    assert sign_changes(np.array([1.0, 0.0, -1.0, 0.0])) == 2
    assert sign_changes(np.array([1.0, -1e-15, 1.0, 1e-15])) == 0


def test_report_is_the_geometry_of_the_package() -> None:
    drum = machine("winding_drum")
    p, report = drum.parameters, drum.report()
    start = drum.linkage.start()
    first, theta = start.joint("package_radius").position, p.yarn_speed_m_per_s
    assert report["angular_speed_first_rad_per_s"] == pytest.approx(theta / first, rel=1e-13)
    last = theta / report["angular_speed_last_rad_per_s"]
    # the area of the ring is that of the yarn, and each turn takes a layer
    layer = 2.0 * pi * (first - last) / (2.0 * pi * report["turns_of_ideal_package"])
    assert report["yarn_length_m"] == pytest.approx(pi * (first**2 - last**2) / layer, rel=1e-12)
    assert report["run_time_at_rated_speed_s"] == pytest.approx(report["yarn_length_m"] / theta, rel=1e-13)
    assert report["steady_torque_min_nm"] < 0.0 < report["steady_torque_max_nm"]
    assert report["eccentric_torque_sign_changes_per_turn"] == 2.0


def test_metrics_of_a_run_are_the_extremes_and_sums_of_its_frames() -> None:
    drum = machine("winding_drum")
    observer, seen = drum.observer(), list(frames(drum, 1.0))
    for frame in seen:
        observer.observe(frame)
    numbers, last = observer.numbers(), seen[-1].linkage
    torques = [frame.linkage.joint("drum").effort for frame in seen]
    shafts = [hypot(w.force_x_n, w.force_y_n) for frame in seen for w in frame.forces.wrenches]
    assert numbers["torque_max_nm"] == max(torques)
    assert numbers["torque_min_nm"] == min(torques)
    assert numbers["speed_max_rad_per_s"] == max(frame.linkage.joint("drum").velocity for frame in seen)
    assert numbers["shaft_force_max_n"] == max(shafts)
    assert numbers["turns"] == pytest.approx(last.joint("drum").position / (2.0 * pi), rel=1e-15)
    assert numbers["yarn_run_m"] == last.joint("yarn").position
    assert numbers["package_radius_m"] == last.joint("package_radius").position
    assert numbers["drive_work_j"] == last.memory["drive_work_j"]
    assert numbers["friction_loss_j"] == last.memory["friction_loss_j"]
