# SPDX-License-Identifier: Apache-2.0
"""Named states and events of the impact mass.

They are floats, because they stand beside numbers in the arrays and samples of the compiled event walk.
"""

from __future__ import annotations

FLIGHT, SERIES, STUCK = 0.0, 1.0, 2.0  # mode of the motion after an event
MODE_NAMES = ("free", "chatter", "stuck")
PHASE_1, PHASE_2 = 0.0, 1.0  # phase of the force

IMPACT, CHATTER_END, RELEASE, PHASE_CHANGE, IMPACTS_SUMMED = 0.0, 1.0, 2.0, 3.0, 4.0  # kinds of events
KIND_NAMES = ("impact", "chatter_end", "release", "phase", "impacts_summed")
KIND_CONTACTS = ("stop", "stop", "stop", "generator", "stop")

FREE_REGIME, IMPACT_REGIME, CHATTER_REGIME, STUCK_REGIME = 0, 1, 2, 3  # regime of a sample
REGIME_NAMES = ("free", "impact", "chatter", "stuck")
