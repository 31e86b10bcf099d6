// The link to the server: messages out and in, the world that both sides work on, and what is changed in it.

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
    badEnd = /^(start|goal)\b/.exec(message)?.[0] ?? null;
    dirty = true;
  } else if (!plan) {
    $("error").textContent = message;
    // What the server did not change is as it has it.
    if (edits.delete(id)) ask("hello").then((hello) => takeWorld(hello, false, scene));
  }
}

// ---- worlds

// What the planner is told beside the world, by the names that Python has for it.
function plannerOptions() {
  const options = {}, margin = Number($("margin").value);
  if (margin > 0) options.clearance = margin;
  if ($("objective").value !== "length") options.objective = $("objective").value;
  return options;
}

async function setWorld(world, fit = true, ends = null) {
  try {
    takeWorld(await ask("world", {world, ...plannerOptions()}), fit, ends);
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
  badEnd = null;
  $("error").textContent = "";
  $("name").textContent = world.name;
  $("worlds").value = [...$("worlds").options].some(({value}) => value === world.name) ? world.name : "";
  document.title = `${world.name} · trailmark live`;
  showRobot();
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
  if (!(drag?.id in (change.move ?? {}))) view.forget("obstacles");
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
}
