// Keys and buttons as the person wants them: pressed once to bind, checked for conflicts here and on the server.

import { on, send } from "./connection.js";
import { $, keycap, make, setHidden } from "./dom.js";
import { open } from "./help.js";
import { PAD_BUTTONS } from "./devices.js";
import { page } from "./state.js";
import { WORDS, belongs, keyName, stickOf } from "./vocabulary.js";

const DEVICES = ["keyboard", "gamepad"], POLL_MS = 50;
let wanted = {}, waiting = null, buttonsDown = new Set(); // wanted: device -> control -> command

function begin() {
  wanted = Object.fromEntries(DEVICES.map((device) => [device, new Map([...page.keys].filter(([control]) => belongs(control, device)))]));
  tell("", "");
  draw();
  open($("controls"));
}

function draw() {
  const rows = Object.entries(WORDS).map(([command, text]) => {
    const row = make("tr");
    row.append(make("td", text), ...DEVICES.map((device) => cell(device, command)));
    return row;
  });
  $("controls-rows").replaceChildren(...rows);
}

function cell(device, command) {
  if (device === "gamepad" && stickOf(command)) return make("td", stickOf(command)); // axes are not changed here
  const td = make("td"), button = make("button", "", { type: "button" });
  const controls = [...wanted[device]].filter(([, bound]) => bound === command).map(([control]) => control);
  button.dataset.of = `${device} ${command}`;
  button.setAttribute("aria-label", `${WORDS[command]}, ${device}: ${controls.map(keyName).join(" or ") || "nothing"}`);
  button.append(...(controls.length ? [...new Set(controls.map(keyName))].map(keycap) : ["–"]));
  button.classList.toggle("changed", controls.some((control) => page.keys.get(control) !== command));
  button.addEventListener("click", () => wait(device, command, button));
  td.append(button);
  return td;
}

function wait(device, command, button) {
  document.querySelector("#controls .waits")?.classList.remove("waits");
  button.classList.add("waits");
  waiting = { device, command };
  buttonsDown = new Set(pressedButtons());
  tell(`Press a ${device === "keyboard" ? "key" : "button"} for “${WORDS[command]}”. Escape leaves it as it is, Delete unbinds it.`, "");
}

function bind(control) {
  const { device, command } = waiting, other = control && wanted[device].get(control);
  if (other && other !== command) {
    tell(`${keyName(control)} gives “${WORDS[other] ?? other}” already. Take another one, or unbind that first.`, "bad");
    return;
  }
  for (const [bound, its] of wanted[device]) if (its === command) wanted[device].delete(bound);
  if (control) wanted[device].set(control, command);
  waiting = null;
  tell("Not saved yet.", "");
  draw();
}

function leave() { waiting = null; tell("", ""); draw(); }

function save() {
  const mapping = {};
  for (const device of DEVICES) {
    if (!wanted[device].size) continue;
    mapping[device] = {};
    for (const [control, command] of wanted[device]) (mapping[device][command] ??= []).push(control);
  }
  send({ type: "bind", mapping });
}

function tell(text, kind) {
  $("controls-notice").textContent = text;
  $("controls-notice").className = `notice ${kind}`;
  setHidden($("controls-notice"), !text);
}

function pressed(event) {
  if (!waiting) return;
  event.preventDefault();
  event.stopPropagation();
  if (event.code === "Escape") leave();
  else if (event.code === "Delete") bind(null);
  else if (waiting.device === "keyboard" && !event.repeat) bind(event.code);
}

function pressedButtons() {
  const pad = [...navigator.getGamepads()].find((each) => each?.connected && each.mapping === "standard");
  return pad ? PAD_BUTTONS.filter((_, i) => pad.buttons[i]?.pressed).map((name) => `pad:${name}`) : [];
}

function poll() {
  if (!waiting || waiting.device !== "gamepad") return;
  const down = pressedButtons(), fresh = down.find((name) => !buttonsDown.has(name));
  buttonsDown = new Set(down);
  if (fresh) bind(fresh);
}

// What the server says to a change: the new mapping has come with a greeting, or a reason why not.
on("bound", ({ ok, text }) => { if (ok) begin(); tell(text, ok ? "good" : "bad"); });
$("controls-button").addEventListener("click", begin);
$("controls-save").addEventListener("click", save);
$("controls-reset").addEventListener("click", () => send({ type: "bind", mapping: {} }));
$("controls").addEventListener("keydown", pressed);
$("controls").addEventListener("cancel", (event) => { if (waiting) event.preventDefault(); });
setInterval(poll, POLL_MS);
