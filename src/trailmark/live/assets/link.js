// The link to the server: messages, the world that both sides work on, what is changed in it, and plans.

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
  offer("worlds", [["this one", ""], ...hello.worlds.map((name) => [name, name])]);
  if (scene.world) return setWorld(scene.content(), false);  // as it was before the connection was lost
  takeWorld(hello, true);
  if (location.hash.length < 2) return;
  await attempt(async () => {
    const shared = JSON.parse(decodeURIComponent(location.hash.slice(1)));
    await setWorld(shared.world, true, shared);
  });
}

function receive(message) {
  const waits = waiting.get(message.id);
  waiting.delete(message.id);
  if (waits && message.type === "error") waits.reject(new Error(message.message));
  else if (waits) waits.resolve(message);
  else if (message.type === "path") receivePath(message);
  else if (message.type === "world") edits.delete(message.id);
  else if (message.type === "error") receiveError(message);
}

function receiveError({id, message}) {
  const plan = inFlight.get(id);
  inFlight.delete(id);
  if (plan && id >= shownPlan) {
    [shownPlan, scene.path, dirty] = [id, null, true];
    say(message.replace(/^(start|goal) \(.*?\) is not valid: /, "$1: "), true);
    showFigures({});
    badEnd = /^(start|goal)\b/.exec(message)?.[0] ?? null;
  } else if (!plan) {
    $("error").textContent = message;
    // What the server did not change is as it has it.
    if (edits.delete(id)) ask("hello").then((hello) => takeWorld(hello, false, scene));
  }
}

// Does what an answer is waited for, and shows what is wrong with it; returns whether nothing is.
async function attempt(act) {
  try {
    await act();
    return true;
  } catch ({message}) {
    $("error").textContent = message;
    return false;
  }
}

// ---- worlds

// What the planner is told beside the world, by the names that Python has for it.
function plannerOptions() {
  const clearance = Number($("clearance").value), objective = $("objective").value;
  return {...(clearance > 0 ? {clearance} : {}), ...(objective === "length" ? {} : {objective})};
}

async function setWorld(world, fit = true, ends = null) {
  const done = await attempt(async () => takeWorld(await ask("world", {world, ...plannerOptions()}), fit, ends));
  if (!done) showRobot();
}

function openWorld(fields) {
  scene.note();
  return attempt(async () => takeWorld(await ask("open", fields), true));
}

function takeWorld({world, unknown}, fit, ends = null) {
  scene.take(world, unknown);
  if (ends) [scene.start, scene.goal, scene.via] = [ends.start, ends.goal, ends.via ?? []];
  else if (fit) scene.takeQuery();
  if (fit) view.fit(world.bounds);
  ready = true;
  pending = badEnd = null;
  $("error").textContent = "";
  $("name").textContent = world.name;
  $("worlds").value = [...$("worlds").options].some(({value}) => value === world.name) ? world.name : "";
  document.title = `${world.name} · trailmark live`;
  showRobot();
  select(selected);
  changed();
}

// Goes back to what was, here and there.
function restore(before) {
  if (!before) return;
  stopPlaying();
  [scene.start, scene.goal, scene.via] = [before.start, before.goal, before.via];
  if (JSON.stringify(before.world) === JSON.stringify(scene.content())) return changed();
  send("world", {world: before.world, ...plannerOptions()});
  takeWorld(before, false);
}

// Changes obstacles here and there: ids, [dx, dy, dtheta] by id, and shapes with ids.
function edit({remove = [], move = {}, add = []}, at) {
  // What is dragged quickly is told of once for each plan.
  pending ??= {remove: new Set(), move: new Map(), add: new Map()};
  for (const id of remove) {
    scene.remove(id);
    pending.move.delete(id);
    if (!pending.add.delete(id)) pending.remove.add(id);
  }
  for (const [id, by] of Object.entries(move)) {
    scene.set(displaced(scene.obstacles.get(id), ...by));
    if (pending.add.has(id)) pending.add.set(id, scene.obstacles.get(id));
    else pending.move.set(id, (pending.move.get(id) ?? [0, 0, 0]).map((v, i) => v + by[i]));
  }
  for (const shape of add) {
    scene.set(shape);
    pending.add.set(shape.id, shape);
  }
  changed(at);
}

