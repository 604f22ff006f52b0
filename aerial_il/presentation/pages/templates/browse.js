// A table and a scatter plot of the same rows; what is marked is edited by the server, or by a command that is shown.
const PAGE = 200, MARGIN = 44, TOP = 24, RIGHT = 30;
let { columns, rows } = given, sort = { column: "uid", up: true }, brush = null, shown = PAGE;
const marked = new Set();

const at = (row, name) => row[columns.indexOf(name)];
const numeric = () => columns.filter((name, i) => rows.some((row) => typeof row[i] === "number"));
const compare = (a, b) => (a === b ? 0 : a === null ? -1 : b === null ? 1 : a < b ? -1 : 1);

function chosen() {
  const text = $("find").value.toLowerCase();
  const found = rows.filter((row) =>
    (!text || row.some((value) => String(value).toLowerCase().includes(text))) && (!brush || within(row)));
  return found.sort((a, b) => (sort.up ? 1 : -1) * compare(at(a, sort.column), at(b, sort.column)));
}

function within(row) {
  const x = at(row, $("across").value), y = at(row, $("up").value);
  return x !== null && y !== null && brush.x[0] <= x && x <= brush.x[1] && brush.y[0] <= y && y <= brush.y[1];
}

function draw() {
  const found = chosen(), won = rows.filter((row) => at(row, "success")).length;
  $("counts").textContent = `${rows.length} episodes, ${won} successful; ${found.length} shown`;
  $("marks").textContent = `${marked.size} marked`;
  for (const id of ["delete", "relabel"]) $(id).disabled = !marked.size;
  $("more").hidden = found.length <= shown;
  drawHead();
  $("body").replaceChildren(...found.slice(0, shown).map(line));
  drawPlot(new Set(found));
}

function drawHead() {
  const cells = columns.map((name) => {
    const cell = document.createElement("th"), button = document.createElement("button");
    button.textContent = name + (sort.column === name ? (sort.up ? " ↑" : " ↓") : "");
    button.onclick = () => { sort = { column: name, up: sort.column !== name || !sort.up }; draw(); };
    cell.setAttribute("aria-sort", sort.column === name ? (sort.up ? "ascending" : "descending") : "none");
    cell.append(button);
    return cell;
  });
  $("head").replaceChildren(document.createElement("th"), ...cells);
}

function line(row) {
  const uid = at(row, "uid"), made = document.createElement("tr"), first = document.createElement("td");
  const box = document.createElement("input"), play = document.createElement("button");
  box.type = "checkbox";
  box.checked = marked.has(uid);
  box.setAttribute("aria-label", `mark ${uid}`);
  box.onchange = () => { box.checked ? marked.add(uid) : marked.delete(uid); draw(); };
  play.textContent = "▶";
  play.setAttribute("aria-label", `watch ${uid}`);
  play.onclick = () => watch(row);
  first.append(box, " ", play);
  made.className = box.checked ? "marked" : "";
  made.append(first, ...row.map((value) => {
    const cell = document.createElement("td");
    cell.textContent = value === null ? "–" : String(value);
    return cell;
  }));
  return made;
}

function ranges() {
  return ["across", "up"].map((id) => {
    const values = rows.map((row) => at(row, $(id).value)).filter((value) => typeof value === "number");
    const low = values.reduce((a, b) => Math.min(a, b), Infinity), high = values.reduce((a, b) => Math.max(a, b), -Infinity);
    const wide = (high - low || 1) * 0.03;
    return [low - wide, high + wide];
  });
}

function places() {
  const canvas = $("plot"), [x, y] = ranges(), width = canvas.clientWidth, height = canvas.clientHeight;
  const w = width - MARGIN - RIGHT, base = height - MARGIN, h = base - TOP;
  return {
    width, height, x, y,
    px: (value) => MARGIN + ((value - x[0]) / (x[1] - x[0])) * w, py: (value) => base - ((value - y[0]) / (y[1] - y[0])) * h,
    vx: (px) => x[0] + ((px - MARGIN) / w) * (x[1] - x[0]), vy: (py) => y[0] + ((base - py) / h) * (y[1] - y[0]),
  };
}

// A canvas knows no variables of the style sheet: an element is asked what they come to.
function colour(name) {
  const probe = document.createElement("i");
  probe.style.color = `var(--${name})`;
  document.body.append(probe);
  const value = getComputedStyle(probe).color;
  probe.remove();
  return value;
}

