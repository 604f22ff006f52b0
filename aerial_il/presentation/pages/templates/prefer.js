// Two films, three answers; the films of the next pair are fetched while this one is watched.
const SIDES = ["left", "right"], KEYS = { ArrowLeft: "left", ArrowDown: "equal", ArrowRight: "right" };
const films = new Map();
let state = given, ready = false;

function film(pair, side) {
  const key = `${pair} ${side}`;
  if (!films.has(key)) {
    films.set(key, ask("/film", { pair, side }).then((answer) => answer.blob()).then(URL.createObjectURL));
    films.get(key).catch(() => films.delete(key));
  }
  return films.get(key);
}

function allow(yes) {
  ready = yes;
  for (const id of Object.values(KEYS)) $(id).disabled = !yes;
}

async function show() {
  const [pair, next] = state.left;
  $("bar").max = state.pairs;
  $("bar").value = state.said;
  $("counts").textContent = `${state.said} of ${state.pairs} pairs have an answer.`;
  allow(false);
  if (pair === undefined) {
    $("counts").textContent += " That is all; this page may be closed.";
    $("films").hidden = true;
    return;
  }
  try {
    const made = await Promise.all(SIDES.map((side) => film(pair, side)));
    SIDES.forEach((side, i) => { $(`film-${side}`).src = made[i]; });
    $("problem").textContent = "";
    allow(true);
    if (next !== undefined) SIDES.forEach((side) => film(next, side).catch(() => {}));
  } catch (error) {
    $("problem").textContent = error.message;
  }
}

async function say(preferred) {
  if (!ready) return;
  allow(false);
  const pair = state.left[0];
  try {
    state = await (await ask("/say", { pair, preferred })).json();
  } catch (error) {
    $("problem").textContent = error.message;
    allow(true);
    return;
  }
  for (const side of SIDES) {
    film(pair, side).then(URL.revokeObjectURL);
    films.delete(`${pair} ${side}`);
  }
  await show();
}

for (const id of Object.values(KEYS)) $(id).onclick = () => say(id);
document.addEventListener("keydown", (event) => {
  if (KEYS[event.key] && !event.repeat) { event.preventDefault(); say(KEYS[event.key]); }
});
show();
