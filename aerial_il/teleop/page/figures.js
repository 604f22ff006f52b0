// The figures in the page's head: how well time is kept, and how far away the flight is.

import { $, setText } from "./dom.js";
import { pictureAge } from "./pictures.js";
import { page } from "./state.js";

const FIGURES_MS = 250;
export const AMBER_MS = 150, RED_MS = 300; // a picture older than this; see docs/teleop.md
const LEVELS = ["", "amber", "red"];

export function drawFigures() {
  const pace = page.status?.pace, age = pictureAge();
  if (pace) {
    const due = page.about.rate * page.status.time_scale;
    show("fig-rate", `${pace.rate.toFixed(1)} Hz`, pace.rate < 0.95 * due ? 2 : 0);
    show("fig-late", String(pace.late), pace.on_time < 0.95 ? 1 : 0);
  }
  show("fig-trip", page.trip === null ? "–" : `${page.trip.toFixed(0)} ms`, 0);
  show("fig-age", age === null ? "–" : `${age.toFixed(0)} ms`, age > RED_MS ? 2 : age > AMBER_MS ? 1 : 0);
}

function show(id, text, level) {
  setText($(id), text);
  $(id).className = LEVELS[level];
}

setInterval(drawFigures, FIGURES_MS);
