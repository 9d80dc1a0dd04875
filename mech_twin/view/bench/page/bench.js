// SPDX-License-Identifier: Apache-2.0
// The bench's page: draws the pictures of a run, and sends orders.  Everything on it is of one instant, the cursor's.

import { colours, Curve } from "./curves.js";
import { draw } from "./drawing.js";
import * as report from "./report.js";
import { Other } from "./other.js";
import { Lanes } from "./lanes.js";
import { key, made, Plots } from "./plots.js";
import { adviceRow, faultRow } from "./twin.js";

const find = (id) => document.getElementById(id);
const KEPT_BYTES = 200e6; // of pictures in this page; the oldest go first
const RETRY_MS = 1000;
const QUIET_MS = 1500;
const PAGE_LAG_S = 0.5; // that a picture may be older than the state a trial went on from
const FIRST_NUMBERS = 6; // that stand open

const token = (() => {
  // only this page of this port may know it: the session's storage is by origin, the fragment is sent to nobody
  if (location.hash.length > 1) sessionStorage.setItem("token", location.hash.slice(1));
  return sessionStorage.getItem("token") ?? "";
})();

const run = { pictures: [], bytes: 0, machine: null, orders: [], paused: false, over: "", commands: false };
const shown = { following: true, playing: false, at: 0, span: null, place: -1, drawn: null, last: 0, heard: 0 };
const curves = new Map(); // path -> Curve
const lanes = new Lanes(), other = new Other();
const plots = new Plots(find("plots"), {
  pieces(part, from, to) {
    const piece = curves.get(part.path)?.between(from, to) ?? empty(part);
    return (other.isThere && other.isDifference ? other.difference(part.path, piece) : piece) ?? empty(part);
  },
  second(part, from, to) {
    const found = other.isThere ? !other.isDifference && other.between(part.path, from, to) : plots.to > plots.now && ghost.curves.get(part.path)?.between(from, to);
    return found || empty(part);
  },
  told(at) {
    find("reading").textContent = at === null ? "" : `cursor t = ${at.toFixed(5)} s`;
    const words = at === null ? [] : Object.entries(lanes.at(at)).map(([name, word]) => `${name}: ${word}`);
    find("lane-reading").textContent = words.join(", ");
    find("lane-line").hidden = !(plots.share >= 0 && plots.share <= 1) || at === null;
    if (at !== null) find("lane-line").style.left = `${lanes.place(find("lane-drawing"), plots.share)}px`;
  },
}, zoomed);
const empty = (part) => [[], ...part.names.map(() => [])];
let socket = null;
let asked = 0;
let owed = false;
const waiting = new Map(); // id of an order -> what to do with the answer
const undone = [];
const ghost = { curves: new Map(), from: Infinity, until: -1, begun: 0, asked: null, next: null, times: [] };

// -- connection -------------------------------------------------------------------------------------------------------

function connect() {
  if (!token) return say("This page needs the whole address that the terminal printed, with all that follows the #.");
  socket = new WebSocket(`ws://${location.host}/feed`);
  socket.onopen = () => { forget(); ghost.asked = null; socket.send(token); };
  socket.onmessage = (event) => hear(JSON.parse(event.data));
  socket.onclose = (event) => {
    commands(false);
    if (event.reason === "token") return say("The address is of another run: its token is not right here.");
    find("state").textContent = "no connection";
    find("role").textContent = "trying to reach the bench again";
    if (!run.pictures.length) say("The bench does not answer; trying again.");
    setTimeout(connect, RETRY_MS);
  };
}

function send(message) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

function order(name, more = {}, then = () => {}) {
  asked += 1;
  waiting.set(asked, then);
  send({ kind: "order", id: asked, name, ...more });
}

