# SPDX-License-Identifier: Apache-2.0
"""Finds the value of one setting that brings a feature of the cycle closest to its target, by simulation.

The model's feature is scaled to the measured one, ``F(new) = F_measured F_model(new)/F_model(now)``, which removes a
constant relative error of the model.  The interval includes the uncertain parameters, each changed by its standard
deviation, and the scatter of the measured mean.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite, sqrt
from typing import Any

import numpy as np
from pydantic import ValidationError

from mech_twin.capabilities.cycle import CycleFeatures
from mech_twin.capabilities.variation import varied
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.rollout import roll_out
from mech_twin.machines.catalog import Entry
from mech_twin.parameters.errors import refusal
from mech_twin.parameters.live_change import live_numbers
from mech_twin.studies.advice import AdviceWish, Recommendation
from mech_twin.studies.monitoring.cycle_features import FeatureFeed, available_features, feed_channels
from mech_twin.studies.observer.parameter_error import changed_parameters, uncertain_keys

COMMAND = "motor/speed_command"
VALUES = 9  # simulated, within one step of the setting
MODEL_CYCLES_S = 2.0  # at the end of the simulation, over which the feature is averaged
USUAL_SHARE = 0.02  # relative standard deviation of an uncertain key
TWO_SIDED = 1.96


@dataclass(frozen=True)
class AdviceModel:
    """The model that predicts the effect of a setting.

    Attributes
    ----------
    entry, parameters
        Machine and configuration.
    wish : AdviceWish
        Target, setting and limits.
    deviations : mapping
        Standard deviation of each uncertain key.
    faults : tuple of str
        Keys changed by a known fault, with their values.
    """

    entry: Entry
    parameters: Parameters
    wish: AdviceWish
    deviations: Mapping[str, float]
    faults: tuple[str, ...] = ()

    @property
    def declared(self) -> CycleFeatures:
        """Cycle reference and features that the machine declares."""
        ask = self.entry.capabilities.features
        if ask is None:
            raise ConfigurationError(f"{self.entry.name} declares no features of a cycle; expected a machine that does")
        return ask(self.parameters)

    def under(self, changes: Mapping[str, Any]) -> AdviceModel:
        """Return the model with a known fault: these keys are changed, and named in the evidence."""
        if not changes:
            return self
        faults = tuple(f"{key} = {value:.5g}" for key, value in changes.items())
        return replace(self, parameters=varied(self.parameters, changes), faults=faults)

    def figure(self, value: float, parameters: Parameters | None = None) -> float:
        """Return the model's mean feature with the setting at this value; nan without a cycle."""
        settings, command, declared = parameters or self.parameters, 1.0, self.declared
        if self.wish.output.key == COMMAND:
            command = value
        else:
            settings = varied(settings, {self.wish.output.key: value})
        feature = next(each for each in declared.features if each.name == self.wish.figure)
        columns = list(dict.fromkeys((declared.reference.column, *feature.needs)))
        run = roll_out(self.entry.build(settings), declared.run_up_s + MODEL_CYCLES_S, columns, command=command)
        late = run["time_s"] >= declared.run_up_s
        channels = {name: (run["time_s"][late], run[name][late]) for name in columns}
        vectors = feed_channels(FeatureFeed(declared, columns), channels)
        values = [vector.values[vector.names.index(self.wish.figure)] for vector in vectors]
        return float(np.mean(values)) if values else float("nan")


