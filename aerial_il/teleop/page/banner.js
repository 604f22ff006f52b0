// The banner above the pictures: why hands do nothing, and how the controls change hands.

import { send } from "./connection.js";
import { $, setHidden, setText } from "./dom.js";
import { earlyKey, lostPad } from "./input.js";
import { flies, page } from "./state.js";

const STILL = ["countdown", "review", "paused"]; // states in which nobody need be at the controls

export function drawBanner() {
  const { title = "", text = "", action = "", calm = false } = said(page.status);
  $("banner").classList.toggle("calm", calm);
  setHidden($("banner"), !title);
  setHidden($("banner-button"), !action);
  setText($("banner-title"), title);
  setText($("banner-text"), text);
  setText($("banner-button"), action);
}

function said(status) {
  if (!status) return lost();
  if (status.role !== "controller") return watching(status);
  if (!page.focused) return { title: "Hands off", text: "Click here to fly: keys go to another window." };
  if (status.asked) {
    return { title: "Hand over?", text: "A spectator asks for the controls.", action: "Hand over", calm: true };
  }
  if (lostPad()) return { title: "Gamepad unplugged", text: "The vehicle hovers. Plug it in again, or fly by keys." };
  if (status.dead && !STILL.includes(status.state)) {
    return { title: "Nobody at the controls", text: "Nothing has arrived for 300 ms: the vehicle hovers." };
  }
  if (earlyKey()) {
    return { title: `“${earlyKey()}” came too early`, text: "The flight had not answered yet: press it again.", calm: true };
  }
  return {};
}

function lost() {
  const text = "The vehicle hovers and a recording pauses. Trying again…";
  return { title: "No connection", text: page.about ? text : "Waiting for the flight to answer: keys do nothing yet." };
}

function watching(status) {
  if (status.asked === page.about.number) {
    return { title: "Watching", text: "You have asked for the controls. They come when nobody has used them for 30 s.", calm: true };
  }
  const text = status.free ? "Nobody has the controls." : "Somebody else has the controls.";
  return { title: "Watching", text, action: status.free ? "Take the controls" : "Ask for the controls", calm: true };
}

$("banner-button").addEventListener("click", () => send({ type: flies() ? "grant" : "ask" }));
