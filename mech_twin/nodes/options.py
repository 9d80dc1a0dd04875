# SPDX-License-Identifier: Apache-2.0
"""How a node is run, as opposed to what the machine is: the ``run`` group of a node's parameters."""

from __future__ import annotations

from typing import Literal

from mech_twin.messages.stream_window import STREAM_RATE_HZ
from mech_twin.quantity import Parameters, choice, quantity


class RunOptions(Parameters):
    """StepPacer, length and company of a run."""

    pace: Literal["realtime", "max"] = choice("follow the wall clock, or run as fast as answers come", default="max")
    duration_s: float = quantity("s", "simulated time to run; 0 runs until stopped", ge=0.0, default=0.0)
    recorder: bool = choice("wait for a recorder before the first step", default=False)
    viewer: bool = choice("wait for a viewer before the first step", default=False)
    observer: bool = choice("wait for an observer of the steps", default=False)
    exclusive: bool = choice("refuse to start where somebody publishes this node's step messages", default=True)
    stream_rate_hz: float = quantity(
        "Hz",
        "messages per simulated second on decimated topics, up to one a step; more where something strikes",
        gt=0.0,
        default=STREAM_RATE_HZ,
    )
    view_rate_hz: float = quantity("Hz", "drawings per simulated second", gt=0.0, le=1000.0, default=30.0)
    peer_timeout_s: float = quantity("s", "silence after which a peer counts as gone", gt=0.0, default=0.5)
    discovery_limit_s: float = quantity("s", "longest wait for peers before the first step", gt=0.0, default=10.0)
    max_loss_s: float = quantity("s", "age at which a recorded message is on its way to the disk", gt=0.0, default=0.5)
    fsync: bool = choice("force each chunk of a recording to the disk, against loss of power", default=False)
    split_mib: float = quantity("MiB", "size at which a recording goes on in a new file", gt=0.0, default=512.0)
    split_s: float = quantity("s", "time after which it does; 0 never", ge=0.0, default=0.0)
