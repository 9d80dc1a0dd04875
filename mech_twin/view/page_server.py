# SPDX-License-Identifier: Apache-2.0
"""The viewer's page, served with a policy under which a browser asks this machine alone.

The page that rerun serves asks other hosts for a font, for news of releases and for telemetry.  Here its files are
passed on under a Content Security Policy, so that the browser itself refuses whatever is not on this machine, and
the page says what renders it, a graphics card or the processor, and with each frame what time it shows.

::

    browser --- page, policy ---> PageServer --- files ---> rerun's own web server
       |                                                    (loopback interface)
       +------- samples ----------------------------------> rerun's data port
"""

from __future__ import annotations

import http.client
import re
import shutil
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

LOOPBACK = "127.0.0.1"
RENDERER_PATH, SHOWN_PATH = "/renderer", "/shown"
LONGEST_NAME = 400
BLOCK_BYTES = 1 << 18
UPSTREAM_LIMIT_S = 10.0
# renderers that draw on the processor: Chromium's, Mesa's, Microsoft's; a browser without WebGL draws nothing faster
SOFTWARE = re.compile(r"swiftshader|llvmpipe|softpipe|swrast|basic render|software|^none$", re.IGNORECASE)
REMOTE_TAG = re.compile(rb"<link[^>]*https://[^>]*>", re.DOTALL)
SHOWN = re.compile(r"([a-z0-9]{1,20}) (\d{1,19})")
HOST = re.compile(r"[A-Za-z0-9.-]+|\[[0-9A-Fa-f:]+\]")
SOFTWARE_PIXELS = 700_000  # of the picture that a processor draws, at most: its time goes with their number
REPORT = (
    """<script>
  (() => {
    const gl = document.createElement("canvas").getContext("webgl2");
    const names = gl && gl.getExtension("WEBGL_debug_renderer_info");
    const found = gl ? gl.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER) : "none";
    fetch("renderer", { method: "POST", body: String(found) });

    if (/SOFTWARE/i.test(String(found))) {
      // fewer pixels than the window has: the browser stretches the picture, and what is a point stays one
      const part = () => Math.min(1, Math.sqrt(PIXELS / (innerWidth * innerHeight * ratio() ** 2)));
      const shrunk = (prototype, name, change) => {
        const read = Object.getOwnPropertyDescriptor(prototype, name).get;
        Object.defineProperty(prototype, name, { configurable: true, get() { return change(read.call(this)); } });
        return read;
      };
      const read = shrunk(window, "devicePixelRatio", (value) => value * part());
      const ratio = () => read.call(window);
      const pixels = (value) => ({ value: Math.round(value * part()) });
      shrunk(ResizeObserverEntry.prototype, "devicePixelContentBoxSize", (sizes) => Array.from(sizes, (size) =>
        Object.create(ResizeObserverSize.prototype, {
          inlineSize: pixels(size.inlineSize),
          blockSize: pixels(size.blockSize),
        })));
    }

    // the viewer's state names the time line, its kind and the time of the cursor, a variable-length integer
    const mark = [...new TextEncoder().encode("sim_time"), 16, 2, 26];
    const page = Math.random().toString(36).slice(2, 20);
    let last = 0n, busy = false;
    const cursor = () => {
      const state = window._handle.viewer_state();
      // the first one has the range of the data, the last one the cursor
      let at = state.lastIndexOf(mark[0]);
      while (at > 0 && !mark.every((byte, i) => state[at + i] === byte)) at = state.lastIndexOf(mark[0], at - 1);
      let time = 0n;
      if (at > 0 && [8, 16].includes(state[at + mark.length + 1])) {
        for (let i = at + mark.length + 2, shift = 0n; i < state.length; i += 1, shift += 7n) {
          time |= BigInt(state[i] & 127) << shift;
          if (state[i] < 128) break;
        }
      }
      return time;
    };
    const tell = () => {
      if (!window._handle || busy) return;
      const time = cursor();
      if (time === last) return;
      last = time;
      busy = true;
      fetch("shown", { method: "POST", body: `${page} ${time}` }).catch(() => {}).finally(() => { busy = false; });
    };
    const ask = window.requestAnimationFrame.bind(window);
    window.requestAnimationFrame = (draw) => ask((now) => { draw(now); tell(); });
  })();
</script>
</head>""".replace("SOFTWARE", SOFTWARE.pattern)
    .replace("PIXELS", str(SOFTWARE_PIXELS))
    .encode()
)


