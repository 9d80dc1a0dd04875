# SPDX-License-Identifier: Apache-2.0
"""Output of an identification: a configuration file with intervals as comments, JSON, a table, and a report.

The report is one self-contained HTML file with embedded figures.
"""

from __future__ import annotations

import hashlib
import io
import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from html import escape
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from mech_twin import __version__
from mech_twin.capabilities.plots import BLUE, GREY, RED, house_style
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.declarations.quantity import Parameters
from mech_twin.files.input_file import opened_input
from mech_twin.files.output_file import YAML_SUFFIXES, check_output_directory, check_output_file, plain, written_file
from mech_twin.files.report_page import page, section
from mech_twin.measurements.blocks import Array
from mech_twin.measurements.units import UNITS, shown_unit
from mech_twin.parameters.description import description_text
from mech_twin.parameters.load import kind_of
from mech_twin.process.dependencies import require_extra
from mech_twin.studies.identification.held_out import ChannelFit, Score, beside
from mech_twin.studies.identification.identification import Identification
from mech_twin.studies.identification.intervals import NORMAL, intervals_before
from mech_twin.studies.identification.keyed_configuration import scalar_lines
from mech_twin.studies.identification.least_squares_fit import Fitted
from mech_twin.studies.identification.residuals import FitProblem
from mech_twin.studies.identification.sensor_plan import Help, sensor_helps
from mech_twin.studies.identification.staged_search import Search
from mech_twin.studies.identification.verdicts import COMBINATION, IDENTIFIED, KeyVerdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure


MOST_POINTS = 1500  # of a curve
MOST_PICTURES, MOST_SENSORS = 4, 4  # so that the report has two pages
SHOWN_SHARE = 0.2  # of a run, at its end, that is plotted
CAPTION = (
    "<p>The end of each run; the band holds 95 % of the samples about the fit. Of white residuals 95 % of the "
    f"autocorrelations lie within the dashed lines. At most {MOST_PICTURES} channels, those that fit worst.</p>"
)


def report_page(found: Identification, runs: Sequence[str], held_out: Sequence[str], helps: Sequence[Help] = ()) -> str:
    """Return the report as HTML.

    Parameters
    ----------
    runs, held_out : sequence of str
        Names of the fitted runs, and of the held-out ones.
    """
    title = f"{found.question.machine}: identification"
    outcome = f"{found.lack}: nothing was written" if found.lack else "predicted better than before"
    head = (
        f"<p>Fitted to {escape(', '.join(runs))}; held out: {escape(', '.join(held_out)) or 'the last share'}, "
        f"{outcome}. {found.model_runs} runs of the model, {found.seconds:.1f} s, seed {found.question.seed}.</p>"
    )
    head += f"<p>{escape(search_words(found.search))}</p>"
    return page(title, [head, _verdicts(found), *_pictures(found), _scores(found), _further_sensors(helps)])


def search_words(search: Search) -> str:
    """Return a summary of the search as a sentence."""
    if search.starts == 1:
        return "The first start ended where the sensors' noise explains the residuals; no other was tried."
    ends = f"{search.starts} starts ended in {search.valleys} local minima, {search.agreeing} of them in the best"
    if search.valleys == 1:
        return f"{ends}."
    return f"{ends}; the misfit of the second best is {search.margin:.3g} times as large."


def _verdicts(found: Identification) -> str:
    known = intervals_before(found.question)
    heads = ("key", "before", "95 % or bounds before", "estimate", "95 % after", "verdict")
    rows = [
        (k.key, k.before, _ends(*known[k.key]), k.estimate, _ends(k.low_95, k.high_95), k.verdict) for k in found.keys
    ]
    reasons = [f"<b>{escape(k.key)}</b>: {escape(k.reason)}" for k in found.keys if k.verdict != IDENTIFIED]
    heads_of_combinations = ("combination", "estimate", "95 % from", "to", "holds for")
    combined = [(c.formula, c.estimate, c.low_95, c.high_95, c.condition) for c in found.combinations]
    parts = [section("Parameters", heads, rows), f"<p>{'.<br>'.join(reasons)}.</p>" if reasons else ""]
    return "".join([*parts, section("Identifiable in combination", heads_of_combinations, combined)])


def _ends(low: float, high: float) -> str:
    return f"{low:.6g} to {high:.6g}"