def advice_model(entry: Entry, parameters: Parameters, wish: AdviceWish, columns: Sequence[str]) -> AdviceModel:
    """Return the model for an advice, checked against machine and channels.

    Raises
    ------
    ConfigurationError
        The channels do not give the figure, the output is not a setting of the machine, or its range is empty.
    """
    model = AdviceModel(entry, parameters, wish, uncertain_keys(parameters, USUAL_SHARE))
    figures = [feature.name for feature in available_features(model.declared, columns)]
    if wish.figure not in figures:
        needs = next((feature.needs for feature in model.declared.features if feature.name == wish.figure), ())
        lacking = ", ".join(sorted(set(needs) - set(columns)))
        wanted = f"expected {lacking} in the map, or" if lacking else "expected"
        raise ConfigurationError(f"key 'figure', value {wish.figure!r}: {wanted} one of {', '.join(figures)}")
    output = wish.output
    if output.low >= output.high:
        raise ConfigurationError(f"key 'output.low', value {output.low}: expected less than output.high, {output.high}")
    if not output.low <= output.value <= output.high:
        raise ConfigurationError(f"key 'output.value', value {output.value}: expected {output.low} to {output.high}")
    live = [key for key, value in live_numbers(parameters).items() if isinstance(value, float)]
    if output.key not in (COMMAND, *live):
        raise ConfigurationError(f"key 'output.key', value {output.key!r}: expected {COMMAND} or a live parameter")
    for end, value in (("low", output.low), ("high", output.high)):
        if (reason := _refused(parameters, output.key, value)) is not None:
            raise ConfigurationError(f"key 'output.{end}', value {value}: {reason}")
    return model


def _refused(parameters: Parameters, key: str, value: float) -> str | None:
    """Return why the machine would refuse a value of a setting; None if it takes it."""
    if key == COMMAND:
        return None if 0.0 <= value <= 1.0 else "expected 0 to 1, a fraction of rated supply frequency"
    try:
        varied(parameters, {key: value})
    except ValidationError as error:
        return str(refusal(f"expected what {key} may be", error, type(parameters)))
    return None


def recommendation(model: AdviceModel, value: float, measured: np.ndarray, time_s: float) -> Recommendation | None:
    """Return the advice for a machine at this value of the setting; None if no change gains enough.

    Parameters
    ----------
    measured : ndarray
        Shape (n,): the feature in the last cycles.
    """
    wish, output = model.wish, model.wish.output
    now, here = float(np.mean(measured)), model.figure(value)
    reach = wish.step_share * (output.high - output.low)
    low, high = max(output.low, value - reach), min(output.high, value + reach)
    if low > high or not isfinite(here) or here == 0.0:
        return None
    found = {new: now * model.figure(new) / here for new in np.linspace(low, high, VALUES).tolist()}
    best = min(found, key=lambda new: abs(found[new] - wish.wanted) if isfinite(found[new]) else float("inf"))
    gain = abs(now - wish.wanted) - abs(found[best] - wish.wanted)
    if not (gain > 0.0 and gain >= wish.least_gain_share * abs(wish.wanted)):
        return None
    sigma = _gain_deviation(model, value, best, measured)
    low_gain, high_gain = gain - TWO_SIDED * sigma, gain + TWO_SIDED * sigma
    evidence = (
        f"{wish.figure} is {now:.5g} over {len(measured)} cycles, wanted {wish.wanted:.5g}; the model has {here:.5g}; "
        f"expected {found[best]:.5g} at {output.key} = {best:.5g}"
        f"{'; the model has the fault that was found: ' if model.faults else ''}{', '.join(model.faults)}"
    )
    at = (output.key, value, best, output.low, output.high, wish.figure, gain, low_gain, high_gain, evidence)
    return Recommendation(*at, time_s + wish.expiry_s)


def _gain_deviation(model: AdviceModel, value: float, best: float, measured: np.ndarray) -> float:
    """Return the standard deviation of the gain, due to the predicted ratio and the measured mean."""
    now = float(np.mean(measured))
    ratio = model.figure(best) / model.figure(value)
    variance = (1.0 - ratio) ** 2 * float(np.var(measured)) / len(measured)
    for key, deviation in model.deviations.items():
        changed = changed_parameters(model.parameters, key, deviation)
        if changed is None:
            continue
        other = model.figure(best, changed) / model.figure(value, changed)
        if isfinite(other):
            variance += (now * (other - ratio)) ** 2
    return sqrt(variance)
