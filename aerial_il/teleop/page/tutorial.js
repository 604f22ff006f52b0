// A minute that teaches by doing: each step waits for what the person really does. What is recorded in it is not kept.

import { send } from "./connection.js";
import { $, make, setText } from "./dom.js";
import { watch } from "./input.js";
import { commanded } from "./motions.js";
import { cue } from "./sound.js";
import { device, flies, page, remember, remembered } from "./state.js";
import { controlsOf } from "./vocabulary.js";

const TICK_S = 0.02, LONG_ENOUGH_S = 0.5, PUSHED = 0.3;
const STICK_WORDS = { forward: "the right stick", up: "the left stick", yaw: "the left stick", grip: "the triggers" };

const moves = (motion) => (memory) => {
  if (Math.abs(commanded(motion)) > PUSHED && !page.status.dead) memory.time = (memory.time ?? 0) + TICK_S;
  return memory.time > LONG_ENOUGH_S;
};
const changes = (read, least) => (memory) => {
  memory.first ??= read();
  return typeof memory.first === "number" ? Math.abs(read() - memory.first) > least : read() !== memory.first;
};
const STEPS = [ // title, commands that do it, what else to say, when it is done
  ["Fly ahead and back", ["forward+", "forward-"], "Let go, and it hovers.", moves("forward")],
  ["Up and down", ["up+", "up-"], "The line below the tool shows what it is above.", moves("up")],
  ["Turn", ["yaw+", "yaw-"], "The camera turns with it: ahead stays ahead.", moves("yaw")],
  ["Change the mode", ["mode"], "Now the sticks move something else. The mode is shown beside the picture.", changes(() => page.status.mode)],
  ["Close and open the gripper", ["grip+", "grip-"], "The bar shows how far it is open.", changes(() => page.status.opening, 0.3)],
  ["Record", ["record"], "Two seconds to get ready, then the episode begins.", () => page.status.state === "recording"],
  ["Fly a little, then stop", ["record"], "It stops by itself once the task is solved.", () => page.status.state === "review"],
  ["Look at it, and keep it", ["save"], "Drag the slider to see any moment again. This one is for practice and is not kept.", (memory) => {
    memory.asked ||= page.status.state === "review";
    return memory.asked && page.status.state === "idle";
  }],
];
let at = -1, memory = {}, offered = false, steps = STEPS;

export function offer() { // to who has never flown here
  if (offered || remembered("tutorial") || !flies()) return;
  offered = true;
  show("New here?", "A minute of flying teaches all that it takes. Nothing of it is kept.", "not now");
  const begin = make("button", "begin", { type: "button", id: "coach-begin" });
  begin.addEventListener("click", start);
  $("coach-text").append(begin);
}

export function start() {
  if (!flies()) return;
  steps = page.about.grips ? STEPS : STEPS.filter(([, commands]) => commands[0] !== "grip+");
  at = 0;
  memory = {};
  send({ type: "practice", on: true });
  draw();
}

function end(text) {
  at = -1;
  remember("tutorial", "done");
  send({ type: "practice", on: false });
  if (text) show("That is all", text, "close");
  else hide();
}

function draw() {
  const [title, commands, more] = steps[at];
  $("coach-steps").replaceChildren(...steps.map((_, i) => make("i", "", { class: i < at ? "met" : i === at ? "now" : "" })));
  show(title, `${means(commands)} ${more}`, "skip the tutorial");
}

function means(commands) { // the controls of the device in use
  const motion = commands[0].slice(0, -1);
  if (device() === "touch") return STICK_WORDS[motion] && motion !== "grip" ? `With ${STICK_WORDS[motion]}.` : "With the button of that name.";
  if (device() === "gamepad" && commands.length > 1) return `With ${STICK_WORDS[motion]}.`;
  const names = commands.flatMap((command) => controlsOf(command, device()).slice(0, 1));
  return names.length ? `Press ${names.join(" and ")}.` : "";
}

function show(title, text, skip) {
  document.body.dataset.coaching = "";
  $("coach").hidden = false;
  for (const [id, said] of [["coach-title", title], ["coach-text", text], ["coach-skip", skip]]) setText($(id), said);
}

function hide() {
  delete document.body.dataset.coaching;
  $("coach").hidden = true;
  $("coach-steps").replaceChildren();
}

function look() {
  if (!$("coach").hidden && at < 0 && page.status?.state === "countdown") hide(); // who records needs no offer
  if (at < 0 || !page.status || !steps[at][3](memory)) return;
  at += 1;
  memory = {};
  cue("step");
  if (at === steps.length) end("Press R to record, and H for help. Good flight.");
  else draw();
}

$("tutorial-button").addEventListener("click", start);
$("coach-skip").addEventListener("click", () => end(""));
watch(look);
new MutationObserver(() => { if (at >= 0) draw(); }).observe(document.body, { attributes: true, attributeFilter: ["data-device"] });