def _scores(found: Identification) -> str:
    if found.held_out is None or found.before is None:
        return "<h2>Held out</h2><p>Nothing was held out.</p>"
    pairs = zip(found.held_out.channels, found.before.channels, strict=True)
    rows = [(one.channel, one.fit_percent, other.fit_percent, 0.0, one.white_p) for one, other in pairs]
    table = section("Held out", ("channel", "fit, %", "before", "constant", "white (p)"), rows)
    if found.held_out.event_time_rms_s is None:
        return table
    return table + (
        f"<p>Times of events are off by {1e3 * found.held_out.event_time_rms_s:.3g} ms in the rms; "
        f"{found.held_out.missed} missed, {found.held_out.false} false.</p>"
    )


def _further_sensors(helps: Sequence[Help]) -> str:
    rows = [(each.what, ", ".join(each.identified) or "-", f"{each.narrowed:.3g}") for each in helps[:MOST_SENSORS]]
    heads = ("one more sensor", "would also identify", "intervals narrower by")
    return section("What one more sensor would give", heads, rows)


def _pictures(found: Identification) -> list[str]:
    """Return the figures with their headings."""
    with house_style():
        pair = [_svg(interval_figure(found)), *([_correlation(found)] if len(found.fitted_keys) > 1 else [])]
        shown = ["<h2>Intervals, and correlation of the estimates</h2>", f'<div class="row">{"".join(pair)}</div>']
        if found.fitted is None:
            return [*shown, "<p>Read from a document: it holds no runs to draw.</p>"]
        after, before = beside_whole_runs(found, found.fitted)
        shown += ["<h2>Measured against fitted</h2>", CAPTION]
        worst = sorted(
            (found.channels[place].fit_percent, run, place)
            for run, each in enumerate(after[0].runs)
            for place in range(len(each.channels))
            if not np.isnan(found.channels[place].fit_percent)
        )
        shown += [_channel_figure(found, (before, after), run, place) for _, run, place in worst[:MOST_PICTURES]]
    return shown


def beside_whole_runs(
    found: Identification, fitted: Fitted
) -> tuple[tuple[FitProblem, Array], tuple[FitProblem, Array]]:
    """Return the fit and the previous configuration as problems over the whole fitted runs, held-out parts included."""
    problem, asked = fitted.problem, found.question
    other, offsets = beside(asked, asked.base, problem.runs)
    whole = [run.within(-np.inf, np.inf) for run in problem.runs]
    return (problem.over(whole), fitted.x), (other.over(whole), offsets)


def _figure(width: float, height: float, columns: Sequence[float] = (1.0,)) -> tuple[Figure, Any]:
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure as Drawn

    figure = Drawn(figsize=(width, height), layout="constrained")
    FigureCanvasSVG(figure)
    return figure, figure.subplots(1, len(columns), width_ratios=columns)


def _svg(figure: Any) -> str:
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue()[text.getvalue().index("<svg") :]


def interval_figure(found: Identification) -> Figure:
    """Return a figure of the identified keys: estimates with intervals, relative to the previous values."""
    shown = [key for key in found.keys if key.verdict == IDENTIFIED and key.before != 0.0]
    figure, axes = _figure(5.5, 0.8 + 0.32 * len(shown))
    for row, key in enumerate(reversed(shown)):
        low, middle, high = (100.0 * (each / key.before - 1.0) for each in (key.low_95, key.estimate, key.high_95))
        axes.plot(sorted((low, high)), [row, row], color=BLUE)
        axes.plot(middle, row, "o", color=BLUE, markersize=4)
    axes.axvline(0.0, color=GREY, linewidth=0.8)
    axes.set_yticks(range(len(shown)), [key.key for key in reversed(shown)])
    axes.set_xlabel("change against the configuration before, %")
    return figure


def _correlation(found: Identification) -> str:
    side = 1.4 + 0.22 * len(found.fitted_keys)
    figure, axes = _figure(side + 1.0, side)
    image = axes.imshow(found.correlation, vmin=-1.0, vmax=1.0, cmap="RdBu_r")
    names = [key.rpartition(".")[2] for key in found.fitted_keys]
    axes.set_xticks(range(len(names)), names, rotation=60, ha="right")
    axes.set_yticks(range(len(names)), names)
    axes.grid(visible=False)
    figure.colorbar(image, ax=axes, shrink=0.8)
    return _svg(figure)


