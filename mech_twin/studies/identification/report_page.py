# SPDX-License-Identifier: Apache-2.0
"""The report of an identification: one self-contained HTML file with embedded figures."""

from __future__ import annotations

import io
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from mech_twin.capabilities.plots import BLUE, GREY, RED, house_style, sheet
from mech_twin.files.report_page import page, section
from mech_twin.measurements.units import UNITS, shown_unit
from mech_twin.studies.identification.fit_quality import Fitted
from mech_twin.studies.identification.identification import Identification
from mech_twin.studies.identification.intervals import NORMAL, intervals_before
from mech_twin.studies.identification.sensor_plan import Help
from mech_twin.studies.identification.staged_fit import Search, fixed_fit
from mech_twin.studies.identification.verdicts import IDENTIFIED

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
    pairs = zip(found.held_out_fits, found.held_out.channels, strict=True)
    rows = [(*fits, 0.0, channel.white_p) for fits, channel in pairs]
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
        fitted, asked = found.fitted, found.question
        runs = fitted.problem.runs
        whole = [run.within(-np.inf, np.inf) for run in runs]  # held-out parts included
        both = fixed_fit(asked, asked.base, runs).over(whole), fitted.over(whole)
        shown += ["<h2>Measured against fitted</h2>", CAPTION]
        worst = sorted(
            (found.channels[place].fit_percent, run, place)
            for run, each in enumerate(runs)
            for place in range(len(each.channels))
            if not np.isnan(found.channels[place].fit_percent)
        )
        shown += [_channel(found, both, run, place) for _, run, place in worst[:MOST_PICTURES]]
    return shown


def _svg(figure: Any) -> str:
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None})
    return text.getvalue()[text.getvalue().index("<svg") :]


def interval_figure(found: Identification) -> Figure:
    """Return a figure of the identified keys: estimates with intervals, relative to the previous values."""
    shown = [key for key in found.keys if key.verdict == IDENTIFIED and key.before != 0.0]
    figure, (axes,) = sheet(1, 1, 5.5, 0.8 + 0.32 * len(shown))
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
    figure, (axes,) = sheet(1, 1, side + 1.0, side)
    image = axes.imshow(found.correlation, vmin=-1.0, vmax=1.0, cmap="RdBu_r")
    names = [key.rpartition(".")[2] for key in found.fitted_keys]
    axes.set_xticks(range(len(names)), names, rotation=60, ha="right")
    axes.set_yticks(range(len(names)), names)
    axes.grid(visible=False)
    figure.colorbar(image, ax=axes, shrink=0.8)
    return _svg(figure)


def _channel(found: Identification, both: tuple[Fitted, Fitted], run: int, place: int) -> str:
    """Return a figure of a run's end: measured and model with the 95 % band, residuals, and their autocorrelation."""
    measured = both[0].problem.runs[run]
    channel, fit = measured.channels[place], found.channels[place]
    last = channel.times_s[-1]
    shown = np.flatnonzero(channel.times_s >= last - SHOWN_SHARE * (last - channel.times_s[0]))
    shown = shown[:: max(1, len(shown) // MOST_POINTS)]
    figure, (left, middle, right) = sheet(1, 3, 9.0, 1.55, width_ratios=(2.2, 1.4, 1.0))
    times, values = channel.times_s[shown], channel.values[shown]
    left.plot(times, values, ".", color=GREY, markersize=3, label="measured")
    for name, colour, drawn in zip(("before", "fitted"), (RED, BLUE), both, strict=True):
        off = drawn.parts[run][place][shown]
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
