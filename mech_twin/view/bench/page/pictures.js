// SPDX-License-Identifier: Apache-2.0
// The pictures of a run stored in this page; the oldest are dropped.

import { answer, curves, find, lanes, other, run, shown } from "./state.js";

const KEPT_BYTES = 200e6; // largest total size of the pictures in this page
let isCut = false; // whether the beginning of the run is no longer here

export function take(list) {
  for (const picture of list) {
    if (picture.side) { other.add(picture, curves); shown.drawn = null; continue; }
    for (const [path, [times, values]] of Object.entries(picture.curves)) curves.get(path)?.add(times, values);
    picture.size = 300 + (picture.shapes?.points.length ?? 0) + 60 * (picture.shapes?.counts.length ?? 0);
    delete picture.curves;
    for (const lane of picture.lanes ?? []) lanes.add(...lane);
    delete picture.lanes;
    // a picture without a drawing keeps the previous one
    if (!picture.shapes) picture.shapes = run.pictures.at(-1)?.shapes ?? null;
    run.pictures.push(picture);
    run.bytes += picture.size;
    for (const [time, text] of picture.events) note(time, text);
  }
  while (run.bytes > KEPT_BYTES) { run.bytes -= run.pictures.shift().size; shown.place -= 1; isCut ||= tellCut(); }
  shown.heard = performance.now();
  shown.owed = true;
  if (run.pictures.length) find("cover").hidden = true;
}

function tellCut() {
  answer(`This page keeps ${KEPT_BYTES / 1e6} MB of pictures: the oldest are no longer here.`, "refused");
  return true;
}

export function note(time, text) {
  const line = document.createElement("li");
  const button = document.createElement("button");
  Object.assign(button, { type: "button", textContent: text.replace("->", "\u2192"), title: "go to this time" });
  button.dataset.time = time;
  line.append(button);
  find("log").hidden = false;
  find("events").prepend(line);
  while (find("events").childElementCount > 300) find("events").lastChild.remove();
}

export function placeOf(time) {
  let low = 0, high = run.pictures.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (run.pictures[middle].time_s <= time + 1e-9) low = middle; else high = middle - 1;
  }
  return low;
}

export function forget() {
  run.pictures = []; run.bytes = 0; isCut = false;
  for (const curve of curves.values()) curve.clear();
  lanes.clear();
  other.clear();
  Object.assign(shown, { place: -1, drawn: null, at: 0 });
  find("events").replaceChildren();
}
