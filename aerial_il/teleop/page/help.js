// The help: every command with its key and its button, as they are bound now.

import { $, keycap, make } from "./dom.js";
import { obey, release } from "./input.js";
import { HELP, controlsOf, gamepadControls } from "./vocabulary.js";

export function buildHelp() {
  const rows = HELP.map(([name, ...commands]) => {
    const keys = commands.flatMap((command) => controlsOf(command, "keyboard")), buttons = gamepadControls(commands);
    return keys.length || buttons.length ? row(name, keys, buttons) : null;
  });
  $("help-rows").replaceChildren(...rows.filter(Boolean));
}

// Open a dialog: keys are its own while it is open.
export function open(dialog) {
  if (dialog.open) return;
  release();
  dialog.showModal();
}

function row(name, keys, buttons) {
  const line = make("tr");
  for (const content of [[name], keys.map(keycap), buttons.map(keycap)]) {
    const cell = make("td");
    cell.append(...content);
    line.append(cell);
  }
  return line;
}

const show = () => open($("help"));
obey("help", show);
$("help-button").addEventListener("click", show);