function hear(message) {
  const does = {
    pictures: () => take(message.list),
    machine: () => know(message),
    layout: () => layOut(message.panels),
    status: () => say(message.text),
    health: () => showHealth(message),
    comparison: () => showComparison(message),
    metrics: () => showMetrics(message.rows),
    role: () => showRole(message),
    answer: () => answered(message),
    changed: () => changed(message.name, message.value),
    pause: () => { run.paused = message.is_paused; showPause(); },
    alarms: () => showFaults(message.faults),
    advice: () => showAdvice(message.rows),
    end: () => { run.over = message.text; answer(message.text, "done"); },
    ghost: () => showGhost(message),
    anew: () => { forget(); if (message.all) beginAnew(); },
    hall: () => showHall(message),
    versions: () => { run.versions = message.text; },
    offer: () => { if (run.commands) message.files.forEach(fetchFile); },
  }[message.kind];
  if (does) does();
}

function say(text) {
  find("status").textContent = text;
  find("cover").hidden = run.pictures.length > 0;
  if (!run.pictures.length) find("state").textContent = "starting";
}

function forget() {
  run.pictures = []; run.bytes = 0;
  for (const curve of curves.values()) curve.clear();
  lanes.clear();
  other.clear();
  Object.assign(shown, { place: -1, drawn: null, at: 0 });
  find("events").replaceChildren();
}

// -- pictures ---------------------------------------------------------------------------------------------------------

function take(list) {
  for (const picture of list) {
    if (picture.side) { other.add(picture, curves); shown.drawn = null; continue; }
    for (const [path, [times, values]] of Object.entries(picture.curves)) curves.get(path)?.add(times, values);
    picture.size = 300 + (picture.shapes?.points.length ?? 0) + 60 * (picture.shapes?.counts.length ?? 0);
    delete picture.curves;
    for (const lane of picture.lanes ?? []) lanes.add(...lane);
    delete picture.lanes;
    // where nothing is drawn, the drawing before stands
    if (!picture.shapes) picture.shapes = run.pictures.at(-1)?.shapes ?? null;
    run.pictures.push(picture);
    run.bytes += picture.size;
    for (const [time, text] of picture.events) note(time, text);
  }
  while (run.bytes > KEPT_BYTES) { run.bytes -= run.pictures.shift().size; shown.place -= 1; }
  shown.heard = performance.now();
  owed = true;
  if (run.pictures.length) find("cover").hidden = true;
}

function note(time, text) {
  const line = document.createElement("li");
  line.textContent = text;
  line.dataset.time = time;
  find("log").hidden = false;
  find("events").prepend(line);
  while (find("events").childElementCount > 300) find("events").lastChild.remove();
}

function placeOf(time) {
  let low = 0, high = run.pictures.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (run.pictures[middle].time_s <= time + 1e-9) low = middle; else high = middle - 1;
  }
  return low;
}

function frame(now) {
  requestAnimationFrame(frame);
  const passed = Math.min(0.25, (now - shown.last) / 1000);
  shown.last = now;
  const newest = run.pictures.at(-1);
  if (newest) {
    find("cursor").min = run.pictures[0].time_s;
    find("cursor").max = newest.time_s;
    if (shown.following) shown.at = newest.time_s;
    else if (shown.playing) {
      shown.at = Math.min(newest.time_s, shown.at + passed * Number(find("pace").value));
      if (shown.at >= newest.time_s) play(false);
    }
    const place = placeOf(shown.at);
    const picture = run.pictures[place];
    if (picture !== shown.drawn || shown.playing) show(picture, shown.following ? picture.time_s : shown.at);
  }
  if (owed) { owed = false; send({ kind: "drawn" }); }
  const isQuiet = socket?.readyState === WebSocket.OPEN && shown.following && newest && !run.over && run.machine?.namespace && now - shown.heard > QUIET_MS;
  if (isQuiet) find("state").textContent = run.paused ? "paused" : "no new picture";
}

