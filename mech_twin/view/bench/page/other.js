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

  // values of the first run minus this one, at the times of the first
  difference(path, [times, ...columns]) {
    const curve = this.curves.get(path);
    if (!curve) return null;
    const own = Float64Array.from(times, (time) => this.own(time));
    return [times, ...columns.map((column, place) => Array.from(column, (value, row) => {
      const at = own[row];
      if (!curve.rows || at < curve.times[0] || at > curve.times[curve.rows - 1]) return null;
      return value - between(curve.times.subarray(0, curve.rows), curve.values[place], at);
    }))];
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
function between(xs, ys, x) {
  const last = xs.length - 1;
  if (last < 0) return x;
  const place = rank(xs.length, (i) => xs[i], x);
  if (place < 0) return ys[0];
  if (place >= last) return ys[last];
  const share = (x - xs[place]) / (xs[place + 1] - xs[place] || 1);
  return ys[place] + Math.min(1, Math.max(0, share)) * (ys[place + 1] - ys[place]);
}
