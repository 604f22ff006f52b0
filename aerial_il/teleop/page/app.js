// The page to fly on: what hands do goes out fifty times a second, pictures and figures come in.

import "./controls.js";
import { connect, on, send } from "./connection.js";
import { $, words } from "./dom.js";
import "./figures.js";
import { buildHelp } from "./help.js";
import { buildButtons, drawHints } from "./hints.js";
import { draw } from "./hud.js";
import { focus, obey } from "./input.js";
import { buildNumbers } from "./numbers.js";
import { nameCameras, pictures, prepareCanvases, swap } from "./pictures.js";
import { buildReview } from "./review.js";
import { page } from "./state.js";
import "./sticks.js";
import "./theme.js";
import "./tools.js";
import "./tutorial.js";

function hello(about) {
  page.about = about;
  page.keys = new Map(about.bindings.keys);
  $("task").textContent = words(about.task);
  $("where").textContent = `${about.robot} · ${about.tier} · ${about.action}`;
  document.title = `${words(about.task)} – fly`;
  $("instruction").textContent = about.instruction;
  prepareCanvases(about);
  nameCameras(about.cameras);
  buildNumbers($("readings"), about.readings);
  $("numbers").hidden = !about.readings.length;
  buildHelp();
  buildButtons();
  buildReview();
  drawHints();
}

function look(focused) {
  focus(focused);
  draw();
}

on("hello", hello);
on("status", (status) => { page.status = status; draw(); });
on("pictures", pictures);
on("lost", draw);
obey("camera", swap);
obey("numbers", () => { $("numbers").open = !$("numbers").open; });
for (const id of ["view-side", "view-main"]) $(id).addEventListener("click", ({ currentTarget }) => {
  if ((currentTarget.id === "view-main") === document.body.classList.contains("swapped")) swap(); // the small picture, whichever it is
});
$("view-button").addEventListener("click", () => send({ type: "view" }));
addEventListener("focus", () => look(true));
addEventListener("blur", () => look(false));
document.addEventListener("visibilitychange", () => look(!document.hidden && document.hasFocus()));
document.addEventListener("contextmenu", (event) => event.preventDefault());
$("numbers").open = !matchMedia("(max-width: 52rem), (max-height: 32rem)").matches; // they would hide a phone's picture
if (matchMedia("(pointer: coarse)").matches) document.body.dataset.device = "touch";
connect();