// header, drawing and curves are all of the picture's instant
function show(picture, at) {
  shown.drawn = picture;
  const header = `t = ${picture.time_s.toFixed(run.paused || !shown.following ? 4 : 2)} s`;
  if (find("time").textContent !== header) find("time").textContent = header;
  find("state").textContent = run.over && shown.following ? "over" : picture.state;
  find("alarm").hidden = !picture.alarm;
  find("alarm").textContent = picture.alarm;
  cards(picture.cards);
  if (picture.shapes) draw(find("drawing"), picture.shapes, picture.bounds, other.isThere ? other.picture(at).shapes : null);
  if (picture.command !== null && document.activeElement !== find("speed")) find("speed").value = picture.command;
  if (picture.command !== null) find("speed-now").textContent = `${Math.round(100 * picture.command)} % now`;
  const span = shown.span ?? Number(find("span").value);
  const wanted = Math.max(at, picture.time_s), until = Math.max(wanted, isTried(wanted) ? ghost.until : wanted);
  plots.ofTwo = other.isThere && !other.isDifference;
  plots.show(wanted - span, wanted, until, shown.following);
  find("lanes").hidden = !lanes.size;
  if (find("lane-words").childElementCount !== lanes.words.length) {
    const hues = colours(lanes.words.length);
    find("lane-words").replaceChildren(...lanes.words.map((word, place) => key(word, hues[place])));
  }
  if (lanes.size) lanes.draw(find("lane-drawing"), wanted - span, until, wanted);
  if (document.activeElement !== find("cursor") || shown.following || shown.playing) find("cursor").value = at;
  window.bench.shown = picture.time_s;
  window.bench.onshow?.(picture);
  window.bench.frames += 1;
}

function cards(list) {
  const box = find("cards");
  while (box.childElementCount > list.length) box.lastChild.remove();
  while (box.childElementCount < list.length) {
    const item = document.createElement("li");
    item.append(document.createElement("b"), document.createElement("span"));
    box.append(item);
  }
  list.forEach(([name, value], place) => {
    box.children[place].firstChild.textContent = value;
    box.children[place].lastChild.textContent = name;
  });
}

// -- curves -----------------------------------------------------------------------------------------------------------

function layOut(panels) {
  for (const { curves: list } of panels) {
    for (const { path, names } of list) {
      if (curves.get(path)?.width !== names.length) curves.set(path, new Curve(names.length));
    }
  }
  plots.layOut(panels);
  listPanels();
  shown.drawn = null;
}

// what is shown of a recording, or of a machine that runs, is kept with its name while this window is open
const kept = () => `shown of ${run.machine?.recording ?? run.machine?.name ?? ""}`;

function listPanels() {
  const told = JSON.parse(sessionStorage.getItem(kept()) ?? "{}");
  plots.hide(told.hidden ?? []);
  if (told.span) find("span").value = told.span;
  find("panel-names").replaceChildren(...plots.list.map(({ title }) => {
    const label = made("label"), box = made("input", { type: "checkbox", checked: !plots.hidden.has(title) });
    box.onchange = () => { if (box.checked) plots.hidden.delete(title); else plots.hidden.add(title); plots.hide(plots.hidden); keep(); };
    label.append(box, title);
    return label;
  }));
  find("panels").hidden = !plots.list.length;
}

function keep() {
  sessionStorage.setItem(kept(), JSON.stringify({ hidden: [...plots.hidden], span: find("span").value }));
  shown.drawn = null;
}

// a stretch of time fills the plots, and the picture is of its end; null: the newest again, in the span asked for
function zoomed(range) {
  const first = run.pictures[0]?.time_s, newest = run.pictures.at(-1)?.time_s;
  if (newest === undefined) return;
  if (range === null) { shown.span = null; if (shown.wasFollowing) follow(true); return void (shown.drawn = null); }
  if (shown.span === null) shown.wasFollowing = shown.following;
  const [from, to] = [Math.max(first, range[0]), Math.min(newest, range[1])];
  if (!(to - from > 1e-6)) return;
  follow(false);
  play(false);
  Object.assign(shown, { span: to - from, at: to, drawn: null });
}

// -- commands ---------------------------------------------------------------------------------------------------------

const WORDS = { start: "Start", stop: "Stop motor", reset: "Reset", pause: "Pause", "step": "One step" };

