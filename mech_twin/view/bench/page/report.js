// SPDX-License-Identifier: Apache-2.0
// A report of the page's contents: one HTML file for printing, or the same as JSON.

import { paint } from "./curves.js";

const escape = (text) => String(text).replace(/[&<>"]/g, (letter) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" })[letter]);

// what, contents of the report: { title, time_s, versions, cards, tables: [{ title, head, rows }], pictures: [{ title, canvas, words }], events }
export function page(what) {
  const table = ({ title, head, rows }) => `<section><h2>${escape(title)}</h2><table><thead><tr>${head.map((word) => `<th>${escape(word)}</th>`).join("")}</tr></thead><tbody>${rows.map((row) => `<tr>${row.map((cell) => `<td>${escape(cell)}</td>`).join("")}</tr>`).join("")}</tbody></table></section>`;
  const picture = ({ title, canvas, words }) => `<figure><figcaption>${escape(title)}</figcaption><img alt="${escape(title)}" src="${canvas.toDataURL("image/png")}"><p>${words.map(([word, colour]) => `<span style="color:${escape(colour)}">&#9644;</span> ${escape(word)}`).join(" &nbsp; ")}</p></figure>`;
  return `<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>${escape(what.title)}</title><style>
:root { color: ${paint("--ink")}; background: ${paint("--sheet")}; font: 11pt/1.4 system-ui, sans-serif; -webkit-print-color-adjust: exact; print-color-adjust: exact; }
body { max-width: 180mm; margin: 10mm auto; } h1 { font-size: 16pt; margin: 0; } h2, figcaption { font-size: 12pt; font-weight: 600; margin: 4mm 0 1mm; }
table { border-collapse: collapse; width: 100%; font-size: 9pt; } th { text-align: left; } td, th { padding: 1px 6px; border-bottom: 1px solid ${paint("--line")}; overflow-wrap: anywhere; }
td:nth-child(n + 2) { font-variant-numeric: tabular-nums; } section, figure { break-inside: avoid; margin: 0; } img { max-width: 100%; } figure p { margin: 0; font-size: 9pt; }
.cards { display: flex; gap: 8mm; flex-wrap: wrap; } .cards b { display: block; font-size: 13pt; } tr { break-inside: avoid; }
</style></head><body>
<h1>${escape(what.title)}</h1><p>t = ${what.time_s.toFixed(3)} s &middot; ${escape(what.made)} &middot; ${escape(what.versions)}</p>
<div class="cards">${what.cards.map(([name, value]) => `<div><b>${escape(value)}</b>${escape(name)}</div>`).join("")}</div>
${what.pictures.map(picture).join("\n")}
${what.tables.filter((each) => each.rows.length).map(table).join("\n")}
</body></html>
`;
}

export function json(what) {
  const { pictures, ...rest } = what;
  return JSON.stringify(rest, null, 1);
}

export function save(name, kind, text) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: kind }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
