// Exploring: cells as they become known, live and by the scrubber.

const STEPS_A_SECOND = 30;

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

// An exploration that was kept: all its steps come at once.
async function openRecording() {
  if (exploring) return;
  stopPlaying();
  const recorded = await ask("recorded");
  exploring = {running: false, steps: [], row: -1, id: recorded.id};
  receiveExploration({...recorded, final: false});
  for (const step of recorded.steps) receiveExploration({...step, id: recorded.id});
  receiveExploration({...recorded, grid: null, final: true});
  $("explore").setAttribute("aria-pressed", "true");
  view.fit(boundsOf(recorded.grid));
}

function boundsOf({origin: [x, y], size, rows, columns}) {
  return [x, y, x + columns * size, y + rows * size];
}

function receiveExploration(message) {
  if (exploring?.id !== message.id) return;
  if (message.grid) {
    exploring.grid = message.grid;
    $("scrub").hidden = false;
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

// Plays it from where it is, or from the beginning; a second time, it stops.
function playExploration() {
  const {steps, row, plays} = exploring;
  if (!steps.length) return;
  exploring.plays = plays ? 0 : STEPS_A_SECOND;
  if (exploring.plays && row === steps.length - 1) showStep(0);
  exploring.begun = {at: performance.now(), row: exploring.row};
  showPlays(Boolean(exploring.plays));
}

function advanceExploration(now) {
  const {begun, plays, steps} = exploring, row = begun.row + Math.floor(((now - begun.at) / 1000) * plays);
  if (row > exploring.row) showStep(Math.min(row, steps.length - 1));
  if (row >= steps.length - 1) playExploration();
}

function endExploration() {
  if (exploring.plays) showPlays(false);
  exploring = null;
  $("scrub").hidden = true;
  $("explore").setAttribute("aria-pressed", "false");
  $("explore").textContent = "Explore";
  changed();
}
