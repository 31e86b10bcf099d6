// The page: what is dragged goes to the server at once, and the newest certified path is shown as it comes.

const $ = (id) => document.getElementById(id);
const canvas = $("map"), view = new View(canvas), scene = new Scene();
const COLOURS = ["page", "ink", "soft", "line", "free", "outside", "obstacle", "way", "goal", "landmark", "start", "other", "bad", "shade"];
const LAYERS = {roadmap: "roadmap and landmarks", field: "clearance field", lattice: "heuristic (cost to go)",
  "c-obstacle": "C-obstacle at the heading", reachable: "not reachable"};
const PLANNERS = ["RRTConnect", "PRM", "PRMstar", "RRTstar", "InformedRRTstar", "BITstar", "KPIECE1", "roadmap", "lattice",
  "RRTConnect+certified", "PRM+certified"];
const SHORTEST = 0.004, LONGEST = 0.5, SETTLED = 2.0;  // seconds that a plan may take: while dragging, and after it
const CHANGED_WITHIN = 300;  // milliseconds of rest after which the plan that takes longer is asked for

let socket, colours, nextId = 1, ready = false;
let tool = "move", selected = {kind: "end", end: "goal"}, drag = null, draft = null, pinch = null;
let dirty = true, pending = null, settle = 0, playing = null, exploring = null, others = [];
const edits = new Set(), pointers = new Map(), inFlight = new Map(), waiting = new Map(), layers = new Map(), latencies = [], drawn = [];
let shownPlan = 0, history = [];

// ---- talking to the server

function send(type, fields = {}) {
  const id = nextId++;
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify({type, id, ...fields}));
  return id;
}

// Sends, and returns the first answer.
function ask(type, fields) {
  return new Promise((resolve, reject) => waiting.set(send(type, fields), {resolve, reject}));
}

function connect() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  socket = new WebSocket(`${scheme}://${location.host}/ws${location.search}`);
  socket.onopen = begin;
  socket.onmessage = ({data}) => receive(JSON.parse(data));
  socket.onclose = () => {
    ready = false;
    inFlight.clear();
    waiting.clear();
    say("connection lost; trying again", true);
    setTimeout(connect, 1000);
  };
}

async function begin() {
  const hello = await ask("hello");
  $("worlds").replaceChildren(...["", ...hello.worlds].map((name) => new Option(name || "this one", name)));
  const shared = location.hash.length > 1 ? await unpacked(location.hash.slice(1)).catch(() => null) : null;
  if (scene.world) await setWorld(scene.content(), false);  // as it was before the connection was lost
  else if (shared?.world) await setWorld(shared.world, true, shared);
  else takeWorld(hello, true);
}

function receive(message) {
  const waits = waiting.get(message.id);
  if (waits) {
    waiting.delete(message.id);
    if (message.type === "error") waits.reject(new Error(message.message));
    else waits.resolve(message);
    return;
  }
  if (message.type === "path") receivePath(message);
  else if (message.type === "world") edits.delete(message.id);
  else if (message.type === "layer") receiveLayer(message);
  else if (message.type === "compare") receiveComparison(message);
  else if (message.type === "explore") receiveExploration(message);
  else if (message.type === "error") receiveError(message);
}

function receiveError({id, message}) {
  const plan = inFlight.get(id);
  inFlight.delete(id);
  if (plan && id >= shownPlan) {
    shownPlan = id;
    scene.path = null;
    say(message.replace(/^(start|goal) \(.*?\) is not valid: /, "$1: "), true);
    showFigures({});
    dirty = true;
  } else if (!plan) {
    $("error").textContent = message;
    // What the server did not change is as it has it.
    if (edits.delete(id)) ask("hello").then((hello) => takeWorld(hello, false, scene));
    if (exploring?.id === id) endExploration();
    others = others.filter((other) => other.id !== id);
    listOthers();
  }
}

// ---- worlds

async function setWorld(world, fit = true, ends = null) {
  const options = {}, margin = Number($("margin").value);
  if (margin > 0) options.clearance = margin;
  if ($("objective").value !== "length") options.objective = $("objective").value;
  try {
    takeWorld(await ask("world", {world, ...options}), fit, ends);
    return true;
  } catch (error) {
    $("error").textContent = error.message;
    showRobot();
    return false;
  }
}

function takeWorld({world}, fit, ends = null) {
  const fresh = scene.world === null || fit;
  scene.take(world);
  if (ends) [scene.start, scene.goal] = [ends.start, ends.goal];
  else if (fresh) scene.takeQuery();
  if (fit) view.fit(world.bounds);
  ready = true;
  others = [];
  layers.clear();
  $("error").textContent = "";
  $("name").textContent = world.name;
  document.title = `${world.name} · trailmark live`;
  showRobot();
  listOthers();
  listSelected();
  view.forget();
  changed();
}

