// SPDX-License-Identifier: Apache-2.0
// Curves with common times: received in base 64, stored in growing arrays.

const MOST_ROWS = 400_000; // per path; then the older half is thinned

export function unpacked(text, Kind) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Kind(bytes.buffer);
}

export class Curve {
  constructor(width) {
    this.width = width;
    this.clear();
  }

  clear() {
    this.rows = 0;
    this.times = new Float64Array(1024);
    this.values = Array.from({ length: this.width }, () => new Float32Array(1024));
  }

  add(times, values) {
    const at = unpacked(times, Float64Array), packed = unpacked(values, Float32Array);
    if (packed.length !== at.length * this.width) return;
    this.makeRoom(at.length);
    this.times.set(at, this.rows);
    this.values.forEach((column, place) => {
      for (let row = 0; row < at.length; row += 1) column[this.rows + row] = packed[row * this.width + place];
    });
    this.rows += at.length;
  }

  // times and columns of a time range, with one row beyond each end so that lines reach the edges; at most `most` rows
  between(from, to, most = Infinity) {
    const first = Math.max(0, this.before(from)), last = Math.min(this.rows, this.before(to + 1e-9) + 1);
    return thinned([this.times, ...this.values].map((column) => column.subarray(first, last)), most);
  }

  before(time) {
    let low = -1, high = this.rows - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.times[middle] <= time) low = middle; else high = middle - 1;
    }
    return low;
  }

  // keep at most half of the first `count` rows, with their extremes
  thin(count) {
    const rows = extremes(this.values.map((column) => column.subarray(0, count)), count >> 1);
    for (const column of [this.times, ...this.values]) {
      rows.forEach((row, place) => { column[place] = column[row]; });
      column.copyWithin(rows.length, count, this.rows);
    }
    this.rows += rows.length - count;
  }

  makeRoom(count) {
    if (this.rows > MOST_ROWS) this.thin(this.rows >> 1);
    if (this.rows + count <= this.times.length) return;
    const size = 2 * (this.rows + count);
    const grown = (old, Kind) => { const fresh = new Kind(size); fresh.set(old.subarray(0, this.rows)); return fresh; };
    this.times = grown(this.times, Float64Array);
    this.values = this.values.map((column) => grown(column, Float32Array));
  }
}

// times and columns with at most `most` rows
export function thinned(all, most) {
  if (all[0].length <= most) return all;
  const rows = extremes(all.slice(1), most);
  return all.map((column) => column.constructor.from(rows, (row) => column[row]));
}

// row numbers after decimation: the ends, and the extremes of every column in each window
function extremes(columns, most) {
  const count = columns[0].length, windows = Math.max(1, Math.floor((most - 2) / (2 * columns.length))), kept = new Set([0, count - 1]);
  for (let place = 0; place < windows; place += 1) {
    const begin = Math.floor((count * place) / windows), end = Math.floor((count * (place + 1)) / windows);
    for (const column of columns) {
      let low = begin, high = begin;
      for (let row = begin + 1; row < end; row += 1) {
        if (column[row] < column[low]) low = row;
        if (column[row] > column[high]) high = row;
      }
      kept.add(low).add(high);
    }
  }
  return Uint32Array.from(kept).sort();
}

// a colour of the style sheet in the present theme
let scheme = null;
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => location.reload());

export function isDark() { return paint("--theme") === "dark"; }

export function paint(name) {
  scheme ??= new Map();
  if (!scheme.has(name)) scheme.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return scheme.get(name);
}

// contrast at least 3 to 1 on white, distinguishable by colour-blind readers (after Okabe and Ito, darkened)
const NAMED = ["#0b6fb8", "#b35c00", "#00795a", "#a8387f", "#5b4bc4", "#7a6a00", "#c0392b", "#3d4b57"];
const ON_DARK = ["#56b4e9", "#e69f00", "#2fc79d", "#ee8fc7", "#a99bff", "#d8c64a", "#ff8a80", "#b3bbc4"];

export function colours(count) {
  const dark = isDark();
  if (count <= NAMED.length) return (dark ? ON_DARK : NAMED).slice(0, count);
  if (dark) return Array.from({ length: count }, (_, place) => `hsl(${Math.round((360 * place) / count)} 75% ${place % 2 ? 68 : 80}%)`);
  return Array.from({ length: count }, (_, place) => legible((360 * place) / count, place % 2 ? 27 : 40));
}

// a hue with the given lightness, or darker until its contrast on white is at least 4 to 1
function legible(hue, lightness) {
  for (let light = lightness; ; light -= 1) {
    const rgb = [0, 8, 4].map((n) => {
      const k = (n + hue / 30) % 12;
      return light / 100 - 0.75 * Math.min(light / 100, 1 - light / 100) * Math.max(-1, Math.min(k - 3, 9 - k, 1));
    });
    const linear = rgb.map((v) => (v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4));
    const luminance = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
    if (1.05 / (luminance + 0.05) >= 4) return `rgb(${rgb.map((v) => Math.round(255 * v)).join(" ")})`;
  }
}
