// SPDX-License-Identifier: Apache-2.0
// Start page without a run: recordings of a folder, machines and configuration pages to run.

import { commands } from "./command.js";
import { order } from "./connection.js";
import { made } from "./plots.js";
import { find, rowsOf, run, say } from "./state.js";

export function showHall({ folder, recordings, machines }) {
  find("hall").hidden = false;
  find("folder").textContent = folder;
  if (!run.machine && !run.pictures.length) {
    if (!run.over) say("Open a recording, or run a machine."); // else why what was begun ended
    find("state").textContent = "ready";
  }
  const chosen = find("machines").value;
  find("machines").replaceChildren(...machines.map((name) => new Option(`${name.split("/").at(-1).replaceAll("_", " ")}${name.includes("/") ? ", installed" : ""}`, name)));
  if (machines.includes(chosen)) find("machines").value = chosen;
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
    buttons.append(made("button", { type: "button", textContent: word, onclick: does }));
  };
  if (recording.opens) {
    button("Open", () => order("open", { values: { recording: recording.name } }));
    if (run.chosen === recording.name) button("No reference", () => choose(""));
    else button("Reference", () => choose(recording.name));
    if (run.chosen && run.chosen !== recording.name) button("Compare with reference", () => order("overlay", { values: { recording: run.chosen, other: recording.name } }));
  } else if (recording.salvages) button("Salvage", () => order("salvage", { values: { recording: recording.name } }));
  button("Download", () => order("download", { values: { recording: recording.name } }));
  if (run.chosen === recording.name) row.classList.add("chosen");
  row.append(text, buttons);
  if (recording.settings.length) row.append(settingsOf(recording));
  return row;
}

// settings of a recording that differ from the installed configuration
function settingsOf({ settings }) {
  const box = made("details"), table = made("table"), head = made("tr");
  box.append(made("summary", { textContent: `${settings.length} setting${settings.length === 1 ? "" : "s"} not as installed` }), table);
  head.append(...["key", "installed", "here"].map((word) => made("th", { textContent: word })));
  table.append(head, ...rowsOf(settings));
  return box;
}

// choose the reference recording for comparisons
function choose(name) {
  run.chosen = name;
  order("list");
}

export function fetchFile({ name, address }) {
  const link = document.createElement("a");
  link.href = address;
  link.download = name;
  link.click();
}

find("list").onclick = () => order("list");
find("begin").onclick = () => order("run", { values: { machine: find("machines").value } });
