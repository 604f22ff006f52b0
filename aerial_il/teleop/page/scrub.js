// A look back at the episode that is to be kept or not: the server renders the moment that the slider asks for.

import { send } from "./connection.js";
import { $, clock, make, words } from "./dom.js";
import { page } from "./state.js";

const SEND_MS = 40, ROOM = 0.3;
let playing = null, marked = "";

// Begin a review at the episode's end.
export function rewind(status) {
  stop();
  marked = "";
  $("scrub").value = $("scrub").max;
  drawTime();
  drawMarks(status.marks ?? {});
}

export function stop() {
  clearInterval(playing);
  playing = null;
  $("scrub-play").textContent = "▶";
}

const seconds = () => page.status.steps / page.about.rate;
const share = () => $("scrub").value / $("scrub").max;

function ask() {
  drawTime();
  send({ type: "scrub", share: share() });
}

function drawTime() { $("scrub-time").textContent = `${clock(share() * seconds())} of ${clock(seconds())}`; }

function drawMarks(marks) { // where sub-tasks were first solved
  if (marked === JSON.stringify(marks)) return;
  marked = JSON.stringify(marks);
  $("scrub-marks").replaceChildren(...gathered(marks).map(({ at, names }) => {
    const mark = make("li", names.map(words).join(", "), { class: at < 0.3 ? "first" : at > 0.6 ? "last" : "" });
    mark.style.left = `${100 * at}%`;
    return mark;
  }));
}

function gathered(marks) { // those that would cover each other stand together, where the first of them is
  const groups = [];
  for (const [name, at] of Object.entries(marks).sort(([, a], [, b]) => a - b)) {
    if (groups.length && at - groups.at(-1).at < ROOM) groups.at(-1).names.push(name);
    else groups.push({ at, names: [name] });
  }
  return groups;
}

function play() {
  if (playing) return stop();
  const started = performance.now() - 1000 * (share() >= 1 ? 0 : share() * seconds());
  $("scrub-play").textContent = "❚❚";
  playing = setInterval(() => {
    const now = (performance.now() - started) / 1000 / Math.max(seconds(), 0.02);
    $("scrub").value = Math.min(1, now) * $("scrub").max;
    ask();
    if (now >= 1) stop();
  }, SEND_MS);
}

$("scrub").addEventListener("input", () => { stop(); ask(); });
$("scrub-play").addEventListener("click", play);
