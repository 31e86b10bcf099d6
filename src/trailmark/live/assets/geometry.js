"use strict";
// Shapes as a world file has them: where they lie, and what moving does to them; paths by their length.

const TURN = 2 * Math.PI;

// Angle in (-pi, pi].
function wrapped(angle) {
  const turned = angle - TURN * Math.floor((angle + Math.PI) / TURN);
  return turned === -Math.PI ? Math.PI : turned;
}

const rounded = (value, digits = 4) => Number(value.toFixed(digits));

function turnedPoints(points, [cx, cy], angle) {
  const cos = Math.cos(angle), sin = Math.sin(angle);
  return points.map(([x, y]) => [cx + cos * (x - cx) - sin * (y - cy), cy + sin * (x - cx) + cos * (y - cy)]);
}

function rectanglePoints({center: [x, y] = [0, 0], length, width, heading = 0}) {
  const corners = [[-length, -width], [length, -width], [length, width], [-length, width]];
  return turnedPoints(corners.map(([dx, dy]) => [x + dx / 2, y + dy / 2]), [x, y], heading);
}

// What a shape covers, holes left out, as the canvas fills it by its even-odd rule.
function areaOf(shape, area = new Path2D()) {
  if (shape.shape === "disc") {
    const [x, y] = shape.center ?? [0, 0];
    area.moveTo(x + shape.radius, y);
    area.arc(x, y, shape.radius, 0, TURN);
  } else {
    const rings = shape.shape === "rectangle" ? [rectanglePoints(shape)] : [shape.vertices, ...(shape.holes ?? [])];
    for (const ring of rings) lineOf(ring, true, area);
  }
  return area;
}

function lineOf(points, closed = false, path = new Path2D()) {
  points.forEach(([x, y], i) => (i ? path.lineTo(x, y) : path.moveTo(x, y)));
  if (closed) path.closePath();
  return path;
}

// What the robot covers at a configuration, and a line that shows where it looks.
function bodyOf(robot, [x, y, theta]) {
  const body = lineOf([[0, 0], [reachOf(robot), 0]], false, areaOf(robot)), placed = new Path2D();
  placed.addPath(body, new DOMMatrix().translate(x, y).rotate((theta * 180) / Math.PI));
  return placed;
}

function reachOf(robot) {
  if (robot.shape === "disc") return robot.radius;
  const corners = robot.shape === "rectangle" ? rectanglePoints(robot) : robot.vertices;
  return Math.max(...corners.map(([x, y]) => Math.hypot(x, y)));
}

function centreOf(shape) {
  if (shape.shape !== "polygon") return shape.center;
  const n = shape.vertices.length;
  return shape.vertices.reduce(([x, y], [px, py]) => [x + px / n, y + py / n], [0, 0]);
}

// The shape moved by dx, dy and turned about its own centre, as the server does it.
function displaced(shape, dx, dy, turn = 0) {
  const [cx, cy] = centreOf(shape);
  if (shape.shape === "polygon") {
    const move = (ring) => turnedPoints(ring, [cx, cy], turn).map(([x, y]) => [x + dx, y + dy]);
    return {...shape, vertices: move(shape.vertices), ...(shape.holes ? {holes: shape.holes.map(move)} : {})};
  }
  const moved = {...shape, center: [cx + dx, cy + dy]};
  return shape.shape === "rectangle" && turn ? {...moved, heading: wrapped((shape.heading ?? 0) + turn)} : moved;
}

// Costs along a path, up to each of its states.
function pathClock(states) {
  const at = [0];
  for (let i = 1; i < states.length; i++) {
    const [[ax, ay, from], [bx, by, to]] = [states[i - 1], states[i]];
    at.push(at[i - 1] + Math.hypot(bx - ax, by - ay) + 0.5 * Math.abs(wrapped(to - from)));
  }
  return at;
}

// The configuration at a cost along a path: x and y straight, the heading the shorter way round.
function stateAlong(states, clock, distance) {
  const next = clock.findIndex((at) => at >= distance), i = Math.max(next, 1);
  if (states.length === 1 || next < 0) return states.at(-1);
  const span = clock[i] - clock[i - 1], share = span > 0 ? Math.max(0, (distance - clock[i - 1]) / span) : 1;
  const [[ax, ay, from], [bx, by, to]] = [states[i - 1], states[i]];
  return [ax + share * (bx - ax), ay + share * (by - ay), wrapped(from + share * wrapped(to - from))];
}
