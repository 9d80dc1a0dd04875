// SPDX-License-Identifier: Apache-2.0
// The time shown, common to drawing, header, cards, curves and lanes; following, playing and zooming change it.

import { isOpen, send } from "./connection.js";
import { colours, Curve, thinned } from "./curves.js";
import { draw, listen } from "./drawing.js";
import { ghost, ghostDrawn, isAwaited, isTried } from "./ghost.js";
import { judged, listLimits } from "./limits.js";
import { placeOf } from "./pictures.js";
import { key, made, Plots } from "./plots.js";
import { curves, find, lanes, other, run, shown } from "./state.js";
import { tellTime } from "./viewer.js";

const QUIET_MS = 1500;
const MOVED_MS = 2000; // so long a speed slider that was moved waits for the next key
const DRAWN_ROWS = 4000; // per curve; longer curves are decimated to their extremes
const WHOLE = "whole";
const AWAITED_MS = 150; // time between two pictures while a trial is awaited

export const plots = new Plots(find("plots"), {
  pieces(part, from, to) {
    const isDifference = other.isThere && other.isDifference, curve = curves.get(part.path);
    const piece = curve?.between(from, to, isDifference ? Infinity : DRAWN_ROWS) ?? empty(part);
    return thinned((isDifference ? other.difference(part.path, piece) : piece) ?? empty(part), DRAWN_ROWS);
  },
  second(part, from, to) {
    const found = other.isThere ? !other.isDifference && other.between(part.path, from, to, DRAWN_ROWS) : plots.to > plots.now && ghost.curves.get(part.path)?.between(from, to);
    return found || empty(part);
  },
  pointed(at) {
    find("reading").textContent = at === null ? "" : `cursor t = ${at.toFixed(5)} s`;
    const words = at === null ? [] : Object.entries(lanes.at(at)).map(([name, word]) => `${name}: ${word}`);
    find("lane-reading").textContent = words.join(", ");
    find("lane-line").hidden = !(plots.share >= 0 && plots.share <= 1) || at === null;
    if (at !== null) find("lane-line").style.left = `${lanes.place(find("lane-drawing"), plots.share)}px`;
  },
}, zoomed, (at) => { if (isWhole()) seek(at); });
const empty = (part) => [[], ...part.names.map(() => [])];

export function frame(now) {
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
    tellTime(shown.following ? null : shown.at);
    const place = placeOf(shown.at);
    const picture = run.pictures[place];
    const isDue = picture !== shown.drawn || shown.playing || (isWhole() && newest !== shown.newest);
    if (isDue && (!isAwaited() || now - shown.showed > AWAITED_MS)) show(picture, shown.following ? picture.time_s : shown.at);
  }
  if (shown.owed) { shown.owed = false; send({ kind: "drawn" }); }
  const isQuiet = isOpen() && shown.following && newest && !run.over && !run.paused && run.machine?.namespace && now - shown.heard > QUIET_MS;
  if (isQuiet) find("state").textContent = "no new picture";
}

// show header, drawing and curves at the time of a picture
export function show(picture, at) {
  const newest = run.pictures.at(-1);
  if (shown.drawn === null || newest !== shown.newest) shown.changes += 1;
  Object.assign(shown, { drawn: picture, newest, showed: performance.now() });
  const header = `t = ${picture.time_s.toFixed(run.paused || !shown.following ? 4 : 2)} s`;
  if (find("time").textContent !== header) find("time").textContent = header;
  find("state").textContent = !isOpen() ? "no connection" : !shown.following ? picture.state : run.over ? "over" : run.paused ? "paused" : picture.state;
  find("alarm").hidden = !picture.alarm;
  find("alarm").textContent = picture.alarm;
  cards(picture.cards, shown.following ? picture.time_s : null);
  if (picture.shapes) draw(find("drawing"), picture.shapes, picture.bounds, other.isThere ? other.picture(at).shapes : null);
  const isMoved = find("speed").matches(":active") || performance.now() - run.sped < MOVED_MS;
  const command = newest.command; // a control shows the present, also beside an earlier picture
  if (command !== null && !isMoved) find("speed").value = command;
  if (command !== null) find("speed-now").textContent = `${Math.round(100 * command)} % now`;
  const wanted = Math.max(at, picture.time_s), now = isWhole() ? newest.time_s : wanted;
  const from = isWhole() ? run.pictures[0].time_s : wanted - (shown.span ?? Number(find("span").value));
  const until = Math.max(now, isTried(wanted) ? ghost.until : now);
  plots.ofTwo = other.isThere && !other.isDifference;
  plots.show(from, now, until, { isLive: shown.following && !isWhole(), at: wanted, stamp: shown.changes });
  ghostDrawn();
  find("lanes").hidden = !lanes.size;
  if (find("lane-words").childElementCount !== lanes.words.length) {
    const hues = colours(lanes.words.length);
    find("lane-words").replaceChildren(...lanes.words.map((word, place) => key(word, hues[place])));
  }
  if (lanes.size) lanes.draw(find("lane-drawing"), from, until, now);
  find("lane-mark").hidden = plots.mark === null;
  if (plots.mark !== null) find("lane-mark").style.left = `${lanes.place(find("lane-drawing"), plots.mark)}px`;
  if (document.activeElement !== find("cursor") || shown.following || shown.playing) find("cursor").value = at;
  window.bench.shown = picture.time_s;
  window.bench.onshow?.(picture);
  window.bench.frames += 1;
}

