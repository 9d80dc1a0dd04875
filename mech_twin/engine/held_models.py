# SPDX-License-Identifier: Apache-2.0
"""Constants of a role kept in compiled memory, so that they are converted once and not at each call.

Unboxing a `NamedTuple` of some eighty numbers costs more than the step of most roles.  A role keeps its constants
here and calls the kernels below with them; the results are bit for bit those of `compiled_steps`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba.core import config, types
from numba.experimental import structref
from numpy.typing import NDArray

from mech_twin.engine.compiled_steps import body_step, force_step, motor_step, whole_linkage_step
from mech_twin.kernels.kernel import kernel

Array = NDArray[np.float64]
_settings: Any = config
_types: Any = types
_structref: Any = structref


if _settings.DISABLE_JIT:

    class Uncompiled:
        """Stand-in for `Held` in interpreted code."""

        def __init__(self, model: Any) -> None:
            self.model = model

    Held: Any = Uncompiled

else:

    @_structref.register
    class HeldType(_types.StructRef):  # type: ignore[misc]
        """The type of constants in compiled memory: one for each type of model."""

    class Held(_structref.StructRefProxy):  # type: ignore[misc, no-redef]
        """Constants in compiled memory."""

    _structref.define_proxy(Held, HeldType, ["model"])


@kernel
def held(model: Any) -> Any:
    """Return a model stored in compiled memory."""
    return Held(model)


@kernel
def held_motor_step(held: Any, linkage: Array, target: float, out: Array) -> None:
    """Fill ``out`` as `motor_step` does."""
    motor_step(held.model, linkage, target, out)


@kernel
def held_linkage_step(
    held: Any, step: int, linkage: Array, motor: Array, body: Array, out: Array, log: Array
) -> tuple[Array, int]:
    """Fill ``out`` as `linkage_step` does."""
    return whole_linkage_step(held.model, step, linkage, motor, body, out, log)


@kernel
def held_force_step(
    held: Any, step: int, linkage: Array, log: Array, count: int, out: Array, loads: Array
) -> tuple[Array, int]:
    """Fill ``out`` as `force_step` does."""
    return force_step(held.model, step, linkage, log, count, out, loads)


@kernel
def held_body_step(
    held: Any, step: int, body: Array, forces: Array, loads: Array, count: int, out: Array, log: Array
) -> tuple[Array, int]:
    """Fill ``out`` as `body_step` does."""
    return body_step(held.model, step, body, forces, loads, count, out, log)
