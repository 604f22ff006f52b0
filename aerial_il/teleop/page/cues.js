// Which sound goes with which change of the flight's status.

import { cue } from "./sound.js";

let before = null;

export function sound(status) {
  const last = before;
  before = status;
  if (!last) return;
  if (!status) return cue("alarm");
  for (const [name, heard] of heardIn(last, status)) if (heard) cue(name);
}

function heardIn(last, status) {
  const entered = (state) => status.state === state && last.state !== state;
  const seconds = (s) => (s.state === "countdown" ? Math.ceil(s.countdown / 50) : 0);
  return [
    ["tick", seconds(status) > 0 && seconds(status) !== seconds(last)],
    ["recording", entered("recording")], ["paused", entered("paused")],
    ["solved", entered("review") && status.success], ["review", entered("review") && !status.success],
    ["kept", last.state === "review" && status.state === "idle" && status.counts.trash === last.counts.trash],
    ["discarded", status.counts.trash > last.counts.trash],
    ["alarm", status.lost.length > last.lost.length],
    ["alarm", status.dead && !last.dead && status.state === "recording"],
  ];
}
