// The words of the page: commands, keys and states, and which commands are worth knowing in which state.

import { page } from "./state.js";

export const WORDS = {
  "forward+": "ahead", "forward-": "back", "lateral+": "left", "lateral-": "right", "up+": "up", "up-": "down",
  "yaw+": "turn left", "yaw-": "turn right", "grip+": "close gripper", "grip-": "open gripper", precision: "precise",
  take_over: "take over", mode: "mode", record: "record", save: "keep", discard: "discard", undo: "undo discard",
  label: "call it a failure", pause: "pause", camera: "swap cameras", numbers: "numbers", help: "help",
  gust: "gust", push: "push", drop: "drop it",
};

export const STATES = {
  idle: "free flight", countdown: "get ready", recording: "recording", paused: "paused", review: "review",
};

export const HINTS = { // state -> commands worth knowing now
  idle: ["record", "take_over", "mode", "precision", "grip+", "grip-", "undo", "camera", "numbers", "help"],
  countdown: ["record"],
  recording: ["take_over", "record", "pause", "discard", "mode", "precision", "grip+", "grip-", "camera", "numbers"],
  paused: ["pause", "save", "discard"],
  review: ["save", "discard", "label"],
};

export const LABELS = { // what a command means in a state
  "idle.record": "record an episode", "countdown.record": "cancel", "recording.record": "stop and review",
  "paused.pause": "go on", "paused.save": "stop and review", "review.save": "keep", "recording.discard": "throw away",
  "idle.take_over": "hold to take over", "recording.take_over": "hold to take over",
};

export const HELP = [ // rows of the help: name, commands
  ["ahead, back", "forward+", "forward-"], ["left, right", "lateral+", "lateral-"], ["up, down", "up+", "up-"],
  ["turn left, right", "yaw+", "yaw-"], ["close, open gripper", "grip+", "grip-"], ["precise (hold)", "precision"],
  ["take over (hold)", "take_over"], ["mode", "mode"], ["record, stop", "record"], ["pause", "pause"],
  ["keep", "save"], ["discard", "discard"], ["undo discard", "undo"], ["call it a failure", "label"],
  ["a gust", "gust"], ["a push", "push"], ["let the object slip", "drop"], ["swap cameras", "camera"], ["show numbers", "numbers"], ["this help", "help"],
];

const KEY_NAMES = {
  ArrowLeft: "←", ArrowRight: "→", ArrowUp: "↑", ArrowDown: "↓", Space: "space", Enter: "enter", Backspace: "⌫",
  ShiftLeft: "shift", ShiftRight: "shift", Tab: "tab", Escape: "esc", Slash: "?", Comma: ",", Period: ".",
};
const PREFIXES = { keyboard: "", gamepad: "pad:", touch: "touch:" };
const STICKS = {
  forward: "right stick ↕", lateral: "right stick ↔", up: "left stick ↕", yaw: "left stick ↔", grip: "RT  LT",
};

export const keyName = (name) => KEY_NAMES[name] ?? name.replace(/^(Key|Digit|pad:|touch:)/, "");

// Whether a control, as frames name it, belongs to a device.
export function belongs(control, device) {
  const prefix = PREFIXES[device];
  return prefix ? control.startsWith(prefix) : prefix === "" && !control.includes(":");
}

// Names of the keys or buttons of a device that give a command now.
export function controlsOf(command, device) {
  if (device === "touch") return []; // its buttons are named after what they do
  const pairs = [...page.keys].filter(([name, bound]) => bound === command && belongs(name, device));
  return [...new Set(pairs.map(([name]) => keyName(name)))];
}

// The stick or trigger that gives a signed motion such as "up+", if one does.
export const stickOf = (command) => (page.about.bindings.axes[command.slice(0, -1)] ? STICKS[command.slice(0, -1)] : "");

// The same for a gamepad, whose sticks are no buttons.
export function gamepadControls(commands) {
  const motion = commands[0].slice(0, -1);
  if (commands.length > 1 && page.about.bindings.axes[motion]) return [STICKS[motion]];
  return commands.flatMap((command) => controlsOf(command, "gamepad"));
}
