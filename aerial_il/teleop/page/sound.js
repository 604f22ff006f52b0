// Short sounds for what happens, so that eyes may stay on the vehicle. Off until asked for.

import { $ } from "./dom.js";
import { remember, remembered } from "./state.js";

const CUES = { // name -> notes: Hz, s after the first, s long
  tick: [[660, 0, 0.06]], recording: [[880, 0, 0.18]], paused: [[440, 0, 0.1], [330, 0.12, 0.14]],
  review: [[523, 0, 0.12]], solved: [[523, 0, 0.1], [659, 0.1, 0.1], [784, 0.2, 0.22]],
  kept: [[659, 0, 0.08], [988, 0.09, 0.16]], discarded: [[330, 0, 0.08], [220, 0.09, 0.18]],
  alarm: [[196, 0, 0.16], [196, 0.22, 0.16]], step: [[784, 0, 0.07], [1047, 0.08, 0.12]],
};
const VOLUME = 0.08;
let on = remembered("sound") === "on", context = null;

export function cue(name) {
  if (!on || !context) return; // browsers let nothing sound before a hand has moved
  for (const [frequency, after, length] of CUES[name]) note(frequency, context.currentTime + after, length);
}

function note(frequency, start, length) {
  const tone = context.createOscillator(), gain = context.createGain();
  tone.frequency.value = frequency;
  gain.gain.setValueAtTime(0, start);
  gain.gain.linearRampToValueAtTime(VOLUME, start + 0.01);
  gain.gain.exponentialRampToValueAtTime(0.0001, start + length);
  tone.connect(gain).connect(context.destination);
  tone.start(start);
  tone.stop(start + length);
}

function wake() {
  if (on) context ??= new AudioContext();
  if (context?.state === "suspended") context.resume();
}

function set(wanted) {
  on = wanted;
  remember("sound", on ? "on" : "off");
  $("sound-button").setAttribute("aria-pressed", String(on));
  wake();
}

$("sound-button").setAttribute("aria-pressed", String(on));
$("sound-button").addEventListener("click", () => { set(!on); cue("kept"); });
for (const kind of ["keydown", "pointerdown"]) addEventListener(kind, wake, { capture: true });