function sendEdits() {
  if (!pending) return;
  const {remove, move, add} = pending;
  pending = null;
  edits.add(send("edit", {remove: [...remove], move: Object.fromEntries(move), add: [...add.values()], brief: true}));
}

// ---- plans

// To be called when anything changed that a path depends on.
function changed(at = performance.now()) {
  dirty = true;
  settle = at + CHANGED_WITHIN;
  if (wanted === null) wanted = at;
}

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
  const query = {start: playing ? playing.state : scene.start, goal: scene.goal, time_limit: settled ? SETTLED : patience};
  const id = send(playing ? "replan" : "plan", playing ? query : {...query, via: scene.via});
  inFlight.set(id, {since, settled, dragged: drag !== null && !settled});
}

function receivePath(message) {
  const asked = inFlight.get(message.id);
  if (asked && !asked.answered && message.status === "solved") {
    asked.answered = true;
    if (asked.dragged) drawn.push(asked.since);
  }
  if (message.final) inFlight.delete(message.id);
  if (asked && !asked.settled && message.final) {
    const found = message.status === "solved" ? message.time.first_solution : null;
    patience = Math.min(LONGEST, Math.max(SHORTEST, found === null ? 2 * patience : Math.min(patience, 4 * found)));
    if (message.status === "timeout" && patience < LONGEST) {
      wanted ??= asked.since;
      return;
    }
  }
  const solved = message.status === "solved";
  if (message.id < shownPlan || (message.final && !solved && inFlight.size)) return;
  if (message.id > shownPlan) history = [];
  [shownPlan, badEnd, dirty] = [message.id, null, true];
  scene.path = solved ? message : message.nearest ? {...message, states: message.nearest, partial: true} : null;
  if (playing && solved) follow(message.states);
  if (solved) history.push([message.time.total ?? 0, message.cost]);
  const words = {timeout: "no path found in time", infeasible: "proven: there is no path",
    solved: playing && message.reason || (message.final ? "path found, certified" : "certified; getting better")};
  say(words[message.status], !solved);
  showFigures(message);
  if (wanted !== null) plan(performance.now());
  $("why").textContent = solved ? "" : message.reason ?? "";
}

const number = (value, digits) => value.toPrecision(digits + (value >= 1000 ? 1 : 0));

function showFigures({cost, lower_bound: bound, time, min_clearance: least}) {
  const recent = latencies.slice(-60).sort((a, b) => a - b), ms = (value) => `${number(value, value < 10 ? 2 : 3)} ms`;
  const figures = {
    cost: cost && `${number(cost, 4)} m`, bound: bound && `${number(bound, 4)} m`,
    gap: cost && bound && `${(100 * (cost / bound - 1)).toFixed(2)} %`, first: time?.first_solution && ms(1000 * time.first_solution),
    latency: recent.length && ms(recent[recent.length >> 1]), least: Number.isFinite(least) && `${least.toFixed(3)} m`,
  };
  for (const [id, text] of Object.entries(figures)) $(id).textContent = text || "–";
  drawChart(history, bound);
}

function drawChart(rows, bound) {
  $("chart").parentElement.hidden = rows.length < 1;
  if (rows.length < 1) return;
  const end = Math.max(rows.at(-1)[0], 1e-3), costs = rows.map(([, cost]) => cost), low = Math.min(bound || Infinity, ...costs);
  const high = Math.max(...costs), span = Math.max(high - low, 1e-6), y = (cost) => 92 - (84 * (cost - low)) / span;
  const steps = rows.slice(1).map(([t, cost]) => `H${(100 * t) / end}V${y(cost)}`).join("");
  $("chart-line").setAttribute("d", `M${(100 * rows[0][0]) / end},${y(costs[0])}${steps}H100`);
  $("chart-bound").setAttribute("d", bound ? `M0,${y(bound)}H100` : "");
  $("chart-high").textContent = `${number(high, 4)} m`;
  $("chart-low").textContent = `${number(low, 4)} m`;
  $("chart-end").textContent = `${number(end, 2)} s`;
}

function say(text, bad = false) {
  $("verdict").textContent = text;
  $("verdict").classList.toggle("bad", bad);
}
