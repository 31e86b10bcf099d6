// Layers under the path, and other planners' paths beside it.

// ---- layers

function toggleLayer(name, on, automatic = false) {
  if (!on) {
    layers.delete(name);
    if (name === "reachable") $("why").textContent = "";
  } else {
    layers.set(name, {automatic});
    requestLayer(name);
  }
  document.querySelector(`[data-layer="${name}"]`).checked = on;
  view.forget(name);
  dirty = true;
}

const wantedLayers = new Set();
let layerAsked = null, nextLayer = 0;

function requestLayer(name) {
  wantedLayers.add(name);
}

// One at a time, never before a path that is waited for, and for no more than a fifth of the time.
function requestLayers(now) {
  if (!ready || layerAsked || now < nextLayer || wanted !== null || [...inFlight.values()].some((asked) => !asked.settled)) return;
  for (const name of wantedLayers) {
    if (name === "roadmap" && drag) continue;  // to draw it takes longer than a frame
    wantedLayers.delete(name);
    if (!layers.has(name)) continue;
    const heading = selected.kind === "end" ? scene[selected.end][2] : scene.goal[2];
    layerAsked = {id: send("layer", {name, heading}), since: now};
    return;
  }
}

function layerAnswered(id) {
  if (layerAsked?.id !== id) return;
  const now = performance.now();
  nextLayer = now + 4 * (now - layerAsked.since);
  layerAsked = null;
}

function receiveLayer(message) {
  layerAnswered(message.id);
  if (!layers.has(message.name)) return;
  const colour = {field: "way", lattice: "other", "c-obstacle": "bad"}[message.name];
  if (message.cells) {
    message.picture = pictureOfCells(message, colourParts(colours[colour]), message.name === "field" ? 0.6 : 0.35);
  }
  layers.set(message.name, {automatic: layers.get(message.name).automatic, ...message});
  if (message.name === "reachable") $("why").textContent = message.text ?? "";
  view.forget(message.name);
  dirty = true;
}

// What is reached from an end: where there is no way, it proves that. A proof shows where it is narrowest.
function drawReach(brush, pixel, {rings = [], boxes = [], end, gap, radius, proof}) {
  brush.fillStyle = brush.strokeStyle = proof ? colours.bad : colours[end];
  brush.globalAlpha = proof ? 0.3 : 0.15;
  brush.beginPath();
  for (const ring of rings) traceLine(brush, ring, true);
  brush.fill("evenodd");
  for (let i = 0; i < boxes.length; i += 5) {
    const [xmin, ymin, xmax, ymax, share] = boxes.slice(i, i + 5);
    brush.globalAlpha = 0.08 + 0.32 * share;
    brush.fillRect(xmin, ymin, xmax - xmin, ymax - ymin);
  }
  brush.globalAlpha = 1;
  brush.lineWidth = 1.5 * pixel;
  brush.stroke();
  if (!gap) return;
  const [x, y, widest] = gap;
  brush.lineWidth = 2.5 * pixel;
  for (const [size, dashes] of [[widest, []], [radius, [5 * pixel, 4 * pixel]]]) {
    brush.setLineDash(dashes);
    brush.beginPath();
    brush.arc(x, y, size, 0, TURN);
    brush.stroke();
  }
  brush.setLineDash([]);
}

// ---- comparison

function compare() {
  const planner = $("planner").value;
  const id = send("compare", {planner, start: scene.start, goal: scene.goal, time_limit: 1});
  others = [...others.filter((other) => other.planner !== planner), {id, planner, waits: true, asked: problem()}].slice(-4);
  listOthers();
}

function receiveComparison(message) {
  others = others.map((other) => (other.id === message.id ? {...message, asked: other.asked} : other));
  listOthers();
  dirty = true;
}

// What a planner was asked: a path is shown beside ours while it is an answer to the same.
function problem() {
  return `${scene.start};${scene.goal};${worldNumber}`;
}

function listOthers() {
  $("others").replaceChildren(...others.map((other) => {
    const item = document.createElement("li");
    const seconds = other.time?.first_solution ?? other.time?.total;
    item.textContent = other.waits ? `${other.planner}: running` : `${other.planner}: `
      + (other.solved ? `cost ${number(other.cost, 4)} m, first path ${milliseconds(1000 * seconds)}, `
        + (other.correct ? "free by the referee" : `refused: ${other.fault}`) : other.fault || "no path in 1 s")
      + (other.asked === problem() ? "" : " (before the last change)");
    item.classList.toggle("bad", !other.waits && !other.correct);
    return item;
  }));
}
