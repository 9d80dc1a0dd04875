// SPDX-License-Identifier: Apache-2.0
// The second of two runs in one view: its curves and pictures, at equal time or at equal angle of the cycle.

import { Curve, unpacked } from "./curves.js";

export class Other {
  constructor() { this.angle = null; this.byAngle = false; this.isDifference = false; this.clear(); }

  clear() { this.pictures = []; this.curves = new Map(); }

  get isThere() { return this.pictures.length > 0; }

  add(picture, widths) {
    for (const [path, [times, values]] of Object.entries(picture.curves)) {
      if (!widths.has(path)) continue;
      if (!this.curves.has(path)) this.curves.set(path, new Curve(widths.get(path).width));
      this.curves.get(path).add(times, values);
    }
    this.pictures.push({ time_s: picture.time_s, shapes: picture.shapes });
  }

  know(pairs) { this.angle = pairs && pairs.map((text) => unpacked(text, Float64Array)); }

  // the time of this run that corresponds to a time of the first, and the inverse
  own(time) { return this.byAngle && this.angle ? between(this.angle[1], this.angle[0], time) : time; }
  first(time) { return this.byAngle && this.angle ? between(this.angle[0], this.angle[1], time) : time; }

  picture(time) {
    const at = this.own(time);
    const place = rank(this.pictures.length, (i) => this.pictures[i].time_s, at);
    return this.pictures[Math.max(0, place)];
  }

  // times and columns of a time range of the first run
  between(path, from, to, most) {
    const curve = this.curves.get(path);
    if (!curve) return null;
    const [times, ...columns] = curve.between(this.own(from), this.own(to), most);
    return [this.byAngle ? Float64Array.from(times, (time) => this.first(time)) : times, ...columns];
  }

  // values of the first run minus this one, at the times of the first that both have
  difference(path, [times, ...columns]) {
    const curve = this.curves.get(path);
    if (!curve?.rows) return null;
    const known = curve.times.subarray(0, curve.rows), own = Float64Array.from(times, (time) => this.own(time));
    const rows = Uint32Array.from(own.keys()).filter((row) => own[row] >= known[0] && own[row] <= known.at(-1));
    const places = Float64Array.from(rows, (row) => placeIn(known, own[row]));
    const taken = curve.values.map((values, column) => Float64Array.from(rows, (row, i) => columns[column][row] - valueAt(values, places[i])));
    return [Float64Array.from(rows, (row) => times[row]), ...taken];
  }
}

function rank(count, at, value) {
  let low = -1, high = count - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (at(middle) <= value + 1e-9) low = middle; else high = middle - 1;
  }
  return low;
}

// linear interpolation, constant beyond the ends
function between(xs, ys, x) { return xs.length ? valueAt(ys, placeIn(xs, x)) : x; }

// row number of a time, with its share of the way to the next row
function placeIn(xs, x) {
  const row = rank(xs.length, (i) => xs[i], x);
  if (row < 0 || row >= xs.length - 1) return Math.max(0, row);
  return row + Math.min(1, Math.max(0, (x - xs[row]) / (xs[row + 1] - xs[row] || 1)));
}

function valueAt(ys, place) {
  const row = Math.floor(place);
  return place > row ? ys[row] + (place - row) * (ys[row + 1] - ys[row]) : ys[row];
}