def _channel_figure(
    found: Identification, both: tuple[tuple[FitProblem, Array], tuple[FitProblem, Array]], run: int, place: int
) -> str:
    """Return a figure of a run's end: measured and model with the 95 % band, residuals, and their autocorrelation."""
    measured = both[1][0].runs[run]
    channel, fit = measured.channels[place], found.channels[place]
    last = channel.times_s[-1]
    shown = np.flatnonzero(channel.times_s >= last - SHOWN_SHARE * (last - channel.times_s[0]))
    shown = shown[:: max(1, len(shown) // MOST_POINTS)]
    figure, (left, middle, right) = _figure(9.0, 1.55, (2.2, 1.4, 1.0))
    times, values = channel.times_s[shown], channel.values[shown]
    left.plot(times, values, ".", color=GREY, markersize=3, label="measured")
    for name, colour, (problem, x) in zip(("before", "fitted"), (RED, BLUE), both, strict=True):
        off = problem.parts(x)[run][place][shown]
        left.plot(times, values - off, color=colour, linewidth=1.0, label=name)
        middle.plot(times, off, color=colour, linewidth=0.8)
        if name == "fitted":
            half = NORMAL * fit.rms
            left.fill_between(times, values - off - half, values - off + half, color=BLUE, alpha=0.2, label="95 %")
            middle.axhspan(-half, half, color=BLUE, alpha=0.2, linewidth=0.0)
    unit = shown_unit(UNITS[channel.channel.unit].si) if channel.channel.unit else "SI"
    left.set_title(f"{channel.name}, {unit}: {measured.path.name}", fontsize=8)
    left.legend(fontsize=6, loc="best")
    middle.set_title("measured less model", fontsize=8)
    lags = np.arange(1, len(fit.autocorrelation) + 1)
    right.vlines(lags, 0.0, fit.autocorrelation, color=BLUE)
    for sign in (-1.0, 1.0):
        right.axhline(sign * NORMAL / max(fit.samples, 1) ** 0.5, color=GREY, linewidth=0.8, linestyle="--")
    right.set_title("autocorrelation", fontsize=8)
    for axes, label in ((left, "time, s"), (middle, "time, s"), (right, "lag, samples")):
        axes.set_xlabel(label, fontsize=7)
        axes.tick_params(labelsize=6)
    return _svg(figure)


HASHED_BLOCK = 1 << 20
ASKED = ("keys", "bounds", "priors", "longest_begin_s", "cores", "scheduler")  # beside machine, configuration and seed


def configuration_text(found: Identification, runs: Sequence[str]) -> str:
    """Return the resulting configuration as a parameter file, with a comment of the result beside each free key."""
    text = description_text(kind_of(found.question.machine), found.parameters)
    notes = {key.key: _note(key, runs) for key in found.keys}
    lines = text.splitlines()
    for key, (*_, line) in scalar_lines(text):
        if key in notes:
            lines[line] += f"  # {notes[key]}"
    return "\n".join(lines) + "\n"


def _note(key: KeyVerdict, runs: Sequence[str]) -> str:
    if key.verdict == IDENTIFIED:
        half = 0.5 * (key.high_95 - key.low_95)
        return f"identified {key.estimate:.6g} +- {half:.2g} (95 %) from {', '.join(runs)}"
    if key.verdict == COMBINATION and key.estimate != key.before:
        return f"in combination: {key.reason}"
    return f"kept: {key.verdict}, {key.reason}"


def document(
    found: Identification, runs: Sequence[Path], held_out: Sequence[Path], map_file: Path | None
) -> dict[str, Any]:
    """Return the complete result as plain values."""
    files = [*runs, *held_out, *([] if map_file is None else [map_file])]
    asked = found.question
    return {
        "machine": asked.machine,
        "config": configuration_tree(found.parameters),
        "before": configuration_tree(asked.base),
        "asked": {name: getattr(asked, name) for name in ASKED},
        "parameters": [asdict(key) for key in found.keys],
        "intervals_before": {key: list(ends) for key, ends in intervals_before(asked).items()},
        "combinations": [asdict(each) for each in found.combinations],
        "channels": [_channel(each) for each in found.channels],
        "search": asdict(found.search),
        "held_out": None if found.held_out is None else held_out_record(found),
        "begins_s": found.begins_s,
        "correlation": {"keys": list(found.fitted_keys), "matrix": found.correlation.tolist()},
        "better": found.better,
        "runs": [str(run) for run in runs],
        "held_out_runs": [str(run) for run in held_out],
        "map": None if map_file is None else str(map_file),
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
        return "\n".join([f"{self.found.question.machine}: fitted in {self.found.seconds:.1f} s", *rows])

    @property
    def _with_helps(self) -> dict[str, Any]:
        """The document with the benefit of further sensors, which takes more simulations."""
        return {**self.document, "further_sensors": [asdict(each) for each in self.helps]}

    def plot(self) -> Figure:
        """Return a figure of the estimates with intervals, relative to the previous values; needs the extra 'plots'."""
        require_extra("plots")
        from mech_twin.capabilities.plots import house_style

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
            record = json.dumps(plain(self._with_helps), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
            texts = {out / f"{machine}.yaml": configuration, out / "identification.json": record}
            if find_spec("matplotlib") is not None:
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
