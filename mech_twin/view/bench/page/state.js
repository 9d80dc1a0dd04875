// SPDX-License-Identifier: Apache-2.0
// State of the page: the run as received, the display state, and helpers for text elements.

import { Lanes } from "./lanes.js";
import { Other } from "./second_run.js";

export const find = (id) => document.getElementById(id);
export const run = { pictures: [], bytes: 0, machine: null, orders: [], paused: false, over: "", commands: false, sped: -Infinity };
export const shown = { following: true, playing: false, at: 0, span: null, place: -1, drawn: null, newest: null, changes: 0, last: 0, heard: 0, showed: 0, owed: false };
export const curves = new Map(); // path -> Curve
export const lanes = new Lanes(), other = new Other();
export const rounded = (value) => (typeof value === "number" ? Number(value.toPrecision(6)) : value);

export function say(text) {
  find("status").textContent = text;
  find("cover").hidden = run.pictures.length > 0;
  if (!run.pictures.length) find("state").textContent = "starting";
}

export function answer(text, kind) {
  const line = document.createElement("li");
  line.className = kind;
  line.textContent = text;
  find("answers").prepend(line);
  find("answered").hidden = false;
  while (find("answers").childElementCount > 50) find("answers").lastChild.remove();
}

// number of a box, which is text: of a comma that its language does not write, a number box keeps the digits alone, and so
// ten times the value; null if the box is empty, or if its text, which is then named as refused, is no number
export function typed(box, name) {
  const text = box.value.trim(), isUnclear = /^[-+]?[1-9]\d{0,2},\d{3}$/.test(text);
  const isNumber = !isUnclear && /^[-+]?(\d+[.,]?\d*|[.,]\d+)(e[-+]?\d+)?$/i.test(text), value = Number(text.replace(",", "."));
  if (isNumber && Number.isFinite(value)) return value;
  if (text) answer(`${name}: ${text}: expected a number such as 0.5 or 1200`, "refused");
  return null;
}

export function rowsOf(rows) {
  return rows.map((row) => {
    const line = document.createElement("tr");
    line.append(...row.map((text) => { const cell = document.createElement("td"); cell.textContent = text; return cell; }));
    return line;
  });
}
