// What sticks and keys ask for along one motion, in [-1, 1], as the bindings have it.

import { page } from "./state.js";

export function commanded(motion) {
  const down = new Set(page.held.map((name) => page.keys.get(name)));
  let value = (down.has(`${motion}+`) ? 1 : 0) - (down.has(`${motion}-`) ? 1 : 0);
  for (const axis of page.about.bindings.axes[motion] ?? []) {
    value += axis.startsWith("-") ? -(page.axes[axis.slice(1)] ?? 0) : page.axes[axis] ?? 0;
  }
  return Math.max(-1, Math.min(1, value));
}
