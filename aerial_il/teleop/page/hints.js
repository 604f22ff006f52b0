// What can be done now: keys in the page's foot, buttons for fingers beside the sticks.

import { $, keycap, make } from "./dom.js";
import { phone, touch } from "./input.js";
import { CLUTCH } from "./phone.js";
import { device, page, state } from "./state.js";
import { HINTS, LABELS, WORDS, controlsOf } from "./vocabulary.js";

const BUTTONS = [ // command, states in which it shows, text
  ["record", "idle", "record"], ["record", "recording", "stop"], ["record", "countdown", "cancel"],
  ["pause", "recording", "pause"], ["pause", "paused", "go on"], ["save", "paused", "stop and review"],
  ["discard", "recording paused", "discard"], ["take_over", "idle recording", "hold to take over"],
  ["mode", "idle recording", "mode"], ["precision", "idle recording", "precise"], ["grip+", "idle recording", "close"],
  ["grip-", "idle recording", "open"], ["undo", "idle", "undo discard"],
  ["gust", "idle recording", "gust"], ["push", "idle recording", "push"], ["drop", "idle recording", "drop it"],
];
const PERTURBATIONS = ["gust", "push", "drop"];

export function drawHints() {
  const means = { label: page.status?.success ?? false, take_over: page.status?.shared ?? false };
  const useful = (command) => means[command] ?? (!PERTURBATIONS.includes(command) || page.about?.perturbations?.includes(command));
  const known = (HINTS[state()] ?? []).filter(useful).map((command) => [command, controlsOf(command, device())]);
  $("hints").replaceChildren(...known.filter(([, keys]) => keys.length).map(([command, keys]) => {
    const hint = make("span");
    hint.append(keycap(keys[0]), LABELS[`${state()}.${command}`] ?? WORDS[command]);
    return hint;
  }));
  for (const button of document.querySelectorAll("#pads [data-states]")) {
    button.hidden = !button.dataset.states.split(" ").includes(state()) || !useful(button.dataset.command);
  }
}

export function buildButtons() {
  const buttons = BUTTONS.map(([command, states, text]) => {
    const button = commandButton(command, text);
    button.dataset.states = states;
    return button;
  });
  const row = make("div", "", { class: "perturbations", role: "group", "aria-label": "Perturbations" });
  row.append(...buttons.filter(({ dataset }) => PERTURBATIONS.includes(dataset.command)));
  $("pads").replaceChildren(...buttons.filter(({ dataset }) => !PERTURBATIONS.includes(dataset.command)), row);
  if (page.keys.has(CLUTCH)) $("pads").prepend(...phone.buttons(touch)); // first, where a thumb is
}

// A button that gives a command while it is pressed.
export function commandButton(command, text) {
  const button = make("button", text, { type: "button" });
  button.dataset.command = command;
  touch.button(button, `touch:${command}`);
  return button;
}

new MutationObserver(drawHints).observe(document.body, { attributes: true, attributeFilter: ["data-device"] });
