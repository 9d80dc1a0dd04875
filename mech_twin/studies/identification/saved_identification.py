# SPDX-License-Identifier: Apache-2.0
"""An identification with its source files: as a table, as a figure, and saved."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mech_twin.declarations.quantity import Parameters
from mech_twin.files.output_file import YAML_SUFFIXES, check_output_directory, check_output_file, written_file
from mech_twin.process.dependencies import require_extra
from mech_twin.studies.identification.identification import Identification
from mech_twin.studies.identification.sensor_plan import Help, sensor_helps
from mech_twin.studies.identification.written_identification import configuration_text, document

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class SavedIdentification:
    """Result of an identification, with the files of its runs.

    Attributes
    ----------
    found : Identification
        Verdicts, channels and scores.
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
        return document(self.found, self.runs, self.held_out, self.map_file)

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
        return "\n".join([f"{self.found.question.machine}: identified in {self.found.seconds:.1f} s", *rows])

    @property
    def _with_helps(self) -> dict[str, Any]:
        """The document with the benefit of further sensors, which takes more simulations."""
        return {**self.document, "further_sensors": [asdict(each) for each in self.helps]}

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
            machine = self.found.question.machine
            texts = {out / f"{machine}.yaml": configuration, out / "identification.json": _json(self._with_helps)}
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


def _json(tree: Mapping[str, Any]) -> str:
    return json.dumps(_finite(tree), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    """Return a value with null for each number that is not finite, which JSON cannot represent."""
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_finite(item) for item in value]
    return value
