// Pictures as they come in: the newest is drawn, and every one is acknowledged, so that the next may be sent.

import { send } from "./connection.js";
import { $, setText } from "./dom.js";
import { page } from "./state.js";

const HEAD_BYTES = 20, FAR_BACK = 1000; // numbers that start anew belong to a new flight

export async function pictures(buffer) {
  const { number, inputSeq, taken, parts } = unpacked(buffer);
  const images = await Promise.all(parts.map((part) => createImageBitmap(part)));
  if (!page.shown || number > page.shown.number || page.shown.number - number > FAR_BACK) {
    images.forEach(draw);
    page.shown = { number, taken, at: performance.now(), input: inputSeq };
    while (page.pressedAt.length && page.pressedAt[0].seq <= inputSeq) {
      page.latencies.push(performance.now() - page.pressedAt.shift().at);
    }
  }
  for (const image of images) image.close();
  send({ type: "ack", seq: number });
}

// Milliseconds since the state that is seen was simulated; null before the clocks are compared.
export function pictureAge() {
  if (!page.shown || page.offset === null) return null;
  return Math.max(0, performance.now() + page.offset - 1000 * page.shown.taken);
}

export function prepareCanvases({ size: [height, width] }) {
  for (const i of [0, 1]) Object.assign($(`canvas-${i}`), { height, width });
}

export function nameCameras(names) { names.forEach((name, i) => setText($(`name-${i}`), name)); }

export function swap() { document.body.classList.toggle("swapped"); }

function draw(image, i) {
  const canvas = $(`canvas-${i}`);
  canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
}

function unpacked(buffer) {
  const view = new DataView(buffer), count = view.getUint32(16, true), parts = [];
  let start = HEAD_BYTES + 4 * count;
  for (let i = 0; i < count; i += 1) {
    const size = view.getUint32(HEAD_BYTES + 4 * i, true);
    parts.push(new Blob([new Uint8Array(buffer, start, size)], { type: "image/jpeg" }));
    start += size;
  }
  return { number: view.getUint32(0, true), inputSeq: view.getUint32(4, true), taken: view.getFloat64(8, true), parts };
}
