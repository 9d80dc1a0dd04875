# SPDX-License-Identifier: Apache-2.0
"""``mech-twin replay --analyse`` and ``--resimulate``: a recording recomputed and compared bit for bit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from mech_twin import __version__
from mech_twin.cli.console import print_json, print_table, progress, say
from mech_twin.cli.failure import CommandError
from mech_twin.nodes.domain import settle_domain
from mech_twin.parameters.load import MACHINE_KEY, description_text, file_tree, machine_parameters
from mech_twin.studies.configuration_history import ConfigurationHistory
from mech_twin.studies.resimulation import Verdict, analysed, resimulated

if TYPE_CHECKING:
    from mech_twin.recording.bag_samples import BagSamples

DIFFERENT = 1
TITLES = {"analyse": "forces recomputed from the recorded motion", "resimulate": "run recomputed from its start"}
WORDS = {
    "machine": "machine",
    "identical": "identical",
    "steps_compared": "compared",
    "samples_compared": "compared",
    "incomplete_steps": "incomplete",
    "parameter_changes": "parameter changes",
    "resets": "resets",
}
UNITS = {"steps_compared": "steps", "samples_compared": "samples", "incomplete_steps": "steps"}


def recompute_bag(
    bag: Path, mode: Literal["analyse", "resimulate"], config: Path | None, tolerance: float, *, as_json: bool
) -> None:
    """Print the result of the comparison; exit code 1 if anything differs or nothing could be compared.

    ``config`` stands in for the configuration of a recording that holds none; ``tolerance`` is for the forces.
    """
    settle_domain()
    from mech_twin.recording.bag_reader import open_bag
    from mech_twin.recording.bag_samples import BagSamples

    with open_bag(bag) as reader:
        samples = BagSamples(reader)
        history = _history(samples, bag, config)
        samples = BagSamples(reader, history.machine_at(0).coupling_step_s)
        if set(history.versions) != {__version__}:
            say(f"recorded with version {', '.join(history.versions)}; this is {__version__}: results may differ")
        with progress(samples.steps(), samples.count, f"{mode[:-1]}ing") as steps:
            if mode == "analyse":
                verdict = analysed(steps, history.machine_at, tolerance)
            else:
                verdict = resimulated(steps, history.machine_at)
    _write(bag, mode, samples, history, verdict, as_json)
    if not verdict.identical:
        raise SystemExit(DIFFERENT)


def _history(samples: BagSamples, bag: Path, config: Path | None) -> ConfigurationHistory:
    """Return the configurations of a recording, or the given one where it holds none."""
    texts = samples.descriptions()
    if config is None:
        if not texts:
            raise CommandError(f"{bag}: holds no configuration of the machine; expected --config FILE beside it")
        return ConfigurationHistory(texts, str(bag))
    if texts:
        raise CommandError(f"--config {config}: {bag} holds its own configuration, which says what ran")
    name = str(file_tree(config).get(MACHINE_KEY, samples.machine))
    return ConfigurationHistory([description_text(name, machine_parameters(name, config))], str(config))


def _write(
    bag: Path, mode: str, samples: BagSamples, history: ConfigurationHistory, verdict: Verdict, as_json: bool
) -> None:
    numbers = {
        "machine": history.name,
        "identical": verdict.identical,
        "steps_compared": verdict.steps,
        "samples_compared": verdict.samples,
        "incomplete_steps": verdict.missing_steps,
        "parameter_changes": history.changes,
    }
    if mode == "resimulate":
        numbers |= {"resets": verdict.resets}
    first = _first(samples.topics, verdict)
    if as_json:
        more = {"resumed_at_steps": verdict.taken_up, "unused_samples": dict(samples.unused), "first_difference": first}
        print_json(
            {"bag": str(bag), "recorded_with": list(history.versions), "version": __version__, **numbers, **more}
        )
        return
    rows = [(WORDS[name], value, UNITS.get(name, "")) for name, value in numbers.items()]
    print_table(f"{bag}: {TITLES[mode]}", ("quantity", "value", "unit"), rows)
    for step in verdict.taken_up[:10]:
        say(f"step {step}: resumed from the recorded state")
    for reason, number in samples.unused.items():
        say(f"{number} recorded samples not used: {reason}")
    if first is not None:
        say(
            f"first difference at {first['time_s']:.9g} s (step {first['step']}), topic {first['topic']}, "
            f"field {first['field']}: recorded {first['recorded']!r}, computed {first['computed']!r}"
        )
    elif not verdict.samples:
        say("nothing could be compared")


def _first(topics: dict[str, str], verdict: Verdict) -> dict[str, Any] | None:
    if verdict.first is None:
        return None
    row = verdict.first._asdict()
    return {"topic": topics[row.pop("role")], **row}
