// Layers under the path, and other planners' paths beside it.

// ---- layers

function toggleLayer(name, on, automatic = false) {
  if (!on) layers.delete(name);
  else {
    layers.set(name, {automatic});
    requestLayer(name);
  }
  document.querySelector(`[data-layer="${name}"]`).checked = on;
  view.forget(name);
  dirty = true;
}

function requestLayer(name) {
  const heading = selected.kind === "end" ? scene[selected.end][2] : scene.goal[2];
  if (ready) send("layer", {name, heading});
}

function receiveLayer(message) {
  if (!layers.has(message.name)) return;
  const colour = {field: "way", lattice: "other", "c-obstacle": "bad", reachable: "bad"}[message.name];
  if (message.cells) {
    if (message.name === "reachable") message.cells = inverted(message.cells);
    message.picture = pictureOfCells(message, colourParts(colours[colour]), message.name === "field" ? 0.6 : 0.35);
  }
  layers.set(message.name, {...layers.get(message.name), ...message});
  view.forget(message.name);
  dirty = true;
}

// What the disc inside the robot does not reach, which is what proves that there is no way.
function inverted(cells) {
  return btoa([...atob(cells)].map((c) => String.fromCharCode(255 - c.charCodeAt(0))).join(""));
}

// ---- comparison

function compare() {
  const planner = $("planner").value;
  const id = send("compare", {planner, start: scene.start, goal: scene.goal, time_limit: 1});
  others = [...others.filter((other) => other.planner !== planner), {id, planner, waits: true}].slice(-4);
  listOthers();
}

function receiveComparison(message) {
  others = others.map((other) => (other.id === message.id ? message : other));
  listOthers();
  dirty = true;
}

function listOthers() {
  $("others").replaceChildren(...others.map((other) => {
    const item = document.createElement("li");
    const seconds = other.time?.first_solution ?? other.time?.total;
    item.textContent = other.waits ? `${other.planner}: running` : `${other.planner}: `
      + (other.solved ? `cost ${number(other.cost, 4)}, first path ${number(1000 * seconds)} ms, `
        + (other.correct ? "free by the referee" : `refused: ${other.fault}`) : other.fault || "no path in 1 s");
    item.classList.toggle("bad", !other.waits && !other.correct);
    return item;
  }));
}
