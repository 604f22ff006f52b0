// The line to the server: messages go out as JSON, pictures and figures come in; a lost line is taken up again.

import { page } from "./state.js";

const PING_MS = 500, RETRY_MS = 1000;
const listeners = { pictures: () => {}, lost: () => {} };

// Call `work` with each message of a kind, with the bytes of "pictures", or when the line is "lost".
export function on(kind, work) { listeners[kind] = work; }

export function connect() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const socket = new WebSocket(`${scheme}://${location.host}/socket${location.search}`);
  socket.binaryType = "arraybuffer";
  socket.onmessage = ({ data }) => (typeof data === "string" ? received(JSON.parse(data)) : listeners.pictures(data));
  socket.onclose = () => { page.status = null; listeners.lost(); setTimeout(connect, RETRY_MS); };
  page.socket = socket;
}

export function send(message) {
  if (page.socket?.readyState === WebSocket.OPEN) page.socket.send(JSON.stringify(message));
}

function received(message) {
  if (message.type === "pong") pong(message);
  else listeners[message.type]?.(message);
}

function pong(message) { // the server's clock, in ms of this page's
  const now = performance.now(), offset = message.now * 1000 - (now + message.t) / 2;
  page.trip = now - message.t;
  page.offset = page.offset === null ? offset : page.offset + 0.2 * (offset - page.offset);
}

setInterval(() => send({ type: "ping", t: performance.now() }), PING_MS);
