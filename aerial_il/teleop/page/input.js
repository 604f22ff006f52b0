// What hands do, fifty times a second: to the server what is flown, to the page what only the page obeys.

import { Gamepad, Keyboard, Touch, sum } from "./devices.js";
import { send } from "./connection.js";
import { Phone } from "./phone.js";
import { flies, page, state } from "./state.js";
import { keyName } from "./vocabulary.js";

const SEND_MS = 20, WALKING = /^(Tab|Enter|Space|Arrow.*)$/;
const local = new Map(); // command -> what the page does
const watchers = [];
let unpluggedAt = -Infinity;

// Whether a gamepad was unplugged so recently that it is worth saying.
export const lostPad = () => performance.now() - unpluggedAt < 6000;

// The key that was pressed before the flight had answered, for as long as it is worth saying.
export const earlyKey = () => (page.early && performance.now() - page.early.at < 8000 ? page.early.key : "");

export const touch = new Touch(used);
export const phone = new Phone();
const pad = new Gamepad(used);
const keyboard = new Keyboard((code) => page.keys.has(code) && !isThePages(code), used);
const hands = [keyboard, pad, touch];

// Let the page itself obey a command.
export function obey(command, work) { local.set(command, work); }

// Call `work` after each message, when page.held and page.axes are new.
export function watch(work) { watchers.push(work); }

export function release() { for (const hand of hands) hand.release(); }

export function focus(focused) {
  if (page.focused && !focused) { send({ type: "blur" }); release(); }
  page.focused = focused;
}

const isDialogOpen = () => Boolean(document.querySelector("dialog[open]"));

// Keys by which one walks through a page are the page's own where it is walked through, or where nothing flies.
function isThePages(code) {
  if (isDialogOpen()) return true;
  if (document.activeElement && document.activeElement !== document.body) return WALKING.test(code);
  return code === "Tab" && (!flies() || !["idle", "recording"].includes(state()));
}

function used(device, control) {
  if (device) document.body.dataset.device = device;
  const work = local.get(page.keys.get(control));
  if (work) work();
  else if (control && device !== "gamepad") sendInput(); // a gamepad is read when input is sent anyway
}

function sendInput() {
  if (!page.focused || !flies()) {
    for (const hand of hands) hand.presses.take(); // a press is for now, or for nothing
    return;
  }
  if (pad.read()) unplugged();
  page.seq += 1;
  const taken = hands.flatMap((hand) => hand.presses.take());
  const flying = isDialogOpen() ? [] : hands; // a dialog has all hands: a button that is bound there gives no command
  const pressed = flying.length ? taken.filter((name) => !local.has(page.keys.get(name))) : [];
  const held = flying.flatMap((hand) => hand.held());
  if (pressed.length) page.pressedAt.push({ seq: page.seq, at: performance.now() });
  page.held = held;
  page.axes = sum(flying.map((hand) => hand.axes()));
  send({ type: "input", seq: page.seq, held, pressed, axes: page.axes, pose: phone.pose(), t: performance.now() });
  for (const work of watchers) work(pressed);
}

function unplugged() {
  send({ type: "blur" }); // hover
  document.body.dataset.device = "keyboard";
  unpluggedAt = performance.now();
}

addEventListener("keydown", ({ code, repeat, ctrlKey, altKey, metaKey }) => {
  if (!page.status && !repeat && !ctrlKey && !altKey && !metaKey) page.early = { key: keyName(code), at: performance.now() };
});
setInterval(sendInput, SEND_MS);