async function restore(before) {
  if (!before) return;
  stopPlaying();
  const same = JSON.stringify(before.world) === JSON.stringify(scene.content());
  if (same) {
    [scene.start, scene.goal] = [before.start, before.goal];
    changed();
  } else await setWorld(before.world, false, before);
  listSelected();
}

// Changes obstacles here and there.
function edit(change, at) {
  for (const id of change.remove ?? []) scene.obstacles.delete(id);
  for (const [id, by] of Object.entries(change.move ?? {})) scene.obstacles.set(id, displaced(scene.obstacles.get(id), ...by));
  for (const shape of change.add ?? []) scene.obstacles.set(shape.id, shape);
  view.forget("obstacles");
  // What is dragged quickly is told of once for each plan.
  pending ??= {remove: new Set(), move: new Map(), add: new Map()};
  for (const id of change.remove ?? []) {
    pending.move.delete(id);
    if (!pending.add.delete(id)) pending.remove.add(id);
  }
  for (const [id, by] of Object.entries(change.move ?? {})) {
    if (pending.add.has(id)) pending.add.set(id, scene.obstacles.get(id));
    else pending.move.set(id, (pending.move.get(id) ?? [0, 0, 0]).map((v, i) => v + (by[i] ?? 0)));
  }
  for (const shape of change.add ?? []) pending.add.set(shape.id, shape);
  changed(at);
}

function sendEdits() {
  if (!pending) return;
  const {remove, move, add} = pending;
  pending = null;
  edits.add(send("edit", {remove: [...remove], move: Object.fromEntries(move), add: [...add.values()],
    brief: true}));
  for (const name of layers.keys()) requestLayer(name);
}

// ---- planning

// To be called when anything changed that a path depends on.
function changed(at = performance.now()) {
  dirty = true;
  settle = at + CHANGED_WITHIN;
  if (wanted === null) wanted = at;
}

let wanted = null, patience = SHORTEST;

function plan(now) {
  if (!ready) return;
  const settled = wanted === null && settle && now > settle;
  if (wanted === null && !settled) return;
  // While dragging one plan at a time, as long as it takes to find a path; what gets better later is given up.
  if (!settled && [...inFlight.values()].some((asked) => !asked.settled)) return;
  const since = wanted ?? now;
  wanted = null;
  sendEdits();
  if (settled) settle = 0;
  const from = playing ? playing.state : scene.start;
  const id = send(playing ? "replan" : "plan",
    {start: from, goal: scene.goal, time_limit: settled ? SETTLED : patience});
  inFlight.set(id, {since, settled});
  if (settled) ["lattice", "reachable"].filter((name) => layers.has(name)).forEach(requestLayer);
}

function receivePath(message) {
  const asked = inFlight.get(message.id);
  if (asked && !asked.answered && message.status === "solved") {
    asked.answered = true;
    if (!asked.settled) drawn.push(asked.since);
  }
  if (message.final) inFlight.delete(message.id);
  if (message.final && layers.has("roadmap")) requestLayer("roadmap");  // it has grown
  if (asked && !asked.settled && message.final) {
    const found = message.status === "solved" ? message.time.first_solution : null;
    patience = Math.min(LONGEST, Math.max(SHORTEST, found === null ? 2 * patience : Math.min(patience, 4 * found)));
    if (message.status === "timeout" && patience < LONGEST) {
      wanted ??= asked.since;
      return;
    }
  }
  if (message.id < shownPlan || (message.final && message.status !== "solved" && inFlight.size)) return;
  if (message.id > shownPlan) history = [];
  shownPlan = message.id;
  const solved = message.status === "solved";
  scene.path = solved ? message : message.nearest ? {...message, states: message.nearest, partial: true} : null;
  if (playing && solved) playing.follow(message.states);
  if (solved) history.push([message.time.total ?? 0, message.cost]);
  const reasons = {timeout: "no path found in time", infeasible: "proven: there is no path"};
  say(solved ? (message.reason && playing ? message.reason : message.final ? "path found, certified" : "certified; getting better")
    : reasons[message.status] ?? message.status, !solved);
  showFigures(message);
  if (wanted !== null) plan(performance.now());
  if (message.status === "infeasible" && !layers.has("reachable")) toggleLayer("reachable", true, true);
  dirty = true;
}

