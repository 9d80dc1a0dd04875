// SPDX-License-Identifier: Apache-2.0
// The bench's page: receives messages, and dispatches them to the modules.

import { changed, commands, forgetCommands, know, showPause, showRole, showSettings } from "./command.js";
import { answered, connect, cut } from "./connection.js";
import { ghost, showGhost } from "./ghost.js";
import { fetchFile, showHall } from "./hall.js";
import { follow, frame, layOut, plots } from "./instant.js";
import { showAdvice, showComparison, showFaults, showFit, showHealth, showMetrics } from "./panes.js";
import { forgetLimits } from "./limits.js";
import { forget, take } from "./pictures.js";
import { answer, curves, find, lanes, other, run, say, shown } from "./state.js";
import "./report_contents.js";

function hear(message) {
  const does = {
    pictures: () => take(message.list),
    machine: () => know(message),
    layout: () => layOut(message.panels),
    status: () => say(message.text),
    health: () => showHealth(message),
    comparison: () => showComparison(message),
    metrics: () => showMetrics(message.rows),
    role: () => showRole(message),
    answer: () => answered(message),
    changed: () => { changed(message.name, message.value); showSettings(message.settings); },
    pause: () => { run.paused = message.is_paused; shown.drawn = null; showPause(); },
    alarms: () => showFaults(message.faults),
    advice: () => showAdvice(message),
    fit: () => showFit(message),
    end: () => { run.over = message.text; commands(run.commands); shown.drawn = null; if (!run.pictures.length) find("state").textContent = "over"; answer(message.text, message.has_failed ? "refused" : "done"); },
    ghost: () => showGhost(message),
    anew: () => { if (message.all) beginAnew(); else forget(); },
    hall: () => showHall(message),
    versions: () => { run.versions = message.text; },
    offer: () => { if (run.commands) message.files.forEach(fetchFile); },
  }[message.kind];
  if (does) does();
}

// nothing is known of the run: another begins, or the bench is reached again, where another may have begun meanwhile
function beginAnew() {
  forget();
  layOut([]);
  Object.assign(run, { machine: null, orders: [], paused: false, over: "" });
  forgetCommands();
  forgetLimits();
  for (const id of ["comparison", "numbers", "alarms", "advice", "fit", "command", "parameters", "log", "lamp", "differs"]) find(id).hidden = true;
  find("cover").hidden = false;
  find("cards").replaceChildren();
  find("time").textContent = "";
  find("machine").textContent = document.title = "mech_twin bench";
  follow(true);
  curves.clear();
  ghost.curves.clear();
  ghost.until = -1;
  window.bench.shown = 0; // the end of the run before was shown once more
}

// number of rows of two runs at common times, and their largest difference
function apart() {
  let rows = 0, largest = 0;
  for (const [path, curve] of curves) {
    const [times, ...columns] = other.difference(path, curve.between(-Infinity, Infinity)) ?? [[]];
    rows += times.length;
    for (const column of columns) for (const value of column) largest = Math.max(largest, Math.abs(value ?? 0));
  }
  return { rows, largest };
}

// number of rows of a plot, and the largest value
function drawn(place) {
  const [times, ...columns] = plots.list[place].plot.data;
  return { rows: times.length, largest: Math.max(...columns.flatMap((column) => [...column]).map((value) => value ?? -Infinity)) };
}

// interface for tests: the time shown (s), the time range of the plots (s), number of pictures drawn
window.bench = { apart, drawn, window: () => [plots.from, plots.now], lanes: () => lanes.at(shown.at), shown: 0, frames: 0, ghosts: [], cut };
requestAnimationFrame(frame);
connect(beginAnew, hear, () => commands(false));
