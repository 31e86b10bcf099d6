"use strict";
// The page of an exploration: cells are painted from the reading on at which they were known first.
const $ = (id) => document.getElementById(id);
const meta = JSON.parse($("meta").textContent);
const canvas = $("map"), brush = canvas.getContext("2d"), time = $("time"), play = $("play");
const [rows, columns] = meta.shape, count = meta.times;
const COLOURS = ["unknown", "free", "occupied", "way", "goal", "landmark", "start", "rim", "ink"];
const NEVER = 65535, UNKNOWN = 0;
let data, colours, cells, pixels, order, begins, painted = 0, row = 0, playing = null;

async function unpacked() {
  const bytes = Uint8Array.from(atob($("data").textContent.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(stream).arrayBuffer();
  const kinds = {int32: Int32Array, uint16: Uint16Array, uint8: Uint8Array}, found = {};
  let at = 0;
  for (const [name, kind, length] of meta.arrays) {
    found[name] = new kinds[kind](buffer, at, length);
    at += length * kinds[kind].BYTES_PER_ELEMENT;
  }
  return found;
}

// Cells in the order in which they became known: begins[i] of them were known before reading i.
function sortCells() {
  begins = new Uint32Array(count + 1);
  for (const i of data.first) if (i !== NEVER) begins[i + 1]++;
  for (let i = 0; i < count; i++) begins[i + 1] += begins[i];
  order = new Uint32Array(begins[count]);
  const next = begins.slice();
  data.first.forEach((i, cell) => { if (i !== NEVER) order[next[i]++] = cell; });
}

function readColours() {
  const style = getComputedStyle(document.documentElement);
  colours = Object.fromEntries(COLOURS.map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  const probe = document.createElement("canvas").getContext("2d", {willReadFrequently: true});
  const packed = ["unknown", "free", "occupied"].map((name) => {
    probe.fillStyle = colours[name];
    probe.fillRect(0, 0, 1, 1);
    return new Uint32Array(probe.getImageData(0, 0, 1, 1).data.buffer)[0];
  });
  cells = new OffscreenCanvas(columns, rows);
  pixels = new ImageData(columns, rows);
  const words = new Uint32Array(pixels.data.buffer).fill(packed[UNKNOWN]);
  painted = 0;
  // An image's first row is its highest, a map's the lowest.
  pixels.paint = (cell, known) => {
    const place = (rows - 1 - Math.floor(cell / columns)) * columns + cell % columns;
    words[place] = packed[known ? data.state[cell] : UNKNOWN];
  };
}

function reveal() {
  const wanted = begins[row + 1];
  while (painted < wanted) pixels.paint(order[painted++], true);
  while (painted > wanted) pixels.paint(order[--painted], false);
  cells.getContext("2d").putImageData(pixels, 0, 0);
}

const at = (name, i, k, width) => data[name][i * width + k] * meta.unit;
const turn = (name, i, k, width) => data[name][i * width + k] * meta.angle;

function draw() {
  const ratio = window.devicePixelRatio || 1, scale = canvas.width / (columns * meta.cell);
  const px = (x) => x * scale, py = (y) => canvas.height - y * scale;
  const dot = (x, y, radius, colour) => {
    brush.beginPath();
    brush.arc(px(x), py(y), radius * ratio, 0, 2 * Math.PI);
    brush.fillStyle = colour;
    brush.strokeStyle = colours.rim;
    brush.lineWidth = 1.5 * ratio;
    brush.fill();
    brush.stroke();
  };
  const line = (name, width, from, to, colour, thickness, dashes) => {
    brush.beginPath();
    for (let i = from; i < to; i++) brush.lineTo(px(at(name, i, 0, width)), py(at(name, i, 1, width)));
    brush.strokeStyle = colour;
    brush.lineWidth = thickness * ratio;
    brush.setLineDash(dashes.map((length) => length * ratio));
    brush.stroke();
    brush.setLineDash([]);
  };
  brush.lineJoin = brush.lineCap = "round";
  brush.imageSmoothingEnabled = canvas.width < columns;
  brush.drawImage(cells, 0, 0, canvas.width, canvas.height);
  dot(at("pose", 0, 0, 3), at("pose", 0, 1, 3), 4, colours.start);
  line("pose", 3, 0, row + 1, colours.way, 2, []);
  line("path", 2, data.span[2 * row], data.span[2 * row + 1], colours.goal, 2.5, [6, 4]);
  brush.font = `600 ${12 * ratio}px system-ui, sans-serif`;
  drawLandmarks(px, py, ratio, dot);
  if (data.aimed[row]) dot(at("target", row, 0, 2), at("target", row, 1, 2), 6, colours.goal);
  drawRobot(px, py, ratio, dot);
  drawScale(scale, ratio);
}

function drawLandmarks(px, py, ratio, dot) {
  const numbered = [];
  for (let k = data.landmarks[row] - 1; k >= 0; k--) {
    const x = at("places", k, 0, 2), y = at("places", k, 1, 2);
    const u = Math.min(px(x) + 6 * ratio, canvas.width - 26 * ratio), v = py(y) - 5 * ratio;
    dot(x, y, 4, colours.landmark);
    // The latest have their numbers, older ones where there is room.
    if (numbered.some(([a, b]) => Math.abs(a - u) < 28 * ratio && Math.abs(b - v) < 15 * ratio)) continue;
    numbered.push([u, v]);
    brush.strokeStyle = colours.rim;
    brush.lineWidth = 3 * ratio;
    brush.fillStyle = colours.landmark;
    brush.strokeText(String(k + 1), u, v);
    brush.fillText(String(k + 1), u, v);
  }
}

function drawRobot(px, py, ratio, dot) {
  const x = at("pose", row, 0, 3), y = at("pose", row, 1, 3), theta = turn("pose", row, 2, 3);
  const place = ([u, v]) => [px(x + u * Math.cos(theta) - v * Math.sin(theta)),
    py(y + u * Math.sin(theta) + v * Math.cos(theta))];
  brush.beginPath();
  meta.robot.forEach((corner) => brush.lineTo(...place(corner)));
  brush.closePath();
  brush.fillStyle = colours.way;
  brush.strokeStyle = colours.rim;
  brush.lineWidth = 1.5 * ratio;
  brush.fill();
  brush.stroke();
  const reach = Math.max(0, ...meta.robot.map(([u]) => u)), [ax, ay] = place([0, 0]), [bx, by] = place([reach, 0]);
  if (Math.hypot(bx - ax, by - ay) < 8 * ratio) { dot(x, y, 5, colours.way); return; }
  brush.beginPath();
  brush.moveTo(ax, ay);
  brush.lineTo(bx, by);
  brush.lineWidth = 2 * ratio;
  brush.stroke();
}

function drawScale(scale, ratio) {
  const room = 0.2 * canvas.width / scale, power = 10 ** Math.floor(Math.log10(room));
  const metres = Math.max(...[1, 2, 5].map((m) => m * power).filter((m) => m <= room));
  const x = 12 * ratio, y = canvas.height - 12 * ratio, text = `${metres} m`;
  for (const [colour, width] of [[colours.rim, 5], [colours.ink, 2]]) {
    brush.strokeStyle = colour;
    brush.lineWidth = width * ratio;
    brush.beginPath();
    brush.moveTo(x, y - 5 * ratio);
    brush.lineTo(x, y);
    brush.lineTo(x + metres * scale, y);
    brush.lineTo(x + metres * scale, y - 5 * ratio);
    brush.stroke();
  }
  brush.lineWidth = 3 * ratio;
  brush.strokeStyle = colours.rim;
  brush.fillStyle = colours.ink;
  brush.strokeText(text, x + 5 * ratio, y - 6 * ratio);
  brush.fillText(text, x + 5 * ratio, y - 6 * ratio);
}

const figure = (name, i) => data[name][i] * meta.scales[name];
const SAYS = {
  clock: (i) => `${figure("clock", i).toFixed(1)} s`, area: (i) => `${figure("area", i).toFixed(1)} m²`,
  distance: (i) => `${figure("distance", i).toFixed(1)} m`, landmarks: (i) => String(data.landmarks[i]),
  sigma: (i) => { const s = figure("sigma", i); return s < 1 ? `${(100 * s).toFixed(1)} cm` : `${s.toFixed(2)} m`; },
  cells: (i) => `${(100 * begins[i + 1] / (rows * columns)).toFixed(1)} %`,
};

function show(i) {
  row = Math.max(0, Math.min(count - 1, Math.round(i)));
  time.value = row;
  for (const [name, says] of Object.entries(SAYS)) $(name).textContent = says(row);
  time.setAttribute("aria-valuetext", $("clock").textContent);
  for (const chart of document.querySelectorAll(".chart line")) {
    const x = 100 * figure("clock", row) / (figure("clock", count - 1) || 1);
    chart.setAttribute("x1", x);
    chart.setAttribute("x2", x);
  }
  let current = null;
  for (const item of $("events").children) {
    const later = item.row > row;
    item.classList.toggle("later", later);
    item.firstChild.removeAttribute("aria-current");
    if (!later) current = item;
  }
  if (current) {
    const list = $("events");
    current.firstChild.setAttribute("aria-current", "true");
    list.scrollTop = current.offsetTop - 0.5 * list.clientHeight;
  }
  reveal();
  draw();
}

function listEvents() {
  for (const [i, text] of meta.events) {
    const item = document.createElement("li"), button = document.createElement("button"), when = document.createElement("b");
    button.type = "button";
    when.textContent = SAYS.clock(i);
    button.append(when, text);
    button.onclick = () => { stop(); show(i); };
    item.row = i;
    item.append(button);
    $("events").append(item);
  }
}

function chart(name) {
  const box = $(`${name}-chart`), end = figure("clock", count - 1) || 1;
  let top = 1e-9, path = "";
  for (let i = 0; i < count; i++) top = Math.max(top, figure(name, i));
  for (let i = 0; i < count; i++) {
    const x = 100 * figure("clock", i) / end, y = 97 - 92 * figure(name, i) / top;
    path += `${i ? "L" : "M"}${x.toFixed(2)} ${y.toFixed(2)}`;
  }
  box.innerHTML = `<path d="${path}"/><line y1="0" y2="100"/>`;
  $(`${name}-end`).textContent = `at the end ${SAYS[name](count - 1)}`;
  box.onclick = (event) => {
    const place = box.getBoundingClientRect();
    stop();
    show(rowAt(end * (event.clientX - place.left) / place.width));
  };
}

function rowAt(seconds) {
  let low = 0, high = count - 1;
  while (low < high) { const k = (low + high + 1) >> 1; if (figure("clock", k) <= seconds) low = k; else high = k - 1; }
  return low;
}

function offerSpeeds() {
  const whole = figure("clock", count - 1) || 1, speeds = [1, 2, 5, 10, 20, 50, 100, 200, 500];
  const usual = speeds.find((speed) => whole / speed <= 25) || 500;
  for (const speed of speeds) $("speed").add(new Option(`${speed}×`, speed, speed === usual, speed === usual));
}

function stop() { playing = null; play.textContent = "Play"; }

function start() {
  if (row === count - 1) show(0);
  playing = {at: performance.now(), clock: figure("clock", row)};
  play.textContent = "Pause";
  requestAnimationFrame(step);
}

function step(now) {
  if (!playing) return;
  playing.clock += Number($("speed").value) * Math.max(0, now - playing.at) / 1000;
  playing.at = now;
  const next = rowAt(playing.clock);
  if (next !== row) show(next);
  if (row === count - 1) stop(); else requestAnimationFrame(step);
}

function resize() {
  const ratio = window.devicePixelRatio || 1, shape = rows / columns;
  canvas.style.maxWidth = `${Math.max(240, 0.72 * window.innerHeight / shape)}px`;
  const width = canvas.clientWidth;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(width * shape * ratio);
  draw();
}

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  $("theme").textContent = theme === "dark" ? "Light" : "Dark";
  readColours();
  show(row);
}

function onKey(event) {
  if (event.target === $("speed") || event.ctrlKey || event.metaKey || event.altKey) return;
  const by = event.shiftKey ? 20 : 1;
  const moves = {ArrowLeft: row - by, ArrowRight: row + by, Home: 0, End: count - 1};
  if (event.key in moves) { stop(); show(moves[event.key]); }
  else if (event.key === " " && event.target.tagName !== "BUTTON") play.onclick();
  else return;
  event.preventDefault();
}

async function main() {
  data = await unpacked();
  sortCells();
  time.max = count - 1;
  offerSpeeds();
  chart("area");
  chart("sigma");
  listEvents();
  row = count - 1;
  setTheme(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  resize();
  $("theme").onclick = () => setTheme(document.documentElement.dataset.theme === "dark" ? "light" : "dark");
  play.onclick = () => { if (playing) stop(); else start(); };
  time.oninput = () => { stop(); show(Number(time.value)); };
  addEventListener("resize", resize);
  addEventListener("keydown", onKey);
  document.documentElement.dataset.ready = "true";
}
main().catch((error) => {
  document.querySelector("header p").textContent = `This browser cannot show the page: ${error.message}`;
});
