// The page: what is dragged goes to the server at once, and the newest certified path is shown as it comes.

const $ = (id) => document.getElementById(id);
const canvas = $("map"), view = new View(canvas), scene = new Scene();
const SHORTEST = 0.004, LONGEST = 0.5, SETTLED = 2.0;  // seconds that a plan may take: while dragging, and after it
const CHANGED_WITHIN = 300;  // milliseconds of rest after which the plan that takes longer is asked for

let socket, colours, nextId = 1, ready = false, dirty = true;
let tool = "move", selected = "goal", drag = null, draft = null, pinch = null, playing = null;
let pending = null, wanted = null, settle = 0, patience = SHORTEST, shownPlan = 0, history = [], badEnd = null;
const edits = new Set(), pointers = new Map(), inFlight = new Map(), waiting = new Map(), latencies = [], drawn = [];

// ---- pointer: dragging, panning, pinching

// How far two fingers are apart, and the place between them.
function pinched() {
  const [[ax, ay], [bx, by]] = pointers.values();
  return {apart: Math.max(1, Math.hypot(ax - bx, ay - by)), middle: [(ax + bx) / 2, (ay + by) / 2]};
}

canvas.addEventListener("pointerdown", (event) => {
  if (!scene.world) return;
  canvas.setPointerCapture(event.pointerId);
  canvas.focus({preventScroll: true});
  const [px, py] = [event.offsetX, event.offsetY], [x, y] = view.toWorld(px, py);
  pointers.set(event.pointerId, [px, py]);
  dirty = true;
  if (pointers.size === 2) {
    drag = draft = null;
    pinch = pinched();
  } else if (tool === "move" && event.shiftKey) {
    scene.note();
    scene.changeVia(x, y, 10 / view.scale);
    changed();
  } else if (tool === "polygon") {
    draft ??= {points: []};
    draft.points.push([x, y]);
    if (event.detail > 1 && draft.points.length > 3) finishDraft();
  } else if (tool !== "move") {
    draft = {from: [x, y], to: [x, y]};
  } else {
    const found = scene.under(x, y, (event.pointerType === "touch" ? 22 : 10) / view.scale);
    if (found) {
      scene.note();
      select(found.id);
    }
    drag = {...(found ?? {kind: "pan"}), last: [x, y], screen: [px, py]};
    canvas.classList.add("busy");
  }
});

// Where the browser tells of moves as they come, a path is on its way before the frame that shows the move.
canvas.addEventListener("onpointerrawupdate" in canvas ? "pointerrawupdate" : "pointermove", (event) => {
  if (!pointers.has(event.pointerId)) return;
  const [px, py] = [event.offsetX, event.offsetY], [x, y] = view.toWorld(px, py);
  pointers.set(event.pointerId, [px, py]);
  dirty = true;
  if (pinch && pointers.size === 2) {
    const {apart, middle} = pinched();
    view.zoom(apart / pinch.apart, ...middle);
    view.pan(middle[0] - pinch.middle[0], middle[1] - pinch.middle[1]);
    pinch = {apart, middle};
  } else if (draft?.from) draft.to = [x, y];
  else if (drag?.kind === "pan") {
    view.pan(px - drag.screen[0], py - drag.screen[1]);
    drag.screen = [px, py];
  } else if (drag) moveDragged(x, y, event.timeStamp);
});

function moveDragged(x, y, at) {
  const [dx, dy] = [x - drag.last[0], y - drag.last[1]], [ex, ey, theta] = scene[drag.id] ?? [];
  drag.last = [x, y];
  if (drag.kind === "obstacle") edit({move: {[drag.id]: [dx, dy, 0]}}, at);
  else {
    scene[drag.id] = drag.kind === "end" ? [ex + dx, ey + dy, theta] : [ex, ey, Math.atan2(y - ey, x - ex)];
    changed(at);
  }
  plan(performance.now());  // at once: the next frame is a while off
  showSelected();
}

function release(event) {
  pointers.delete(event.pointerId);
  if (pointers.size < 2) pinch = null;
  drag = null;
  dirty = true;
  canvas.classList.remove("busy");
  if (draft?.from) finishDraft();
}
for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, release);
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  view.zoom(Math.exp(-event.deltaY * 0.0015), event.offsetX, event.offsetY);
  dirty = true;
}, {passive: false});

// ---- drawing obstacles

function draftShape() {
  if (draft.points) return draft.points.length > 2 ? {shape: "polygon", vertices: draft.points} : null;
  const [[ax, ay], [bx, by]] = [draft.from, draft.to];
  if (tool === "disc") return {shape: "disc", center: [ax, ay], radius: Math.hypot(bx - ax, by - ay)};
  return {shape: "rectangle", center: [(ax + bx) / 2, (ay + by) / 2], length: Math.abs(bx - ax), width: Math.abs(by - ay)};
}

