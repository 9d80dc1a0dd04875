# SPDX-License-Identifier: Apache-2.0
"""MuJoCo's system identification on the data of `peers`: its optimiser, residuals and intervals, our roll-outs.

The model it is given has the two sensors and nothing to simulate: `custom_rollout` puts our roll-out in its place, so
that all tools fit the same machine.  Sensors are weighed by their known noise, and the zero of the crank is a bias.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from mujoco import sysid

SENSORS = """
<mujoco><option timestep="{step}"/>
  <worldbody>
    <body><joint name="turn" type="hinge"/><geom size="0.1" mass="1"/></body>
    <body><joint name="slide" type="slide"/><geom size="0.1" mass="1"/></body>
  </worldbody>
  <actuator><motor name="none" joint="turn"/></actuator>
  <sensor><jointpos name="crank" joint="turn"/><jointpos name="slider" joint="slide"/></sensor>
</mujoco>
"""
SMALLEST, LARGEST = 0.05, 20.0  # of a key's start: how far it may go
WIDEST_ZERO = 3.0
Shown = Callable[[np.ndarray], np.ndarray]


def sysid_answer(
    start: Mapping[str, float],
    times_s: np.ndarray,
    measured: np.ndarray,
    noises: Sequence[float],
    shown: Shown,
) -> dict[str, tuple[float, float, float, float]]:
    """Return estimate, standard error and ends of the 95 % interval of each key.

    Parameters
    ----------
    start : mapping of str to float
        Keys and where they start.
    times_s, measured : ndarray
        Shape (samples,) and (samples, 2): crank and slider.
    noises : sequence of float
        Known standard deviations of the two.
    shown : callable
        Returns crank and slider of a roll-out with these values of the keys, shape (samples, 2).
    """
    spec = mujoco.MjSpec.from_string(SENSORS.format(step=times_s[1] - times_s[0]))
    model = spec.compile()
    asked = sysid.ParameterDict()
    for key, value in start.items():
        asked.add(sysid.Parameter(key, value, SMALLEST * value, LARGEST * value, modifier=_nothing))
    asked.add(sysid.Parameter("zero", 0.0, -WIDEST_ZERO, WIDEST_ZERO, modifier=_nothing))
    transform = sysid.SignalTransform(normalize=False)
    transform.bias("crank", asked["zero"], target="predicted")
    transform.set_sensor_weights({"crank": 1.0 / noises[0], "slider": 1.0 / noises[1]})
    sequences = sysid.ModelSequences(
        "crank mechanism",
        spec,
        "run",
        sysid.create_initial_state(model, np.zeros(model.nq)),
        sysid.TimeSeries.from_control_names(times_s, np.zeros((len(times_s), model.nu)), model),
        sysid.TimeSeries.from_names(times_s, measured, model),
    )
    residuals = sysid.build_residual_fn(
        models_sequences=[sequences],
        modify_residual=transform.apply,
        custom_rollout=_rolled_out(tuple(start), times_s, shown),
    )
    with contextlib.redirect_stdout(io.StringIO()):  # it tells its last iterations, silent or not
        found, result = sysid.optimize(asked, residuals, optimizer="mujoco", verbose=False)
    covariance, halves = sysid.calculate_intervals(residuals(found.as_vector(), found)[0], result.jac)
    errors = np.sqrt(np.diag(covariance))
    told = zip(start, found.as_vector().tolist(), errors.tolist(), halves.tolist(), strict=False)  # the zero is last
    return {key: (value, error, value - half, value + half) for key, value, error, half in told}


def _nothing(spec: mujoco.MjSpec, parameter: sysid.Parameter) -> None:
    """Change nothing of the model: the roll-out reads the parameter itself."""


def _rolled_out(keys: tuple[str, ...], times_s: np.ndarray, shown: Shown) -> Callable[..., list[Any]]:
    """Return what takes the place of MuJoCo's roll-outs."""

    def rolled_out(
        models: Sequence[mujoco.MjModel],
        control_signal: Sequence[sysid.TimeSeries],
        initial_states: Sequence[np.ndarray],
        param_dicts: Sequence[sysid.ParameterDict],
        rollout_signal_mapping: Any,
        rollout_state_mapping: Any,
        **_: Any,
    ) -> list[Any]:
        found = []
        for model, control, state, asked in zip(models, control_signal, initial_states, param_dicts, strict=True):
            values = shown(np.array([float(asked[key].value[0]) for key in keys]))
            states = np.column_stack([times_s, np.zeros((len(times_s), model.nq + model.nv))])
            found.append(
                sysid.SystemTrajectory(
                    model,
                    control,
                    sysid.TimeSeries(times_s, values, rollout_signal_mapping),
                    state,
                    sysid.TimeSeries(times_s, states, rollout_state_mapping),
                )
            )
        return found

    return rolled_out
