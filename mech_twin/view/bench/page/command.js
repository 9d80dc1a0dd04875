// SPDX-License-Identifier: Apache-2.0
// Commands: buttons, speed, a row per live parameter with undo, and which page may send them.

import { forgetOrders, order, send } from "./connection.js";
import { attempt, forgetTrial, warm } from "./ghost.js";
import { listPanels } from "./instant.js";
import { find, rounded, rowsOf, run, typed } from "./state.js";

const undone = [];
const MOST_READ = 1e6; // larger bounds are not shown

const WORDS = { start: "Start", stop: "Stop motor", reset: "Reset", pause: "Pause", "step": "One step" };

export function know(machine) {
  run.machine = machine;
  run.orders = machine.orders;
  const name = machine.configuration?.name ?? machine.name; // a configuration page has its own name
  find("machine").textContent = name.replaceAll("_", " ");
  document.title = `${name} - bench`;
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
  if (!machine.sides) find("comparison").hidden = true;
  showSettings(machine.settings ?? []);
  listPanels();
  for (const [name, id] of [["acknowledge", "alarms"], ["accept", "advice"], ["identify", "fit"]]) if (!machine.orders.includes(name)) find(id).hidden = true;
  commands(run.commands);
  showPause();
}

// settings that differ from the installed ones
export function showSettings(settings) {
  if (!run.machine) return;
  run.machine.settings = settings;
  find("differs").hidden = !settings.length || Boolean(run.machine.sides);
  find("changed").replaceChildren(...rowsOf(settings));
}

export function showPause() {
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
  const [low, high] = [parameter.low, parameter.high].map((bound) => (bound == null || Math.abs(bound) >= MOST_READ ? null : bound));
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
  // an input that is typed into or dragged keeps its value until it is sent or left
  row.addEventListener("input", () => { row.dataset.edited = ""; });
  row.addEventListener("change", () => { delete row.dataset.edited; }, { capture: true });
  row.addEventListener("focusout", () => {
    if (row.dataset.edited === undefined) return;
    delete row.dataset.edited;
    changed(parameter.name, parameter.value);
  });
  return row;
}

// live parameters to be set: one after the answer to the one before, and of a key the last value that was wanted
const wanted = new Map();
let isAsked = false;
let undos = 0; // pressed while a change is not answered, whose own turn it is then

// set a live parameter; undone: the change that this takes back
function change(name, value, takenBack = null) {
  const replaced = wanted.get(name);
  if (replaced?.takenBack) undone.push(replaced.takenBack);
  wanted.set(name, { value, takenBack });
  sendWanted();
}

function sendWanted() {
  if (!isAsked && !wanted.size && undos) { undos -= 1; undo(); }
  if (isAsked || !wanted.size) return;
  const [name, { value, takenBack }] = wanted.entries().next().value;
  wanted.delete(name);
  const before = run.machine?.parameters.find((each) => each.name === name)?.value;
  if (before === undefined || before === value) { changed(name, before); return sendWanted(); }
  isAsked = true;
  order("change", { values: { [name]: value } }, (isDone) => {
    isAsked = false;
    if (isDone !== Boolean(takenBack)) undone.push(takenBack ?? { name, before });
    find("undo").disabled = !undone.length || !run.commands || run.over;
    changed(name, isDone ? value : before);
    sendWanted();
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

// the slider covers the range of the key, or up to 3 times the value if that is narrower; the number box has no limit
function numbers(parameter) {
  const slider = document.createElement("input"), number = document.createElement("input");
  slider.type = "range"; number.className = "number";
  const size = Math.abs(parameter.value) || 1;
  const low = Math.max(parameter.low ?? -Infinity, parameter.value >= 0 ? 0 : -3 * size);
  const high = Math.min(parameter.high ?? Infinity, 3 * size);
  slider.min = low; slider.max = high; slider.step = "any";
  slider.value = parameter.value;
  number.value = rounded(parameter.value);
  slider.setAttribute("aria-label", `${parameter.name}, slider`);
  number.setAttribute("aria-label", `${parameter.name}, number`);
  slider.oninput = () => {
    number.value = Number(Number(slider.value).toPrecision(4));
    attempt(parameter.name, Number(number.value));
  };
  slider.onchange = () => { forgetTrial(); change(parameter.name, Number(number.value)); };
  number.onchange = () => change(parameter.name, typed(number, parameter.name) ?? parameter.value);
  return [slider, number];
}

export function changed(name, value) {
  const parameter = run.machine?.parameters.find((each) => each.name === name);
  const row = find("keys").querySelector(`[data-name="${CSS.escape(name)}"]`);
  if (!parameter || !row) return;
  if (parameter.value !== value) row.querySelector(".was").textContent = `was ${rounded(parameter.value)}`;
  parameter.value = value;
  if (wanted.has(name) || row.dataset.edited !== undefined) return; // what is wanted next stands there
  for (const input of row.querySelectorAll("input, select")) {
    if (input.type === "checkbox") input.checked = value;
    else input.value = input.type === "range" ? value : rounded(value);
  }
}

export function showRole(message) {
  const others = message.pages > 1 ? `, ${message.pages} pages` : "";
  find("role").textContent = run.machine && !run.orders.length && find("hall").hidden ? ""
    : (message.commands ? "this page commands" : message.free ? "nobody commands" : "another page commands") + others;
  find("take").hidden = message.commands;
  if (!message.commands) forgetTrial(true);
  commands(message.commands);
}

// whether this page commands; a run that is over takes no command, and the hall begins another
export function commands(can) {
  run.commands = can;
  const disable = (which, off) => { for (const each of document.querySelectorAll(which)) each.disabled = off || each.dataset.idle !== undefined; };
  disable("#hall button", !can);
  disable("#command button, #command input, #keys input, #keys select, #alarms button, #advice button, #fit button, #fit select", !can || run.over);
  find("undo").disabled = !can || run.over || !undone.length;
}

// one speed after the other, and of those that come meanwhile the last: a key that is held down sends thirty a second
const speeds = { wanted: null, isAsked: false };
function sendSpeed() {
  if (speeds.isAsked || speeds.wanted === null) return;
  const share = speeds.wanted;
  Object.assign(speeds, { wanted: null, isAsked: true });
  order("speed", { values: { share } }, () => { speeds.isAsked = false; sendSpeed(); });
}

// a run has ended: what was asked of it, and not answered, concerns no other
export function forgetCommands() {
  forgetOrders();
  forgetTrial(true);
  undone.length = 0;
  wanted.clear();
  isAsked = false;
  undos = 0;
  Object.assign(speeds, { wanted: null, isAsked: false });
  run.sped = -Infinity;
}

for (const event of ["pointerenter", "focusin"]) find("keys").addEventListener(event, warm, { once: true });
find("take").onclick = () => send({ kind: "take" });
find("speed").oninput = () => { run.sped = performance.now(); find("speed-now").textContent = `${Math.round(100 * find("speed").value)} % wanted`; };
find("speed").onchange = () => { speeds.wanted = Number(find("speed").value); sendSpeed(); };
function undo() {
  if (isAsked || wanted.size) { undos += 1; return; }
  const last = undone.pop();
  find("undo").disabled = !undone.length;
  if (last) change(last.name, last.before, last); else undos = 0;
}

find("undo").onclick = undo;
