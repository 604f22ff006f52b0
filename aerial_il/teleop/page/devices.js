// What a person does with hands: keys, a gamepad, sticks on the page. Each answers held(), and axes(); presses are kept
// until they are taken, so that a tap between two messages is not lost.

export const PAD_BUTTONS = [
  "A", "B", "X", "Y", "LB", "RB", "LT", "RT", "Back", "Start", "L3", "R3", "Up", "Down", "Left", "Right", "Home",
];

class Presses {
  constructor() { this.waiting = []; }
  add(name) { this.waiting.push(name); }
  take() { const taken = this.waiting; this.waiting = []; return taken; }
}

export class Keyboard {
  constructor(isBound, changed) {
    this.down = new Set();
    this.presses = new Presses();
    this.isBound = isBound;
    this.changed = changed;
    addEventListener("keydown", (event) => this.press(event));
    addEventListener("keyup", (event) => { if (this.down.delete(event.code)) changed("keyboard", null); });
  }
  press(event) {
    if (event.ctrlKey || event.altKey || event.metaKey || !this.isBound(event.code)) return;
    event.preventDefault();
    if (event.repeat || this.down.has(event.code)) return;
    this.down.add(event.code);
    this.presses.add(event.code);
    this.changed("keyboard", event.code);
  }
  held() { return [...this.down]; }
  axes() { return {}; }
  release() { this.down.clear(); this.presses.take(); }
}

export class Gamepad {
  constructor(changed) {
    this.down = new Set();
    this.presses = new Presses();
    this.sticks = {};
    this.present = false;
    this.changed = changed;
    addEventListener("gamepadconnected", () => changed("gamepad", null));
  }
  read() {
    const pad = [...navigator.getGamepads()].find((each) => each && each.connected && each.mapping === "standard");
    const lost = this.present && !pad;
    this.present = Boolean(pad);
    if (!pad) { this.release(); return lost; }
    const [left_x, left_y, right_x, right_y] = pad.axes.map(clip);
    const value = (i) => clip(pad.buttons[i]?.value ?? 0);
    this.sticks = { left_x, left_y, right_x, right_y, left_trigger: value(6), right_trigger: value(7) };
    const now = new Set(PAD_BUTTONS.filter((_, i) => pad.buttons[i]?.pressed).map((name) => `pad:${name}`));
    const fresh = [...now].filter((name) => !this.down.has(name));
    this.down = now;
    for (const name of fresh) { this.presses.add(name); this.changed("gamepad", name); }
    if (Object.values(this.sticks).some((a) => Math.abs(a) > 0.3)) this.changed("gamepad", null);
    return false;
  }
  held() { return [...this.down]; }
  axes() { return this.sticks; }
  release() { this.down.clear(); this.presses.take(); this.sticks = {}; }
}

export class Touch {
  constructor(changed) {
    this.down = new Set();
    this.presses = new Presses();
    this.sticks = {};
    this.changed = changed;
  }
  stick(element) {
    const { x, y } = element.dataset;
    let pointer = null;
    const move = (event) => {
      const box = element.getBoundingClientRect();
      const [dx, dy] = [event.clientX - box.left - box.width / 2, event.clientY - box.top - box.height / 2];
      const far = Math.max(1, Math.hypot(dx, dy) / (box.width * 0.36));
      this.sticks[x] = clip(dx / far / (box.width * 0.36));
      this.sticks[y] = clip(dy / far / (box.width * 0.36));
    };
    const end = (event) => {
      if (event.pointerId !== pointer) return;
      pointer = null;
      delete this.sticks[x];
      delete this.sticks[y];
    };
    element.addEventListener("pointerdown", (event) => {
      if (pointer !== null) return;
      pointer = event.pointerId;
      element.setPointerCapture(pointer);
      this.changed(event.pointerType === "touch" ? "touch" : "keyboard", null);
      move(event);
    });
    element.addEventListener("pointermove", (event) => { if (event.pointerId === pointer) move(event); });
    element.addEventListener("pointerup", end);
    element.addEventListener("pointercancel", end);
    element.addEventListener("lostpointercapture", end);
  }
  button(element, name) {
    const up = () => this.down.delete(name);
    element.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      this.down.add(name);
      this.presses.add(name);
      this.changed(event.pointerType === "touch" ? "touch" : null, name);
    });
    for (const kind of ["pointerup", "pointercancel", "pointerleave"]) element.addEventListener(kind, up);
  }
  held() { return [...this.down]; }
  axes() { return this.sticks; }
  release() { this.down.clear(); this.presses.take(); this.sticks = {}; }
}

export function sum(all) {
  const sum = {};
  for (const axes of all) for (const [name, value] of Object.entries(axes)) sum[name] = clip((sum[name] ?? 0) + value);
  return sum;
}

function clip(value) { return Math.max(-1, Math.min(1, Number.isFinite(value) ? value : 0)); }
