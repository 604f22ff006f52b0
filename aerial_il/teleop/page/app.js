// The page to fly on: what hands do goes out fifty times a second, pictures and figures come in.

import { Gamepad, Keyboard, Touch, sum } from "./devices.js";
import { buildNumbers, drawNumbers } from "./numbers.js";

const SEND_MS = 20, PING_MS = 500, FIGURES_MS = 250, RETRY_MS = 1000;
const LOCAL = new Set(["help", "camera", "numbers"]); // commands that only the page obeys
const WORDS = {
  "forward+": "ahead", "forward-": "back", "lateral+": "left", "lateral-": "right", "up+": "up", "up-": "down",
  "yaw+": "turn left", "yaw-": "turn right", "grip+": "close gripper", "grip-": "open gripper", precision: "precise",
  take_over: "take over", mode: "mode", record: "record", save: "keep", discard: "discard", undo: "undo discard",
  label: "call it a failure", pause: "pause", camera: "swap cameras", numbers: "numbers", help: "help",
};
const HELP = [ // rows of the help: name, commands
  ["ahead, back", "forward+", "forward-"], ["left, right", "lateral+", "lateral-"], ["up, down", "up+", "up-"],
  ["turn left, right", "yaw+", "yaw-"], ["close, open gripper", "grip+", "grip-"], ["precise (hold)", "precision"],
  ["mode", "mode"], ["record, stop", "record"], ["pause", "pause"], ["keep", "save"], ["discard", "discard"],
  ["undo discard", "undo"], ["call it a failure", "label"], ["swap cameras", "camera"], ["show numbers", "numbers"],
  ["this help", "help"],
];
const KEY_NAMES = {
  ArrowLeft: "←", ArrowRight: "→", ArrowUp: "↑", ArrowDown: "↓", Space: "space", Enter: "enter", Backspace: "⌫",
  ShiftLeft: "shift", ShiftRight: "shift", Tab: "tab", Escape: "esc", Slash: "?",
};
const HINTS = { // state -> commands worth knowing now
  idle: ["record", "mode", "precision", "grip+", "grip-", "undo", "camera", "numbers", "help"],
  countdown: ["record"],
  recording: ["record", "pause", "discard", "mode", "precision", "grip+", "grip-", "camera", "numbers"],
  paused: ["pause", "save", "discard"],
  review: ["save", "discard", "label"],
};
const LABELS = { // what a command means in a state
  "idle.record": "record an episode", "countdown.record": "cancel", "recording.record": "stop and review",
  "paused.pause": "go on", "paused.save": "stop and review", "review.save": "keep", "recording.discard": "throw away",
};
const STATES = { idle: "free flight", countdown: "get ready", recording: "recording", paused: "paused", review: "review" };

const $ = (id) => document.getElementById(id);
const page = { about: null, status: null, socket: null, seq: 0, focused: document.hasFocus(), offset: null, trip: null,
  shown: null, swapped: false, pressedAt: [], latencies: [], keys: new Map(), refused: false };
window.teleop = page; // for tests, and for who is curious

const touch = new Touch(used);
const pad = new Gamepad(used);
const keyboard = new Keyboard((code) => page.keys.has(code) && !$("help").open, used);
const hands = [keyboard, pad, touch];

// ---- connection

