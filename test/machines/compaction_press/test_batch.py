# SPDX-License-Identifier: Apache-2.0
"""The batch kernels give what the scalar ones give, design by design."""

import numpy as np
import pytest
from four_bar_batch import batch_forces, batch_motions, batch_positions, full_turn

from mech_twin.machines.compaction_press.dynamics import press_pins, press_state
from mech_twin.parameters.load import machine


@pytest.mark.slow
def test_batches_equal_single_positions():
    press = machine("compaction_press").linkage.mechanism
    shorter = press._replace(bar=press.bar._replace(crank_m=0.05))
    designs = np.array([press.bar, shorter.bar])
    angles, w, e = full_turn(24), 20.0, 5.0
    positions, motions = batch_positions(designs, angles), batch_motions(designs, angles, w, e)
    forces = batch_forces(press, designs, angles, w, e, np.full(24, 700.0))
    for i, one in enumerate((press, shorter)):
        for k, f in enumerate(angles):
            _, rates, *_ = press_state(one, f, w, e, 0)
            assert motions[i, 4:6, k] == pytest.approx(rates[1:], rel=1e-12)
            assert positions[i, :, k] == pytest.approx(motions[i, :4, k], abs=0.0)
            assert forces[i, :, k] == pytest.approx(np.array(press_pins(one, f, w, e, 700.0)), rel=1e-12, abs=1e-9)
