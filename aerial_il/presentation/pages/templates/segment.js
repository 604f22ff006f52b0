// A film above a time line of cuts; what is changed stays on the page until it is saved.
const NEW = 25, HUES = 8, EDITS = ["thing", "remove", "add", "found", "save", "undo"];
let flight = null, cuts = [], chosen = 0, dirty = false;

async function attempt(work) {
  try {
    $("problem").textContent = "";
    await work();
  } catch (error) {
    $("problem").textContent = error.message;
  }
}

const here = () => Math.min(flight.steps, Math.round($("film").currentTime / flight.step_s));
const typed = (cut) => `${cut.thing}:${cut.first}-${cut.last}`;
const share = (step) => `${(100 * step) / flight.steps}%`;
const hue = (thing) => `hue${flight.things.indexOf(thing) % HUES}`;

function made(kind, className, left, right, text) {
  const element = document.createElement(kind);
  element.className = className;
  element.style.left = share(left);
  element.style.width = share(right - left);
  element.textContent = text;
  return element;
}

function draw() {
  $("cuts").replaceChildren(...cuts.map(block));
  $("said").textContent = cuts.map(typed).join(", ")
    + (dirty ? " (not saved)" : flight.by_hand ? " (by hand)" : " (as found)");
  const cut = cuts[chosen];
  for (const id of ["thing", "remove"]) $(id).disabled = !cut;
  $("thing").value = cut?.thing ?? "";
  $("save").disabled = !dirty;
}

function block(cut, i) {
  const element = made("div", `cut ${hue(cut.thing)}${i === chosen ? " chosen" : ""}`, cut.first, cut.last, cut.thing);
  element.onclick = () => { chosen = i; seek(cut.first); draw(); };
  element.append(edge(cut, i, "first"), edge(cut, i, "last"));
  return element;
}

function edge(cut, i, side) {
  const element = document.createElement("span");
  element.className = `edge ${side}`;
  element.id = `${side}-${i}`;
  element.tabIndex = 0;
  for (const [name, value] of Object.entries({ role: "slider", "aria-label": `${side} step of ${cut.thing}`,
    "aria-valuenow": cut[side], "aria-valuemin": 0, "aria-valuemax": flight.steps })) element.setAttribute(name, value);
  element.onclick = (event) => event.stopPropagation();
  element.onpointerdown = (event) => { event.preventDefault(); drag(i, side); };
  element.onkeydown = (event) => {
    const way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (!way) return;
    event.preventDefault();
    move(i, side, cut[side] + way * (event.shiftKey ? 10 : 1));
    $(element.id).focus();
  };
  return element;
}

function drag(i, side) {
  const follow = (event) => move(i, side, stepAt(event));
  addEventListener("pointermove", follow);
  addEventListener("pointerup", () => removeEventListener("pointermove", follow), { once: true });
}

function stepAt(event) {
  const { left, width } = $("line").getBoundingClientRect();
  return Math.max(0, Math.min(flight.steps, Math.round((flight.steps * (event.clientX - left)) / width)));
}

// An edge stays between those beside it.
function move(i, side, step) {
  const low = side === "first" ? (cuts[i - 1]?.last ?? 0) : cuts[i].first + 1;
  const high = side === "first" ? cuts[i].last - 1 : (cuts[i + 1]?.first ?? flight.steps);
  cuts[i][side] = Math.max(low, Math.min(high, step));
  seek(cuts[i][side]);
  change(i);
}

function change(i) {
  chosen = i;
  dirty = true;
  draw();
}

function seek(step) {
  $("film").pause();
  $("film").currentTime = step * flight.step_s;
  $("now").style.left = share(step);
}

function add() {
  const step = Math.min(here(), flight.steps - 1), inside = cuts.findIndex((cut) => cut.first <= step && step < cut.last);
  if (inside < 0) {
    const next = cuts.findIndex((cut) => cut.first > step), i = next < 0 ? cuts.length : next;
    const last = Math.min(step + NEW, next < 0 ? flight.steps : cuts[next].first);
    cuts.splice(i, 0, { thing: flight.things[0], first: step, last });
    change(i);
  } else if (step > cuts[inside].first) {
    cuts.splice(inside + 1, 0, { ...cuts[inside], first: step });
    cuts[inside].last = step;
    change(inside + 1);
  }
}

function show(answer) {
  flight = answer;
  cuts = flight.cuts.map((cut) => ({ ...cut }));
  [chosen, dirty] = [0, false];
  $("thing").replaceChildren(...flight.things.map((name) => new Option(name)));
  $("phases").replaceChildren(...flight.phases.map(({ first, name }, i) =>
    made("span", "phase", first, flight.phases[i + 1]?.first ?? flight.steps, name)));
  const most = Math.max(...flight.gripper, 1e-9);
  $("gripper").setAttribute("viewBox", `0 0 ${flight.steps} 1`);
  $("gripper").firstElementChild.setAttribute("points", flight.gripper.map((y, x) => `${x},${1 - y / most}`).join(" "));
  for (const id of EDITS) $(id).disabled = false;
  draw();
}

const uid = () => $("flight").value;

// What comes late, of a flight that is chosen no longer, is not shown.
async function told(path, asked, more = {}) {
  const answer = await (await ask(path, { uid: asked, ...more })).json();
  if (asked === uid()) show(answer);
}

// Nothing can be edited until the chosen flight is there: what is seen is never another one's.
function clear() {
  [flight, cuts, dirty] = [null, [], false];
  for (const id of ["cuts", "phases"]) $(id).replaceChildren();
  $("gripper").firstElementChild.setAttribute("points", "");
  $("said").textContent = "";
  for (const id of EDITS) $(id).disabled = true;
}

async function open() {
  const asked = uid();
  clear();
  $("film").removeAttribute("src");
  $("making").hidden = false;
  await attempt(() => told("/flight", asked));
  await attempt(async () => {
    const film = await (await ask("/film", { uid: asked })).blob();
    if (asked === uid()) $("film").src = URL.createObjectURL(film);
  });
  if (asked === uid()) $("making").hidden = true;
}

function leave() {
  if (!dirty || confirm("The cuts of this flight are not saved. Leave them?")) open();
  else $("flight").value = flight.uid;
}

$("flight").replaceChildren(...given.map((name) => new Option(name)));
$("flight").onchange = leave;
$("play").onclick = $("film").onclick = () => attempt(() => ($("film").paused ? $("film").play() : $("film").pause()));
$("film").onplay = $("film").onpause = () => { $("play").textContent = $("film").paused ? "Play" : "Pause"; };
$("film").ontimeupdate = () => { if (flight) $("now").style.left = share(here()); };
$("line").onclick = (event) => { if (flight && !event.target.closest(".cut")) seek(stepAt(event)); };
$("thing").onchange = () => { cuts[chosen].thing = $("thing").value; change(chosen); };
$("remove").onclick = () => { cuts.splice(chosen, 1); change(Math.max(0, chosen - 1)); };
$("add").onclick = add;
$("found").onclick = () => attempt(() => told("/save", flight.uid, { cuts: ["found"] }));
$("save").onclick = () => attempt(() => told("/save", flight.uid, { cuts: cuts.map(typed) }));
$("undo").onclick = () => attempt(() => told("/undo", flight.uid));
addEventListener("beforeunload", (event) => { if (dirty) event.preventDefault(); });
open();
