// SPDX-License-Identifier: Apache-2.0
// Collects the page's contents at the time shown for a report, and handles the two buttons that save it.

import { colours } from "./curves.js";
import { plots, show } from "./instant.js";
import * as report from "./report.js";
import { find, lanes, other, rounded, run, shown } from "./state.js";

function seen() {
  const picture = shown.drawn ?? run.pictures.at(-1);
  for (const plot of plots.shown) plot.visible = true;
  if (picture) show(picture, shown.at);
  const cells = (id) => [...find(id).querySelectorAll("tr")].map((line) => [...line.children].map((cell) => cell.textContent));
  const two = !find("comparison").hidden, chosen = (id) => find(id).selectedOptions[0].textContent;
  const drawn = other.isDifference ? "curves are A - B" : "A solid, B dashed";
  const live = (run.machine?.parameters ?? []).map((each) => [each.name, String(rounded(each.value)), each.unit]);
  const events = [...find("events").children].map((line) => [line.textContent]).slice(0, 50);
  return {
    title: `${find("machine").textContent}${run.machine?.recording ? `, ${run.machine.recording}` : ""}`,
    time_s: picture?.time_s ?? 0, made: `${new Date().toISOString().slice(0, 16).replace("T", " ")} UTC`, versions: run.versions ?? "",
    sides: run.machine?.sides ?? [],
    cards: picture?.cards ?? [],
    pictures: [
      { title: "Machine", canvas: find("drawing"), words: [] },
      ...(lanes.size ? [{ title: "Regimes", canvas: find("lane-drawing"), words: lanes.words.map((word, place) => [word, colours(lanes.words.length)[place]]) }] : []),
      ...plots.shown.map((plot) => ({ title: two && other.isDifference ? `${plot.title}, A - B` : plot.title, canvas: plot.plot.ctx.canvas, words: plot.names.map((name, place) => [name.replaceAll("_", " "), plot.colours[place]]) })),
    ],
    tables: [
      ...(two ? [{ title: `Runs: ${drawn}, at equal ${chosen("align")}`, head: ["side", "run"], rows: [...run.machine.sides.map((name, place) => ["AB"[place], name]), ["", find("equal").textContent]] },
        { title: "Settings that differ", head: ["key", "A", "B"], rows: cells("settings") },
        { title: "Numbers that differ", head: ["quantity", "A", "B", "apart"], rows: cells("compared") }] : []),
      { title: "Settings that differ from the machine as installed", head: ["key", "installed", "here"], rows: run.machine?.settings ?? [] },
      { title: "Live parameters", head: ["key", "value", "unit"], rows: live },
      { title: "Numbers of the run", head: ["quantity", "value", "unit"], rows: [...cells("metrics"), ...cells("more-metrics")] },
      { title: "Residuals", head: ["residual", "worst", "limit"], rows: cells("residuals") },
      { title: "Alarms", head: ["fault"], rows: [...find("faults").querySelectorAll(".fault")].map((each) => [...each.querySelectorAll(":scope > b, :scope > div:not(.row)")].map((part) => part.textContent.replace("\n", ", ")).join(", ")).map((text) => [text]) },
      { title: "Advice", head: ["advice", ""], rows: [...cells("advice-rows"), ["last answer", find("advice-decided").textContent]].filter(([, value]) => value) },
      { title: "Identified from the last minutes", head: ["key", "before", "found, 95 % interval"], rows: cells("fit-rows") },
      { title: "Newest events", head: ["event"], rows: events },
    ],
  };
}

const fileName = (suffix) => `${run.machine?.name ?? "bench"}-report.${suffix}`;
find("report").onclick = () => report.save(fileName("html"), "text/html", report.page(seen()));
find("report-json").onclick = () => report.save(fileName("json"), "application/json", report.json(seen()));
