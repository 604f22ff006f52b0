// Charts answer the pointer and the keys: values under the cursor, drag to zoom, double click to see all again.
// They stay whole without it. A chart's inner svg holds the data; to zoom is to look at a part of it by its viewBox.
(() => {
const LEAST = 6; // pixels that a drag must span to be one

function element(name, attributes, parent) {
  const made = document.createElementNS(parent.namespaceURI, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return parent.appendChild(made);
}
function written(value) { return Math.abs(value) >= 1e5 || (value && Math.abs(value) < 1e-3) ? value.toExponential(2) : String(+value.toPrecision(4)); }

function roundTicks(lo, hi, log) {
  if (log && hi / lo >= 10) {
    const powers = [];
    for (let p = Math.ceil(Math.log10(lo) - 1e-9); p <= Math.log10(hi) + 1e-9; p++) powers.push(10 ** p);
    if (powers.length > 1) return powers;
  }
  const raw = (hi - lo) / 5, power = 10 ** Math.floor(Math.log10(raw)), ticks = [];
  const step = [1, 2, 5, 10].map(m => m * power).find(s => s >= raw * 0.999);
  for (let k = Math.ceil(lo / step - 1e-9); k <= hi / step + 1e-9; k++) ticks.push(k * step);
  return ticks;
}

function enliven(chart) {
  const axes = JSON.parse(chart.dataset.axes), data = chart.querySelector(".data"), ticks = chart.querySelector(".ticks");
  const [left, top, width, height] = data.getAttribute("viewBox").split(" ").map(Number), whole = { x: left, y: top, w: width, h: height };
  const readout = chart.closest("figure").querySelector("figcaption").appendChild(document.createElement("output"));
  const still = ticks.innerHTML, marks = [...data.querySelectorAll("circle, .end")], whiskers = [...data.querySelectorAll(".whisker, .reach")];
  const lines = [...data.querySelectorAll("polyline")].map(line => {
    const points = [...line.points].map(p => [p.x, p.y]);
    return { title: line.textContent, points, ordered: points.every((p, k) => !k || p[0] >= points[k - 1][0]) };
  }).filter(line => line.points.length);
  const bars = [...data.querySelectorAll("rect")].map(bar => ({ title: bar.textContent, from: bar.x.baseVal.value, to: bar.x.baseVal.value + bar.width.baseVal.value }));
  const cursor = element("path", { class: "cursor" }, data), dot = element("circle", { class: "nearest", r: 4, visibility: "hidden" }, data);
  const box = element("rect", { class: "selection", width: 0, height: 0 }, data);
  marks.push(dot);
  let view = whole, at = null, start = null;

  const share = { x: px => (px - left) / width, y: py => (top + height - py) / height };
  const value = (axis, pixel) => {
    const [lo, hi, log] = axes[axis], s = share[axis](pixel);
    return log ? lo * (hi / lo) ** s : lo + s * (hi - lo);
  };
  const place = (axis, v) => {
    const [lo, hi, log] = axes[axis], s = log ? Math.log(v / lo) / Math.log(hi / lo) : (v - lo) / (hi - lo);
    return axis === "x" ? left + s * width : top + height - s * height;
  };
  const read = (axis, pixel) => { // as exactly as a drawing in tenths of pixels says it
    const [lo, hi, log] = axes[axis], v = value(axis, pixel);
    const percent = axis === "y" && axes.percent, shown = percent ? 100 * v : v, span = (hi - lo) * (percent ? 100 : 1);
    const digits = Math.min(Math.max(Math.ceil(-Math.log10(span / 500)), 0), 12);
    return (log ? written(+v.toPrecision(3)) : written(+shown.toFixed(digits))) + (percent ? " %" : "");
  };
  const inside = event => {
    const p = new DOMPoint(event.clientX, event.clientY).matrixTransform(chart.getScreenCTM().inverse());
    const clip = (v, lo, hi) => Math.min(Math.max(v, lo), hi);
    return [view.x + clip((p.x - left) / width, 0, 1) * view.w, view.y + clip((p.y - top) / height, 0, 1) * view.h];
  };

  function look(part) {
    view = part;
    const sx = view.w / width, sy = view.h / height, zoomed = view !== whole;
    data.setAttribute("viewBox", `${view.x} ${view.y} ${view.w} ${view.h}`);
    chart.classList.toggle("zoomed", zoomed);
    for (const mark of marks) mark.style.transform = `scale(${sx}, ${sy})`;
    for (const whisker of whiskers) whisker.style.transform = `scale(${sx}, 1)`;
    if (!zoomed) { ticks.innerHTML = still; return; }
    ticks.replaceChildren();
    for (const v of roundTicks(value("y", view.y + view.h), value("y", view.y), axes.y[2])) {
      const y = top + (place("y", v) - view.y) / sy;
      element("path", { class: "grid", d: `M${left} ${y}h${width}` }, ticks);
      element("text", { class: "tick", x: left - 6, y: y + 3.5, "text-anchor": "end" }, ticks).textContent = axes.percent ? `${written(100 * v)} %` : written(v);
    }
    for (const v of roundTicks(value("x", view.x), value("x", view.x + view.w), axes.x[2]))
      element("text", { class: "tick", x: left + (place("x", v) - view.x) / sx, y: top + height + 14, "text-anchor": "middle" }, ticks).textContent = written(v);
  }

  function nearest(x, y) {
    let best = null, least = Infinity;
    for (const line of lines) for (const point of line.points) {
      const dx = (point[0] - x) / view.w * width, dy = (point[1] - y) / view.h * height;
      const away = line.ordered ? Math.hypot(50 * dx, dy) : Math.hypot(dx, dy); // along a curve: the cursor's moment counts
      if (away < least) { least = away; best = { title: line.title, point }; }
    }
    return best;
  }

  function show(x, y) {
    at = [x, y];
    const hit = nearest(x, y), stacked = bars.filter(bar => bar.from <= x && x <= bar.to).map(bar => bar.title);
    if (!hit) { readout.textContent = stacked.join(", "); return; }
    at = hit.point;
    cursor.setAttribute("d", `M${at[0]} ${view.y}V${view.y + view.h}`);
    [dot.cx.baseVal.value, dot.cy.baseVal.value] = at;
    dot.setAttribute("visibility", "visible");
    const high = read("y", at[1]);
    const words = [hit.title, `${axes.labels[0]} = ${read("x", at[0])}`, axes.labels[1] ? `${axes.labels[1]} = ${high}` : high];
    readout.textContent = words.filter(Boolean).join(" · ");
  }
  function leave() {
    cursor.removeAttribute("d"); dot.setAttribute("visibility", "hidden");
    readout.textContent = "";
  }
  function around([x, y], factor) {
    const w = Math.min(width, view.w * factor), h = Math.min(height, view.h * factor);
    const keep = (v, lo, most) => Math.min(Math.max(v, lo), most);
    const part = { x: keep(x - w / 2, left, left + width - w), y: keep(y - h / 2, top, top + height - h), w, h };
    look(w === width && h === height ? whole : part);
  }
  function step(by) {
    const xs = [...new Set(lines.flatMap(line => line.points.map(p => p[0])).concat(bars.map(bar => (bar.from + bar.to) / 2)))].sort((a, b) => a - b);
    const shown = xs.filter(x => x >= view.x && x <= view.x + view.w);
    if (!shown.length) return;
    const beyond = at && (by > 0 ? shown.find(x => x > at[0] + 1e-9) : shown.findLast(x => x < at[0] - 1e-9));
    show(beyond ?? shown[by > 0 ? (at ? shown.length - 1 : 0) : (at ? 0 : shown.length - 1)], at ? at[1] : view.y + view.h / 2);
  }

  chart.addEventListener("pointerdown", event => {
    if (event.button || event.pointerType === "touch") return;
    start = inside(event); chart.setPointerCapture(event.pointerId); event.preventDefault(); chart.focus({ preventScroll: true });
  });
  chart.addEventListener("pointermove", event => {
    const [x, y] = inside(event);
    show(x, y);
    if (!start) return;
    const level = Math.abs(y - start[1]) / view.h * height < 3 * LEAST && lines.every(line => line.ordered);
    const flat = level || bars.length; // a stretch of time, or some bars in all their height
    const area = flat ? [Math.min(x, start[0]), view.y, Math.abs(x - start[0]), view.h] : [Math.min(x, start[0]), Math.min(y, start[1]), Math.abs(x - start[0]), Math.abs(y - start[1])];
    ["x", "y", "width", "height"].forEach((name, k) => box.setAttribute(name, area[k]));
  });
  chart.addEventListener("pointerup", () => {
    const [x, y, w, h] = ["x", "y", "width", "height"].map(name => +box.getAttribute(name));
    if (start && w / view.w * width >= LEAST && h / view.h * height >= LEAST) look({ x, y, w, h });
    start = null; box.setAttribute("width", 0);
  });
  chart.addEventListener("pointercancel", () => { start = null; box.setAttribute("width", 0); });
  chart.addEventListener("pointerleave", leave);
  chart.addEventListener("blur", leave);
  chart.addEventListener("dblclick", () => look(whole));
  chart.addEventListener("keydown", event => {
    const centre = at ?? [view.x + view.w / 2, view.y + view.h / 2];
    const act = { ArrowRight: () => step(1), ArrowLeft: () => step(-1), "+": () => around(centre, 0.5), "-": () => around(centre, 2), Escape: () => { look(whole); leave(); } }[event.key];
    if (act) { act(); event.preventDefault(); }
  });
  chart.tabIndex = 0;
}

document.querySelectorAll("figure .chart[data-axes]").forEach(enliven);
})();
