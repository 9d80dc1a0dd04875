// SPDX-License-Identifier: Apache-2.0
// The drawing of the machine: lines, points, arrows and texts in the machine's plane, on a canvas.

import { isDark, paint, unpacked } from "./curves.js";
import { shown } from "./state.js";

const HEAD_PX = 9, SEAM_PX = 4;
const CLOSEST = 40; // largest zoom factor
const STEP_PX = 40, STEP = 1.25; // shift and zoom factor per key press
const look = { zoom: 1, x: 0, y: 0 }; // zoom factor, and shift of the centre (px)

export function draw(canvas, shapes, bounds, under = null) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (!width || !height || !bounds) return;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const [left, right, low, high] = bounds;
  const scale = look.zoom * Math.min(width / (right - left), height / (high - low));
  const x0 = look.x + (width - scale * (right - left)) / 2 - scale * left;
  const y0 = look.y + (height + scale * (high - low)) / 2 + scale * low;
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  const at = { context, x0, y0, scale };
  if (under) {
    context.globalAlpha = 0.3;
    trace(at, under);
    context.globalAlpha = 1;
  }
  for (const [text, place] of trace(at, shapes)) write(context, text, place, width);
}

// draw all shapes except texts, and return the texts with their positions
function trace({ context, x0, y0, scale }, shapes) {
  const points = shapes.unpacked ??= unpacked(shapes.points, Float32Array);
  const texts = [];
  let first = 0;
  shapes.counts.forEach((count, place) => {
    const at = Array.from({ length: count }, (_, i) =>
      [x0 + scale * points[2 * (first + i)], y0 - scale * points[2 * (first + i) + 1]]);
    first += count;
    const [red, green, blue] = shapes.colours[place];
    const colour = shade(red, green, blue);
    const size = Math.max(1.25, scale * shapes.widths[place]);
    const text = shapes.texts[place];
    const kind = shapes.kinds[place];
    if (kind === "l") line(context, at, colour, size);
    else if (kind === "a") arrow(context, at, colour, size);
    else if (kind === "p") dots(context, at, colour, size);
    if (text && (kind === "t" || kind === "p")) texts.push([text, at[0]]);
  });
  return texts;
}

// lighten the machine's colours, made for a light background, in the dark theme
function shade(red, green, blue) {
  const lift = isDark() ? (part) => Math.round(255 - 0.62 * (255 - part)) : (part) => part;
  return `rgb(${lift(red)} ${lift(green)} ${lift(blue)})`;
}

function line(context, at, colour, size) {
  context.strokeStyle = colour;
  context.lineWidth = size;
  context.lineJoin = context.lineCap = "round";
  context.beginPath();
  at.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.stroke();
}

function dots(context, at, colour, size) {
  context.fillStyle = colour;
  for (const [x, y] of at) {
    context.beginPath();
    context.arc(x, y, Math.max(1.5, size / 2), 0, 2 * Math.PI);
    context.fill();
  }
}

function arrow(context, at, colour, size) {
  const [[x1, y1], [x2, y2]] = at;
  const length = Math.hypot(x2 - x1, y2 - y1);
  if (!(length > 0.5)) return;
  const along = [(x2 - x1) / length, (y2 - y1) / length], head = Math.min(HEAD_PX, length);
  const back = [x2 - head * along[0], y2 - head * along[1]];
  line(context, [[x1, y1], back], colour, Math.min(size, 4));
  context.fillStyle = colour;
  context.beginPath();
  context.moveTo(x2, y2);
  context.lineTo(back[0] - 0.45 * head * along[1], back[1] + 0.45 * head * along[0]);
  context.lineTo(back[0] + 0.45 * head * along[1], back[1] - 0.45 * head * along[0]);
  context.fill();
}

// zoom about a point of the canvas, relative to its centre (px)
function near(factor, x = 0, y = 0) {
  const zoom = Math.max(1, Math.min(CLOSEST, look.zoom * factor)), by = zoom / look.zoom;
  Object.assign(look, zoom === 1 ? { x: 0, y: 0 } : { x: x - by * (x - look.x), y: y - by * (y - look.y) }, { zoom });
  shown.drawn = null;
}

function move(x, y) {
  look.x += x;
  look.y += y;
  shown.drawn = null;
}

export function listen(canvas) {
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const box = canvas.getBoundingClientRect();
    near(Math.exp(-event.deltaY / 400), event.clientX - box.left - box.width / 2, event.clientY - box.top - box.height / 2);
  }, { passive: false });
  canvas.addEventListener("pointerdown", (event) => { if (event.button === 0) canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointermove", (event) => { if (canvas.hasPointerCapture(event.pointerId)) move(event.movementX, event.movementY); });
  canvas.addEventListener("dblclick", () => near(0));
  canvas.addEventListener("keydown", (event) => {
    const does = {
      "+": () => near(STEP), "-": () => near(1 / STEP), 0: () => near(0),
      ArrowLeft: () => move(STEP_PX, 0), ArrowRight: () => move(-STEP_PX, 0), ArrowUp: () => move(0, STEP_PX), ArrowDown: () => move(0, -STEP_PX),
    }[event.key];
    if (!does || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    does();
  });
}

// dark text with a light outline, centred below its point, inside the canvas
function write(context, text, [x, y], width) {
  const rows = text.split("\n");
  context.font = "12px system-ui, sans-serif";
  context.textBaseline = "top";
  const wide = Math.max(...rows.map((row) => context.measureText(row).width)) + 8;
  const left = Math.max(2, Math.min(width - wide - 2, x - wide / 2));
  context.strokeStyle = paint("--sheet");
  context.fillStyle = paint("--ink");
  context.lineWidth = SEAM_PX;
  context.lineJoin = "round";
  rows.forEach((row, i) => {
    context.strokeText(row, left + 4, y + 3 + 15 * i);
    context.fillText(row, left + 4, y + 3 + 15 * i);
  });
}
