// What the flight's status says, drawn whenever it arrives.

import { drawBanner } from "./banner.js";
import { sound } from "./cues.js";
import { $, clock, make, setHidden, setText, words } from "./dom.js";
import { drawHints } from "./hints.js";
import { drawNumbers } from "./numbers.js";
import { drawReview } from "./review.js";
import { page } from "./state.js";
import { nameCameras } from "./pictures.js";
import { offer } from "./tutorial.js";
import { STATES } from "./vocabulary.js";

const FLIERS = { policy: "The policy flies", person: "You fly", nobody: "Nobody watches: it hovers" };

export function draw() {
  const { status } = page;
  document.body.dataset.role = status?.role ?? "spectator";
  if (status && status.state !== document.body.dataset.state) enter(status);
  drawBanner();
  sound(status);
  if (!status) return drawFlier({ shared: false }); // who flies is not known any more
  offer();
  drawFlier(status);
  drawLesson(status.lesson);
  drawEpisode(status);
  setText($("speed"), status.speed.toFixed(2));
  $("gripper").value = status.opening;
  $("gripper").title = `${Math.round(100 * status.opening)} % open`;
  document.body.classList.toggle("precise", status.precise);
  drawNumbers($("readings"), page.about.readings, status.numbers);
  drawSubtasks(status);
  drawHold(status);
  drawModes(status);
  drawReview(status);
}

function enter(status) {
  document.body.dataset.state = status.state;
  setText($("live"), `${STATES[status.state] ?? status.state}. ${status.message}`);
  drawHints();
}

function drawEpisode(status) {
  setText($("state"), STATES[status.state] ?? status.state);
  setText($("timer"), status.state === "idle" ? "" : clock(status.steps / page.about.rate));
  setText($("message"), status.message);
  const left = Math.max(1, Math.ceil(status.countdown / page.about.rate));
  setText($("countdown"), status.state === "countdown" ? String(left) : "");
  for (const kind of ["demos", "failures", "trash"]) setText($(`count-${kind}`), String(status.counts[kind]));
  setText($("count-waiting"), String(status.waiting));
  $("count-waiting").parentElement.classList.toggle("some", status.waiting > 0);
  setHidden($("practice"), !status.practice);
  if (status.cameras) nameCameras(status.cameras);
}

function drawLesson(lesson) { // how a policy that learns from these flights gets on
  const text = JSON.stringify(lesson ?? {}), panel = $("lesson");
  if (panel.dataset.shown === text) return;
  panel.dataset.shown = text;
  panel.hidden = !lesson?.message;
  setText($("lesson-message"), lesson?.message ?? "");
  $("lesson-rounds").replaceChildren(...(lesson?.rounds ?? []).map(({ alone, share }, i) =>
    make("li", `round ${i + 1}: ${alone}\u00a0% alone, you flew ${share}\u00a0%`)));
}

function drawFlier(status) { // of flights that a person and a policy share
  const flier = status.shared ? status.flier : "";
  if (document.body.dataset.flier === flier) return;
  document.body.dataset.flier = flier;
  for (const id of ["who", "live-flier"]) setText($(id), FLIERS[flier] ?? "");
  drawHints();
}

function drawSubtasks(status) {
  const list = $("subtasks"), flags = { ...status.subtasks, done: status.success };
  if (list.children.length !== Object.keys(flags).length) {
    list.replaceChildren(...Object.keys(flags).map((name) => make("li", name === "done" ? "success" : words(name))));
  }
  Object.entries(flags).forEach(([name, met], i) => {
    list.children[i].classList.toggle("met", met);
    list.children[i].classList.toggle("lost", status.lost.includes(name));
  });
  setText($("live-lost"), status.lost.map((name) => `${words(name)} is lost.`).join(" "));
}

function drawHold({ held, state }) { // how long success has held, of the time for which it must
  const ring = $("hold"), percent = Math.round(100 * held);
  setHidden(ring, !percent || !(state === "recording" || (state === "idle" && percent < 100)));
  if (ring.getAttribute("aria-valuenow") === String(percent)) return;
  ring.setAttribute("aria-valuenow", String(percent));
  ring.style.setProperty("--held", `${percent}%`);
}

function drawModes({ modes, mode }) {
  if ($("modes").dataset.of !== modes.join()) {
    $("modes").dataset.of = modes.join();
    $("modes").replaceChildren(...modes.map((name) => make("span", name)));
  }
  modes.forEach((name, i) => $("modes").children[i].classList.toggle("on", name === mode));
  setHidden($("mode"), mode === modes[0]); // one that was chosen stays on, from episode to episode
  setText($("mode"), `${mode} mode`);
}
