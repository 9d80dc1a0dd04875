// SPDX-License-Identifier: Apache-2.0
// The plots: visibility, zoom by dragging, and the values at a common cursor.

import { colours, paint } from "./curves.js";
import { RIGHT } from "./lanes.js";

const HEIGHT = 118;
const DRAGGED_PX = 5; // a shorter drag is a click
const NARROW = 16; // longest name (letters) for two legend entries with values side by side
const TINY = 1e-9, ROUNDING = 1e-6; // smallest value read off; values are rounded to a few times 1e-8 of their size
const STEP = 0.01; // share of the window by which an arrow key moves the cursor

export class Plots {
  // source: pieces(part, from, to), second(part, from, to); zoomed: called with [from, to], or null for the selected
  // span; sought: called with the time of a click
  constructor(box, source, zoomed, sought) {
    Object.assign(this, { box, source, zoomed, sought, mark: null, stamp: "", list: [], hidden: new Set(), from: 0, to: 1, now: 1, share: null, at: null, ofTwo: false });
  }

  layOut(panels) {
    for (const plot of this.list) plot.remove();
    this.list = panels.map((panel) => new Plot(panel, this));
    this.hide(this.hidden);
  }

  hide(titles) {
    this.hidden = new Set(titles);
    for (const plot of this.list) plot.box.hidden = this.hidden.has(plot.title);
  }

  get shown() { return this.list.filter((plot) => !plot.box.hidden); }

  // whether the values of two runs are shown; space for both is reserved, so that no plot moves under the mouse
  get ofTwo() { return this.box.classList.contains("two"); }
  set ofTwo(wanted) { this.box.classList.toggle("two", wanted); }

  // while the newest is followed, the cursor keeps its position on the page, otherwise its time; the time shown has a
  // mark if the plots extend beyond it; a plot with an unchanged stamp is not redrawn
  show(from, now, to, { isLive, at, stamp }) {
    const mark = (at - from) / (to - from);
    Object.assign(this, { from, now, to, mark: mark < 1 - 1e-9 ? mark : null, stamp: `${from} ${now} ${to} ${stamp}` });
    if (this.share !== null && isLive) this.at = from + this.share * (to - from);
    else if (this.share !== null) this.share = (this.at - from) / (to - from);
    for (const plot of this.shown) plot.show();
    this.read();
  }

  point(share) {
    this.share = share === null ? null : Math.max(0, Math.min(1, share));
    this.at = share === null ? null : this.from + this.share * (this.to - this.from);
    this.read();
  }

  read() {
    for (const plot of this.shown) plot.read(this.at, this.share);
    this.source.pointed(this.at);
  }

  zoom(one, other) {
    const [low, high] = [Math.min(one, other), Math.max(one, other)], wide = this.to - this.from;
    this.zoomed([this.from + low * wide, this.from + high * wide]);
  }

  key(event) {
    const near = this.share ?? 0.5, step = (event.shiftKey ? 10 : 1) * STEP;
    const does = {
      ArrowLeft: () => this.point(near - step),
      ArrowRight: () => this.point(near + step),
      Home: () => this.point(0),
      End: () => this.point(1),
      "+": () => this.zoom(near - near / 2, near + (1 - near) / 2),
      "-": () => this.zoom(-near, 2 - near),
      0: () => this.zoomed(null),
      Escape: () => this.point(null),
      Enter: () => this.at !== null && this.sought(this.at),
    }[event.key];
    if (!does || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    does();
  }

  fit() { for (const plot of this.list) plot.fit(); }
}

class Plot {
  constructor(panel, all) {
    this.all = all;
    this.title = panel.title;
    this.parts = panel.curves.map(({ path, names }) => ({ path, names }));
    this.names = this.parts.flatMap((part) => part.names);
    this.colours = colours(this.names.length);
    this.box = made("section", { className: "plot", tabIndex: 0 });
    this.box.setAttribute("aria-label", `${panel.title}; arrow keys move the cursor, + and - zoom, 0 shows all again`);
    const holder = made("div"), legend = made("ul", { className: "legend" });
    this.box.append(made("h2", { textContent: panel.title }), holder, legend);
    this.values = this.names.map((name, place) => {
      const item = key(name, this.colours[place]), value = made("b");
      item.classList.toggle("wide", name.length > NARROW);
      item.append(value);
      legend.append(item);
      return value;
    });
    all.box.append(this.box);
    const axis = { stroke: () => paint("--ink"), grid: { stroke: () => paint("--grid"), width: 1 }, ticks: { stroke: () => paint("--tick"), width: 1 }, font: "12px system-ui" };
    const line = (label, place, dash) => ({ label, stroke: this.colours[place], width: 1.5, dash, points: { show: false }, spanGaps: true });
    this.plot = new uPlot({
      width: this.width, height: HEIGHT, padding: [8, RIGHT, 0, 0],
      legend: { show: false },
      cursor: { show: false },
      scales: { x: { time: false }, y: { range: (_, low, high) => padded(low, high) } },
      series: [{}, ...this.names.map((name, place) => line(name, place)), ...this.names.map((name, place) => line(`${name}, tried`, place, [5, 4]))],
      axes: [{ ...axis, size: 24, gap: 2, values: (_, ticks) => ticks.map((tick) => `${Number(tick.toFixed(6))} s`), space: 64 },
        { ...axis, size: 76, values: (_, ticks) => labels(ticks), space: 15 }],
    }, null, holder);
    this.line = made("div", { className: "reading", hidden: true });
    this.band = made("div", { className: "band", hidden: true });
    this.mark = made("div", { className: "shown-at", hidden: true });
    this.plot.over.append(this.band, this.mark, this.line);
    this.listen();
    this.visible = true;
    new IntersectionObserver((seen) => { this.visible = seen.at(-1).isIntersecting; this.show(); }, { root: all.box }).observe(this.box);
  }

