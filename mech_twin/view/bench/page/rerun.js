// SPDX-License-Identifier: Apache-2.0
// rerun's web viewer of the run, controlled by its JavaScript interface: a data channel, and the time shown.

const status = document.getElementById("status");
const CHANNEL = "run", RETRY_MS = 1000;
const say = (text) => { status.textContent = text; status.hidden = !text; };

// a number as varint of Protocol Buffers, seven bits per byte
function varint(value) {
  const bytes = [];
  for (let rest = BigInt(value); ; rest >>= 7n) {
    bytes.push(Number(rest & 127n) | (rest > 127n ? 128 : 0));
    if (rest <= 127n) return bytes;
  }
}

const text = (bytes) => new TextDecoder("latin1").decode(Uint8Array.from(bytes));

// time = 3: { time = 1: ns }
function timeField(seconds) {
  const time = [0x08, ...varint(Math.max(0, Math.round(1e9 * seconds)))];
  return [0x1a, time.length, ...time];
}

// ViewerControlRequest { set_time_cursor = 6: { time = 3: { time = 1: ns }, play_state = 5: 1 paused, 3 following } }
function timeCursor(seconds) {
  const cursor = seconds === null ? [0x28, 3] : [...timeField(seconds), 0x28, 1];
  return Uint8Array.from([0x32, cursor.length, ...cursor]);
}

// receive the run, from its beginning, and after a loss of the connection again
function connect(take) {
  const socket = new WebSocket(`ws://${location.host}/rerun`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => socket.send(sessionStorage.getItem("token") ?? "");
  socket.onmessage = ({ data }) => { say(""); take(new Uint8Array(data)); window.received = (window.received ?? 0) + 1; };
  socket.onclose = ({ reason }) => {
    say(reason === "pages" ? "rerun is open in too many pages" : "no connection");
    if (!reason) setTimeout(() => connect(take), RETRY_MS);
  };
  window.cut = () => socket.close();
}

async function show() {
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  await wasm_bindgen({ module_or_path: "re_viewer_bg.wasm" });
  const viewer = new wasm_bindgen.WebHandle({ url: [], render_backend: "webgl", hide_welcome_screen: true, persist: false, enable_history: false, notebook: false, theme: dark ? "dark" : "light" });
  await viewer.start(document.getElementById("viewer"));
  for (const panel of ["top", "blueprint", "selection"]) viewer.override_panel_state(panel, "hidden");
  viewer.open_channel(CHANNEL, "mech_twin");
  connect((piece) => viewer.send_rrd_to_channel(CHANNEL, piece));
  say("waiting for the run");
  // called by the enclosing page with a time, or null for the newest; no effect until the viewer has taken in that time
  window.seek = (seconds) => viewer.viewer_control(timeCursor(seconds)).catch(() => {});
  window.state = () => viewer.viewer_state();
  window.isAt = (seconds) => text(window.state()).includes(text(timeField(seconds)));
}

show().catch((reason) => say(`rerun's viewer does not start here: ${reason}`));
