# SPDX-License-Identifier: Apache-2.0
"""The force of a contact over a step of time: how soon it is found."""

from __future__ import annotations

import numpy as np
import pytest

from mech_twin.parts.rod_waves import contact_law
from mech_twin.parts.rod_waves.contact_law import ContactLaw, hertz_contact, linear_contact


@pytest.mark.parametrize("law", [linear_contact(2e8), ContactLaw(3, 5e7, 2e8, 0.0), hertz_contact(1.15e11, 0.1)])
def test_the_force_of_a_step_is_found_in_a_few_trials(law: ContactLaw, monkeypatch: pytest.MonkeyPatch) -> None:
    """The trial at the root ends the search; it does not send it back to halving the bounds."""
    trials: list[float] = []
    mean = contact_law.mean_force.py_func

    def counted(*arguments: float) -> float:
        trials.append(arguments[3])
        return float(mean(*arguments))

    monkeypatch.setattr(contact_law, "mean_force", counted)
    starts, closings = np.geomspace(1e-5, 1e-3, 12), np.linspace(-1.9, 2.0, 12)
    for start in starts:
        for closing in closings:
            trials.clear()
            contact_law.force_of_step.py_func(law, 1.5 * start, start, closing, 1.0 / 1.15e5, 2.7e-6)
            assert len(trials) <= 8


def test_the_force_of_a_step_is_found_where_a_stiff_wall_comes_to_its_largest_compression() -> None:
    """The slopes on either side of the largest compression may send Newton's method to and fro for good."""
    random = np.random.default_rng(0)
    for _ in range(20000):
        loading, ratio = 10.0 ** random.uniform(6.0, 12.0), 10.0 ** random.uniform(0.0, 4.0)
        compliance, span = 10.0 ** random.uniform(-6.0, 1.0), 10.0 ** random.uniform(-7.0, -5.0)
        closing = 10.0 ** random.uniform(-1.0, 2.0)
        most = closing / compliance / loading * 10.0 ** random.uniform(-1.0, 1.0)
        start = most * (1.0 - min(random.uniform(0.0, 2.0) / ratio, 1.0))
        law = ContactLaw(3, loading, ratio * loading, 0.0)
        force, change = contact_law.force_of_step(law, most, start, closing, compliance, span)
        assert change == pytest.approx((closing - compliance * force) * span, abs=1e-6 * closing * span)
