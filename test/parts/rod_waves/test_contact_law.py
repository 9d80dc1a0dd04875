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
