// SPDX-License-Identifier: Apache-2.0
// Trial: the predicted effect of a value not sent yet, requested while a slider moves, drawn dashed.

import { send } from "./connection.js";
import { Curve } from "./curves.js";
import { curves, find, rounded, run, shown } from "./state.js";

const PAGE_LAG_S = 0.5; // largest age of a picture relative to the initial state of a trial
export const ghost = { curves: new Map(), from: Infinity, until: -1, begun: 0, asked: null, next: null };

// a trial continues the newest state: it is not visible when older times are shown
export function isTried(time) { return shown.span === null && ghost.from <= time + (shown.following ? PAGE_LAG_S : 0) && ghost.until > time; }

export function attempt(name, value) {
  const wanted = { name, value, begun: performance.now() };
  if (ghost.asked) { ghost.next = wanted; return; }
  ghost.asked = wanted;
  send({ kind: "try", values: { [name]: value } });
}

// the first trial loads the machine, which takes seconds: start it when the pointer enters the parameters
export function warm() {
  if (ghost.asked || !run.commands) return;
  ghost.asked = { begun: 0 };
  send({ kind: "try", values: {} });
}

// a trial is requested; drawing pictures meanwhile would delay its answer
export const isAwaited = () => ghost.asked !== null && !ghost.begun;

// the value tried is sent, or nobody tries any more: no answer on its way is shown, and none waited for that does not come
export function forgetTrial(isUnanswered = false) {
  ghost.next = null;
  if (ghost.asked) ghost.asked = isUnanswered ? null : { begun: 0 };
}

// the plots contain the trial: it is visible with the next animation frame
export function ghostDrawn() {
  if (!ghost.begun) return;
  const begun = ghost.begun;
  ghost.begun = 0;
  requestAnimationFrame(() => { window.bench.ghosts.push(performance.now() - begun); window.bench.onghost?.(); });
}

export function showGhost(message) {
  if (!ghost.asked) return;
  const { name, value, begun } = ghost.asked;
  const row = name && find("keys").querySelector(`[data-name="${CSS.escape(name)}"] .was`);
  ghost.asked = null;
  if (name && message.values[name] !== value) { // of before a takeover: while it was computed, the bench took no other
    attempt(name, value);
    ghost.asked.begun = begun;
    return;
  }
  if (!row) message.curves = null;
  else if (message.refused) row.textContent = message.refused;
  else {
    ghost.curves.clear();
    for (const [path, [times, values]] of Object.entries(message.curves)) {
      const curve = curves.get(path);
      if (!curve) continue;
      const fresh = new Curve(curve.width);
      fresh.add(times, values);
      ghost.curves.set(path, fresh);
    }
    Object.assign(ghost, { from: message.from_s, until: message.to_s });
    shown.drawn = null;
    row.textContent = `with ${rounded(value)}: ${message.cards.map(([card, text]) => `${card} ${text}`).join(", ")}`;
    ghost.begun = begun;
  }
  const next = ghost.next;
  ghost.next = null;
  if (next) { attempt(next.name, next.value); ghost.asked.begun = next.begun; }
}
