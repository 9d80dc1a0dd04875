# SPDX-License-Identifier: Apache-2.0
"""Output of an identification: a configuration file with intervals as comments, and the complete result as JSON.

With its source files it is also a table and a figure.
"""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from mech_twin import __version__
from mech_twin.declarations.configuration_tree import configuration_tree, value_in
from mech_twin.declarations.quantity import Parameters
from mech_twin.files.input_file import opened_input
from mech_twin.files.output_file import (
    YAML_SUFFIXES,
    check_output_directory,
    check_output_file,
    json_text,
    written_file,
)
from mech_twin.parameters.description import description_text
from mech_twin.parameters.load import kind_of
from mech_twin.process.dependencies import require_extra
from mech_twin.studies.identification.fit_quality import ChannelFit, Score
from mech_twin.studies.identification.identification import Identification
from mech_twin.studies.identification.intervals import intervals_before
from mech_twin.studies.identification.keyed_configuration import scalar_lines
from mech_twin.studies.identification.sensor_plan import Help, sensor_helps
from mech_twin.studies.identification.verdicts import COMBINATION, IDENTIFIED, KeyVerdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HASHED_BLOCK = 1 << 20
ASKED = ("keys", "bounds", "priors", "longest_begin_s", "cores", "scheduler")  # beside machine, configuration and seed


def configuration_text(found: Identification, runs: Sequence[str]) -> str:
    """Return the resulting configuration as a parameter file, with a comment of the result beside each free key."""
    text = description_text(kind_of(found.question.machine), found.parameters)
    tree = configuration_tree(found.parameters)
    notes = {key.key: _note(key, runs, changed=value_in(tree, key.key) != key.before) for key in found.keys}
    lines = text.splitlines()
    for key, (*_, line) in scalar_lines(text):
        if key in notes:
            lines[line] += f"  # {notes[key]}"
    return "\n".join(lines) + "\n"


def _note(key: KeyVerdict, runs: Sequence[str], *, changed: bool) -> str:
    if key.verdict == IDENTIFIED:
        half = 0.5 * (key.high_95 - key.low_95)
        return f"identified {key.estimate:.6g} +- {half:.2g} (95 %) from {', '.join(runs)}"
    if key.verdict == COMBINATION and changed:
        return f"in combination: {key.reason}"
    return f"{'changed' if changed else 'kept'}: {key.verdict}, {key.reason}"


def _channel(each: ChannelFit) -> dict[str, Any]:
    numbers = asdict(each)
    return {"is": numbers.pop("channel"), **numbers}


def held_out_record(found: Identification) -> dict[str, Any]:
    """Return the score on held-out data, with those of the previous configuration and of a constant."""
    assert found.held_out is not None
    assert found.before is not None
    constant = {channel.channel: 0.0 for channel in found.held_out.channels}
    return {**_score(found.held_out), "before": _score(found.before), "constant": {"fit_percent": constant}}


def _score(each: Score) -> dict[str, Any]:
    return {
        "fit_percent": {channel.channel: channel.fit_percent for channel in each.channels},
        "rms": {channel.channel: channel.rms for channel in each.channels},
        "white_p": {channel.channel: channel.white_p for channel in each.channels},
        "event_time_rms_s": each.event_time_rms_s,
        "missed_events": each.missed,
        "false_events": each.false,
    }


def digest(path: Path) -> str:
    """Return the SHA-256 of a file, or of the files of a directory in the order of their names."""
    found = hashlib.sha256()
    files: Mapping[str, Path] = {"": path}
    if path.is_dir():
        files = {each.name: each for each in path.iterdir() if each.is_file()}
    for name in sorted(files):
        with opened_input(files[name]) as stream:
            while block := stream.read(HASHED_BLOCK):
                found.update(block)
    return found.hexdigest()


