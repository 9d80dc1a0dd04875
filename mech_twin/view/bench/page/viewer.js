// SPDX-License-Identifier: Apache-2.0
// rerun's web viewer in place of drawing and plots: opened and closed by a button, synchronised with the page's time.

import { find } from "./state.js";

const APART_MS = 50; // least time between two updates of the viewer's time
const AGAIN_MS = 500, MOST_AGAIN = 240; // a time that it has not taken in yet is sent again
const SURE = 6; // it is looked at so often after it was taken in: what loads then may move it
let sent, listener, last = 0, again = 0; // the listener is of one viewer: closed and opened, it is another

function open(wanted) {
  document.querySelector("main").classList.toggle("in-rerun", wanted);
  find("rerun").setAttribute("aria-pressed", wanted);
  find("viewer").hidden = !wanted;
  if (wanted) find("viewer").src = "rerun.html"; else find("viewer").removeAttribute("src");
}

// set the viewer's time; null: follow the newest
export function tellTime(at) {
  const viewer = find("viewer").hidden ? null : find("viewer").contentWindow, now = performance.now();
  const isNew = at !== sent || viewer?.seek !== listener;
  if (!viewer?.seek || !(isNew || again) || now - last < (isNew ? APART_MS : AGAIN_MS)) return;
  const isThere = !isNew && at !== null && viewer.isAt(at);
  again = at === null ? 0 : isNew ? MOST_AGAIN : (isThere ? Math.min(again, SURE) : again) - 1;
  sent = at;
  listener = viewer.seek;
  last = now;
  if (isNew || (again && !isThere)) viewer.seek(at);
}

find("rerun").onclick = () => open(find("viewer").hidden);
