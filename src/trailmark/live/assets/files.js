// Files that are dropped, read here and sent as a world: nothing of them reaches the server's disk.

const MOST_RECTANGLES = 12000;

async function worldOfFiles(files, robot) {
  const byName = new Map([...files].map((file) => [file.name, file]));
  for (const [name, file] of byName) {
    if (/\.ya?ml$/i.test(name)) {
      const text = await file.text();
      return /^\s*image\s*:/m.test(text) ? {world: await nav2World(text, byName, name, robot)} : {text};
    }
    if (/\.map$/i.test(name)) return {world: movingAiWorld(await file.text(), name, robot)};
    if (/\.json$/i.test(name)) return {world: JSON.parse(await file.text())};
  }
  throw new Error("expected a world (.yaml), a nav2 map (.yaml with its image), a MovingAI map (.map) or JSON");
}

function yamlValue(text, key, other) {
  const found = new RegExp(`^\\s*${key}\\s*:\\s*(.+?)\\s*(?:#.*)?$`, "m").exec(text);
  return found ? found[1].replace(/^["']|["']$/g, "") : other;
}

async function nav2World(text, byName, name, robot) {
  const image = yamlValue(text, "image").split("/").pop();
  if (!byName.has(image)) throw new Error(`expected the image ${image} to be dropped with ${name}`);
  const resolution = Number(yamlValue(text, "resolution"));
  const [x, y, yaw] = JSON.parse(yamlValue(text, "origin", "[0, 0, 0]"));
  if (!(resolution > 0) || yaw) throw new Error("expected a resolution above 0 and an origin that is not turned");
  const negate = yamlValue(text, "negate", "0") === "1", free = Number(yamlValue(text, "free_thresh", "0.196"));
  const {width, height, grey} = await greyImage(byName.get(image));
  // Unknown is not free.
  const blocked = Uint8Array.from(grey, (v) => ((negate ? v : 255 - v) / 255 <= free ? 0 : 1));
  return gridWorld(name.replace(/\.ya?ml$/i, ""), width, height, blocked, resolution, [x, y], robot);
}

async function greyImage(file) {
  const bytes = new Uint8Array(await file.arrayBuffer());
  if (bytes[0] === 0x50 && (bytes[1] === 0x35 || bytes[1] === 0x32)) return pgmImage(bytes);
  const bitmap = await createImageBitmap(file), {width, height} = bitmap;
  const brush = new OffscreenCanvas(width, height).getContext("2d");
  brush.drawImage(bitmap, 0, 0);
  const {data} = brush.getImageData(0, 0, width, height), grey = new Float64Array(width * height);
  for (let i = 0; i < grey.length; i++) grey[i] = (data[4 * i] + data[4 * i + 1] + data[4 * i + 2]) / 3;
  return {width, height, grey};
}

function pgmImage(bytes) {
  let at = 2;
  const word = () => {
    for (;;) {
      while (at < bytes.length && bytes[at] <= 32) at++;
      if (bytes[at] !== 35) break;
      while (at < bytes.length && bytes[at] !== 10) at++;
    }
    let text = "";
    while (at < bytes.length && bytes[at] > 32) text += String.fromCharCode(bytes[at++]);
    return Number(text);
  };
  const [width, height, most] = [word(), word(), word()];
  if (!(width > 0 && height > 0 && most > 0 && most < 256)) throw new Error("expected a PGM image of 8 bits");
  const plain = bytes[1] === 0x32, begin = at + 1;
  if (!plain && bytes.length - begin < width * height) throw new Error("expected a whole PGM image, got a part of one");
  const grey = new Float64Array(width * height);
  for (let i = 0; i < grey.length; i++) grey[i] = ((plain ? word() : bytes[begin + i]) * 255) / most;
  return {width, height, grey};
}

function movingAiWorld(text, name, robot) {
  const rows = text.split(/\r?\n/), begin = rows.findIndex((row) => row.trim() === "map") + 1;
  const head = rows.slice(0, begin).join("\n");
  const width = Number(/width\s+(\d+)/.exec(head)?.[1]), height = Number(/height\s+(\d+)/.exec(head)?.[1]);
  if (!begin || !(width > 0) || !(height > 0)) throw new Error(`expected a MovingAI map, got ${name}`);
  const blocked = new Uint8Array(width * height);
  for (let row = 0; row < height; row++) {
    for (let column = 0; column < width; column++) {
      blocked[row * width + column] = ".G".includes(rows[begin + row]?.[column] ?? "@") ? 0 : 1;
    }
  }
  return gridWorld(name.replace(/\.map$/i, ""), width, height, blocked, 1, [0, 0], robot);
}

// A world of rectangles: each as wide as it gets, then as tall. Row 0 of a picture is its highest.
function gridWorld(name, width, height, blocked, size, [x0, y0], robot) {
  const obstacles = [], left = blocked.slice();
  for (let row = 0; row < height; row++) {
    for (let column = 0; column < width; column++) {
      if (!left[row * width + column]) continue;
      let wide = 1, tall = 1;
      while (column + wide < width && left[row * width + column + wide]) wide++;
      const whole = (r) => left.subarray(r * width + column, r * width + column + wide).every((cell) => cell);
      while (row + tall < height && whole(row + tall)) tall++;
      for (let r = row; r < row + tall; r++) left.fill(0, r * width + column, r * width + column + wide);
      const center = [x0 + size * (column + wide / 2), y0 + size * (height - row - tall / 2)];
      obstacles.push({shape: "rectangle", center: center.map((v) => rounded(v, 6)), length: rounded(wide * size, 6),
        width: rounded(tall * size, 6)});
      if (obstacles.length > MOST_RECTANGLES) {
        throw new Error(`expected a map of at most ${MOST_RECTANGLES} rectangles here; 'trailmark live FILE' takes larger ones`);
      }
    }
  }
  return {trailmark: 1, name, bounds: [x0, y0, x0 + width * size, y0 + height * size], robot, obstacles};
}

function download(name, content, type) {
  const link = document.createElement("a");
  link.href = content instanceof Blob ? URL.createObjectURL(content) : URL.createObjectURL(new Blob([content], {type}));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

// Return whether a text was copied: only pages of this machine or by https have a clipboard, and it may be forbidden.
async function copy(text) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    return false;
  }
}

// What is shared in an address: deflated, without what an address may not hold.
async function packed(value) {
  const stream = new Blob([JSON.stringify(value)]).stream().pipeThrough(new CompressionStream("deflate-raw"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  let text = "";
  for (const byte of bytes) text += String.fromCharCode(byte);
  return btoa(text).replace(/\+/g, "-").replace(/\//g, "_").replace(/=+$/, "");
}

async function unpacked(text) {
  const bytes = Uint8Array.from(atob(text.replace(/-/g, "+").replace(/_/g, "/")), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  return JSON.parse(await new Response(stream).text());
}

function svgOf(scene, colours) {
  const {bounds: [xmin, ymin, xmax, ymax]} = scene.world, line = (points) => points.map((p) => p.map((v) => rounded(v)).join(",")).join(" ");
  const shapes = [...scene.obstacles.values()].map((shape) => shape.shape === "disc"
    ? `<circle cx="${rounded(shape.center[0])}" cy="${rounded(shape.center[1])}" r="${rounded(shape.radius)}"/>`
    : `<path d="${ringsOf(shape).map((ring) => `M${line(ring)}Z`).join("")}"/>`);
  const states = scene.path?.states ?? [], outline = footprintOf(scene.robot), size = 0.004 * Math.max(xmax - xmin, ymax - ymin);
  const bodies = states.map((q) => outline
    ? `<polygon points="${line(placed(outline, q))}"/>` : `<circle cx="${q[0]}" cy="${q[1]}" r="${scene.robot.radius}"/>`);
  return `<svg xmlns="http://www.w3.org/2000/svg" viewBox="${xmin} ${-ymax} ${xmax - xmin} ${ymax - ymin}">`
    + `<g transform="scale(1,-1)"><rect x="${xmin}" y="${ymin}" width="${xmax - xmin}" height="${ymax - ymin}" fill="#fff"/>`
    + `<g fill="${colours.obstacle}" fill-rule="evenodd">${shapes.join("")}</g>`
    + `<g fill="none" stroke="${colours.way}" stroke-width="${size / 2}" opacity=".5">${bodies.join("")}</g>`
    + `<polyline points="${line(states.map((q) => q.slice(0, 2)))}" fill="none" stroke="${colours.way}" stroke-width="${size}"/></g></svg>\n`;
}

function pythonOf(scene, worldFile, options) {
  const given = Object.entries(options).map(([name, value]) => `, ${name}=${JSON.stringify(value)}`).join("");
  const robot = scene.robot, list = (q) => `(${q.map((v) => rounded(v, 6)).join(", ")})`;
  return `from trailmark import LandmarkPlanner, World

world = World.load(${JSON.stringify(worldFile)})  # ${robot.shape} robot; save it from the page
planner = LandmarkPlanner(world, seed=0${given})
result = planner.plan(${list(scene.start)}, ${list(scene.goal)}, time_limit=1.0)
print(result.status, result.path and result.path.cost)
`;
}
