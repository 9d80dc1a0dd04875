// SPDX-License-Identifier: Apache-2.0
// rerun's own viewer in place of drawing and plots: opened and closed by a button, its time that of this page.

import { find } from "./state.js";

const APART_MS = 50; // between two times that the viewer is told
let told, last = 0;

function open(wanted) {
  document.querySelector("main").classList.toggle("in-rerun", wanted);
  find("rerun").setAttribute("aria-pressed", wanted);
  find("viewer").hidden = !wanted;
  if (wanted) find("viewer").src = "rerun.html"; else find("viewer").removeAttribute("src");
  told = null; // the viewer begins with the newest
}

// null: the newest is followed
export function tellTime(at) {
  const seek = find("viewer").hidden ? null : find("viewer").contentWindow?.seek, now = performance.now();
  if (!seek || at === told || now - last < APART_MS) return;
  told = at;
  last = now;
  seek(at);
}

find("rerun").onclick = () => open(find("viewer").hidden);