function finishDraft() {
  const shape = draftShape(), least = 3 / view.scale;
  draft = null;
  dirty = true;
  if (!shape || (shape.radius ?? Math.min(shape.length ?? 1, shape.width ?? 1)) < least) return;
  const made = {...shape, id: scene.freshId()};
  scene.note();
  attempt(async () => {
    // A polygon may cross itself: the server says so before it is taken over.
    await ask("edit", {add: [made]});
    scene.set(made);
    select(made.id);
    changed();
  });
}

function setTool(name) {
  tool = name;
  draft = null;
  for (const button of $("tools").children) button.setAttribute("aria-pressed", String(button.dataset.tool === name));
  canvas.classList.toggle("draw", name !== "move");
  $("told").textContent = {disc: "Drag from the middle to the rim.", rectangle: "Drag from corner to corner.",
    polygon: "Click the corners; a double click or Enter closes it."}[name] ?? "";
  dirty = true;
}

// ---- the selection: "start", "goal" or an obstacle's id

const offer = (id, options) => $(id).replaceChildren(...options.map(([text, value]) => new Option(text, value)));

function select(what) {
  selected = what === "start" || scene.obstacles.has(what) ? what : "goal";
  offer("selected", ["start", "goal", ...scene.obstacles.keys()].map((name) => [name, name]));
  $("selected").value = selected;
  showSelected();
  dirty = true;
}

function selectedPose() {
  const shape = scene.obstacles.get(selected);
  return shape ? [...centreOf(shape), shape.heading ?? 0] : scene[selected];
}

function showSelected() {
  const [x, y, theta] = selectedPose();
  for (const [id, value] of [["sx", x], ["sy", y], ["st", (theta * 180) / Math.PI]]) {
    if (document.activeElement !== $(id)) $(id).value = rounded(value, 3);
  }
}

// Moves and turns what is selected.
function nudge(dx, dy, turn) {
  scene.note();
  if (scene.obstacles.has(selected)) edit({move: {[selected]: [dx, dy, turn]}});
  else {
    const [x, y, theta] = scene[selected];
    scene[selected] = [x + dx, y + dy, wrapped(theta + turn)];
    changed();
  }
  showSelected();
}

function setPose(axis, value) {
  const pose = selectedPose(), by = [0, 0, 0];
  if (!Number.isFinite(value)) return;
  by[axis] = axis === 2 ? wrapped((value * Math.PI) / 180 - pose[2]) : value - pose[axis];
  nudge(...by);
}

function removeSelected() {
  if (!scene.obstacles.has(selected)) return;
  scene.note();
  edit({remove: [selected]});
  select(selected);
}

function selectNext(step) {
  const names = ["start", "goal", ...scene.obstacles.keys()];
  select(names.at((names.indexOf(selected) + step) % names.length));
  $("told").textContent = `${selected} selected`;
}

// ---- the robot: its shape, and driving, in which it replans where the world has changed

function showRobot() {
  const {robot} = scene;
  $("shape").value = robot.shape;
  for (const name of ["radius", "length", "width"]) {
    $(name).value = robot[name] ?? "";
    $(`${name}-label`).hidden = robot.shape !== (name === "radius" ? "disc" : "rectangle");
  }
  $("turning").value = robot.turning_radius ?? "";
}

function changeRobot() {
  const reach = reachOf(scene.robot), given = (id, other) => Number($(id).value) || scene.robot[id] || other;
  const shapes = {disc: {shape: "disc", radius: given("radius", reach)},
    rectangle: {shape: "rectangle", length: given("length", 2 * reach), width: given("width", 1.4 * reach)}};
  const robot = shapes[$("shape").value] ?? {shape: "polygon", vertices: scene.robot.vertices};
  const turning = Number($("turning").value);
  if (turning > 0) robot.turning_radius = turning;
  else if (scene.robot.drive === "differential") robot.drive = "differential";
  scene.note();
  setWorld({...scene.content(), robot}, false, scene);
}

const follow = (states) => Object.assign(playing, {states, clock: pathClock(states), at: 0, state: states[0]});

// Drives on, and returns whether there is a way left.
function drive(now) {
  playing.at += (Number($("speed").value) || 1) * Math.min(0.1, (now - playing.last) / 1000);
  playing.last = now;
  playing.state = stateAlong(playing.states, playing.clock, playing.at);
  return playing.at < playing.clock.at(-1);
}

function startPlaying() {
  if (!scene.path || scene.path.partial) return;
  playing = {last: performance.now()};
  follow(scene.path.states);
  settle = 0;
  $("play").textContent = "Stop";
}

function stopPlaying() {
  if (playing) changed();
  playing = null;
  $("play").textContent = "Play";
}

// ---- files: what is opened is sent as a world, nothing of it reaches the server's disk

async function open([file]) {
  if (/\.(ya?ml|json)$/i.test(file.name)) openWorld({text: await file.text()});  // JSON is YAML
  else $("error").textContent = "expected a world (.yaml, .json); 'trailmark live FILE' opens maps";
}

function download(name, content, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], {type}));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

