// SPDX-License-Identifier: Apache-2.0
// Rows of a shadow's panes: faults, recommendations and identified parameters.

import { made } from "./plots.js";

const ORDERS = [["acknowledge", "Acknowledge"], ["shelve", "Shelve"]];
const seconds = (time) => `t = ${time.toFixed(1)} s`;

// the row of a fault, made or, so that no button vanishes under the mouse, brought up to date
export function faultRow(fault, order, before) {
  const row = before ?? emptyRow(fault.name, order);
  row.className = fault.is_acknowledged || fault.shelved_until_s !== null ? "fault known" : "fault";
  row.dataset.state = fault.state;
  const words = [`${fault.state} since ${seconds(fault.since_s)}`];
  if (fault.is_acknowledged) words.push("acknowledged");
  if (fault.shelved_until_s !== null) words.push(`shelved until ${seconds(fault.shelved_until_s)}`);
  row.querySelector(".fault-state").textContent = [words.join(", "), fault.size.replaceAll("_", " ")].filter(Boolean).join("\n");
  const idle = { acknowledge: fault.is_acknowledged || fault.state === "pending", shelve: fault.shelved_until_s !== null };
  for (const button of row.querySelectorAll("button")) {
    if (idle[button.name]) button.dataset.idle = ""; else delete button.dataset.idle;
  }
  return row;
}

function emptyRow(fault, order) {
  const row = made("div"), buttons = made("div", { className: "row" });
  row.dataset.name = fault;
  buttons.append(...ORDERS.map(([name, textContent]) => made("button", { type: "button", name, textContent, onclick: () => order(name, { fault }) })));
  row.append(made("b", { textContent: fault.replaceAll("_", " ") }), made("div", { className: "fault-state" }), buttons);
  return row;
}

export function adviceRow([name, value]) {
  const line = made("tr");
  line.append(made("th", { textContent: name }), made("td", { textContent: value }));
  return line;
}

// an identified key with its verdict, the value before, and the value found with its interval
export function fitRow([name, before, found, interval, verdict]) {
  const line = made("tr"), key = made("td", { textContent: name }), value = made("td", { textContent: found });
  key.append(made("small", { textContent: ` ${verdict}` }));
  value.append(made("small", { textContent: ` ${interval}` }));
  line.append(key, made("td", { textContent: before }), value);
  return line;
}
