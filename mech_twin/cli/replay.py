# SPDX-License-Identifier: Apache-2.0
"""``mech-twin replay``: a recording published on its topics, or recomputed and compared bit for bit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mech_twin import __version__
from mech_twin.cli.console import bar, print_json, print_table, progress, say
from mech_twin.cli.failure import FOUND, CommandError
from mech_twin.cli.info import shared_topics
from mech_twin.cli.verbs import ReplayVerb
from mech_twin.nodes.run.domain import settle_domain
from mech_twin.parameters.load import MACHINE_KEY, description_text, file_tree, is_page, machine_parameters
from mech_twin.studies.configuration_history import ConfigurationHistory
from mech_twin.studies.resimulation import Verdict, analysed, resimulated

if TYPE_CHECKING:
    from mech_twin.nodes.replay.replay_node import ReplayNode
    from mech_twin.nodes.replay.source import ReplaySource
    from mech_twin.recording.bag_samples import BagSamples


def replay(asked: ReplayVerb) -> None:
    """Publish a recording, or recompute it, or a measured run by its map."""
    if is_page(str(asked.bag)) and asked.bag.is_file():
        raise CommandError(
            f"{asked.bag}: expected a recording, not a page or configuration; `mech-twin check` draws a page, "
            "`mech-twin simulate PAGE --bag NAME` records one"
        )
    if asked.given_map is not None:
        if not asked.analyse:
            raise CommandError(
                f"--map {asked.given_map}: a measured run has no topics of the twin; expected --analyse beside it"
            )
        from mech_twin.cli.measured import analyse_measured

        analyse_measured(asked, asked.given_map)
    elif asked.analyse or asked.resimulate:
        recompute_bag(asked)
    else:
        replay_bag(asked)


def replay_bag(request: ReplayVerb) -> None:
    """Publish a recording on its topics until its end, or until stopped."""
    from mech_twin.nodes.replay import FASTEST, SLOWEST

    if not SLOWEST <= request.rate <= FASTEST:  # false for NaN, too
        raise CommandError(f"--rate {request.rate:g}: expected {SLOWEST:g} to {FASTEST:g}")
    settle_domain()
    from mech_twin.nodes.replay.replay_node import ReplayOptions
    from mech_twin.nodes.replay.session import replayed
    from mech_twin.nodes.replay.source import ReplaySource
    from mech_twin.recording.bag_reader import open_bag

    with open_bag(request.bag) as reader:
        source = ReplaySource(reader, request.topics, request.start_s, request.duration_s)
        say(*(f"{name}: not replayed: {why}" for name, why in source.unknown.items()))
        if not source.topics:
            raise CommandError(f"{request.bag}: no topic can be replayed: {'; '.join(source.unknown.values())}")
        options = ReplayOptions(request.rate, request.loop, request.clock, request.listeners)
        with _progress(source) as notice:
            outcome = replayed(source, options, notice, request.namespace)
    say(f"published {sum(outcome.published.values())} messages on {len(outcome.published)} topics")
    malformed, refused = outcome.malformed.items(), outcome.refused.items()
    say(*(f"{name}: {number} messages skipped: not decodable as the topic's type" for name, number in malformed))
    say(*(f"{name}: {number} messages not published" for name, number in refused))


@contextmanager
def _progress(source: ReplaySource) -> Iterator[Callable[[ReplayNode], None]]:
    """Provide the callback that shows the position, if standard error is a terminal."""
    first, last = source.seconds(source.first_ns), source.seconds(source.last_ns)
    shown = "{task.completed:.2f} of {task.total:.2f} s"
    with bar("replaying", "{task.description}", "BarColumn", shown, total=last - first) as update:

        def notice(node: ReplayNode) -> None:
            if update is not None:
                word = "paused" if node.paused else f"replaying at {node.rate:.3g}"
                update(completed=node.position_s - first, description=word)

        yield notice


LATEST_SECOND = 64  # steps after a difference within which a second sample of its step comes
TITLES = {"analyse": "forces recomputed from the recorded motion", "resimulate": "run recomputed from its start"}
UNITS = {"steps_compared": "steps", "samples_compared": "samples", "incomplete_steps": "steps"}


def recompute_bag(asked: ReplayVerb) -> None:
    """Print the result of the comparison; exit code 1 if anything differs or nothing could be compared.

    A difference at or after a step that was published twice, and not alike, proves nothing: that is not certain.
    """
    bag, mode = asked.bag, "analyse" if asked.analyse else "resimulate"
    settle_domain()
    from mech_twin.recording.bag_reader import open_bag
    from mech_twin.recording.bag_samples import BagSamples

    with open_bag(bag) as reader:
        samples = BagSamples(reader)
        history = _history(samples, bag, asked.config)
        samples = BagSamples(reader, history.machine_at(0).coupling_step_s)
        if set(history.versions) != {__version__}:
            say(f"recorded with version {', '.join(history.versions)}; this is {__version__}: results may differ")
        with progress(samples.steps(), samples.count, f"{mode[:-1]}ing") as steps:
            if mode == "analyse":
                verdict = analysed(steps, history.machine_at, asked.tolerance or 0.0)
            else:
                verdict = resimulated(steps, history.machine_at)
            for _ in islice(steps, LATEST_SECOND):
                pass
        shared = shared_topics(reader.info.counters)
    _write(asked, mode, samples, history, verdict)
    say(*shared)
    if not verdict.identical:
        raise SystemExit(FOUND)


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


def _write(asked: ReplayVerb, mode: str, samples: BagSamples, history: ConfigurationHistory, verdict: Verdict) -> None:
    first, doubted = None, samples.contradicted_from
    if verdict.first is not None:
        row = verdict.first._asdict()
        first = {"topic": samples.topics[row.pop("role")], **row}
    uncertain = first is not None and doubted is not None and first["step"] >= doubted
    numbers = {
        "machine": history.name,
        "identical": None if uncertain else verdict.identical,
        "steps_compared": verdict.steps,
        "samples_compared": verdict.samples,
        "incomplete_steps": verdict.missing_steps,
        "parameter_changes": history.changes,
    }
    if mode == "resimulate":
        numbers["resets"] = verdict.resets
    if asked.as_json:
        more: dict[str, Any] = {"resumed_at_steps": verdict.taken_up, "unused_samples": samples.unused}
        more |= {"contradicted_from_step": doubted, "first_difference": first}
        print_json({"bag": asked.bag, "recorded_with": history.versions, "version": __version__, **numbers, **more})
        return
    numbers["identical"] = "not certain" if uncertain else verdict.identical
    rows = [(_word(name), value, UNITS.get(name, "")) for name, value in numbers.items()]
    print_table(f"{asked.bag}: {TITLES[mode]}", ("quantity", "value", "unit"), rows)
    say(*(f"step {step}: resumed from the recorded state" for step in verdict.taken_up[:10]))
    say(*(f"{number} recorded samples not used: {reason}" for reason, number in samples.unused.items()))
    if uncertain:
        say(
            f"not certain from step {doubted} on: samples of it differ, so that a second publisher spoke; "
            "which of them the run used, no message tells"
        )
    if first is not None:
        say(
            f"first difference at {first['time_s']:.9g} s (step {first['step']}), topic {first['topic']}, "
            f"field {first['field']}: recorded {first['recorded']!r}, computed {first['computed']!r}"
        )
    elif not verdict.samples:
        say("nothing could be compared")


def _word(name: str) -> str:
    """Return the word of a number whose unit stands beside it: compared, of ``steps_compared``."""
    told, unit = name.replace("_", " "), UNITS.get(name, "")
    return told.removeprefix(f"{unit} ").removesuffix(f" {unit}") if unit else told