function know(machine) {
  run.machine = machine;
  run.orders = machine.orders;
  find("machine").textContent = machine.name.replaceAll("_", " ");
  document.title = `${machine.name} - bench`;
  const buttons = machine.orders.filter((name) => WORDS[name]);
  find("orders").replaceChildren(...buttons.map((name) => {
    const button = document.createElement("button");
    button.type = "button";
    button.id = `order-${name}`;
    button.textContent = WORDS[name];
    button.onclick = () => order(name === "pause" && run.paused ? "go-on" : name);
    return button;
  }));
  find("command").hidden = !buttons.length;
  find("speed-row").hidden = !machine.orders.includes("speed");
  find("parameters").hidden = !machine.parameters.length;
  find("keys").replaceChildren(...machine.parameters.map(keyRow));
  if (machine.recording) follow(false);
  if (!machine.sides) find("comparison").hidden = true;
  find("differs").hidden = !machine.settings?.length || Boolean(machine.sides);
  find("changed").replaceChildren(...rowsOf(machine.settings ?? []));
  if (plots.list.length) listPanels();
  for (const [name, id] of [["acknowledge", "alarms"], ["accept", "advice"]]) if (!machine.orders.includes(name)) find(id).hidden = true;
  commands(run.commands);
  showPause();
}

function showPause() {
  const button = find("order-pause");
  if (button) { button.textContent = run.paused ? "Go on" : "Pause"; button.setAttribute("aria-pressed", run.paused); }
  if (find("order-step")) find("order-step").hidden = !run.paused;
}

function keyRow(parameter) {
  const row = document.createElement("div");
  row.className = "key";
  row.dataset.name = parameter.name;
  const label = document.createElement("label");
  label.textContent = parameter.name + (parameter.unit ? `, ${parameter.unit}` : "");
  const meaning = document.createElement("p");
  const { low, high } = parameter;
  const range = low == null && high == null ? "" : high == null ? `at least ${rounded(low)}` : low == null ? `at most ${rounded(high)}` : `${rounded(low)} to ${rounded(high)}`;
  meaning.textContent = [parameter.meaning, range].filter(Boolean).join("; ");
  const controls = document.createElement("div");
  controls.className = "row";
  const inputs = parameter.choices.length ? [choice(parameter)]
    : typeof parameter.value === "boolean" ? [tick(parameter)]
    : typeof parameter.value === "number" ? numbers(parameter) : [words(parameter)];
  inputs[0].id = `key-${parameter.name}`;
  label.htmlFor = inputs[0].id;
  controls.append(...inputs);
  const was = document.createElement("p");
  was.className = "was";
  row.append(label, meaning, controls, was);
  return row;
}

function change(name, value) {
  const parameter = run.machine.parameters.find((each) => each.name === name);
  const before = parameter.value;
  if (before === value) return;
  order("change", { values: { [name]: value } }, (isDone) => {
    if (!isDone) return changed(name, before);
    if (undone.at(-1)?.taken !== true) undone.push({ name, before });
    else undone.pop();
    find("undo").disabled = !undone.length || !run.commands;
    changed(name, value);
  });
}

function choice(parameter) {
  const select = document.createElement("select");
  select.append(...parameter.choices.map((word) => new Option(word, word, false, word === parameter.value)));
  select.onchange = () => change(parameter.name, select.value);
  return select;
}

function tick(parameter) {
  const box = document.createElement("input");
  box.type = "checkbox";
  box.checked = parameter.value;
  box.onchange = () => change(parameter.name, box.checked);
  return box;
}

function words(parameter) {
  const box = document.createElement("input");
  box.value = parameter.value;
  box.onchange = () => change(parameter.name, box.value);
  return box;
}

