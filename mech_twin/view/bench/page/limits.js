// SPDX-License-Identifier: Apache-2.0
// Limits of the headline numbers: rated values of the machine, or values entered on this page.

import { note } from "./pictures.js";
import { made } from "./plots.js";
import { find, run, shown, typed } from "./state.js";

const kept = () => `limits of ${run.machine?.name ?? ""}`;
const asked = () => JSON.parse(sessionStorage.getItem(kept()) ?? "{}");
const outside = new Set(); // keys that were out of their limits at the last picture

function of([, , key, , , most]) {
  const own = asked()[key] ?? {};
  return { least: own.least ?? null, most: own.most ?? most ?? null };
}

// text of a violated limit of a card at a time; empty if within its limits, or without any
export function judged(card, time) {
  const [, , key, value, unit] = card;
  if (value === null || value === undefined) return "";
  const { least, most } = of(card);
  const word = most !== null && value > most ? `above ${most} ${unit}` : least !== null && value < least ? `below ${least} ${unit}` : "";
  if (word && !outside.has(key) && time !== null) note(time, `t = ${time.toFixed(3)} s: ${key} ${word}`);
  if (word) outside.add(key); else outside.delete(key);
  return word;
}

// add a row for each new headline number; existing rows stay, so that input is not lost
export function listLimits(cards) {
  const keys = cards.filter(([, , key]) => key), shown = [...find("limit-rows").children].map((row) => row.dataset.key);
  find("limits").hidden = !keys.length;
  const news = keys.filter(([, , key]) => !shown.includes(key));
  find("limit-rows").append(...news.map(row));
}

function row(card) {
  const [, , key, , unit] = card, line = made("tr"), name = made("th", { textContent: `${key}, ${unit}` });
  line.dataset.key = key;
  const boxes = ["least", "most"].map((end) => {
    const cell = made("td"), box = made("input", { className: "number", value: of(card)[end] ?? "" });
    box.setAttribute("aria-label", `${key}, at ${end}`);
    box.onchange = () => {
      const all = asked(), isEmpty = box.value.trim() === "", value = typed(box, `${key}, at ${end}`);
      if (isEmpty || value !== null) all[key] = { ...all[key], [end]: value ?? undefined };
      sessionStorage.setItem(kept(), JSON.stringify(all));
      box.value = of(card)[end] ?? "";
      shown.drawn = null; // judged anew, also where no picture comes
    };
    cell.append(box);
    return cell;
  });
  line.append(name, ...boxes);
  return line;
}

export function forgetLimits() {
  outside.clear();
  find("limit-rows").replaceChildren();
  find("limits").hidden = true;
}
