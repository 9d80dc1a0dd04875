// SPDX-License-Identifier: Apache-2.0
// rerun's web viewer of the run, controlled by its JavaScript interface: a data channel, and the time shown.

const status = document.getElementById("status");
const CHANNEL = "run";
const say = (text) => { status.textContent = text; status.hidden = !text; };

// a number as varint of Protocol Buffers, seven bits per byte
function varint(value) {
  const bytes = [];
  for (let rest = BigInt(value); ; rest >>= 7n) {
    bytes.push(Number(rest & 127n) | (rest > 127n ? 128 : 0));
    if (rest <= 127n) return bytes;
  }
}

// ViewerControlRequest { set_time_cursor = 6: { time = 3: { time = 1: ns }, play_state = 5: 1 paused, 3 following } }
function timeCursor(seconds) {
  const time = seconds === null ? [] : [0x08, ...varint(Math.max(0, Math.round(1e9 * seconds)))];
  const cursor = seconds === null ? [0x28, 3] : [0x1a, time.length, ...time, 0x28, 1];
  return Uint8Array.from([0x32, cursor.length, ...cursor]);
}

async function show() {
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  await wasm_bindgen({ module_or_path: "re_viewer_bg.wasm" });
  const viewer = new wasm_bindgen.WebHandle({ url: [], render_backend: "webgl", hide_welcome_screen: true, persist: false, enable_history: false, notebook: false, theme: dark ? "dark" : "light" });
  await viewer.start(document.getElementById("viewer"));
  for (const panel of ["top", "blueprint", "selection"]) viewer.override_panel_state(panel, "hidden");
  viewer.open_channel(CHANNEL, "mech_twin");
  const socket = new WebSocket(`ws://${location.host}/rerun`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => socket.send(sessionStorage.getItem("token") ?? "");
  socket.onmessage = ({ data }) => { say(""); viewer.send_rrd_to_channel(CHANNEL, new Uint8Array(data)); window.received = (window.received ?? 0) + 1; };
  socket.onclose = ({ reason }) => say(reason === "viewers" ? "rerun is open in too many pages" : "no connection");
  say("waiting for the run");
  // called by the enclosing page with a time, or null for the newest; no effect before the first picture
  window.seek = (seconds) => viewer.viewer_control(timeCursor(seconds)).catch(() => {});
  window.state = () => viewer.viewer_state();
}

show().catch((reason) => say(`rerun's viewer does not start here: ${reason}`));
