// The view: which part of the plane is shown, and everything that is drawn on the canvas, once a frame at most.

class View {
  constructor(canvas) {
    this.canvas = canvas;
    this.brush = canvas.getContext("2d");
    this.centre = [0, 0];
    this.scale = 50;  // pixels a metre
  }

  // Returns whether the canvas has another size than before.
  resize() {
    const {clientWidth: width, clientHeight: height} = this.canvas, ratio = window.devicePixelRatio || 1;
    Object.assign(this, {width, height, ratio});
    const size = [Math.round(width * ratio), Math.round(height * ratio)];
    if (this.canvas.width === size[0] && this.canvas.height === size[1]) return false;
    [this.canvas.width, this.canvas.height] = size;
    return true;
  }

  fit([xmin, ymin, xmax, ymax]) {
    this.resize();
    this.centre = [(xmin + xmax) / 2, (ymin + ymax) / 2];
    this.scale = 0.94 * Math.min(this.width / (xmax - xmin), this.height / (ymax - ymin));
  }

  toScreen(x, y) {
    return [this.width / 2 + (x - this.centre[0]) * this.scale, this.height / 2 - (y - this.centre[1]) * this.scale];
  }

  toWorld(px, py) {
    return [this.centre[0] + (px - this.width / 2) / this.scale, this.centre[1] - (py - this.height / 2) / this.scale];
  }

  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const [x, y] = this.toWorld(px, py);
    this.scale = Math.min(1e5, Math.max(1e-3, this.scale * factor));
    const [nx, ny] = this.toWorld(px, py);
    this.centre = [this.centre[0] + x - nx, this.centre[1] + y - ny];
  }

  pan(dx, dy) { this.centre = [this.centre[0] - dx / this.scale, this.centre[1] + dy / this.scale]; }

  // From here on the brush draws in metres, y up.
  clear() {
    const k = this.scale * this.ratio, {brush, canvas, centre} = this;
    brush.setTransform(1, 0, 0, 1, 0, 0);
    brush.clearRect(0, 0, canvas.width, canvas.height);
    brush.setTransform(k, 0, 0, -k, canvas.width / 2 - centre[0] * k, canvas.height / 2 + centre[1] * k);
    brush.lineJoin = brush.lineCap = "round";
  }

  fill(path, colour, alpha = 1) {
    this.brush.globalAlpha = alpha;
    this.brush.fillStyle = colour;
    this.brush.fill(path, "evenodd");
    this.brush.globalAlpha = 1;
  }

  // Draws a line, its width in pixels.
  stroke(path, colour, width = 2, dash = []) {
    this.brush.strokeStyle = colour;
    this.brush.lineWidth = width / this.scale;
    this.brush.setLineDash(dash.map((length) => length / this.scale));
    this.brush.stroke(path);
  }

  covers(path, x, y) {
    this.brush.setTransform(1, 0, 0, 1, 0, 0);  // places are told in the canvas's own pixels
    return this.brush.isPointInPath(path, x, y, "evenodd");
  }
}

function readColours() {
  const style = getComputedStyle(document.documentElement);
  const names = ["page", "ink", "soft", "line", "free", "outside", "obstacle", "way", "goal", "start", "other", "bad", "shade"];
  colours = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  dirty = true;
}

// Where a start or goal is turned by.
function handlePlace(end) {
  const [x, y, theta] = scene[end], away = reachOf(scene.robot) + 22 / view.scale;
  return [x + away * Math.cos(theta), y + away * Math.sin(theta)];
}

function draw() {
  view.clear();
  if (!scene.world) return;
  drawWorld(scene.world);
  for (const area of scene.areas.values()) view.fill(area, colours.obstacle);
  for (const area of scene.unknown) view.fill(area, colours.shade, 0.35);
  if (scene.path) drawPath(scene.path);
  for (const center of scene.via) view.fill(areaOf({shape: "disc", center, radius: 6 / view.scale}), colours.way);
  for (const end of ["start", "goal"]) drawEnd(end);
  if (scene.obstacles.has(selected)) view.stroke(scene.areas.get(selected), colours.goal, 3);
  if (draft) view.stroke(draftShape() ? areaOf(draftShape()) : lineOf(draft.points), colours.goal);
  if (playing) drawBody(playing.state, colours.way, 1, colours.ink, 2);
  while (drawn.length) latencies.push(performance.now() - drawn.shift());
  if (latencies.length > 2000) latencies.splice(0, 1000);
}

function drawWorld({bounds: [xmin, ymin, xmax, ymax], boundary, zones = []}) {
  const whole = lineOf([[xmin, ymin], [xmax, ymin], [xmax, ymax], [xmin, ymax]], true), outside = new Path2D(whole);
  view.fill(whole, colours.free);
  if (boundary) view.fill(lineOf(boundary, true, outside), colours.outside);
  for (const {kind, vertices} of zones) view.fill(lineOf(vertices, true), kind === "keep-out" ? colours.bad : colours.other, 0.2);
  view.stroke(whole, colours.shade, 1);
}

function drawPath({states, partial}) {
  const clock = pathClock(states), step = Math.max(0.9 * reachOf(scene.robot), clock.at(-1) / 60), swept = new Path2D();
  for (let at = step; !partial && at < clock.at(-1); at += step) swept.addPath(bodyOf(scene.robot, stateAlong(states, clock, at)));
  view.brush.globalAlpha = 0.45;
  view.stroke(swept, colours.way, 1);
  view.brush.globalAlpha = 1;
  view.stroke(lineOf(states), colours.way, 3, partial ? [6, 6] : []);
}

function drawEnd(end) {
  const bad = badEnd === end, colour = bad ? colours.bad : colours[end];
  drawBody(scene[end], colour, bad ? 0.6 : 0.25, colour, selected === end ? 3.5 : 2);
  view.fill(areaOf({shape: "disc", center: handlePlace(end), radius: 7 / view.scale}), colours[end]);
}

function drawBody(q, fill, alpha, stroke, width) {
  const body = bodyOf(scene.robot, q);
  view.fill(body, fill, alpha);
  view.stroke(body, stroke, width);
}

function frame(now) {
  if (view.resize()) dirty = true;
  if (playing) {
    if (!drive(now)) stopPlaying();
    dirty = true;
  }
  plan(now);
  if (dirty) {
    dirty = false;
    draw();
  }
  requestAnimationFrame(frame);
}