function number(value, digits = 3) {
  return value === null || value === undefined ? "–" : Number(value).toPrecision(digits + (Math.abs(value) >= 1000 ? 1 : 0));
}

function showFigures({cost, lower_bound: bound, time, min_clearance: least, history: whole}) {
  $("cost").textContent = cost ? `${number(cost, 4)} m` : "–";
  $("bound").textContent = bound ? `${number(bound, 4)} m` : "–";
  $("gap").textContent = cost && bound ? `${(100 * (cost / bound - 1)).toFixed(2)} %` : "–";
  const first = time?.first_solution;
  $("first").textContent = first === null || first === undefined ? "–" : `${number(1000 * first)} ms`;
  const recent = latencies.slice(-60).sort((a, b) => a - b);
  $("latency").textContent = recent.length ? `${number(recent[recent.length >> 1], 2)} ms` : "–";
  $("least").textContent = least === null || least === undefined ? "–" : `${least.toFixed(3)} m`;
  drawChart(whole?.length > 1 ? whole : history, bound);
}

function drawChart(rows, bound) {
  const chart = $("chart");
  if (rows.length < 1) return chart.replaceChildren();
  const end = Math.max(rows.at(-1)[0], 1e-3), costs = rows.map(([, cost]) => cost), low = Math.min(bound || Infinity, ...costs);
  const high = Math.max(...costs), span = Math.max(high - low, 1e-6), y = (cost) => 92 - (84 * (cost - low)) / span;
  let line = `M${(100 * rows[0][0]) / end},${y(costs[0])}`;
  for (const [t, cost] of rows.slice(1)) line += `H${(100 * t) / end}V${y(cost)}`;
  const parts = [["path", {d: `${line}H100`}]];
  if (bound) parts.push(["line", {x1: 0, x2: 100, y1: y(bound), y2: y(bound)}]);
  chart.replaceChildren(...parts.map(([name, given]) => {
    const element = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(given)) element.setAttribute(key, value);
    return element;
  }));
}

function say(text, bad = false) {
  $("verdict").textContent = text;
  $("verdict").classList.toggle("bad", bad);
}

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

// ---- playing

class Drive {
  constructor(states) {
    this.state = states[0];
    this.follow(states);
    this.last = performance.now();
  }

  follow(states) {
    this.states = states;
    this.clock = pathClock(states);
    this.at = 0;
  }

  advance(now) {
    this.at += (Number($("speed").value) || 1) * Math.min(0.1, (now - this.last) / 1000);
    this.last = now;
    this.state = stateAlong(this.states, this.clock, this.at);
    return this.at < this.clock.at(-1);
  }
}

function togglePlay() {
  if (playing) stopPlaying();
  else if (scene.path && !scene.path.partial) {
    playing = new Drive(scene.path.states);
    settle = 0;
    $("play").setAttribute("aria-pressed", "true");
    $("play").textContent = "Stop";
  }
  dirty = true;
}

function stopPlaying() {
  if (!playing) return;
  playing = null;
  $("play").setAttribute("aria-pressed", "false");
  $("play").textContent = "Play";
  changed();
}

// ---- exploring

function toggleExploration() {
  if (exploring?.running) return send("stop");
  if (exploring) return endExploration();
  stopPlaying();
  const reach = Number($("range").value) || undefined;
  exploring = {running: true, steps: [], row: -1};
  exploring.id = send("explore", {start: scene.start, strategy: $("strategy").value, ...(reach ? {sensor_range: reach} : {})});
  $("explore").setAttribute("aria-pressed", "true");
  $("explore").textContent = "Stop";
}

function receiveExploration(message) {
  if (exploring?.id !== message.id) return;
  if (message.grid) {
    exploring.grid = message.grid;
    exploring.picture = new OffscreenCanvas(message.grid.columns, message.grid.rows);
    exploring.range = message.sensor_range;
    exploring.state = new Uint8Array(message.grid.rows * message.grid.columns);
  } else if (message.final) {
    exploring.running = false;
    $("explore").textContent = "Close";
    say(`exploration ${message.status}: ${message.reason}`, message.status !== "complete");
  } else {
    const at = new Int32Array(Uint8Array.from(atob(message.at), (c) => c.charCodeAt(0)).buffer);
    const now = Uint8Array.from(atob(message.cells), (c) => c.charCodeAt(0));
    const before = at.map((cell) => exploring.state[cell]);
    at.forEach((cell, i) => { exploring.state[cell] = now[i]; });
    exploring.steps.push({...message, at, now, before});
    const scrub = $("scrub"), follows = exploring.row === exploring.steps.length - 2;
    scrub.hidden = false;
    scrub.max = exploring.steps.length - 1;
    if (follows) showStep(exploring.steps.length - 1);
  }
  dirty = true;
}

