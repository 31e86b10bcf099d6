// The view: which part of the plane is shown, and what is drawn there. Pictures that change seldom are kept.

const BEYOND = 0.25;  // of its width and height, that a picture that is kept reaches beyond each side of what is shown
const MOVES_FOR = 150;  // milliseconds after a move for which pictures are only moved

class View {
  constructor(canvas) {
    this.canvas = canvas;
    this.brush = canvas.getContext("2d");
    this.centre = [0, 0];
    this.scale = 50;  // pixels a metre
    this.kept = new Map();
    this.movedAt = -Infinity;
    this.blurred = false;  // whether a picture is shown that was drawn for another part
  }

  resize() {
    const ratio = window.devicePixelRatio || 1, {clientWidth: width, clientHeight: height} = this.canvas;
    if (this.canvas.width !== Math.round(width * ratio) || this.canvas.height !== Math.round(height * ratio)) {
      this.canvas.width = Math.round(width * ratio);
      this.canvas.height = Math.round(height * ratio);
      this.forget();
    }
    this.ratio = ratio;
    this.width = width;
    this.height = height;
  }

  fit([xmin, ymin, xmax, ymax]) {
    this.resize();
    this.centre = [(xmin + xmax) / 2, (ymin + ymax) / 2];
    this.scale = 0.94 * Math.min(this.width / (xmax - xmin), this.height / (ymax - ymin));
    this.forget();
  }

  toScreen(x, y) {
    return [this.width / 2 + (x - this.centre[0]) * this.scale, this.height / 2 - (y - this.centre[1]) * this.scale];
  }

  toWorld(px, py) {
    return [this.centre[0] + (px - this.width / 2) / this.scale, this.centre[1] - (py - this.height / 2) / this.scale];
  }

  zoom(factor, px, py) {
    const [x, y] = this.toWorld(px, py);
    this.scale = Math.min(1e5, Math.max(1e-3, this.scale * factor));
    const [nx, ny] = this.toWorld(px, py);
    this.centre = [this.centre[0] + x - nx, this.centre[1] + y - ny];
    this.movedAt = performance.now();
  }

  pan(dx, dy) {
    this.centre = [this.centre[0] - dx / this.scale, this.centre[1] + dy / this.scale];
    this.movedAt = performance.now();
  }

  // Lets a picture that is kept be drawn anew; all of them without a name.
  forget(name) {
    if (name === undefined) this.kept.clear();
    else this.kept.delete(name);
  }

  clear() {
    this.blurred = false;
    this.brush.setTransform(1, 0, 0, 1, 0, 0);
    this.brush.clearRect(0, 0, this.canvas.width, this.canvas.height);
    this.metres(this.brush);
  }

  // From here on a brush draws in metres, y up.
  metres(brush) {
    const k = this.scale * this.ratio;
    brush.setTransform(k, 0, 0, -k, brush.canvas.width / 2 - this.centre[0] * k, brush.canvas.height / 2 + this.centre[1] * k);
    brush.lineJoin = brush.lineCap = "round";
  }

  get moves() {
    return performance.now() - this.movedAt < MOVES_FOR;
  }

  // Draws a picture by a function once, and from then on as it is, until it is forgotten. While the view moves, it is
  // moved, too, as far as it reaches beyond what is shown: to draw it anew may take longer than a frame.
  keep(name, draw) {
    let kept = this.kept.get(name);
    const same = kept && kept.scale === this.scale && kept.centre[0] === this.centre[0] && kept.centre[1] === this.centre[1];
    if (!kept || (!same && !(this.moves && this.within(kept)))) {
      const size = [this.canvas.width, this.canvas.height].map((pixels) => pixels + 2 * Math.round(BEYOND * pixels));
      const picture = kept?.picture ?? new OffscreenCanvas(...size), brush = picture.getContext("2d");
      brush.setTransform(1, 0, 0, 1, 0, 0);
      brush.clearRect(0, 0, ...size);
      this.metres(brush);
      draw(brush, 1 / this.scale);
      kept = {picture, scale: this.scale, centre: this.centre};
      this.kept.set(name, kept);
    } else if (!same) this.blurred = true;
    const {picture, centre: [x, y]} = kept, zoom = this.scale / kept.scale, k = this.scale * this.ratio;
    this.brush.setTransform(zoom, 0, 0, zoom, this.canvas.width / 2 + (x - this.centre[0]) * k - (zoom * picture.width) / 2,
      this.canvas.height / 2 - (y - this.centre[1]) * k - (zoom * picture.height) / 2);
    this.brush.drawImage(picture, 0, 0);
    this.metres(this.brush);
  }

  // Whether a picture that is kept covers all that is shown.
  within({scale, centre}) {
    const reach = (pixels) => (0.5 + BEYOND) * pixels / scale - (0.5 * pixels) / this.scale;
    return Math.abs(centre[0] - this.centre[0]) <= reach(this.width) && Math.abs(centre[1] - this.centre[1]) <= reach(this.height);
  }
}

function traceShape(brush, shape) {
  if (shape.shape === "disc") {
    brush.moveTo(shape.center[0] + shape.radius, shape.center[1]);
    brush.arc(shape.center[0], shape.center[1], shape.radius, 0, TURN);
  }
  for (const ring of ringsOf(shape)) traceLine(brush, ring, true);
}

function traceLine(brush, points, closed = false) {
  points.forEach(([x, y], i) => (i ? brush.lineTo(x, y) : brush.moveTo(x, y)));
  if (closed) brush.closePath();
}

function drawRobot(brush, robot, [x, y, theta], pixel, {fill, stroke, width = 2}) {
  brush.beginPath();
  const outline = footprintOf(robot);
  if (outline) traceLine(brush, placed(outline, [x, y, theta]), true);
  else brush.arc(x, y, robot.radius, 0, TURN);
  if (fill) {
    brush.fillStyle = fill;
    brush.fill();
  }
  brush.strokeStyle = stroke;
  brush.lineWidth = width * pixel;
  brush.stroke();
  // Where it looks.
  const reach = reachOf(robot);
  brush.beginPath();
  brush.moveTo(x, y);
  brush.lineTo(x + reach * Math.cos(theta), y + reach * Math.sin(theta));
  brush.stroke();
}
