# SPDX-License-Identifier: Apache-2.0
r"""State machine of an advice: offered, accepted, on trial, then kept or reverted.

::

    idle --offer--> offered --accept--> trial --gain came--> idle (kept)
                       |                  |\--gain did not come, fault, silence, stop--> idle (reverted)
                       |                  \--another changes the output, or the machine refuses--> idle
                       \--reject, expiry, fault, another changes the output--> idle

Nothing is sent without acceptance.  A value that is sent lies in the declared range and at most a share of the range
from the present value, and follows the previous change after a minimum time.  Every transition is a decision with its
reason.
"""

from typing import Literal, NamedTuple

from mech_twin.declarations.quantity import Parameters, choice, quantity

Phase = Literal["idle", "offered", "trial"]


class AdviceOutput(Parameters):
    """Setting that the advisor may change, and its allowed range."""

    key: str = choice("motor/speed_command, or a live parameter of the machine")
    low: float = quantity("1", "least value")
    high: float = quantity("1", "largest value")
    value: float = quantity("1", "value in force when the advisor starts")


class AdviceWish(Parameters):
    """Task of an advisor: a feature of the cycle, its target, the setting that may be changed, and the limits."""

    figure: str = choice("feature of a cycle, as `mech-twin monitor` names it")
    wanted: float = quantity("1", "what it should be, in its SI unit")
    output: AdviceOutput = choice("what may be changed")
    step_share: float = quantity("1", "largest change at once, as a share of the range", gt=0.0, le=1.0, default=0.1)
    expiry_s: float = quantity("s", "time for which a recommendation holds", gt=0.0, default=600.0)
    least_gain_share: float = quantity("1", "gain worth an advice, as a share of what is wanted", gt=0.0, default=0.01)
    cycles: int = choice("cycles that the measured mean is of", default=10, ge=1)
    dry_run: bool = choice("nothing goes out, even when accepted", default=True)
    interval_s: float = quantity("s", "least time between two changes", ge=0.0, default=60.0)
    settling_cycles: int = choice("cycles after a change that are not judged", default=5, ge=0)
    trial_cycles: int = choice("cycles after those that are", default=10, ge=1)
    promised_share: float = quantity("1", "share of the promised gain that must come", ge=0.0, le=1.0, default=0.5)
    silence_s: float = quantity("s", "time without a cycle that ends a trial", gt=0.0, default=5.0)


class Recommendation(NamedTuple):
    """A recommended change of one setting.

    Attributes
    ----------
    key : str
        Setting to change: ``motor/speed_command``, or a live parameter.
    value, proposed : float
        Present and recommended value.
    low, high : float
        Allowed range of the setting.
    figure : str
        Feature of a cycle that should come closer to its target.
    gain, gain_low, gain_high : float
        Expected decrease of its distance to the target with the 95 % interval, in the figure's unit.
    evidence : str
        Reason as text.
    expires_s : float
        Stamp until which it is valid.
    """

    key: str
    value: float
    proposed: float
    low: float
    high: float
    figure: str
    gain: float
    gain_low: float
    gain_high: float
    evidence: str
    expires_s: float


class Setting(NamedTuple):
    """Value that is sent to the machine."""

    key: str
    value: float


class Decision(NamedTuple):
    """A decision, its reason, and the value that was sent."""

    time_s: float
    what: str
    reason: str
    sent: Setting | None = None


class AdviceState(NamedTuple):
    """State of an advice.

    Attributes
    ----------
    phase : str
        ``idle``, ``offered`` or ``trial``.
    advice : Recommendation or None
        Advice that is offered or on trial.
    miss_before : float
        Distance of the figure from its target at acceptance.
    offs : tuple of float
        The figure less its target in each cycle since.
    newest_s : float
        Stamp of the newest cycle.
    changed_s : float
        Stamp of the last change that was sent.
    is_kept : bool
        Whether the value of an accepted advice stays after its trial.
    """

    phase: Phase = "idle"
    advice: Recommendation | None = None
    miss_before: float = 0.0
    offs: tuple[float, ...] = ()
    newest_s: float = float("-inf")
    changed_s: float = float("-inf")
    is_kept: bool = False

    @property
    def in_force(self) -> bool:
        """Whether an accepted advice is in force, on trial or kept."""
        return self.is_kept or self.phase == "trial"


class AdviceStep(NamedTuple):
    """A state, and the decision that led to it; None without a decision."""

    state: AdviceState
    decision: Decision | None = None


def offered(state: AdviceState, advice: Recommendation, time_s: float) -> AdviceStep:
    """Return the state with an advice; an advice that is on trial, or already offered, is not replaced.

    Raises
    ------
    ValueError
        The proposed value lies outside its range.
    """
    if not advice.low <= advice.proposed <= advice.high:
        raise ValueError(f"{advice.key} = {advice.proposed}: expected {advice.low} to {advice.high}")
    if state.phase != "idle":
        return AdviceStep(state)
    decision = Decision(time_s, "offered", advice.evidence)
    return AdviceStep(state._replace(phase="offered", advice=advice), decision)