@dataclass(frozen=True)
class SavedIdentification:
    """Result of an identification, with the files of its runs.

    Attributes
    ----------
    runs, held_out : tuple of Path
        Fitted runs, and held-out ones.
    map_file : Path or None
        Map of the runs; None if it was proposed automatically.
    """

    found: Identification
    runs: tuple[Path, ...]
    held_out: tuple[Path, ...]
    map_file: Path | None

    @property
    def parameters(self) -> Parameters:
        """The resulting configuration."""
        return self.found.parameters

    @property
    def better(self) -> bool:
        """Whether a key is identified, and held-out data is predicted better than before and than by a constant."""
        return self.found.better

    @property
    def table(self) -> list[dict[str, Any]]:
        """One row per key: before, estimate, standard error, interval, verdict and reason."""
        return [asdict(key) for key in self.found.keys]

    @property
    def document(self) -> dict[str, Any]:
        """The complete result as plain values, as in ``identification.json``."""
        found, asked = self.found, self.found.question
        files = [*self.runs, *self.held_out, *([] if self.map_file is None else [self.map_file])]
        return {
            "machine": asked.machine,
            "config": configuration_tree(found.parameters),
            "before": configuration_tree(asked.base),
            "asked": {name: getattr(asked, name) for name in ASKED},
            "parameters": self.table,
            "intervals_before": {key: list(ends) for key, ends in intervals_before(asked).items()},
            "combinations": [asdict(each) for each in found.combinations],
            "channels": [_channel(each) for each in found.channels],
            "search": asdict(found.search),
            "held_out": None if found.held_out is None else held_out_record(found),
            "begins_s": found.begins_s,
            "correlation": {"keys": list(found.fitted_keys), "matrix": found.correlation.tolist()},
            "better": found.better,
            "runs": [str(run) for run in self.runs],
            "held_out_runs": [str(run) for run in self.held_out],
            "map": None if self.map_file is None else str(self.map_file),
            "sha256": {str(file): digest(file) for file in files if file.exists()},
            "versions": {
                "mech_twin": __version__,
                "python": platform.python_version(),
                "numpy": np.__version__,
                "scipy": scipy.__version__,
            },
            "seed": asked.seed,
            "model_runs": found.model_runs,
            "seconds": found.seconds,
        }

    @cached_property
    def helps(self) -> list[Help]:
        """Benefit of each further sensor beside those of the first run; empty without a run."""
        fitted, asked = self.found.fitted, self.found.question
        if fitted is None or not fitted.problem.runs[0].channels:
            return []
        run = fitted.problem.runs[0]
        noises = zip(run.channels, fitted.comparison.sigmas.tolist(), strict=True)
        begin = fitted.problem.begin(fitted.x, 0)
        channels = tuple(
            replace(each, noise=noise, times_s=each.times_s + begin) for each, noise in noises if not each.of_events
        )
        known = replace(run, channels=channels, begin_s=0.0)
        return sensor_helps(replace(asked, base=self.found.parameters), known, known.last_s) if channels else []

    def __repr__(self) -> str:
        rows = [
            f"  {key.key:<36} {key.before:>12.6g} -> {key.estimate:>12.6g}  "
            f"[{key.low_95:.6g}, {key.high_95:.6g}]  {key.verdict}"
            for key in self.found.keys
        ]
        return "\n".join([f"{self.found.question.machine}: fitted in {self.found.seconds:.1f} s", *rows])

    def plot(self) -> Figure:
        """Return a figure of the estimates with intervals, relative to the previous values; needs the extra 'plots'."""
        require_extra("plots")
        from mech_twin.capabilities.plots import house_style
        from mech_twin.studies.identification.report_page import interval_figure

        with house_style():
            return interval_figure(self.found)

    def save(self, out: Path | str, *, force: bool = False) -> list[Path]:
        """Write configuration, JSON and report into a directory, or only the configuration into a ``.yaml`` file.

        Returns
        -------
        list of Path
            Files written; the report only if matplotlib is installed.
        """
        out = Path(out)
        check_out(out, force=force)
        configuration = configuration_text(self.found, [path.name for path in self.runs])
        texts = {out: configuration}
        if not is_file(out):
            out.mkdir(parents=True, exist_ok=True)
            machine = Path(self.found.question.machine).stem  # of a page, its path
            record = json_text({**self.document, "further_sensors": self.helps})
            texts = {out / f"{machine}.yaml": configuration, out / "identification.json": record}
            if find_spec("matplotlib") is not None:
                from mech_twin.studies.identification.report_page import report_page

                names = [[path.name for path in paths] for paths in (self.runs, self.held_out)]
                texts[out / "report.html"] = report_page(self.found, names[0], names[1], self.helps)
        for path, text in texts.items():
            with written_file(path, force=force) as file:
                file.write_text(text, encoding="utf-8")
        return list(texts)


def is_file(out: Path) -> bool:
    """Return whether an output path is a single configuration file, not a directory."""
    return out.suffix in YAML_SUFFIXES


def check_out(out: Path, *, force: bool = False) -> None:
    """Raise an OutputError if an identification cannot be written there."""
    if is_file(out):
        check_output_file(out, force=force)
    else:
        check_output_directory(out, force=force)