  get width() { return Math.max(160, this.all.box.clientWidth - 16); }

  listen() {
    const over = this.plot.over, share = (event) => (event.clientX - over.getBoundingClientRect().left) / over.clientWidth;
    let begun = null;
    const end = () => { begun = null; this.band.hidden = true; };
    over.addEventListener("pointerdown", (event) => { if (event.button === 0) { begun = share(event); over.setPointerCapture(event.pointerId); } });
    over.addEventListener("pointermove", (event) => {
      this.all.point(share(event));
      if (begun === null) return;
      const low = Math.max(0, Math.min(begun, share(event))), high = Math.min(1, Math.max(begun, share(event)));
      Object.assign(this.band.style, { left: `${100 * low}%`, width: `${100 * (high - low)}%` });
      this.band.hidden = false;
    });
    over.addEventListener("pointerup", (event) => {
      const from = begun, to = share(event);
      end();
      if (from === null) return;
      if (Math.abs(to - from) * over.clientWidth <= DRAGGED_PX) this.all.sought(this.all.at);
      else this.all.zoom(Math.max(0, Math.min(1, from)), Math.max(0, Math.min(1, to)));
    });
    over.addEventListener("pointercancel", end);
    over.addEventListener("pointerleave", () => { if (begun === null) this.all.point(null); });
    over.addEventListener("dblclick", () => this.all.zoomed(null));
    this.box.addEventListener("keydown", (event) => this.all.key(event));
  }

  show() {
    if (!this.visible) return;
    const { from, now, to, source, mark, stamp } = this.all;
    this.mark.hidden = mark === null;
    if (mark !== null) this.mark.style.left = `${100 * mark}%`;
    if (this.stamp === stamp) return;
    this.stamp = stamp;
    const pieces = this.parts.map((part) => source.pieces(part, from, now));
    for (const part of this.parts) pieces.push(source.second(part, from, to));
    const data = uPlot.join(pieces);
    this.plot.batch(() => {
      this.plot.setData(data, false);
      this.plot.setScale("x", { min: from, max: to });
      this.plot.setScale("y", { min: null, max: null });
    });
  }

  // show the values at a time, interpolated linearly
  read(at, share) {
    const isIn = at !== null && share >= 0 && share <= 1;
    this.line.hidden = !isIn;
    if (isIn) this.line.style.left = `${100 * share}%`;
    this.values.forEach((value, place) => {
      const read = isIn ? [place, place + this.names.length].slice(0, this.all.ofTwo ? 2 : 1).map((column) => valueAt(this.plot.data, column + 1, at)) : [];
      const text = read.filter((each) => each !== null).map(readOff).join(" | ");
      if (value.textContent !== text) value.textContent = text;
    });
  }

  fit() { this.plot.setSize({ width: this.width, height: HEIGHT }); }

  remove() { this.plot.destroy(); this.box.remove(); }
}

function valueAt(data, column, at) {
  const times = data?.[0] ?? [], values = data?.[column] ?? [];
  let low = 0, high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= at) low = middle + 1; else high = middle;
  }
  let before = low - 1, after = low;
  while (before >= 0 && values[before] == null) before -= 1;
  while (after < times.length && values[after] == null) after += 1;
  if (before >= 0 && times[before] === at) return values[before];
  if (before < 0 || after >= times.length) return null;
  return values[before] + ((values[after] - values[before]) * (at - times[before])) / (times[after] - times[before]);
}

// a curve that varies by rounding alone is drawn as a straight line
export function padded(low, high) {
  if (low === null || high === null) return [0, 1];
  const isFlat = high - low <= Math.max(TINY, ROUNDING * Math.max(Math.abs(low), Math.abs(high)));
  const room = isFlat ? Math.max(1e-3, 0.05 * Math.abs(high)) : 0.05 * (high - low);
  return [low - room, high + room];
}

function short(value, digits = 4) {
  const size = Math.abs(value);
  if (size >= 1e6) return `${Number((value / 1e6).toPrecision(digits))}M`;
  if (size >= 1e4) return `${Number((value / 1e3).toPrecision(digits))}k`;
  return String(Number(value.toPrecision(digits)));
}

// labels of an axis, with as many digits as tell its ticks apart
export function labels(ticks) {
  const largest = Math.max(...ticks.map(Math.abs)), step = Math.abs(ticks[1] - ticks[0]) || largest;
  const digits = Math.max(4, Math.min(9, 2 + Math.floor(Math.log10(largest)) - Math.floor(Math.log10(step))));
  return ticks.map((tick) => short(tick, Number.isFinite(digits) ? digits : 4));
}

const readOff = (value) => (Math.abs(value) < TINY ? "0" : short(value));

export function made(kind, properties = {}) { return Object.assign(document.createElement(kind), properties); }

export function key(name, colour) {
  const item = made("li"), sample = made("canvas", { width: 14, height: 8 });
  const context = sample.getContext("2d");
  context.fillStyle = colour;
  context.fillRect(0, 2, 14, 4);
  item.append(sample, name.replaceAll("_", " "));
  return item;
}
