// SPDX-License-Identifier: Apache-2.0
// Panes: faults, advice, identification, numbers of the run, comparison of two runs, residuals.

import { commands } from "./command.js";
import { order } from "./connection.js";
import { save } from "./report.js";
import { find, other, rowsOf, run, shown } from "./state.js";
import { adviceRow, faultRow, fitRow } from "./shadow_rows.js";

const SPANS_S = [10, 30, 60, 120, 300]; // time spans that may be fitted
const FIRST_NUMBERS = 6; // shown without opening the list

export function showFaults(faults) {
  find("alarms").hidden = !run.orders.includes("acknowledge");
  const box = find("faults"), before = (name) => box.querySelector(`[data-name="${CSS.escape(name)}"]`);
  const rows = faults.map((fault) => faultRow(fault, order, before(fault.name)));
  if (!rows.length) box.replaceChildren("no fault");
  else if (rows.some((row, place) => row !== box.children[place]) || rows.length < box.children.length) box.replaceChildren(...rows);
  commands(run.commands);
}

export function showAdvice({ rows, decided, is_on_trial: isOnTrial }) {
  find("advice").hidden = !run.orders.includes("accept");
  find("advice-rows").replaceChildren(...rows.map(adviceRow));
  find("advice-none").hidden = rows.length > 0;
  find("advice-answers").hidden = !rows.length;
  find("advice-decided").textContent = decided;
  mark("accept", isOnTrial);
  commands(run.commands);
}

// identification from the last minutes: progress, result, and whether it may be applied
let configuration = "";
export function showFit({ phase, status_line: status, free, kept_s: kept, rows, held_out: held, text }) {
  find("fit").hidden = !run.orders.includes("identify");
  find("fit").dataset.phase = phase;
  find("fit-free").textContent = `${free.length} free key${free.length === 1 ? "" : "s"}: ${free.join(", ")}`;
  const span = find("fit-span"), seconds = SPANS_S.filter((each) => each <= kept);
  const offered = seconds.length ? seconds : [Math.max(2, kept)];
  if (span.dataset.offered !== String(offered)) {
    const chosen = span.value;
    span.dataset.offered = String(offered);
    span.replaceChildren(...offered.map((each) => new Option(each < 120 ? `${each} s` : `${each / 60} min`, each)));
    if (seconds.includes(Number(chosen))) span.value = chosen; else span.lastChild.selected = true;
  }
  find("fit-status").textContent = `${phase}: ${status}`;
  find("fit-keys").hidden = !rows.length;
  find("fit-rows").replaceChildren(...rows.map(fitRow));
  find("fit-held").hidden = !held.length;
  find("fit-scores").replaceChildren(...rowsOf(held));
  find("fit-answers").hidden = !text;
  configuration = text;
  mark("identify", phase === "running");
  mark("take-over", phase !== "found");
  commands(run.commands);
}

function mark(id, isIdle) { if (isIdle) find(id).dataset.idle = ""; else delete find(id).dataset.idle; }

export function showMetrics(rows) {
  const lines = rowsOf(rows);
  find("numbers").hidden = !rows.length;
  find("metrics").replaceChildren(...lines.slice(0, FIRST_NUMBERS));
  find("more-metrics").replaceChildren(...lines.slice(FIRST_NUMBERS));
}

// two runs in one view: their names, differences, and alignment
export function showComparison({ settings, numbers, note, angle }) {
  other.know(angle);
  find("comparison").hidden = false;
  find("align").disabled = !angle;
  if (!angle) find("align").value = "time";
  other.byAngle = find("align").value === "angle";
  find("align").title = angle ? "" : "the leading joint does not turn a whole cycle in both runs";
  const [first, second] = run.machine?.sides ?? ["A", "B"];
  find("sides").replaceChildren(`A, solid: ${first}`, document.createElement("br"), `B, dashed: ${second}`);
  find("settings").replaceChildren(...rowsOf(settings.length ? settings : [["no setting differs", "", ""]]));
  find("compared").replaceChildren(...rowsOf(numbers.filter((row) => row[3] !== "0 %")));
  const equal = `${numbers.filter((row) => row[3] === "0 %").length} of ${numbers.length} numbers are equal`;
  find("equal").textContent = [equal, note].filter(Boolean).join(". ");
  shown.drawn = null;
}

// one lamp for residuals against their limits, and for the lag of the run and of this page
export function showHealth({ residuals, behind_s: behind }) {
  const broken = residuals.filter((row) => row[3]).length, late = behind !== null && behind > 0.5;
  find("lamp").hidden = false;
  find("lamp").className = broken ? "bad" : late ? "late" : "good";
  find("lamp-text").textContent = broken ? `${broken} residual${broken > 1 ? "s" : ""} over the limit` : late ? `${behind.toFixed(1)} s behind` : "within limits";
  const newest = run.pictures.at(-1);
  const page = newest && shown.following ? `; this page ${Math.max(0, Date.now() / 1000 - newest.sent_s).toFixed(2)} s` : "";
  find("lag").textContent = behind === null ? "" : `behind the wall clock: the run ${behind.toFixed(2)} s${page}`;
  find("residuals").replaceChildren(...residuals.map(([name, worst, limit, isBroken]) => {
    const line = document.createElement("tr");
    line.className = isBroken ? "refused" : "";
    line.append(...[name, worst, limit].map((text) => { const cell = document.createElement("td"); cell.textContent = text; return cell; }));
    return line;
  }));
}

find("align").onchange = () => { other.byAngle = find("align").value === "angle"; shown.drawn = null; };
find("how").onchange = () => { other.isDifference = find("how").value === "difference"; shown.drawn = null; };
find("accept").onclick = () => order("accept");
find("reject").onclick = () => order("reject");
find("identify").onclick = () => order("identify", { values: { span_s: Number(find("fit-span").value) } });
find("take-over").onclick = () => order("take-over");
find("fit-save").onclick = () => save(`${run.machine?.name ?? "machine"}-identified.yaml`, "application/yaml", configuration);
