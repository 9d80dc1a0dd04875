# SPDX-License-Identifier: Apache-2.0
"""The phase-locked observer: estimates the whole frame of a running machine from its samples."""

from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter

import numpy as np

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.compiled_steps import Indices
from mech_twin.engine.sample_vectors import Array
from mech_twin.errors import MotionError
from mech_twin.roles import Machine
from mech_twin.samples import Event, Frame
from mech_twin.studies.observer.estimate import (
    ACCEPTED,
    FrameEstimate,
    ObserverState,
    SeenSample,
    SensedChannel,
    located,
)
from mech_twin.studies.observer.filter_state import (
    Correction,
    FilterState,
    Observation,
    Prediction,
    SaltedFilter,
    leading_angle,
    output_variance,
    state_space,
    undetermined,
)
from mech_twin.studies.observer.model_run import AnchorNow, RegimeByAngle, model_run, without_turns
from mech_twin.studies.observer.parameter_error import parameter_error, uncertain_keys

ON_STEP = 1e-6  # of a step: tolerance for a stamp that coincides with a step
UNKNOWN_SIGMA = 5e-4  # of a column's range: standard deviation of a sensor if it is unknown
UNKNOWN_IN_STEP = 0.3  # standard deviation of an instant within a known step, in steps
JUDGED = 40  # newest samples that decide whether the observer has lost the machine
RUN_S = 5.0  # of the model's run that is searched for the phase
LOCK_S = 0.25  # of the samples that are fitted to it
LONGEST_GAP_S = 0.25  # bridged by prediction; after a longer one the observer searches again
LATE_STEPS = 20.0  # a sample may be so many steps older than the newest estimate
PARAMETER_SHARE = 0.02  # relative standard deviation of each uncertain key
# standard deviation of the random walk of an offset after one second, in scales: torque, prescribed speed of the drive
DRIVE_WALK, LED_WALK = 0.3, 0.005
ACCELERATION_SHARE = 0.05  # unmodelled acceleration, of the 95 % quantile of the model's own
ACCELERATION_S = 0.01  # correlation time of that acceleration