function showStep(row) {
  const {grid, steps} = exploring, brush = exploring.picture.getContext("2d");
  const paint = (cell, state) => {
    const x = cell % grid.columns, y = grid.rows - 1 - Math.floor(cell / grid.columns);
    brush.fillStyle = [colours.outside, colours.free, colours.obstacle][state];
    brush.fillRect(x, y, 1, 1);
  };
  if (exploring.row < 0) {
    brush.fillStyle = colours.outside;
    brush.fillRect(0, 0, grid.columns, grid.rows);
  }
  while (exploring.row < row) {
    const step = steps[++exploring.row];
    step.at.forEach((cell, i) => paint(cell, step.now[i]));
  }
  while (exploring.row > row) {
    const step = steps[exploring.row--];
    step.at.forEach((cell, i) => paint(cell, step.before[i]));
  }
  const step = steps[row];
  $("scrub").value = row;
  say(`${number(step.time, 3)} s, ${number(step.distance)} m driven, ${number(step.area)} m² known, ${step.landmarks} landmarks`
    + (step.event ? `; ${step.event}` : ""));
  dirty = true;
}

function endExploration() {
  exploring = null;
  $("scrub").hidden = true;
  $("explore").setAttribute("aria-pressed", "false");
  $("explore").textContent = "Explore";
  changed();
}

// ---- drawing