// the slider goes over the range of the key, or about the value where the range is far wider; the number goes anywhere
function numbers(parameter) {
  const slider = document.createElement("input"), number = document.createElement("input");
  slider.type = "range"; number.type = "number";
  const size = Math.abs(parameter.value) || 1;
  const low = Math.max(parameter.low ?? -Infinity, parameter.value >= 0 ? 0 : -3 * size);
  const high = Math.min(parameter.high ?? Infinity, 3 * size);
  slider.min = low; slider.max = high; slider.step = "any";
  number.step = "any";
  slider.value = parameter.value;
  number.value = rounded(parameter.value);
  slider.setAttribute("aria-label", `${parameter.name}, slider`);
  number.setAttribute("aria-label", `${parameter.name}, number`);
  slider.oninput = () => {
    number.value = Number(Number(slider.value).toPrecision(4));
    attempt(parameter.name, Number(number.value));
  };
  slider.onchange = () => change(parameter.name, Number(number.value));
  number.onchange = () => { if (number.value !== "") change(parameter.name, Number(number.value)); };
  return [slider, number];
}

const rounded = (value) => (typeof value === "number" ? Number(value.toPrecision(6)) : value);

function changed(name, value) {
  const parameter = run.machine?.parameters.find((each) => each.name === name);
  const row = find("keys").querySelector(`[data-name="${CSS.escape(name)}"]`);
  if (!parameter || !row) return;
  if (parameter.value !== value) row.querySelector(".was").textContent = `was ${rounded(parameter.value)}`;
  parameter.value = value;
  for (const input of row.querySelectorAll("input, select")) {
    if (input.type === "checkbox") input.checked = value;
    else input.value = input.type === "number" ? rounded(value) : value;
  }
}

function answered(message) {
  waiting.get(message.id)?.(message.is_done);
  waiting.delete(message.id);
  answer(message.text, message.is_done ? "done" : "refused");
}

function answer(text, kind) {
  const line = document.createElement("li");
  line.className = kind;
  line.textContent = text;
  find("answers").prepend(line);
  while (find("answers").childElementCount > 50) find("answers").lastChild.remove();
}

function showRole(message) {
  const others = message.pages > 1 ? `, ${message.pages} pages` : "";
  find("role").textContent = run.machine && !run.orders.length && find("hall").hidden ? ""
    : (message.commands ? "this page commands" : message.free ? "nobody commands" : "another page commands") + others;
  find("take").hidden = message.commands;
  commands(message.commands);
}

function commands(can) {
  run.commands = can;
  for (const each of document.querySelectorAll("#hall button, #command button, #command input, #keys input, #keys select, #alarms button, #advice button")) each.disabled = !can || each.dataset.idle !== undefined;
  find("undo").disabled = !can || !undone.length;
}

function showFaults(faults) {
  find("alarms").hidden = !run.orders.includes("acknowledge");
  find("faults").replaceChildren(...(faults.length ? faults.map((fault) => faultRow(fault, order)) : ["no fault"]));
  commands(run.commands);
}

function showAdvice(rows) {
  find("advice").hidden = !run.orders.includes("accept");
  find("advice-rows").replaceChildren(...rows.map(adviceRow));
  find("advice-none").hidden = rows.length > 0;
  find("advice-answers").hidden = !rows.length;
}

function showMetrics(rows) {
  const lines = rowsOf(rows);
  find("numbers").hidden = !rows.length;
  find("metrics").replaceChildren(...lines.slice(0, FIRST_NUMBERS));
  find("more-metrics").replaceChildren(...lines.slice(FIRST_NUMBERS));
}

// what can be opened where nothing runs yet
function showHall({ folder, recordings, machines }) {
  find("hall").hidden = false;
  find("folder").textContent = folder;
  if (!run.machine && !run.pictures.length) say("Open a recording, or run a machine.");
  find("machines").replaceChildren(...machines.map((name) => new Option(name.split("/").at(-1).replaceAll("_", " "), name)));
  find("recordings").replaceChildren(...(recordings.length ? recordings.map(recordingRow) : ["no recording here"]));
  commands(run.commands);
}

