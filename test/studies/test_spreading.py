# SPDX-License-Identifier: Apache-2.0
"""Work spread over processes: nothing of it is left once the results are taken."""

from __future__ import annotations

import threading

from mech_twin.studies.spreading import spread


def test_no_thread_that_holds_semaphores_outlives_the_last_result() -> None:
    """A command ends right after its results; what such a thread held would be called leaked on the terminal."""
    for _ in range(3):
        assert sorted(spread(abs, [-1, 2, -3], 2)) == [1, 2, 3]
        assert "_ExecutorManagerThread" not in {type(thread).__name__ for thread in threading.enumerate()}
