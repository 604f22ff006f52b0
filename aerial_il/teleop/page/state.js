// What the page knows: of the flight, of its own hands, and of the picture that is shown.

export const page = {
  about: null, status: null, socket: null, seq: 0, focused: document.hasFocus(), offset: null, trip: null, shown: null,
  pressedAt: [], early: null, latencies: [], keys: new Map(), held: [], axes: {}, // of what was sent last
};
window.teleop = page; // for tests, and for who is curious

export const flies = () => page.status?.role === "controller";
export const state = () => document.body.dataset.state;
export const device = () => document.body.dataset.device;

// What this browser keeps for the next visit; a browser that keeps nothing is no reason to fail.
export function remembered(name) {
  try { return localStorage.getItem(`aerial_il.${name}`); } catch { return null; }
}
export function remember(name, value) {
  try { localStorage.setItem(`aerial_il.${name}`, value); } catch { /* private windows */ }
}