function recordingRow(recording) {
  const row = document.createElement("div");
  row.className = "recording";
  const text = document.createElement("div");
  const length = recording.length_s === null ? "" : `, ${recording.length_s} s`;
  text.textContent = `${recording.name}: ${recording.machine.replaceAll("_", " ") || "no machine"}${length}, ${(recording.size_bytes / 1e6).toFixed(1)} MB, ${recording.state}`;
  const buttons = document.createElement("div");
  buttons.className = "row";
  const button = (word, does) => {
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = word;
    made.onclick = () => does(made);
    buttons.append(made);
  };
  if (recording.opens) {
    button("Open", () => order("open", { values: { recording: recording.name } }));
    if (run.chosen === recording.name) button("No reference", () => choose(""));
    else button("Reference", () => choose(recording.name));
    if (run.chosen && run.chosen !== recording.name) button("Compare with reference", () => order("overlay", { values: { recording: run.chosen, other: recording.name } }));
  } else button("Salvage", () => order("salvage", { values: { recording: recording.name } }));
  button("Download", () => order("download", { values: { recording: recording.name } }));
  if (run.chosen === recording.name) row.classList.add("chosen");
  row.append(text, buttons);
  return row;
}

// the recording that others are compared with
function choose(name) {
  run.chosen = name;
  order("list");
}

function fetchFile({ name, address }) {
  const link = document.createElement("a");
  link.href = address;
  link.download = name;
  link.click();
}

function beginAnew() {
  layOut([]);
  Object.assign(run, { machine: null, orders: [], paused: false, over: "" });
  undone.length = 0;
  for (const id of ["comparison", "numbers", "alarms", "advice", "command", "parameters", "log", "lamp", "differs"]) find(id).hidden = true;
  find("cover").hidden = false;
  find("cards").replaceChildren();
  find("time").textContent = "";
  shown.following = true;
  curves.clear();
  ghost.curves.clear();
  ghost.until = -1;
}

find("list").onclick = () => order("list");
find("begin").onclick = () => order("run", { values: { machine: find("machines").value } });

// two runs in one view: which is which, what differs, and how they are laid over each other
function showComparison({ settings, numbers, angle }) {
  other.know(angle);
  find("comparison").hidden = false;
  find("align").disabled = !angle;
  find("align").title = angle ? "" : "the leading joint does not turn a whole cycle in both runs";
  const [first, second] = run.machine?.sides ?? ["A", "B"];
  find("sides").replaceChildren(`A, solid: ${first}`, document.createElement("br"), `B, dashed: ${second}`);
  find("settings").replaceChildren(...rowsOf(settings.length ? settings : [["no setting differs", "", ""]]));
  find("compared").replaceChildren(...rowsOf(numbers.filter((row) => row[3] !== "0 %")));
  find("equal").textContent = `${numbers.filter((row) => row[3] === "0 %").length} of ${numbers.length} numbers are equal`;
  shown.drawn = null;
}

function rowsOf(rows) {
  return rows.map((row) => {
    const line = document.createElement("tr");
    line.append(...row.map((text) => { const cell = document.createElement("td"); cell.textContent = text; return cell; }));
    return line;
  });
}

find("align").onchange = () => { other.byAngle = find("align").value === "angle"; shown.drawn = null; };
find("how").onchange = () => { other.isDifference = find("how").value === "difference"; shown.drawn = null; };

// one lamp for what must be zero or small: residuals against their limits, and how far the run and this page are behind
function showHealth({ residuals, behind_s: behind }) {
  const broken = residuals.filter((row) => row[3]).length, late = behind !== null && behind > 0.5;
  find("lamp").hidden = false;
  find("lamp").className = broken ? "bad" : late ? "late" : "good";
  find("lamp-text").textContent = broken ? `${broken} residual${broken > 1 ? "s" : ""} over the limit` : late ? `${behind.toFixed(1)} s behind` : "within limits";
  const newest = run.pictures.at(-1);
  const page = newest && shown.following ? `; this page ${Math.max(0, Date.now() / 1000 - newest.sent_s).toFixed(2)} s` : "";
  find("lag").textContent = behind === null ? "" : `behind the wall clock: the run ${behind.toFixed(2)} s${page}`;
  find("residuals").replaceChildren(...residuals.map(([name, worst, limit, isBroken]) => {
    const line = document.createElement("tr");
    line.className = isBroken ? "refused" : "";
    line.append(...[name, worst, limit].map((text) => { const cell = document.createElement("td"); cell.textContent = text; return cell; }));
    return line;
  }));
}