def accepted(state: AdviceState, miss: float, time_s: float, wish: AdviceWish) -> AdviceStep:
    """Return the state after the operator accepts; ``miss`` is the distance of the figure from its target."""
    advice = state.advice
    if state.phase != "offered" or advice is None:
        return AdviceStep(state, Decision(time_s, "refused", "nothing is offered"))
    if time_s > advice.expires_s:
        return AdviceStep(_idle(state), Decision(time_s, "expired", "nobody has answered in time"))
    if time_s - state.changed_s < wish.interval_s:
        left_s = wish.interval_s - (time_s - state.changed_s)
        return AdviceStep(state, Decision(time_s, "refused", f"the last change was too lately; {left_s:.1f} s to wait"))
    if wish.dry_run:
        return AdviceStep(_idle(state), Decision(time_s, "accepted", "dry run: nothing was sent"))
    sent = Setting(advice.key, advice.proposed)
    trial = state._replace(phase="trial", miss_before=miss, offs=(), newest_s=time_s, changed_s=time_s)
    return AdviceStep(trial, Decision(time_s, "accepted", f"on trial for {wish.trial_cycles} cycles", sent))


def rejected(state: AdviceState, time_s: float) -> AdviceStep:
    """Return the state after the operator rejects; a trial is reverted."""
    if state.phase == "trial":
        return _reverted(state, time_s, "rejected")
    if state.phase == "offered":
        return AdviceStep(_idle(state), Decision(time_s, "rejected", "by the operator"))
    return AdviceStep(state, Decision(time_s, "refused", "nothing is offered"))


def after_machine_cycle(state: AdviceState, off: float, time_s: float, has_fault: bool, wish: AdviceWish) -> AdviceStep:
    """Return the state after a cycle; ``off`` is its figure less the target."""
    state = state._replace(newest_s=time_s)
    if has_fault and state.phase != "idle":
        if state.phase == "trial":
            return _reverted(state, time_s, "a fault became active")
        return AdviceStep(_idle(state), Decision(time_s, "withdrawn", "a fault became active"))
    if state.phase == "offered" and state.advice is not None and time_s > state.advice.expires_s:
        return AdviceStep(_idle(state), Decision(time_s, "expired", "nobody has answered in time"))
    if state.phase != "trial" or state.advice is None:
        return AdviceStep(state)
    return _after_trial_cycle(state, state.advice, off, wish)


def _after_trial_cycle(state: AdviceState, advice: Recommendation, off: float, wish: AdviceWish) -> AdviceStep:
    state = state._replace(offs=(*state.offs, off))
    if len(state.offs) < wish.settling_cycles + wish.trial_cycles:
        return AdviceStep(state)
    judged = state.offs[wish.settling_cycles :]
    gain = state.miss_before - abs(sum(judged) / len(judged))  # of the mean, as promised: scatter is no distance
    outcome = f"gain {gain:.4g} of {advice.gain:.4g} promised, over {len(judged)} cycles"
    if gain < wish.promised_share * advice.gain:
        return _reverted(state, state.newest_s, outcome)
    return AdviceStep(_idle(state)._replace(is_kept=True), Decision(state.newest_s, "kept", outcome))


def watched(state: AdviceState, time_s: float, wish: AdviceWish) -> AdviceStep:
    """Return the state at a time: a trial without cycles for too long is reverted."""
    if state.phase == "trial" and time_s - state.newest_s > wish.silence_s:
        return _reverted(state, time_s, f"no cycle for {wish.silence_s:g} s")
    return AdviceStep(state)


def overruled(state: AdviceState, time_s: float) -> AdviceStep:
    """Return the state after another has changed the output: nothing is offered or in force, and nothing is sent."""
    after = _idle(state)._replace(changed_s=time_s, is_kept=False)
    reason = "another has changed the output"
    return AdviceStep(after, None if state.phase == "idle" else Decision(time_s, "withdrawn", reason))


def not_taken(state: AdviceState, time_s: float, reason: str) -> AdviceStep:
    """Return the state after the machine has refused the value of a trial: it has the one before."""
    decision = Decision(time_s, "withdrawn", f"the machine refuses the value: {reason}")
    return AdviceStep(_idle(state), decision) if state.phase == "trial" else AdviceStep(state)


def ended(state: AdviceState, time_s: float, reason: str = "the advisor ends") -> AdviceStep:
    """Return the state when the advisor or the machine's run ends: a trial is reverted."""
    return _reverted(state, time_s, reason) if state.phase == "trial" else AdviceStep(_idle(state))


def _idle(state: AdviceState) -> AdviceState:
    return state._replace(phase="idle", advice=None, offs=())


def _reverted(state: AdviceState, time_s: float, reason: str) -> AdviceStep:
    assert state.advice is not None
    sent = Setting(state.advice.key, state.advice.value)
    after = _idle(state)._replace(changed_s=time_s)
    return AdviceStep(after, Decision(time_s, "reverted", reason, sent))