def draws_in_software(renderer: str) -> bool:
    """Return whether a renderer of this name (WebGL's ``UNMASKED_RENDERER``) draws on the processor."""
    return SOFTWARE.search(renderer) is not None


def local_page(page: bytes) -> bytes:
    """Return the page without links to other hosts, telling its server what renders it."""
    return REMOTE_TAG.sub(b"", page).replace(b"</head>", REPORT, 1)


def content_policy(host: str, grpc_port: int) -> str:
    """Return the policy of a page asked for under a host name: nothing but the page's server and the data port."""
    named = host if HOST.fullmatch(host) else LOOPBACK
    data = " ".join(dict.fromkeys(f"http://{each}:{grpc_port}" for each in (LOOPBACK, named)))
    return (
        "default-src 'none'; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval'; style-src 'self' 'unsafe-inline'; "
        f"img-src 'self' data: blob:; worker-src 'self' blob:; connect-src 'self' {data}; base-uri 'none'; "
        "form-action 'none'"
    )


class PageServer:
    """Serves the page from threads of its own until closed.

    Parameters
    ----------
    address : str
        Interface to listen on.
    port : int
        Port of the page.
    upstream_port, grpc_port : int
        Ports of rerun's own web server, on the loopback interface, and of the data.
    on_renderer : callable
        Receives the name of the renderer of each page that is opened, in a thread of the server.
    on_shown : callable
        Receives a page's name and the time (s) it shows, with each of its frames that shows another one.
    """

    def __init__(
        self,
        address: str,
        port: int,
        upstream_port: int,
        grpc_port: int,
        on_renderer: Callable[[str], None],
        on_shown: Callable[[str, float], None] = lambda page, time_s: None,
    ) -> None:
        class Handler(_PageHandler):
            upstream = upstream_port
            data_port = grpc_port
            told = staticmethod(on_renderer)
            shown = staticmethod(on_shown)

        self._server = ThreadingHTTPServer((address, port), Handler)
        self._server.daemon_threads = True
        self._thread = Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop serving and free the port."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _PageHandler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    upstream: int
    data_port: int
    told: Callable[[str], None]
    shown: Callable[[str, float], None]

    def do_GET(self) -> None:
        """Pass on a file of the viewer, the page itself without its links to other hosts."""
        connection = http.client.HTTPConnection(LOOPBACK, self.upstream, timeout=UPSTREAM_LIMIT_S)
        try:
            connection.request("GET", self.path)
            self._pass_on(connection.getresponse())
        except ConnectionError:  # the browser went away, or the viewer has ended
            self.close_connection = True
        finally:
            connection.close()

    def do_POST(self) -> None:
        """Take the name of the renderer, or the time that is shown."""
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or int(length) > LONGEST_NAME:
            self.send_error(HTTPStatus.BAD_REQUEST)
            return
        body = self.rfile.read(int(length)).decode(errors="replace")
        found = SHOWN.fullmatch(body)
        if self.path == RENDERER_PATH:
            self.told(body)
        elif self.path == SHOWN_PATH and found is not None:
            self.shown(found[1], int(found[2]) * 1e-9)
        else:
            self.send_error(HTTPStatus.BAD_REQUEST)
            return
        self.send_response(HTTPStatus.NO_CONTENT)
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 (the name is the base class's)
        """Say nothing: the terminal is the run's."""

    def _pass_on(self, answer: http.client.HTTPResponse) -> None:
        kind = answer.headers.get("Content-Type", "application/octet-stream")
        length = answer.headers.get("rerun-final-length")
        page = local_page(answer.read()) if kind.startswith("text/html") else None
        if page is None and length is None:
            page = answer.read()
        self.send_response(answer.status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(page)) if page is not None else str(length))
        self.send_header("Content-Security-Policy", content_policy(self._host(), self.data_port))
        self.send_header("Referrer-Policy", "no-referrer")
        self.end_headers()
        if page is not None:
            self.wfile.write(page)
        else:
            shutil.copyfileobj(answer, self.wfile, BLOCK_BYTES)

    def _host(self) -> str:
        host = self.headers.get("Host", LOOPBACK)
        return host if host.endswith("]") else host.rpartition(":")[0] or host