// Returns whether a text was copied: only pages of this machine or by https have a clipboard, and it may be forbidden.
function copy(text) {
  return navigator.clipboard?.writeText(text).then(() => true, () => false) ?? false;
}

function pythonOf(worldFile) {
  const given = Object.entries(plannerOptions()).map(([name, value]) => `, ${name}=${JSON.stringify(value)}`).join("");
  const [start, goal] = [scene.start, scene.goal].map((q) => `(${q.map((v) => rounded(v, 6)).join(", ")})`);
  return `from trailmark import LandmarkPlanner, World

world = World.load(${JSON.stringify(worldFile)})  # ${scene.robot.shape} robot; save it from the page
planner = LandmarkPlanner(world, seed=0${given})
result = planner.plan(${start}, ${goal}, time_limit=1.0)
print(result.status, result.path and result.path.cost)
`;
}

// ---- everything that is clicked, and the keyboard; then the page begins

const clicks = {
  undo: () => restore(scene.step(true)), redo: () => restore(scene.step(false)), delete: removeSelected,
  play: () => (playing ? stopPlaying() : startPlaying()), fit: () => view.fit(scene.world.bounds),
  theme: () => {
    const dark = document.documentElement.dataset.theme !== "dark";
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    $("theme").textContent = dark ? "Light" : "Dark";
    readColours();
  },
  save: async () => {
    sendEdits();
    download(`${scene.world.name}.yaml`, (await ask("save", {start: scene.start, goal: scene.goal})).text, "text/yaml");
  },
  png: () => canvas.toBlob((blob) => download(`${scene.world.name}.png`, blob, "image/png")),
  json: () => scene.path && download(`${scene.world.name}.json`, JSON.stringify({...scene.path, type: undefined, final: undefined, id: undefined}, null, 1), "application/json"),
  python: async () => {
    const text = pythonOf(`${scene.world.name}.yaml`), copied = await copy(text);
    if (!copied) download("plan.py", text, "text/x-python");
    $("told").textContent = copied ? "Copied." : "Nothing can be copied here: plan.py holds it.";
  },
  share: async () => {
    location.hash = encodeURIComponent(scene.snapshot());
    await copy(location.href);
    $("told").textContent = "The address holds the world now.";
  },
};
for (const [id, act] of Object.entries(clicks)) {
  $(id).addEventListener("click", () => {
    if (scene.world) act();
    dirty = true;
  });
}
$("tools").addEventListener("click", ({target}) => target.dataset.tool && setTool(target.dataset.tool));
$("worlds").addEventListener("change", ({target: {value}}) => value && openWorld({name: value}));
$("open").addEventListener("change", ({target}) => target.files.length && open(target.files));
for (const id of ["shape", "radius", "length", "width", "turning"]) $(id).addEventListener("change", changeRobot);
for (const id of ["clearance", "objective"]) $(id).addEventListener("change", () => setWorld(scene.content(), false, scene));
$("selected").addEventListener("change", ({target}) => select(target.value));
["sx", "sy", "st"].forEach((id, axis) => $(id).addEventListener("change", ({target}) => setPose(axis, Number(target.value))));
document.addEventListener("dragover", (event) => event.preventDefault());
document.addEventListener("drop", (event) => {
  event.preventDefault();
  if (event.dataTransfer.files.length) open(event.dataTransfer.files);
});

document.addEventListener("keydown", (event) => {
  const {key, target, shiftKey} = event;
  if (!scene.world || event.altKey || /^(INPUT|SELECT|TEXTAREA)$/.test(target.tagName)) return;
  const step = (shiftKey ? 20 : 2) / view.scale, turn = ((shiftKey ? 15 : 3) * Math.PI) / 180, {undo, redo} = clicks;
  const actions = event.ctrlKey || event.metaKey ? {z: undo, Z: redo, y: redo} : target.tagName === "BUTTON" ? {} : {
    ArrowLeft: () => nudge(-step, 0, 0), ArrowRight: () => nudge(step, 0, 0), ArrowUp: () => nudge(0, step, 0),
    ArrowDown: () => nudge(0, -step, 0), "[": () => nudge(0, 0, turn), "]": () => nudge(0, 0, -turn),
    "{": () => nudge(0, 0, turn), "}": () => nudge(0, 0, -turn), n: () => selectNext(1), N: () => selectNext(-1),
    Delete: removeSelected, Backspace: removeSelected, " ": clicks.play, f: clicks.fit,
    "+": () => view.zoom(1.25), "=": () => view.zoom(1.25), "-": () => view.zoom(0.8),
    Enter: () => draft?.points && finishDraft(), Escape: () => setTool("move"),
  };
  if (!actions[key]) return;
  event.preventDefault();
  actions[key]();
  dirty = true;
});
if (matchMedia("(prefers-color-scheme: dark)").matches) clicks.theme();
// What tests and the curious may look at.
window.trailmark = {scene, view, latencies, inFlight};
readColours();
connect();
requestAnimationFrame(frame);