function readColours() {
  const style = getComputedStyle(document.documentElement);
  colours = Object.fromEntries(COLOURS.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  view.forget();
  for (const name of layers.keys()) requestLayer(name);
  dirty = true;
}

function handlePlace(end) {
  const [x, y, theta] = scene[end], away = reachOf(scene.robot) + 22 / view.scale;
  return [x + away * Math.cos(theta), y + away * Math.sin(theta)];
}

function drawWorld(brush, pixel) {
  const [xmin, ymin, xmax, ymax] = scene.world.bounds;
  brush.fillStyle = colours.free;
  brush.fillRect(xmin, ymin, xmax - xmin, ymax - ymin);
  if (scene.world.boundary) {
    brush.fillStyle = colours.outside;
    brush.beginPath();
    brush.rect(xmin, ymin, xmax - xmin, ymax - ymin);
    traceLine(brush, scene.world.boundary, true);
    brush.fill("evenodd");
  }
  for (const zone of scene.world.zones ?? []) {
    brush.beginPath();
    traceLine(brush, zone.vertices, true);
    brush.fillStyle = zone.kind === "keep-out" ? colours.bad : colours.other;
    brush.globalAlpha = 0.2;
    brush.fill();
    brush.globalAlpha = 1;
  }
  brush.strokeStyle = colours.shade;
  brush.lineWidth = pixel;
  brush.strokeRect(xmin, ymin, xmax - xmin, ymax - ymin);
}

function drawObstacles(brush, pixel) {
  brush.fillStyle = colours.obstacle;
  brush.strokeStyle = colours.obstacle;
  brush.lineWidth = 0.5 * pixel;
  // One by one, for where they overlap an even-odd rule would leave holes.
  for (const shape of scene.obstacles.values()) {
    brush.beginPath();
    traceShape(brush, shape);
    brush.fill("evenodd");
  }
}

function drawRoadmap(brush, pixel, {nodes = [], edges = []}) {
  brush.strokeStyle = brush.fillStyle = colours.landmark;
  brush.globalAlpha = 0.35;
  brush.lineWidth = pixel;
  brush.beginPath();
  for (let i = 0; i < edges.length; i += 2) {
    brush.moveTo(nodes[3 * edges[i]], nodes[3 * edges[i] + 1]);
    brush.lineTo(nodes[3 * edges[i + 1]], nodes[3 * edges[i + 1] + 1]);
  }
  brush.stroke();
  brush.globalAlpha = 1;
  const size = 2.2 * pixel;
  for (let i = 0; i < nodes.length; i += 3) brush.fillRect(nodes[i] - size, nodes[i + 1] - size, 2 * size, 2 * size);
}

function drawPath(brush, pixel, {states, partial}, colour, width = 3) {
  brush.strokeStyle = colour;
  brush.lineWidth = width * pixel;
  brush.setLineDash(partial ? [6 * pixel, 6 * pixel] : []);
  brush.beginPath();
  traceLine(brush, states);
  brush.stroke();
  brush.setLineDash([]);
}

function drawSwept(brush, pixel, states) {
  const clock = pathClock(states), step = Math.max(0.9 * reachOf(scene.robot), clock.at(-1) / 60);
  brush.globalAlpha = 0.45;
  for (let at = step; at < clock.at(-1); at += step) {
    drawRobot(brush, scene.robot, stateAlong(states, clock, at), pixel, {stroke: colours.way, width: 1});
  }
  brush.globalAlpha = 1;
}

function draw(now) {
  view.clear();
  const brush = view.brush, pixel = 1 / view.scale;
  if (!scene.world) return;
  if (exploring?.picture && exploring.row >= 0) {
    drawCells(brush, exploring.picture, exploring.grid);
    const step = exploring.steps[exploring.row];
    if (step.path.length) drawPath(brush, pixel, {states: step.path}, colours.goal, 2);
    drawPath(brush, pixel, {states: exploring.steps.slice(0, exploring.row + 1).map(({pose}) => pose)}, colours.way, 2);
    brush.beginPath();
    brush.arc(step.pose[0], step.pose[1], exploring.range, 0, TURN);
    brush.strokeStyle = colours.soft;
    brush.lineWidth = pixel;
    brush.stroke();
    drawRobot(brush, scene.robot, step.pose, pixel, {fill: colours.page, stroke: colours.way});
    return;
  }
  view.keep("world", drawWorld);
  for (const [name, layer] of layers) {
    if (layer.picture) view.keep(name, (kept) => drawCells(kept, layer.picture, layer));
  }
  view.keep("obstacles", drawObstacles);
  if (layers.get("roadmap")?.nodes) view.keep("roadmap", (kept, size) => drawRoadmap(kept, size, layers.get("roadmap")));
  for (const other of others) if (other.states?.length) drawPath(brush, pixel, other, other.correct ? colours.other : colours.bad, 2);
  if (scene.path) {
    if (!scene.path.partial) drawSwept(brush, pixel, scene.path.states);
    drawPath(brush, pixel, scene.path, colours.way);
  }
  for (const end of ["start", "goal"]) drawEnd(brush, pixel, end);
  drawSelection(brush, pixel);
  if (draft) drawDraft(brush, pixel);
  if (playing) drawRobot(brush, scene.robot, playing.state, pixel, {fill: colours.way, stroke: colours.ink});
  while (drawn.length) latencies.push(performance.now() - drawn.shift());
  if (latencies.length > 2000) latencies.splice(0, 1000);
  canvas.dataset.frames = Number(canvas.dataset.frames ?? 0) + 1;
}

function drawEnd(brush, pixel, end) {
  const chosen = selected.kind === "end" && selected.end === end;
  brush.globalAlpha = 0.25;
  drawRobot(brush, scene.robot, scene[end], pixel, {fill: colours[end], stroke: colours[end]});
  brush.globalAlpha = 1;
  drawRobot(brush, scene.robot, scene[end], pixel, {stroke: colours[end], width: chosen ? 3.5 : 2});
  const [hx, hy] = handlePlace(end);
  brush.beginPath();
  brush.arc(hx, hy, 7 * pixel, 0, TURN);
  brush.fillStyle = colours[end];
  brush.fill();
}

function drawSelection(brush, pixel) {
  const shape = selected.kind === "obstacle" ? scene.obstacles.get(selected.id) : null;
  if (!shape) return;
  brush.beginPath();
  traceShape(brush, shape);
  brush.strokeStyle = colours.goal;
  brush.lineWidth = 3 * pixel;
  brush.stroke();
}

function drawDraft(brush, pixel) {
  brush.strokeStyle = colours.goal;
  brush.lineWidth = 2 * pixel;
  brush.beginPath();
  const shape = draftShape();
  if (shape) traceShape(brush, shape);
  else traceLine(brush, draft.points);
  brush.stroke();
}

function frame(now) {
  view.resize();
  if (playing) {
    if (!playing.advance(now)) stopPlaying();
    dirty = true;
  }
  plan(now);
  if (dirty || canvas.dataset.size !== `${view.width}x${view.height}`) {
    canvas.dataset.size = `${view.width}x${view.height}`;
    dirty = false;
    draw(now);
  }
  requestAnimationFrame(frame);
}

// ---- pointer

function place(event) {
  const box = canvas.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
}

canvas.addEventListener("pointerdown", (event) => {
  if (!scene.world || exploring) return;
  canvas.setPointerCapture(event.pointerId);
  canvas.focus({preventScroll: true});
  const [px, py] = place(event), [x, y] = view.toWorld(px, py);
  pointers.set(event.pointerId, [px, py]);
  if (pointers.size === 2) {
    drag = draft = null;
    const [a, b] = [...pointers.values()];
    pinch = {apart: Math.hypot(a[0] - b[0], a[1] - b[1]), middle: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]};
    return;
  }
  if (tool === "polygon") {
    draft ??= {points: []};
    draft.points.push([x, y]);
    if (event.detail > 1 && draft.points.length > 3) finishDraft();
  } else if (tool !== "move") {
    draft = {from: [x, y], to: [x, y]};
  } else {
    const reach = (event.pointerType === "touch" ? 22 : 10) / view.scale;
    const found = scene.under(x, y, reach, {start: handlePlace("start"), goal: handlePlace("goal")});
    if (found) {
      scene.note();
      select(found.kind === "turn" ? {kind: "end", end: found.end} : found);
    }
    drag = {...(found ?? {kind: "pan"}), last: [x, y], screen: [px, py]};
    canvas.classList.add("busy");
  }
  dirty = true;
});

