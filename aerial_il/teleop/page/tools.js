// The tools in the page's head: a list where there is no room for them side by side.

import { $ } from "./dom.js";

function open(wanted) {
  $("tools").classList.toggle("open", wanted);
  $("tools-button").setAttribute("aria-expanded", String(wanted));
}

$("tools-button").addEventListener("click", () => open(!$("tools").classList.contains("open")));
addEventListener("click", ({ target }) => { if (!target.closest("#tools-button, #theme-button, #sound-button")) open(false); });
// A click leaves no focus behind: the space bar belongs to the gripper again. Who walks by keys keeps it.
addEventListener("pointerup", ({ target }) => setTimeout(() => target.closest("button, a, summary")?.blur()));
addEventListener("keydown", ({ code }) => { if (code === "Escape") { open(false); document.activeElement?.blur(); } });
$("summary-button").href = `summary${location.search}`;
