// SPDX-License-Identifier: Apache-2.0
// The WebSocket to the bench: it begins with the token, reconnects after a loss, and carries orders and answers.

import { answer, find, run, say } from "./state.js";

const RETRY_MS = 1000;
const token = (() => {
  // only this page on this port can read it: session storage is per origin, and the fragment is never sent
  if (location.hash.length > 1) sessionStorage.setItem("token", location.hash.slice(1));
  return sessionStorage.getItem("token") ?? "";
})();
let socket = null;
let asked = 0;
const waiting = new Map(); // id of an order -> callback for the answer

export function connect(opened, heard, lost) {
  if (!token) return say("This page needs the whole address that the terminal printed, with all that follows the #.");
  socket = new WebSocket(`ws://${location.host}/feed`);
  socket.onopen = () => { opened(); socket.send(token); };
  socket.onmessage = (event) => heard(JSON.parse(event.data));
  socket.onclose = (event) => {
    lost();
    for (const then of waiting.values()) then(false); // nothing answers them any more
    waiting.clear();
    find("state").textContent = "no connection";
    if (event.reason === "token") {
      find("role").textContent = "";
      return say("The address is of another run: its token is not right here. Open the one that the terminal printed last.");
    }
    find("role").textContent = event.reason === "pages" ? "open in too many pages; trying again" : "trying to reach the bench again";
    if (!run.pictures.length) say(event.reason === "pages" ? "The bench is open in too many pages: close one of them." : "The bench does not answer; trying again.");
    setTimeout(() => connect(opened, heard, lost), RETRY_MS);
  };
}

export function send(message) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

export function order(name, more = {}, then = () => {}) {
  if (!isOpen()) return then(false);
  asked += 1;
  waiting.set(asked, then);
  send({ kind: "order", id: asked, name, ...more });
}

export function answered(message) {
  waiting.get(message.id)?.(message.is_done);
  waiting.delete(message.id);
  answer(message.text, message.is_done ? "done" : "refused");
}

// the orders of a run that has ended: their answers are shown, and change nothing
export function forgetOrders() { waiting.clear(); }

export const isOpen = () => socket?.readyState === WebSocket.OPEN;
export const cut = () => socket.close();