function connect() {
  const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/socket${location.search}`);
  socket.binaryType = "arraybuffer";
  socket.onmessage = (event) => (typeof event.data === "string" ? told(JSON.parse(event.data)) : pictures(event.data));
  socket.onclose = () => { page.status = null; draw(); setTimeout(connect, RETRY_MS); };
  page.socket = socket;
}

function send(message) {
  if (page.socket?.readyState === WebSocket.OPEN) page.socket.send(JSON.stringify(message));
}

function sendInput() {
  if (!page.focused || page.status?.role !== "controller") return;
  if (pad.read()) send({ type: "blur" }); // unplugged in flight: hover
  page.seq += 1;
  const pressed = hands.flatMap((hand) => hand.presses.take()).filter((name) => !LOCAL.has(page.keys.get(name)));
  const held = hands.flatMap((hand) => hand.held());
  if (pressed.length) page.pressedAt.push({ seq: page.seq, at: performance.now() });
  send({ type: "input", seq: page.seq, held, pressed, axes: sum(hands.map((hand) => hand.axes())), t: performance.now() });
  drawSticks(held);
}

function used(device, control) {
  if (device) document.body.dataset.device = device;
  const command = page.keys.get(control);
  if (command === "help") showHelp();
  else if (command === "camera") swap();
  else if (command === "numbers") $("numbers").open = !$("numbers").open;
  else if (control && device !== "gamepad") sendInput(); // a gamepad is read when input is sent anyway
}

function focus(focused) {
  if (page.focused && !focused) { send({ type: "blur" }); for (const hand of hands) hand.release(); }
  page.focused = focused;
  draw();
}

// ---- what the server tells

function told(message) {
  if (message.type === "hello") hello(message);
  else if (message.type === "status") { page.status = message; draw(); }
  else if (message.type === "pong") {
    const now = performance.now();
    page.trip = now - message.t;
    const offset = message.now * 1000 - (now + message.t) / 2;
    page.offset = page.offset === null ? offset : page.offset + 0.2 * (offset - page.offset);
  }
}

function hello(about) {
  page.about = about;
  page.keys = new Map(about.bindings.keys);
  $("task").textContent = words(about.task);
  $("where").textContent = `${about.robot} · ${about.tier} · ${about.action}`;
  document.title = `${words(about.task)} – fly`;
  $("instruction").textContent = about.instruction;
  about.cameras.forEach((name, i) => { $(`name-${i}`).textContent = name; });
  for (const i of [0, 1]) { const canvas = $(`canvas-${i}`); [canvas.height, canvas.width] = about.size; }
  buildNumbers($("readings"), about.readings);
  $("numbers").hidden = !about.readings.length;
  buildHelp();
}

async function pictures(buffer) {
  const view = new DataView(buffer);
  const [number, inputSeq, taken, count] =
    [view.getUint32(0, true), view.getUint32(4, true), view.getFloat64(8, true), view.getUint32(16, true)];
  let start = 20 + 4 * count;
  const parts = [];
  for (let i = 0; i < count; i += 1) {
    const size = view.getUint32(20 + 4 * i, true);
    parts.push(new Blob([new Uint8Array(buffer, start, size)], { type: "image/jpeg" }));
    start += size;
  }
  const images = await Promise.all(parts.map((part) => createImageBitmap(part)));
  if (!page.shown || number > page.shown.number || page.shown.number - number > 1000) {
    images.forEach((image, i) => $(`canvas-${i}`).getContext("2d").drawImage(image, 0, 0, ...page.about.size.toReversed()));
    page.shown = { number, taken, at: performance.now(), input: inputSeq };
    while (page.pressedAt.length && page.pressedAt[0].seq <= inputSeq) {
      page.latencies.push(performance.now() - page.pressedAt.shift().at);
    }
  }
  for (const image of images) image.close();
  send({ type: "ack", seq: number });
}

// ---- what is shown

function draw() {
  const status = page.status, body = document.body;
  body.dataset.role = status?.role ?? "spectator";
  if (status && status.state !== body.dataset.state) {
    body.dataset.state = status.state;
    $("live").textContent = `${STATES[status.state] ?? status.state}. ${status.message}`;
    drawHints();
  }
  drawBanner();
  if (!status) return;
  $("state").textContent = STATES[status.state] ?? status.state;
  $("timer").textContent = status.state === "idle" ? "" : clock(status.steps / page.about.rate);
  $("message").textContent = status.message;
  $("countdown").textContent = status.state === "countdown" ? Math.max(1, Math.ceil(status.countdown / page.about.rate)) : "";
  for (const kind of ["demos", "failures", "trash"]) $(`count-${kind}`).textContent = status.counts[kind];
  $("speed").textContent = status.speed.toFixed(2);
  $("gripper").value = status.opening;
  $("gripper").title = `${Math.round(100 * status.opening)} % open`;
  body.classList.toggle("precise", status.precise);
  drawNumbers($("readings"), page.about.readings, status.numbers);
  drawSubtasks(status);
  drawModes(status);
  drawReview(status);
}

function drawSubtasks(status) {
  const list = $("subtasks"), flags = { ...status.subtasks, done: status.success };
  if (list.children.length !== Object.keys(flags).length) {
    list.replaceChildren(...Object.keys(flags).map((name) => item(name === "done" ? "success" : words(name))));
  }
  Object.values(flags).forEach((met, i) => list.children[i].classList.toggle("met", met));
}

function drawModes(status) {
  const modes = status.modes;
  if ($("modes").dataset.of !== modes.join()) {
    $("modes").dataset.of = modes.join();
    $("modes").replaceChildren(...modes.map((name) => { const span = document.createElement("span"); span.textContent = name; return span; }));
  }
  modes.forEach((name, i) => $("modes").children[i].classList.toggle("on", name === status.mode));
}

function drawReview(status) {
  const asking = status.state === "review" && status.role === "controller";
  $("review").hidden = !asking;
  if (!asking) return;
  const good = status.success && status.label;
  for (const button of $("review-buttons").children) {
    if (button.dataset.command === "label") button.hidden = !status.success;
    if (button.dataset.command === "label") setText(button, status.label ? "Call it a failure" : "It is a success");
    if (button.dataset.command === "save") setText(button, good ? "Keep" : "Keep as a failure");
  }
  $("review").classList.toggle("good", good);
  $("verdict").textContent = good ? "Solved" : status.success ? "Solved, but called a failure" : "Not solved";
  $("verdict-text").textContent = `${clock(status.steps / page.about.rate)} long, seed ${status.seed}. ${status.message}`;
}

function drawBanner() {
  const status = page.status, banner = $("banner"), button = $("banner-button");
  let title = "", text = "", action = "";
  if (!status) [title, text] = ["No connection", page.about ? "The vehicle hovers and a recording pauses. Trying again…" : "Waiting for the flight to answer."];
  else if (status.role !== "controller") {
    [title, text] = ["Watching", status.free ? "Nobody has the controls." : "Somebody else has the controls."];
    action = status.asked === page.about.number ? "" : status.free ? "Take the controls" : "Ask for the controls";
    if (!action) text = "You have asked for the controls.";
  } else if (!page.focused) [title, text] = ["Hands off", "Click here to fly: keys go to another window."];
  else if (status.asked) [title, text, action] = ["Hand over?", "A spectator asks for the controls.", "Hand over"];
  else if (status.dead && status.state !== "countdown" && status.state !== "review" && status.state !== "paused") {
    [title, text] = ["Nobody at the controls", "Nothing has arrived for 300 ms: the vehicle hovers."];
  }
  banner.classList.toggle("calm", Boolean(status) && (status.role !== "controller" || status.asked > 0));
  if (banner.hidden !== !title) banner.hidden = !title;
  if (button.hidden !== !action) button.hidden = !action;
  if ($("banner-title").textContent !== title) $("banner-title").textContent = title;
  if ($("banner-text").textContent !== text) $("banner-text").textContent = text;
  if (button.textContent !== action) button.textContent = action;
}

function drawHints() {
  const state = document.body.dataset.state, device = document.body.dataset.device;
  const known = (HINTS[state] ?? []).filter((command) => command !== "label" || page.status?.success);
  const found = known.map((command) => ({ command, keys: controlsOf(command, device) }));
  $("hints").replaceChildren(...found.filter(({ keys }) => keys.length).map(({ command, keys }) => {
    const span = document.createElement("span");
    span.append(...keys.slice(0, 1).map(keycap), LABELS[`${state}.${command}`] ?? WORDS[command]);
    return span;
  }));
  for (const button of document.querySelectorAll("#pads [data-states]")) {
    button.hidden = !button.dataset.states.split(" ").includes(state);
  }
}

function drawSticks(held) {
  const down = new Set(held.map((name) => page.keys.get(name)));
  const key = (motion) => (down.has(`${motion}+`) ? 1 : 0) - (down.has(`${motion}-`) ? 1 : 0);
  const axes = sum(hands.map((hand) => hand.axes()));
  place($("stick-left"), (axes.left_x ?? 0) - key("yaw"), (axes.left_y ?? 0) - key("up"));
  place($("stick-right"), (axes.right_x ?? 0) - key("lateral"), (axes.right_y ?? 0) - key("forward"));
}

function place(stick, x, y) {
  const far = Math.max(1, Math.hypot(x, y));
  stick.style.setProperty("--x", (x / far).toFixed(3));
  stick.style.setProperty("--y", (y / far).toFixed(3));
  stick.classList.toggle("moved", x !== 0 || y !== 0);
}

function drawFigures() {
  const pace = page.status?.pace, age = pictureAge();
  figure("fig-rate", pace ? `${pace.rate.toFixed(1)} Hz` : "–", pace ? Number(pace.rate < 0.95 * page.about.rate * page.status.time_scale) * 2 : 0);
  figure("fig-late", pace ? String(pace.late) : "–", pace ? Number(pace.on_time < 0.95) : 0);
  figure("fig-trip", page.trip === null ? "–" : `${page.trip.toFixed(0)} ms`, 0);
  figure("fig-age", age === null ? "–" : `${age.toFixed(0)} ms`, age === null ? 0 : age > 300 ? 2 : age > 150 ? 1 : 0);
}

function pictureAge() {
  return page.shown && page.offset !== null ? Math.max(0, performance.now() + page.offset - 1000 * page.shown.taken) : null;
}

function figure(id, text, level) {
  $(id).textContent = text;
  $(id).className = ["", "amber", "red"][level];
}

function swap() {
  page.swapped = !page.swapped;
  document.body.classList.toggle("swapped", page.swapped);
}

function showHelp() {
  if (!$("help").open) { for (const hand of hands) hand.release(); $("help").showModal(); }
}

function buildHelp() {
  const sticks = { forward: "right stick ↕", lateral: "right stick ↔", up: "left stick ↕", yaw: "left stick ↔", grip: "RT  LT" };
  const rows = HELP.map(([name, ...commands]) => {
    const keys = commands.flatMap((command) => controlsOf(command, "keyboard")), motion = commands[0].slice(0, -1);
    const axes = commands.length > 1 && page.about.bindings.axes[motion];
    const buttons = axes ? [sticks[motion]] : commands.flatMap((command) => controlsOf(command, "gamepad"));
    return keys.length || buttons.length ? row(name, keys, buttons) : null;
  });
  $("help-rows").replaceChildren(...rows.filter(Boolean));
  $("help-modes").textContent = "Modes: tool moves along the heading; base carries it all as one body; wrist turns the tool on the spot.";
  buildButtons();
  drawHints();
}

function buildButtons() {
  const make = (command, states, text) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = text ?? WORDS[command];
    button.dataset.command = command;
    if (states) button.dataset.states = states;
    touch.button(button, `touch:${command}`);
    return button;
  };
  $("pads").replaceChildren(
    make("record", "idle", "record"), make("record", "recording", "stop"), make("record", "countdown", "cancel"),
    make("pause", "recording"), make("pause", "paused", "go on"), make("save", "paused", "stop and review"),
    make("discard", "recording paused"), make("mode", "idle recording"), make("precision", "idle recording"),
    make("grip+", "idle recording", "close"), make("grip-", "idle recording", "open"), make("undo", "idle", "undo discard"),
  );
  $("review-buttons").replaceChildren(make("save", "review", "Keep"), make("label", "review", "Call it a failure"), make("discard", "review", "Discard"));
}

function row(name, keys, buttons) {
  const line = document.createElement("tr");
  for (const content of [[name], keys.map(keycap), buttons.map(keycap)]) {
    const cell = document.createElement("td");
    cell.append(...content);
    line.append(cell);
  }
  return line;
}

function controlsOf(command, device) {
  const prefix = { keyboard: "", gamepad: "pad:", touch: "touch:" }[device];
  const mine = (name) => (prefix ? name.startsWith(prefix) : !name.includes(":"));
  const found = [...page.keys].filter(([name, bound]) => bound === command && mine(name)).map(([name]) => name);
  return device === "touch" ? [] : [...new Set(found.map(keyName))];
}

function keyName(name) {
  return KEY_NAMES[name] ?? name.replace(/^(Key|Digit|pad:|touch:)/, "");
}

function setText(element, text) { if (element.textContent !== text) element.textContent = text; }
function keycap(text) { const cap = document.createElement("kbd"); cap.textContent = text; return cap; }
function item(text) { const li = document.createElement("li"); li.textContent = text; return li; }
function words(name) { return name.replaceAll("_", " "); }
function clock(seconds) {
  const minutes = Math.floor(seconds / 60);
  return `${minutes}:${(seconds - 60 * minutes).toFixed(1).padStart(4, "0")}`;
}

// ---- begin

for (const id of ["stick-left", "stick-right"]) touch.stick($(id));
$("banner-button").addEventListener("click", () => send({ type: page.status?.role === "controller" ? "grant" : "ask" }));
$("help-button").addEventListener("click", showHelp);
$("view-side").addEventListener("click", swap);
addEventListener("focus", () => focus(true));
addEventListener("blur", () => focus(false));
document.addEventListener("visibilitychange", () => focus(!document.hidden && document.hasFocus()));
document.addEventListener("contextmenu", (event) => event.preventDefault());
new MutationObserver(drawHints).observe(document.body, { attributes: true, attributeFilter: ["data-device"] });
setInterval(sendInput, SEND_MS);
setInterval(() => send({ type: "ping", t: performance.now() }), PING_MS);
setInterval(drawFigures, FIGURES_MS);
$("numbers").open = !matchMedia("(max-width: 52rem), (max-height: 32rem)").matches; // they would hide a phone's picture
if (matchMedia("(pointer: coarse)").matches) document.body.dataset.device = "touch";
connect();
