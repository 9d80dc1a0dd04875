// SPDX-License-Identifier: Apache-2.0
// Lanes of regimes: the regime of each part of the machine over time.

import { colours, paint } from "./curves.js";

export const RIGHT = 18; // px, margin right of lanes and plots: half the width of the last time label
const ROW = 18, LEFT = 76, MOST = 100_000;

export class Lanes {
  constructor() { this.clear(); }

  clear() { this.lanes = new Map(); this.words = []; }

  get size() { return this.lanes.size; }

  add(name, begin, word, changes) {
    if (!this.lanes.has(name)) this.lanes.set(name, { times: [], words: [] });
    const lane = this.lanes.get(name);
    for (const [time, regime] of [[begin, word], ...changes]) {
      if (lane.words.at(-1) === regime) continue;
      if (!this.words.includes(regime)) this.words.push(regime);
      lane.times.push(time);
      lane.words.push(regime);
    }
    if (lane.times.length > MOST) { lane.times.splice(0, MOST / 2); lane.words.splice(0, MOST / 2); }
  }

  // the regime of each lane at a time, for screen readers and tests
  at(time) {
    return Object.fromEntries([...this.lanes].map(([name, lane]) => [name, lane.words[before(lane.times, time)] ?? ""]));
  }

  // position (px) of a share of the window
  place(canvas, share) {
    const left = Math.min(LEFT, canvas.clientWidth / 3);
    return left + share * (canvas.clientWidth - left - RIGHT);
  }

  draw(canvas, from, to, now) {
    const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = ROW * this.lanes.size;
    if (!width) return;
    canvas.style.height = `${height}px`;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const context = canvas.getContext("2d"), hues = colours(this.words.length);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    context.font = "12px system-ui, sans-serif";
    context.textBaseline = "middle";
    const left = Math.min(LEFT, width / 3), place = (time) => left + (width - left - RIGHT) * (time - from) / (to - from);
    const clamp = (x) => Math.max(left, Math.min(width - RIGHT, x));
    [...this.lanes].forEach(([name, lane], row) => {
      const middle = ROW * row + ROW / 2;
      context.fillStyle = paint("--ink");
      context.font = "11px system-ui, sans-serif";
      context.fillText(name, 2, middle, left - 4);
      context.font = "12px system-ui, sans-serif";
      const first = Math.max(0, before(lane.times, from));
      for (let i = first; i < lane.times.length && lane.times[i] <= now; i += 1) {
        const begin = clamp(place(lane.times[i])), end = clamp(place(Math.min(now, lane.times[i + 1] ?? now)));
        if (end <= begin) continue;
        context.fillStyle = hues[this.words.indexOf(lane.words[i])];
        context.fillRect(begin, middle - 7, Math.max(1, end - begin), 14);
        if (end - begin > context.measureText(lane.words[i]).width + 6) {
          context.fillStyle = paint("--sheet");
          context.fillText(lane.words[i], begin + 3, middle + 1);
        }
      }
    });
    canvas.setAttribute("aria-label", Object.entries(this.at(now)).map(([name, word]) => `${name}: ${word}`).join(", "));
  }
}

function before(times, time) {
  let low = -1, high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= time + 1e-9) low = middle; else high = middle - 1;
  }
  return low;
}
