// SPDX-License-Identifier: Apache-2.0
// Rows of a shadow's panes: faults, recommendations and identified parameters.

import { made } from "./plots.js";

const ORDERS = [["acknowledge", "Acknowledge"], ["shelve", "Shelve"]];
const seconds = (time) => `t = ${time.toFixed(1)} s`;

export function faultRow(fault, order) {
  const row = made("div", { className: fault.is_acknowledged || fault.shelved_until_s !== null ? "fault known" : "fault" });
  row.dataset.state = fault.state;
  const words = [`${fault.state} since ${seconds(fault.since_s)}`];
  if (fault.is_acknowledged) words.push("acknowledged");
  if (fault.shelved_until_s !== null) words.push(`shelved until ${seconds(fault.shelved_until_s)}`);
  const buttons = made("div", { className: "row" });
  const idle = { acknowledge: fault.is_acknowledged || fault.state === "pending", shelve: fault.shelved_until_s !== null };
  for (const [name, word] of ORDERS) {
    const button = made("button", { type: "button", textContent: word, onclick: () => order(name, { fault: fault.name }) });
    if (idle[name]) button.dataset.idle = "";
    buttons.append(button);
  }
  row.append(made("b", { textContent: fault.name.replaceAll("_", " ") }), made("div", { textContent: words.join(", ") }));
  if (fault.size) row.append(made("div", { textContent: fault.size.replaceAll("_", " ") }));
  row.append(buttons);
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
