"use strict";
// Shapes as a world file has them: what they cover, where their centres lie, and what moving does to them.

const TURN = 2 * Math.PI;

// Angle in (-pi, pi].
function wrapped(angle) {
  const turned = angle - TURN * Math.floor((angle + Math.PI) / TURN);
  return turned === -Math.PI ? Math.PI : turned;
}

function rounded(value, digits = 4) {
  return Number(value.toFixed(digits));
}

function turnedPoints(points, [cx, cy], angle) {
  const cos = Math.cos(angle), sin = Math.sin(angle);
  return points.map(([x, y]) => [cx + cos * (x - cx) - sin * (y - cy), cy + sin * (x - cx) + cos * (y - cy)]);
}

function placed(points, [x, y, theta]) {
  return turnedPoints(points, [0, 0], theta).map(([px, py]) => [px + x, py + y]);
}

function rectanglePoints({center: [x, y] = [0, 0], length, width, heading = 0}) {
  const corners = [[-length, -width], [length, -width], [length, width], [-length, width]];
  return turnedPoints(corners.map(([dx, dy]) => [x + dx / 2, y + dy / 2]), [x, y], heading);
}

// Rings of points: the outline, then holes; a disc has none.
function ringsOf(shape) {
  if (shape.shape === "rectangle") return [rectanglePoints(shape)];
  return shape.shape === "polygon" ? [shape.vertices, ...(shape.holes ?? [])] : [];
}

function centreOf(shape) {
  if (shape.shape !== "polygon") return shape.center;
  const n = shape.vertices.length;
  return shape.vertices.reduce(([x, y], [px, py]) => [x + px / n, y + py / n], [0, 0]);
}

// The shape moved by dx, dy and turned about its own centre, as the server does it.
function displaced(shape, dx, dy, turn = 0) {
  const [cx, cy] = centreOf(shape), step = ([x, y]) => [x + dx, y + dy];
  if (shape.shape === "polygon") {
    const move = (ring) => turnedPoints(ring, [cx, cy], turn).map(step);
    return {...shape, vertices: move(shape.vertices), ...(shape.holes ? {holes: shape.holes.map(move)} : {})};
  }
  const moved = {...shape, center: [cx + dx, cy + dy]};
  return shape.shape === "rectangle" && turn ? {...moved, heading: wrapped((shape.heading ?? 0) + turn)} : moved;
}

function insideRing(ring, x, y) {
  let inside = false;
  for (let i = 0, j = ring.length - 1; i < ring.length; j = i++) {
    const [xi, yi] = ring[i], [xj, yj] = ring[j];
    if (yi > y !== yj > y && x < ((xj - xi) * (y - yi)) / (yj - yi) + xi) inside = !inside;
  }
  return inside;
}

function covers(shape, x, y) {
  if (shape.shape === "disc") return Math.hypot(x - shape.center[0], y - shape.center[1]) <= shape.radius;
  const [outline, ...holes] = ringsOf(shape);
  return insideRing(outline, x, y) && !holes.some((hole) => insideRing(hole, x, y));
}

function areaOf(shape) {
  if (shape.shape === "disc") return Math.PI * shape.radius ** 2;
  const [ring] = ringsOf(shape);
  return Math.abs(ring.reduce((sum, [x, y], i) => {
    const [nx, ny] = ring[(i + 1) % ring.length];
    return sum + x * ny - nx * y;
  }, 0)) / 2;
}

// The robot's outline about its reference point.
function footprintOf(robot) {
  if (robot.shape === "disc") return null;
  return robot.shape === "rectangle" ? rectanglePoints(robot) : robot.vertices;
}

function reachOf(robot) {
  return robot.shape === "disc" ? robot.radius : Math.max(...footprintOf(robot).map(([x, y]) => Math.hypot(x, y)));
}

// Configurations along a path, by the share of its cost: x and y straight, the heading the shorter way round.
function pathClock(states) {
  const at = [0];
  for (let i = 1; i < states.length; i++) {
    const [ax, ay, at0] = states[i - 1], [bx, by, bt] = states[i];
    at.push(at[i - 1] + Math.hypot(bx - ax, by - ay) + 0.5 * Math.abs(wrapped(bt - at0)));
  }
  return at;
}

function stateAlong(states, clock, distance) {
  if (states.length === 1 || distance <= 0) return states[0];
  let i = clock.findIndex((at) => at >= distance);
  if (i < 0) return states[states.length - 1];
  i = Math.max(i, 1);
  const span = clock[i] - clock[i - 1], share = span > 0 ? (distance - clock[i - 1]) / span : 1;
  const [ax, ay, at] = states[i - 1], [bx, by, bt] = states[i];
  return [ax + share * (bx - ax), ay + share * (by - ay), wrapped(at + share * wrapped(bt - at))];
}
