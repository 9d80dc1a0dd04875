# SPDX-License-Identifier: Apache-2.0
"""The report of an identification: one HTML file that needs no network, with its pictures inside."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from mech_twin.capabilities.plots import BLUE, GREY, RED, house_style
from mech_twin.files.report_page import page
from mech_twin.measurements.blocks import Array
from mech_twin.studies.identification.held_out import beside
from mech_twin.studies.identification.identification import Identification
from mech_twin.studies.identification.least_squares_fit import Fitted
from mech_twin.studies.identification.residuals import FitProblem
from mech_twin.studies.identification.staged_search import Search

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_POINTS = 1500  # of a curve
SHOWN_SHARE = 0.2  # of a run, at its end


def report_page(found: Identification, runs: Sequence[str], held_out: Sequence[str]) -> str:
    """Return the report as HTML.

    Parameters
    ----------
    found : Identification
        What was found.
    runs, held_out : sequence of str
        Names of the runs that were fitted, and of those that were not.
    """
    title = f"{found.question.machine}: identification"
    outcome = "foretold better than before" if found.better else "foretold no better than before: nothing was written"
    head = (
        f"<p>Fitted to {escape(', '.join(runs))}; held out: {escape(', '.join(held_out)) or 'the last share'}, "
        f"{outcome}. {found.model_runs} runs of the model, {found.seconds:.1f} s, seed {found.question.seed}.</p>"
    )
    head += f"<p>{escape(search_words(found.search))}</p>"
    parts = [head, "<h2>Parameters</h2>", _verdict_table(found), *_pictures(found), "<h2>Held out</h2>", _scores(found)]
    return page(title, parts)


def search_words(search: Search) -> str:
    """Return what the search has seen, as a sentence."""
    if search.starts == 1:
        return "The first start ended where the sensors' noise explains the residuals; no other was tried."
    ends = f"{search.starts} starts ended in {search.valleys} valleys, {search.agreeing} of them in the best"
    if search.valleys == 1:
        return f"{ends}."
    return f"{ends}; the misfit of the second best is {search.margin:.3g} times as large."


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    head = "".join(f"<th>{escape(each)}</th>" for each in heads)
    body = "".join("<tr>" + "".join(row) + "</tr>" for row in rows)
    return f"<table><tr>{head}</tr>{body}</table>"


def _cell(value: Any, kind: str = "") -> str:
    shown = f"{value:.6g}" if isinstance(value, float) else escape(str(value))
    return f'<td class="{kind}">{shown}</td>' if kind else f"<td>{shown}</td>"


def _verdict_table(found: Identification) -> str:
    rows = []
    for key in found.keys:
        kind = "identified" if key.verdict == "identified" else "other"
        numbers = [_cell(each) for each in (key.before, key.estimate, key.low_95, key.high_95)]
        rows.append([_cell(key.key), *numbers, _cell(key.verdict, kind), _cell(key.reason, "words")])
    tables = _table(("key", "before", "estimate", "95 % from", "to", "verdict", "reason"), rows)
    if found.combinations:
        heads = ("combination", "estimate", "95 % from", "to", "holds for")
        combined = [
            [
                _cell(c.formula, "words"),
                *map(_cell, (c.estimate, c.low_95, c.high_95)),
                _cell(c.condition, "words"),
            ]
            for c in found.combinations
        ]
        tables += "<h3>Seen in combination</h3>" + _table(heads, combined)
    return tables


def _scores(found: Identification) -> str:
    if found.held_out is None or found.before is None:
        return "<p>Nothing was held out.</p>"
    rows = [
        [_cell(each) for each in (one.channel, one.fit_percent, other.fit_percent, 0.0, one.white_p)]
        for one, other in zip(found.held_out.channels, found.before.channels, strict=True)
    ]
    table = _table(("channel", "fit, %", "before", "constant", "white (p)"), rows)
    if found.held_out.event_time_rms_s is None:
        return table
    return table + (
        f"<p>Times of events are off by {1e3 * found.held_out.event_time_rms_s:.3g} ms in the rms; "
        f"{found.held_out.missed} missed, {found.held_out.false} false.</p>"
    )


def _pictures(found: Identification) -> list[str]:
    """Return the pictures with their headings."""
    with house_style():
        shown = ["<h2>Intervals</h2>", _intervals(found)]
        if len(found.fitted_keys) > 1:
            shown += ["<h2>Correlation of the estimates</h2>", _correlation(found)]
        if found.fitted is None:
            return [*shown, "<p>Read from a document: it holds no runs to draw.</p>"]
        after, before = beside_whole_runs(found, found.fitted)
        problem = after[0]
        for run in range(len(problem.runs)):
            shown.append(f"<h2>Channels: {escape(problem.runs[run].path.name)}</h2>")
            shown += [
                _channel(after, before, run, place)
                for place, channel in enumerate(problem.runs[run].channels)
                if not channel.of_events
            ]
    return shown


def beside_whole_runs(
    found: Identification, fitted: Fitted
) -> tuple[tuple[FitProblem, Array], tuple[FitProblem, Array]]:
    """Return the fit, and the configuration before, beside the whole of the fitted runs, what was held out included."""
    problem, asked = fitted.problem, found.question
    other, offsets = beside(asked.machine, asked.base, problem.runs, asked.longest_begin_s)
    whole = [run.within(-np.inf, np.inf) for run in problem.runs]
    return (problem.over(whole), fitted.x), (other.over(whole), offsets)


def _figure(width: float, height: float, rows: int = 1) -> tuple[Figure, Any]:
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure as Drawn

    figure = Drawn(figsize=(width, height), layout="constrained")
    FigureCanvasSVG(figure)
    return figure, figure.subplots(rows, 1, sharex=rows > 1)


def _svg(figure: Any) -> str:
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue()[text.getvalue().index("<svg") :]


def _intervals(found: Identification) -> str:
    return _svg(interval_figure(found))


def interval_figure(found: Identification) -> Figure:
    """Return the estimates of the keys that were identified, with their intervals, over the values before."""
    shown = [key for key in found.keys if key.verdict == "identified" and key.before != 0.0]
    figure, axes = _figure(7.5, 0.6 + 0.32 * len(shown))
    for row, key in enumerate(reversed(shown)):
        low, middle, high = (100.0 * (each / key.before - 1.0) for each in (key.low_95, key.estimate, key.high_95))
        axes.plot(sorted((low, high)), [row, row], color=BLUE)
        axes.plot(middle, row, "o", color=BLUE, markersize=4)
    axes.axvline(0.0, color=GREY, linewidth=0.8)
    axes.set_yticks(range(len(shown)), [key.key for key in reversed(shown)])
    axes.set_xlabel("change against the configuration before, %")
    return figure


def _correlation(found: Identification) -> str:
    figure, axes = _figure(5.5, 4.5)
    image = axes.imshow(found.correlation, vmin=-1.0, vmax=1.0, cmap="RdBu_r")
    names = [key.rpartition(".")[2] for key in found.fitted_keys]
    axes.set_xticks(range(len(names)), names, rotation=60, ha="right")
    axes.set_yticks(range(len(names)), names)
    axes.grid(visible=False)
    figure.colorbar(image, ax=axes, shrink=0.8)
    return _svg(figure)


def _channel(after: tuple[FitProblem, Array], before: tuple[FitProblem, Array], run: int, place: int) -> str:
    """Return measured and model before and after at the end of a run, and the residuals."""
    channel = after[0].runs[run].channels[place]
    last = channel.times_s[-1]
    shown = np.flatnonzero(channel.times_s >= last - SHOWN_SHARE * (last - channel.times_s[0]))
    shown = shown[:: max(1, len(shown) // MOST_POINTS)]
    figure, (above, below) = _figure(7.5, 4.0, 2)
    times, values = channel.times_s[shown], channel.values[shown]
    above.plot(times, values, ".", color=GREY, markersize=3, label="measured")
    for name, colour, (problem, x) in (("before", RED, before), ("identified", BLUE, after)):
        off = problem.parts(x)[run][place][shown]
        above.plot(times, values - off, color=colour, linewidth=1.0, label=name)
        below.plot(times, off, color=colour, linewidth=0.8)
    above.set_title(channel.name)
    above.legend(ncols=3, loc="upper right")
    below.set_ylabel("measured less model")
    below.set_xlabel("time, s")
    return _svg(figure)