class PhaseLockedObserver:
    """Extended Kalman filter that follows one running machine.

    Parameters
    ----------
    build : callable
        Returns the machine for given parameters, to compute the effect of wrong ones.
    deviations : mapping, optional
        Standard deviation of each uncertain configuration key; a share of every mass, force and stiffness if absent.

    Attributes
    ----------
    state : ObserverState
        Whether it is locked on.
    counts : Counter
        Numbers of rejected samples by reason: ``late``, ``repeated``, ``jump``, ``unbelievable`` (channels beyond the
        gate); and ``lost``, the number of times the machine was lost.

    Raises
    ------
    ConfigurationError
        A channel is not a column of the machine, or none is given.
    """

    def __init__(
        self,
        machine: Machine,
        build: Callable[[Parameters], Machine],
        channels: Sequence[SensedChannel],
        deviations: Mapping[str, float] | None = None,
    ) -> None:
        self.state = ObserverState.SEARCHING
        self.counts: Counter[str] = Counter()
        self.run = model_run(machine, RUN_S)
        self.columns = self.run.bank.columns
        self.places = _places(channels, self.columns, machine.name)
        self.channels = tuple(map(self._with_sigma, channels))
        self.space = state_space(self.run, machine.name)
        angle = leading_angle(self.run, self.space)
        keys = uncertain_keys(machine.parameters, PARAMETER_SHARE) if deviations is None else deviations
        self.parameters = parameter_error(self.run, machine.parameters, build, keys, angle)
        self.undetermined = undetermined(self.run, self.space)
        self._anchor = AnchorNow(self.run, machine.name)
        self._regimes = RegimeByAngle(self.run, angle, has_body=machine.body is not None)
        self._filter = SaltedFilter(self.run.bank, self.space, self.run.angles)
        self._noise = _process_noise(self)
        self._believed: deque[bool] = deque(maxlen=JUDGED)
        self._waiting: list[SeenSample] = []
        self._base: FilterState | None = None
        self._ahead: Prediction | None = None
        self._rates = np.zeros(len(self.columns))
        self._kinks = np.zeros(len(self.columns))
        self._origin_s = 0.0
        self._newest_s: dict[tuple[int, ...], float] = {}
        self._passed: list[Event] = []
        self.target = 1.0

    def command(self, fraction: float) -> None:
        """Set the requested fraction of rated supply frequency from now on."""
        self.target = fraction

    def take(self, sample: SeenSample) -> FrameEstimate | None:
        """Process a sample; return the estimate at it, None without one.

        Times are the machine's own (stamp minus delay); the channels of a sample belong to one message.
        """
        newest = self._newest_s.get(sample.channels)
        if newest is not None and sample.time_s <= newest:
            self._not_newer(sample, newest)
            return None
        self._newest_s[sample.channels] = sample.time_s
        try:
            return self._search(sample) if self._base is None else self._follow(self._base, sample)
        except MotionError:  # also of the step in which it locks on
            self._lose()
            return None

    def _follow(self, base: FilterState, sample: SeenSample) -> FrameEstimate | None:
        step = int(np.ceil((sample.time_s - self._origin_s) / self.step_s - ON_STEP))  # at or after the sample
        steps = step - base.step - 1
        if steps < 0 and self._origin_s + base.step * self.step_s - sample.time_s > LATE_STEPS * self.step_s:
            self.counts["late"] += 1
            return None
        if steps * self.step_s > LONGEST_GAP_S:
            self.counts["jump"] += 1
            self._forget()
            return self._search(sample)
        for _ in range(steps):
            self._advance()
        return self._estimate(sample)

    def _with_sigma(self, channel: SensedChannel) -> SensedChannel:
        """Return a channel with known noise; if unknown, a small share of the column's range is assumed."""
        assumed = UNKNOWN_SIGMA * float(self.run.spread[self.columns[channel.column]])
        return channel if channel.sigma > 0.0 else channel._replace(sigma=assumed)

    # -- locking on -------------------------------------------------------------------------------------------------

    def _not_newer(self, sample: SeenSample, newest_s: float) -> None:
        if sample.time_s == newest_s:
            self.counts["repeated"] += 1
        elif newest_s - sample.time_s <= LONGEST_GAP_S:
            self.counts["late"] += 1
        else:
            self.counts["jump"] += 1
            self._forget()
            self._newest_s[sample.channels] = sample.time_s
            self._waiting = [sample]

    def _search(self, sample: SeenSample) -> FrameEstimate | None:
        near = [each for each in self._waiting if abs(sample.time_s - each.time_s) <= LOCK_S]
        self._waiting = sorted([*near, sample], key=attrgetter("time_s"))
        if self._waiting[-1] is not sample:  # a slightly late sample of another channel
            return None
        if len(self._waiting) < 5 or sample.time_s - self._waiting[0].time_s < 0.8 * LOCK_S:
            return None
        found = located(self.run, self.places, self._waiting)
        if found is None or found.difference > ACCEPTED:
            del self._waiting[: len(self._waiting) // 2]  # the next search waits for new samples
            return None
        self._lock_on(max(found.step, 1), sample)
        return self._estimate(sample)

    def _lock_on(self, step: int, sample: SeenSample) -> None:
        space, spread = self.space, self.run.spread
        deviation = 0.1 * spread[space.places] / space.scales
        deviation[np.isin(space.places, self.run.angles)] = 0.1
        deviation[space.of_time] = UNKNOWN_IN_STEP
        self._origin_s = sample.time_s - step * self.step_s
        offsets = np.zeros(len(space.places) - space.states)
        deviation[space.states :] = 0.1
        covariance = np.diag(deviation**2) + self._noise
        row = self._anchor.restated(self.run.rows[step - 1].copy(), step - 1)
        with_keys = np.zeros((len(deviation), len(self.parameters.keys)))
        self._base = FilterState(step - 1, row, offsets, covariance, with_keys)
        self._ahead = self._filter.predicted(self._base, self.target)
        self._keep_rates()
        self._believed.clear()
        self._passed = []
        self.state = ObserverState.LOCKED

    def _forget(self) -> None:
        self.state, self._base, self._ahead = ObserverState.SEARCHING, None, None
        self._waiting = []
        self._newest_s.clear()

    def _lose(self) -> None:
        self.counts["lost"] += 1
        self._forget()

    # -- filtering --------------------------------------------------------------------------------------------------

    def _advance(self) -> None:
        assert self._base is not None and self._ahead is not None
        self._passed += self._ahead.events
        effect = self.parameters.effect_at(self._ahead.row)
        base = self._filter.committed(self._base, self._ahead, self._noise, effect)
        self._base = base._replace(row=self._anchor.restated(self._regimes.repaired(base.row), base.step))
        self._ahead = self._filter.predicted(self._base, self.target)
        self._keep_rates()

    def _keep_rates(self) -> None:
        """Store the rates of the step ahead, and their change by an event in it."""
        assert self._base is not None and self._ahead is not None
        rise = self._ahead.row - self._base.row
        rise[self.space.input_places] -= self._base.offsets
        rise[self.run.angles] = without_turns(rise[self.run.angles])
        before, self._rates = self._rates, rise / self.step_s
        self._kinks = np.abs(self._rates - before) if self._ahead.events else np.zeros_like(before)

    def _within_step(self, after_s: float) -> Array:
        """Return the variance (w,) due to a change of rate by an event within the step.

        Columns are interpolated linearly over the step.  Up to the event the true rate is that of the previous step;
        after it, the true curve leads to the frame at the step's end.
        """
        away_s = min(abs(after_s), abs(self.step_s - abs(after_s)))
        return np.asarray((self._kinks * away_s) ** 2)

    def _estimate(self, sample: SeenSample) -> FrameEstimate | None:
        assert self._base is not None and self._ahead is not None
        at_s = self._origin_s + (self._base.step + 1) * self.step_s
        by_parameters = self.parameters.at(self._ahead.row) + self._within_step(sample.time_s - at_s)
        places = self.places[list(sample.channels)]
        sigma = np.array([self.channels[channel].sigma for channel in sample.channels])
        variances, after_s = sigma**2 + by_parameters[places], np.full(len(places), sample.time_s - at_s)
        seen = Observation(places, np.array(sample.values, float), variances, after_s)
        effect = self.parameters.effect_at(self._ahead.row)
        now = self._filter.corrected(self._base, self._ahead, seen, effect, self._rates, self.target)
        self._base, self._ahead = now.state, now.prediction
        self.counts["unbelievable"] += int(len(now.used) - np.count_nonzero(now.used))
        self._believed.append(bool(now.used.all()))
        if len(self._believed) == JUDGED and sum(self._believed) < JUDGED // 2:
            self._lose()
            return None
        variance = output_variance(self._ahead, self._base, effect, by_parameters)
        variance[self.undetermined] = np.nan
        return self._frame_estimate(sample, now, np.sqrt(variance))

    def _frame_estimate(self, sample: SeenSample, now: Correction, sigma: Array) -> FrameEstimate:
        assert self._base is not None and self._ahead is not None
        row = self._ahead.row + self._rates * (sample.time_s - self._origin_s - (self._base.step + 1) * self.step_s)
        row[self.undetermined] = np.nan
        events, self._passed = tuple(self._passed), []
        shifted = tuple(event._replace(time_s=self._origin_s + event.time_s) for event in events)
        return FrameEstimate(
            sample.time_s,
            self._base.step + 1,
            row,
            sigma,
            sample.channels,
            tuple(now.innovations.tolist()),
            tuple(now.sigma.tolist()),
            tuple(now.used.tolist()),
            shifted,
        )

    def frame(self, estimate: FrameEstimate) -> Frame:
        """Return all samples of the machine at an estimate; ``time_s`` in them is the machine's time."""
        return self.run.bank.compiled.layout.frame(estimate.step, [estimate.time_s, *estimate.row[1:].tolist()])

    @property
    def step_s(self) -> float:
        """Coupling step of the model."""
        return self.run.bank.step_s


def _places(channels: Sequence[SensedChannel], columns: Mapping[str, int], machine: str) -> Indices:
    if not channels:
        raise ConfigurationError(f"{machine}: no channel is measured; expected at least one")
    for channel in channels:
        if channel.column not in columns:
            raise ConfigurationError(f"channel {channel.column!r}: expected a column of {machine}")
    return np.array([columns[channel.column] for channel in channels], dtype=np.int64)


def _process_noise(observer: PhaseLockedObserver) -> Array:
    """Return the covariance added in one step, in scales of the state.

    Offsets of the drive are random walks.  Speeds have the noise of an unmodelled acceleration, constant for
    `ACCELERATION_S` and independent after that.  Its size is a share of the 95 % quantile of the model's
    accelerations.
    """
    space, run = observer.space, observer.run
    variance = np.zeros(len(space.places))
    for i, name in enumerate(space.names):
        if i >= space.states:
            walk = LED_WALK if name.endswith(".velocity") else DRIVE_WALK
            variance[i] = walk**2 * run.bank.step_s
        elif name.endswith(("velocity", "velocity_m_per_s")):
            usual = float(np.quantile(np.abs(np.diff(run.settled[:, space.later[i]])), 0.95)) / run.bank.step_s
            missing = ACCELERATION_SHARE * usual / space.scales[i]
            variance[i] = missing**2 * ACCELERATION_S * run.bank.step_s
    return np.diag(variance)