// -- ghost: what would come of a value that is not sent yet -------------------------------------------------------------

// what was tried goes on from the newest: where older times are shown it is not in sight
function isTried(time) { return shown.span === null && ghost.from <= time + (shown.following ? PAGE_LAG_S : 0) && ghost.until > time; }

function attempt(name, value) {
  const wanted = { name, value, begun: performance.now() };
  if (ghost.asked) { ghost.next = wanted; return; }
  ghost.asked = wanted;
  send({ kind: "try", values: { [name]: value } });
}

// the first trial loads the machine, which takes seconds: begin when a person reaches for a value
function warm() {
  if (ghost.asked || !run.commands) return;
  ghost.asked = { begun: 0 };
  send({ kind: "try", values: {} });
}

function showGhost(message) {
  const { name, value, begun } = ghost.asked;
  const row = name && find("keys").querySelector(`[data-name="${CSS.escape(name)}"] .was`);
  ghost.asked = null;
  if (!row) message.curves = null;
  else if (message.refused) row.textContent = message.refused;
  else {
    ghost.curves.clear();
    for (const [path, [times, values]] of Object.entries(message.curves)) {
      const curve = curves.get(path);
      if (!curve) continue;
      const fresh = new Curve(curve.width);
      fresh.add(times, values);
      ghost.curves.set(path, fresh);
    }
    Object.assign(ghost, { from: message.from_s, until: message.to_s });
    shown.drawn = null;
    row.textContent = `with ${rounded(value)}: ${message.cards.map(([card, told]) => `${card} ${told}`).join(", ")}`;
    window.bench.ghosts.push(performance.now() - begun);
  }
  const next = ghost.next;
  ghost.next = null;
  if (next) { attempt(next.name, next.value); ghost.asked.begun = next.begun; }
}

// -- time -------------------------------------------------------------------------------------------------------------

function follow(wanted) {
  shown.following = wanted;
  if (wanted) play(false);
  find("follow").setAttribute("aria-pressed", wanted);
}

function play(wanted) {
  if (wanted) {
    follow(false);
    const newest = run.pictures.at(-1)?.time_s ?? 0;
    if (shown.at >= newest - 1e-6) shown.at = run.pictures[0]?.time_s ?? 0;
  }
  shown.playing = wanted;
  find("play").textContent = wanted ? "Halt" : "Play";
}

find("follow").onclick = () => follow(!shown.following);
find("play").onclick = () => play(!shown.playing);
find("cursor").oninput = () => { follow(false); play(false); shown.at = Number(find("cursor").value); };
find("span").onchange = () => { shown.span = null; keep(); };
for (const event of ["pointerenter", "focusin"]) find("keys").addEventListener(event, warm, { once: true });
find("take").onclick = () => send({ kind: "take" });
find("speed").oninput = () => { find("speed-now").textContent = `${Math.round(100 * find("speed").value)} % wanted`; };
find("speed").onchange = () => { order("speed", { values: { share: Number(find("speed").value) } }); find("speed").blur(); };
find("accept").onclick = () => order("accept");
find("reject").onclick = () => order("reject");
find("undo").onclick = () => {
  const last = undone.at(-1);
  if (last) { last.taken = true; change(last.name, last.before); }
};
addEventListener("keydown", (event) => {
  if (event.target.matches("input, select, button") || event.ctrlKey || event.metaKey || event.altKey) return;
  const does = {
    f: () => follow(true),
    k: () => play(!shown.playing),
    ",": () => step(-1),
    ".": () => step(1),
  }[event.key];
  if (does) { event.preventDefault(); does(); }
});

function step(by) {
  follow(false);
  play(false);
  const place = Math.max(0, Math.min(run.pictures.length - 1, placeOf(shown.at) + by));
  if (run.pictures[place]) shown.at = run.pictures[place].time_s;
}