function drawPlot(found) {
  const canvas = $("plot"), place = places(), scale = devicePixelRatio || 1;
  const colours = Object.fromEntries(["good", "bad", "ink", "muted", "accent"].map((name) => [name, colour(name)]));
  canvas.width = place.width * scale;
  canvas.height = place.height * scale;
  const pen = canvas.getContext("2d");
  pen.scale(scale, scale);
  pen.font = "12px system-ui, sans-serif";
  pen.fillStyle = colours.muted;
  for (let i = 0; i <= 4; i++) {
    const x = place.x[0] + ((place.x[1] - place.x[0]) * i) / 4, y = place.y[0] + ((place.y[1] - place.y[0]) * i) / 4;
    pen.fillText(x.toPrecision(3), place.px(x) - 12, place.height - 24);
    pen.fillText(y.toPrecision(3), 2, place.py(y) + 4);
  }
  pen.fillText($("across").value, place.width / 2, place.height - 6);
  pen.fillText($("up").value, 2, 12);
  for (const row of rows) {
    const x = at(row, $("across").value), y = at(row, $("up").value);
    if (typeof x !== "number" || typeof y !== "number") continue;
    pen.globalAlpha = found.has(row) ? 0.75 : 0.12;
    pen.fillStyle = at(row, "success") ? colours.good : colours.bad;
    pen.beginPath();
    pen.arc(place.px(x), place.py(y), 3, 0, 7);
    pen.fill();
    if (marked.has(at(row, "uid"))) { pen.globalAlpha = 1; pen.strokeStyle = colours.ink; pen.stroke(); }
  }
  pen.globalAlpha = 1;
  if (!brush) return;
  pen.strokeStyle = colours.accent;
  const [x0, x1] = brush.x.map(place.px), [y0, y1] = brush.y.map(place.py);
  pen.strokeRect(x0, y1, x1 - x0, y0 - y1);
}

$("plot").onpointerdown = (down) => {
  const canvas = $("plot"), place = places(), from = [down.offsetX, down.offsetY];
  canvas.setPointerCapture(down.pointerId);
  const pull = (event) => {
    const [xs, ys] = [[from[0], event.offsetX], [from[1], event.offsetY]];
    const far = Math.abs(xs[1] - xs[0]) > 3 || Math.abs(ys[1] - ys[0]) > 3, order = (a, b) => a - b;
    brush = far ? { x: xs.map(place.vx).sort(order), y: ys.map(place.vy).sort(order) } : null;
    draw();
  };
  canvas.onpointermove = pull;
  canvas.onpointerup = (event) => { canvas.onpointermove = canvas.onpointerup = null; pull(event); };
};

function say(text, bad = false) { $("said").textContent = text; $("said").className = bad ? "bad" : ""; }
const quoted = (text) => `'${String(text).replaceAll("'", `'"'"'`)}'`;

function type(words) {
  $("command").hidden = false;
  $("command").textContent = `aerial-il ${words.map(quoted).join(" ")}`;
  say("This page is a file. The command does it:");
}

async function edit(what, labels) {
  const uids = [...marked], where = `where=uid in [${uids.map((uid) => JSON.stringify(uid)).join(", ")}]`;
  const words = Object.entries(labels ?? {}).map(([name, value]) => `${name}=${value}`);
  if (!given.served) return type(what === "undo" ? ["undo", given.dataset] : [what, given.dataset, where, ...words]);
  say("…");
  try {
    const done = await (await ask("/edit", { what, uids, labels })).json();
    ({ columns, rows } = done);
    marked.clear();
    say(done.said);
    offer();
  } catch (error) { say(error.message, true); }
  draw();
}

async function watch(row) {
  const uid = at(row, "uid");
  const recording = `recording=${given.dataset}/${at(row, "success") ? "demos" : "failures"}/${uid}.mcap`;
  if (!given.served) return type(["view", recording]);
  $("watched").textContent = `${uid}: the film is being made…`;
  $("film").hidden = true;
  $("watch").showModal();
  try {
    $("film").src = URL.createObjectURL(await (await ask("/film", { uid })).blob());
    $("film").hidden = false;
    $("watched").textContent = uid;
    await $("film").play();
  } catch (error) { $("watched").textContent = error.message; }
}

function offer() {
  for (const [id, first] of [["across", "seconds"], ["up", "return"]]) {
    const before = $(id).value || first;
    $(id).replaceChildren(...numeric().map((name) => new Option(name, name, name === before, name === before)));
  }
}

$("find").oninput = () => { shown = PAGE; draw(); };
$("more").onclick = () => { shown += PAGE; draw(); };
$("mark").onclick = () => { for (const row of chosen()) marked.add(at(row, "uid")); draw(); };
$("clear").onclick = () => { marked.clear(); draw(); };
$("delete").onclick = () => edit("delete", null);
$("undo").onclick = () => edit("undo", null);
$("relabel").onclick = () => {
  const filled = ["success", "operator", "instruction", "tag"].map((id) => [id, $(id).value]).filter(([, value]) => value !== "");
  edit("relabel", Object.fromEntries(filled.map(([id, value]) => [id, id === "success" ? value === "true" : value])));
};
for (const id of ["across", "up"]) $(id).onchange = () => { brush = null; draw(); };
addEventListener("resize", draw);
offer();
draw();
