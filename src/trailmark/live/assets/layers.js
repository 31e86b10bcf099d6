// Layers under the path.

function toggleLayer(name, on) {
  if (!on) layers.delete(name);
  else {
    layers.set(name, {});
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
  layers.set(message.name, message);
  view.forget(message.name);
  dirty = true;
}
