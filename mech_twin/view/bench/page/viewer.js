// SPDX-License-Identifier: Apache-2.0
// rerun's web viewer in place of drawing and plots: opened and closed by a button, synchronised with the page's time.

import { find } from "./state.js";

const APART_MS = 50; // least time between two updates of the viewer's time
let told, last = 0;

function open(wanted) {
  document.querySelector("main").classList.toggle("in-rerun", wanted);
  find("rerun").setAttribute("aria-pressed", wanted);
  find("viewer").hidden = !wanted;
  if (wanted) find("viewer").src = "rerun.html"; else find("viewer").removeAttribute("src");
  told = null; // the viewer begins at the newest time
}

// set the viewer's time; null: follow the newest
export function tellTime(at) {
  const seek = find("viewer").hidden ? null : find("viewer").contentWindow?.seek, now = performance.now();
  if (!seek || at === told || now - last < APART_MS) return;
  told = at;
  last = now;
  seek(at);
}

find("rerun").onclick = () => open(find("viewer").hidden);