// Where the browser tells of moves as they come, a path is on its way before the frame that shows the move.
canvas.addEventListener("onpointerrawupdate" in canvas ? "pointerrawupdate" : "pointermove", (event) => {
  if (!pointers.has(event.pointerId)) return;
  const [px, py] = place(event), [x, y] = view.toWorld(px, py);
  pointers.set(event.pointerId, [px, py]);
  if (pinch && pointers.size === 2) {
    const [a, b] = [...pointers.values()], apart = Math.hypot(a[0] - b[0], a[1] - b[1]);
    const middle = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
    view.zoom(apart / Math.max(pinch.apart, 1), ...middle);
    view.pan(middle[0] - pinch.middle[0], middle[1] - pinch.middle[1]);
    pinch = {apart, middle};
    dirty = true;
  } else if (draft?.from) {
    draft.to = [x, y];
    dirty = true;
  } else if (drag) moveDragged(px, py, x, y, event.timeStamp);
});

function moveDragged(px, py, x, y, at) {
  const dx = x - drag.last[0], dy = y - drag.last[1];
  if (drag.kind === "pan") {
    view.pan(px - drag.screen[0], py - drag.screen[1]);
    drag.screen = [px, py];
    dirty = true;
    return;
  }
  drag.last = [x, y];
  if (drag.kind === "end") {
    const [ex, ey, theta] = scene[drag.end];
    scene[drag.end] = [ex + dx, ey + dy, theta];
  } else if (drag.kind === "turn") {
    const [ex, ey] = scene[drag.end];
    scene[drag.end] = [ex, ey, Math.atan2(y - ey, x - ex)];
    if (layers.has("c-obstacle")) requestLayer("c-obstacle");
  } else edit({move: {[drag.id]: [dx, dy, 0]}}, at);
  if (drag.kind !== "obstacle") changed(at);
  plan(performance.now());  // at once: the next frame is a while off
  showSelected();
}

function release(event) {
  pointers.delete(event.pointerId);
  if (pointers.size < 2) pinch = null;
  drag = null;
  canvas.classList.remove("busy");
  if (draft?.from) finishDraft();
}
canvas.addEventListener("pointerup", release);
canvas.addEventListener("pointercancel", release);
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  view.zoom(Math.exp(-event.deltaY * 0.0015), ...place(event));
  dirty = true;
}, {passive: false});

// ---- drawing obstacles

function draftShape() {
  if (draft.points) return draft.points.length > 2 ? {shape: "polygon", vertices: draft.points} : null;
  const [[ax, ay], [bx, by]] = [draft.from, draft.to];
  if (tool === "disc") return {shape: "disc", center: [ax, ay], radius: Math.hypot(bx - ax, by - ay)};
  return {shape: "rectangle", center: [(ax + bx) / 2, (ay + by) / 2], length: Math.abs(bx - ax), width: Math.abs(by - ay)};
}

