// The question after an episode: keep it, as what, or throw it away?

import { $, clock, setHidden, setText } from "./dom.js";
import { commandButton } from "./hints.js";
import { rewind, stop } from "./scrub.js";
import { page } from "./state.js";

export function buildReview() {
  $("review-buttons").replaceChildren(
    commandButton("save", "Keep"), commandButton("label", "Call it a failure"), commandButton("discard", "Discard"),
  );
}

export function drawReview(status) {
  const asking = status.state === "review" && status.role === "controller";
  if (asking && $("review").hidden) rewind(status);
  setHidden($("review"), !asking);
  if (!asking) { stop(); return; }
  const good = status.success && status.label;
  drawButtons(status, good);
  $("review").classList.toggle("good", good);
  setText($("verdict"), good ? "Solved" : status.success ? "Solved, but called a failure" : "Not solved");
  setText($("verdict-text"), `${clock(status.steps / page.about.rate)} long, seed ${status.seed}. ${status.message}`);
}

function drawButtons(status, good) {
  for (const button of $("review-buttons").children) {
    if (button.dataset.command === "label") {
      setHidden(button, !status.success);
      setText(button, status.label ? "Call it a failure" : "It is a success");
    }
    if (button.dataset.command === "save") setText(button, good ? "Keep" : "Keep as a failure");
  }
}
