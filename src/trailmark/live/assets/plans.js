// Plans: what is asked for while something is dragged and after it, and what is shown of the answers.

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
  if (message.id < shownPlan || (message.final && message.status !== "solved" && inFlight.size)) return;
  if (message.id > shownPlan) history = [];
  shownPlan = message.id;
  badEnd = null;
  const solved = message.status === "solved";
  scene.path = solved ? message : message.nearest ? {...message, states: message.nearest, partial: true} : null;
  if (playing && solved) playing.follow(message.states);
  if (solved) history.push([message.time.total ?? 0, message.cost]);
  const reasons = {timeout: "no path found in time", infeasible: "proven: there is no path"};
  say(solved ? (message.reason && playing ? message.reason : message.final ? "path found, certified" : "certified; getting better")
    : reasons[message.status] ?? message.status, !solved);
  showFigures(message);
  if (wanted !== null) plan(performance.now());
  $("why").textContent = solved ? "" : message.reason ?? "";
  dirty = true;
}

function number(value, digits = 3) {
  return value === null || value === undefined ? "–" : Number(value).toPrecision(digits + (Math.abs(value) >= 1000 ? 1 : 0));
}

function milliseconds(value) {
  return `${value < 10 ? value.toFixed(1) : Math.round(value)} ms`;
}

function showFigures({cost, lower_bound: bound, time, min_clearance: least, history: whole}) {
  $("cost").textContent = cost ? `${number(cost, 4)} m` : "–";
  $("bound").textContent = bound ? `${number(bound, 4)} m` : "–";
  $("gap").textContent = cost && bound ? `${(100 * (cost / bound - 1)).toFixed(2)} %` : "–";
  const first = time?.first_solution;
  $("first").textContent = first === null || first === undefined ? "–" : milliseconds(1000 * first);
  const recent = latencies.slice(-60).sort((a, b) => a - b);
  $("latency").textContent = recent.length ? milliseconds(recent[recent.length >> 1]) : "–";
  $("least").textContent = least === null || least === undefined ? "–" : `${least.toFixed(3)} m`;
  drawChart(whole?.length > 1 ? whole : history, bound);
}

function drawChart(rows, bound) {
  const chart = $("chart");
  chart.parentElement.hidden = rows.length < 1;
  if (rows.length < 1) return;
  const end = Math.max(rows.at(-1)[0], 1e-3), costs = rows.map(([, cost]) => cost), low = Math.min(bound || Infinity, ...costs);
  const high = Math.max(...costs), span = Math.max(high - low, 1e-6), y = (cost) => 92 - (84 * (cost - low)) / span;
  let line = `M${(100 * rows[0][0]) / end},${y(costs[0])}`;
  for (const [t, cost] of rows.slice(1)) line += `H${(100 * t) / end}V${y(cost)}`;
  $("chart-high").textContent = `${number(high, 4)} m`;
  $("chart-low").textContent = `${number(low, 4)} m`;
  $("chart-end").textContent = `${number(end, 2)} s`;
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