new ResizeObserver(() => { plots.fit(); shown.drawn = null; }).observe(find("plots"));
new ResizeObserver(() => { shown.drawn = null; }).observe(find("drawing"));

// -- report: what is on the page at the time shown ------------------------------------------------------------------------

function seen() {
  const picture = shown.drawn ?? run.pictures.at(-1);
  for (const plot of plots.shown) plot.visible = true;
  if (picture) show(picture, shown.at);
  const cells = (id) => [...find(id).querySelectorAll("tr")].map((line) => [...line.children].map((cell) => cell.textContent));
  const two = !find("comparison").hidden;
  const live = (run.machine?.parameters ?? []).map((each) => [each.name, String(rounded(each.value)), each.unit]);
  const events = [...find("events").children].map((line) => [line.textContent]).slice(0, 50);
  return {
    title: `${find("machine").textContent}${run.machine?.recording ? `, ${run.machine.recording}` : ""}`,
    time_s: picture?.time_s ?? 0, made: new Date().toISOString().slice(0, 16).replace("T", " "), versions: run.versions ?? "",
    sides: run.machine?.sides ?? [],
    cards: picture?.cards ?? [],
    pictures: [
      { title: "Machine", canvas: find("drawing"), words: [] },
      ...(lanes.size ? [{ title: "Regimes", canvas: find("lane-drawing"), words: lanes.words.map((word, place) => [word, colours(lanes.words.length)[place]]) }] : []),
      ...plots.shown.map((plot) => ({ title: plot.title, canvas: plot.plot.ctx.canvas, words: plot.names.map((name, place) => [name, plot.colours[place]]) })),
    ],
    tables: [
      ...(two ? [{ title: "Runs", head: ["side", "run"], rows: run.machine.sides.map((name, place) => ["AB"[place], name]) },
        { title: "Settings that differ", head: ["key", "A", "B"], rows: cells("settings") },
        { title: "Numbers that differ", head: ["quantity", "A", "B", "apart"], rows: cells("compared") }] : []),
      { title: "Settings that differ from the machine as installed", head: ["key", "installed", "here"], rows: run.machine?.settings ?? [] },
      { title: "Live parameters", head: ["key", "value", "unit"], rows: live },
      { title: "Numbers of the run", head: ["quantity", "value", "unit"], rows: [...cells("metrics"), ...cells("more-metrics")] },
      { title: "Residuals", head: ["residual", "worst", "limit"], rows: cells("residuals") },
      { title: "Alarms", head: ["fault"], rows: [...find("faults").querySelectorAll(".fault")].map((each) => [...each.querySelectorAll(":scope > b, :scope > div:not(.row)")].map((part) => part.textContent).join(", ")).map((text) => [text]) },
      { title: "Advice", head: ["advice", ""], rows: cells("advice-rows") },
      { title: "Newest events", head: ["event"], rows: events },
    ],
  };
}

const fileName = (suffix) => `${run.machine?.name ?? "bench"}-report.${suffix}`;
find("report").onclick = () => report.save(fileName("html"), "text/html", report.page(seen()));
find("report-json").onclick = () => report.save(fileName("json"), "application/json", report.json(seen()));

// how many rows of two runs are over each other, and how far they are apart at most
function apart() {
  let rows = 0, largest = 0;
  for (const [path, curve] of curves) {
    const [times, ...columns] = other.difference(path, curve.between(-Infinity, Infinity)) ?? [[]];
    rows += times.length;
    for (const column of columns) for (const value of column) largest = Math.max(largest, Math.abs(value ?? 0));
  }
  return { rows, largest };
}

// what is looked at from outside: the time shown (s), the stretch in the plots (s), how many pictures were drawn
window.bench = { apart, window: () => [plots.from, plots.now], lanes: () => lanes.at(shown.at), shown: 0, frames: 0, ghosts: [], cut: () => socket.close() };
requestAnimationFrame(frame);
connect();