async function finishDraft() {
  const shape = draftShape(), least = 3 / view.scale;
  draft = null;
  dirty = true;
  if (!shape || (shape.radius ?? Math.min(shape.length ?? 1, shape.width ?? 1)) < least) return;
  scene.note();
  const id = scene.freshId();
  try {
    // A polygon may cross itself: the server says so before it is taken over.
    await ask("edit", {add: [{...shape, id}]});
    scene.obstacles.set(id, {...shape, id});
    view.forget("obstacles");
    select({kind: "obstacle", id});
    for (const name of layers.keys()) requestLayer(name);
    changed();
  } catch (error) {
    $("error").textContent = error.message;
  }
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

// ---- selection

function select(what) {
  selected = what;
  const value = what.kind === "end" ? what.end : what.id;
  if (![...$("selected").options].some((option) => option.value === value)) listSelected();
  $("selected").value = value;
  showSelected();
  dirty = true;
}

function listSelected() {
  if (selected.kind === "obstacle" && !scene.obstacles.has(selected.id)) selected = {kind: "end", end: "goal"};
  $("selected").replaceChildren(...["start", "goal", ...scene.obstacles.keys()].map((name) => new Option(name, name)));
  $("selected").value = selected.kind === "end" ? selected.end : selected.id;
  showSelected();
}

function selectedPose() {
  if (selected.kind === "end") return scene[selected.end];
  const shape = scene.obstacles.get(selected.id);
  return shape ? [...centreOf(shape), shape.heading ?? 0] : null;
}

function showSelected() {
  const pose = selectedPose();
  if (!pose) return;
  for (const [id, value] of [["sx", pose[0]], ["sy", pose[1]], ["st", (pose[2] * 180) / Math.PI]]) {
    if (document.activeElement !== $(id)) $(id).value = rounded(value, 3);
  }
}

// Moves and turns what is selected.
function nudge(dx, dy, turn) {
  scene.note();
  if (selected.kind === "end") {
    const [x, y, theta] = scene[selected.end];
    scene[selected.end] = [x + dx, y + dy, wrapped(theta + turn)];
    changed();
  } else if (scene.obstacles.has(selected.id)) edit({move: {[selected.id]: [dx, dy, turn]}});
  showSelected();
}

function setPose(axis, value) {
  const pose = selectedPose();
  if (!pose || !Number.isFinite(value)) return;
  const by = [0, 0, 0];
  by[axis] = axis === 2 ? wrapped((value * Math.PI) / 180 - pose[2]) : value - pose[axis];
  nudge(...by);
}

function removeSelected() {
  if (selected.kind !== "obstacle" || !scene.obstacles.has(selected.id)) return;
  scene.note();
  edit({remove: [selected.id]});
  listSelected();
}

function selectNext(step) {
  const names = [...$("selected").options].map((option) => option.value);
  const at = (names.indexOf($("selected").value) + step + names.length) % names.length;
  select(at < 2 ? {kind: "end", end: names[at]} : {kind: "obstacle", id: names[at]});
  $("told").textContent = `${names[at]} selected`;
}

// ---- robot

function showRobot() {
  const robot = scene.robot;
  $("shape").value = robot.shape;
  $("radius").value = robot.radius ?? "";
  $("length").value = robot.length ?? "";
  $("width").value = robot.width ?? "";
  $("turning").value = robot.turning_radius ?? "";
  $("radius-label").hidden = robot.shape !== "disc";
  $("length-label").hidden = $("width-label").hidden = robot.shape !== "rectangle";
  if (!$("range").value) {
    const [xmin, ymin, xmax, ymax] = scene.world.bounds;
    $("range").value = rounded(0.2 * Math.max(xmax - xmin, ymax - ymin), 2);
  }
}

async function changeRobot() {
  const kind = $("shape").value, reach = reachOf(scene.robot), given = (id, other) => Number($(id).value) || other;
  const {length = 2 * reach, width = 1.4 * reach, radius = reach} = scene.robot;
  const shapes = {disc: {shape: "disc", radius: given("radius", radius)},
    rectangle: {shape: "rectangle", length: given("length", length), width: given("width", width)}};
  const robot = shapes[kind] ?? {shape: "polygon", vertices: scene.robot.vertices};
  const turning = Number($("turning").value);
  if (turning > 0) robot.turning_radius = turning;
  else if (scene.robot.drive === "differential") robot.drive = "differential";
  scene.note();
  await setWorld({...scene.content(), robot}, false, scene);
}

// ---- keyboard

document.addEventListener("keydown", (event) => {
  const typing = /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName);
  if ((event.ctrlKey || event.metaKey) && !typing) {
    const key = event.key.toLowerCase();
    if (key === "z" || key === "y") {
      event.preventDefault();
      restore(key === "y" || event.shiftKey ? scene.redo() : scene.undo());
    }
    return;
  }
  if (typing || event.target.tagName === "BUTTON" || event.altKey) return;
  const step = (event.shiftKey ? 20 : 2) / view.scale, turn = ((event.shiftKey ? 15 : 3) * Math.PI) / 180;
  const actions = {
    ArrowLeft: () => nudge(-step, 0, 0), ArrowRight: () => nudge(step, 0, 0), ArrowUp: () => nudge(0, step, 0),
    ArrowDown: () => nudge(0, -step, 0), "[": () => nudge(0, 0, turn), "]": () => nudge(0, 0, -turn),
    "{": () => nudge(0, 0, turn), "}": () => nudge(0, 0, -turn), n: () => selectNext(1), N: () => selectNext(-1),
    Delete: removeSelected, Backspace: removeSelected, " ": togglePlay, f: () => view.fit(scene.world.bounds),
    "+": () => view.zoom(1.25, view.width / 2, view.height / 2), "=": () => view.zoom(1.25, view.width / 2, view.height / 2),
    "-": () => view.zoom(0.8, view.width / 2, view.height / 2), Enter: () => draft?.points && finishDraft(),
    Escape: () => { draft = null; setTool("move"); },
  };
  if (actions[event.key] && scene.world) {
    event.preventDefault();
    actions[event.key]();
    dirty = true;
  }
});

