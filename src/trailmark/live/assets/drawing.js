// Drawing: everything on the canvas, once a frame at most.

function readColours() {
  const style = getComputedStyle(document.documentElement);
  colours = Object.fromEntries(COLOURS.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  view.forget();
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
  // One by one, for where they overlap an even-odd rule would leave holes. One that is dragged is drawn anew each frame.
  for (const shape of scene.obstacles.values()) if (shape.id !== drag?.id) drawObstacle(brush, shape);
}

function drawObstacle(brush, shape) {
  brush.beginPath();
  traceShape(brush, shape);
  brush.fill("evenodd");
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
  view.keep("world", drawWorld);
  view.keep("obstacles", drawObstacles);
  if (scene.obstacles.has(drag?.id)) {
    brush.fillStyle = colours.obstacle;
    drawObstacle(brush, scene.obstacles.get(drag.id));
  }
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
  const colour = badEnd === end ? colours.bad : colours[end];
  brush.globalAlpha = badEnd === end ? 0.6 : 0.25;
  drawRobot(brush, scene.robot, scene[end], pixel, {fill: colour, stroke: colour});
  brush.globalAlpha = 1;
  drawRobot(brush, scene.robot, scene[end], pixel, {stroke: colour, width: chosen ? 3.5 : 2});
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
  if (dirty || (view.blurred && !view.moves) || canvas.dataset.size !== `${view.width}x${view.height}`) {
    canvas.dataset.size = `${view.width}x${view.height}`;
    dirty = false;
    draw(now);
  }
  requestAnimationFrame(frame);
}