function cards(list, time) {
  const box = find("cards");
  listLimits(list);
  while (box.childElementCount > list.length) box.lastChild.remove();
  while (box.childElementCount < list.length) {
    const item = made("li");
    item.append(made("b"), made("span"), made("em"));
    box.append(item);
  }
  list.forEach((card, place) => {
    const [value, name, limit] = box.children[place].children, word = judged(card, time);
    value.textContent = card[1];
    name.textContent = card[0];
    limit.textContent = word;
    box.children[place].className = word ? "outside" : "";
  });
}

export function layOut(panels) {
  for (const { curves: list } of panels) {
    for (const { path, names } of list) {
      if (curves.get(path)?.width !== names.length) curves.set(path, new Curve(names.length));
    }
  }
  plots.layOut(panels);
  listPanels();
  shown.drawn = null;
}

// whether a complete recording is shown; of a live run the last seconds are shown
const isWhole = () => shown.span === null && find("span").value === WHOLE;

// key of the display settings of a recording or machine in the session storage
const kept = () => `shown of ${run.machine?.recording ?? run.machine?.name ?? ""}`;

export function listPanels() {
  const stored = JSON.parse(sessionStorage.getItem(kept()) ?? "{}");
  plots.hide(stored.hidden ?? []);
  find("span").lastElementChild.hidden = !run.machine?.recording;
  find("span").value = stored.span ?? (run.machine?.recording ? WHOLE : "1");
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

// show a time range in the plots, and the picture at its end; null: the newest again, with the selected span
function zoomed(range) {
  const first = run.pictures[0]?.time_s, newest = run.pictures.at(-1)?.time_s;
  if (newest === undefined) return;
  if (range === null && shown.span === null) return;
  if (range === null) { shown.span = null; if (shown.wasFollowing) follow(true); return void (shown.drawn = null); }
  if (shown.span === null) shown.wasFollowing = shown.following;
  const [from, to] = [Math.max(first, range[0]), Math.min(newest, range[1])];
  if (!(to - from > 1e-6)) return;
  follow(false);
  play(false);
  Object.assign(shown, { span: to - from, at: to, drawn: null });
}

export function seek(time) {
  follow(false);
  play(false);
  shown.at = Math.max(run.pictures[0]?.time_s ?? 0, Math.min(run.pictures.at(-1)?.time_s ?? 0, time));
}

export function follow(wanted) {
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
find("cursor").oninput = () => seek(Number(find("cursor").value));
find("span").onchange = () => { shown.span = null; keep(); };

addEventListener("keydown", (event) => {
  if (event.target.matches("select, input:not([type=range], [type=checkbox])") || event.ctrlKey || event.metaKey || event.altKey) return;
  const does = {
    f: () => follow(true),
    k: () => play(!shown.playing),
    ",": () => step(-1),
    ".": () => step(1),
  }[event.key];
  if (does) { event.preventDefault(); does(); }
});

function step(by) {
  const place = Math.max(0, Math.min(run.pictures.length - 1, placeOf(shown.at) + by));
  if (run.pictures[place]) seek(run.pictures[place].time_s);
}

// jump to an event: the first picture that contains it
find("events").onclick = ({ target }) => {
  const time = Number(target.dataset.time ?? NaN), picture = run.pictures[placeOf(time)];
  if (picture) seek(picture.time_s < time - 1e-9 ? run.pictures[placeOf(time) + 1]?.time_s ?? time : picture.time_s);
};

listen(find("drawing"));
new ResizeObserver(() => { plots.fit(); shown.drawn = null; }).observe(find("plots"));
new ResizeObserver(() => { shown.drawn = null; }).observe(find("drawing"));