// ---- files, and everything else that is clicked

async function open(files) {
  try {
    const {text, world} = await worldOfFiles(files, scene.robot);
    scene.note();
    if (text !== undefined) takeWorld(await ask("open", {text}), true);
    else await setWorld(world.states ? scene.content() : world, true);
  } catch (error) {
    $("error").textContent = error.message;
  }
}

const clicks = {
  undo: () => restore(scene.undo()), redo: () => restore(scene.redo()), delete: removeSelected, play: togglePlay,
  fit: () => view.fit(scene.world.bounds), compare, explore: toggleExploration,
  theme: () => {
    const dark = document.documentElement.dataset.theme !== "dark";
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    $("theme").textContent = dark ? "Light" : "Dark";
    readColours();
  },
  save: async () => {
    sendEdits();
    const {text} = await ask("save", {start: scene.start, goal: scene.goal});
    download(`${scene.world.name}.yaml`, text, "text/yaml");
  },
  png: () => canvas.toBlob((blob) => download(`${scene.world.name}.png`, blob)),
  svg: () => download(`${scene.world.name}.svg`, svgOf(scene, colours), "image/svg+xml"),
  json: () => scene.path && download(`${scene.world.name}.json`, JSON.stringify({...scene.path, type: undefined, final: undefined, id: undefined}, null, 1), "application/json"),
  python: async () => {
    const text = pythonOf(scene, `${scene.world.name}.yaml`);
    await navigator.clipboard?.writeText(text).catch(() => download("plan.py", text, "text/x-python"));
    $("told").textContent = "Copied.";
  },
  share: async () => {
    location.hash = await packed({world: scene.content(), start: scene.start, goal: scene.goal});
    await navigator.clipboard?.writeText(location.href).catch(() => null);
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
$("worlds").addEventListener("change", async ({target}) => {
  if (!target.value) return;
  scene.note();
  try {
    takeWorld(await ask("open", {name: target.value}), true);
  } catch (error) {
    $("error").textContent = error.message;
  }
});
$("open").addEventListener("change", ({target}) => target.files.length && open(target.files));
for (const id of ["shape", "radius", "length", "width", "turning"]) $(id).addEventListener("change", changeRobot);
for (const id of ["margin", "objective"]) $(id).addEventListener("change", () => setWorld(scene.content(), false, scene));
$("selected").addEventListener("change", ({target: {value}}) =>
  select(value === "start" || value === "goal" ? {kind: "end", end: value} : {kind: "obstacle", id: value}));
["sx", "sy", "st"].forEach((id, axis) => $(id).addEventListener("change", ({target}) => setPose(axis, Number(target.value))));
$("scrub").addEventListener("input", ({target}) => exploring && showStep(Number(target.value)));
$("planner").replaceChildren(...PLANNERS.map((name) => new Option(name, name)));
$("layers").replaceChildren(...Object.entries(LAYERS).map(([name, text]) => {
  const label = document.createElement("label"), box = document.createElement("input");
  box.type = "checkbox";
  box.dataset.layer = name;
  box.addEventListener("change", () => toggleLayer(name, box.checked));
  label.append(box, text);
  return label;
}));
for (const name of ["dragover", "drop"]) {
  document.addEventListener(name, (event) => {
    event.preventDefault();
    if (name === "drop" && event.dataTransfer.files.length) open(event.dataTransfer.files);
  });
}
new ResizeObserver(() => {
  view.resize();
  dirty = true;
}).observe(canvas);

if (matchMedia("(prefers-color-scheme: dark)").matches) {
  document.documentElement.dataset.theme = "dark";
  $("theme").textContent = "Light";
}
// What tests and the curious may look at.
window.trailmark = {scene, view, latencies, inFlight, layers};
readColours();
connect();
requestAnimationFrame(frame);
