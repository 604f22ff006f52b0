// The two sticks on the page: they show what any device does, and fingers move them.

import { $ } from "./dom.js";
import { touch, watch } from "./input.js";
import { page } from "./state.js";

const STICKS = { "stick-left": ["left", "yaw", "up"], "stick-right": ["right", "lateral", "forward"] };

function drawSticks() {
  const down = new Set(page.held.map((name) => page.keys.get(name)));
  const key = (motion) => (down.has(`${motion}+`) ? 1 : 0) - (down.has(`${motion}-`) ? 1 : 0);
  for (const [id, [side, across, along]] of Object.entries(STICKS)) {
    place($(id), (page.axes[`${side}_x`] ?? 0) - key(across), (page.axes[`${side}_y`] ?? 0) - key(along));
  }
}

function place(stick, x, y) {
  const far = Math.max(1, Math.hypot(x, y));
  stick.style.setProperty("--x", (x / far).toFixed(3));
  stick.style.setProperty("--y", (y / far).toFixed(3));
  stick.classList.toggle("moved", x !== 0 || y !== 0);
}

for (const id of Object.keys(STICKS)) touch.stick($(id));
watch(drawSticks);
