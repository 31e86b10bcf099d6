// The selection, its fields, and the robot's.

// ---- selection

function select(what) {
  selected = what;
  const value = what.kind === "end" ? what.end : what.id;
  if (![...$("selected").options].some((option) => option.value === value)) listSelected();
  $("selected").value = value;
  showSelected();
  dirty = true;
}

function listSelected() {
  if (selected.kind === "obstacle" && !scene.obstacles.has(selected.id)) selected = {kind: "end", end: "goal"};
  $("selected").replaceChildren(...["start", "goal", ...scene.obstacles.keys()].map((name) => new Option(name, name)));
  $("selected").value = selected.kind === "end" ? selected.end : selected.id;
  showSelected();
}

function selectedPose() {
  if (selected.kind === "end") return scene[selected.end];
  const shape = scene.obstacles.get(selected.id);
  return shape ? [...centreOf(shape), shape.heading ?? 0] : null;
}

function showSelected() {
  const pose = selectedPose();
  if (!pose) return;
  for (const [id, value] of [["sx", pose[0]], ["sy", pose[1]], ["st", (pose[2] * 180) / Math.PI]]) {
    if (document.activeElement !== $(id)) $(id).value = rounded(value, 3);
  }
}

// Moves and turns what is selected.
function nudge(dx, dy, turn) {
  scene.note();
  if (selected.kind === "end") {
    const [x, y, theta] = scene[selected.end];
    scene[selected.end] = [x + dx, y + dy, wrapped(theta + turn)];
    changed();
  } else if (scene.obstacles.has(selected.id)) edit({move: {[selected.id]: [dx, dy, turn]}});
  showSelected();
}

function setPose(axis, value) {
  const pose = selectedPose();
  if (!pose || !Number.isFinite(value)) return;
  const by = [0, 0, 0];
  by[axis] = axis === 2 ? wrapped((value * Math.PI) / 180 - pose[2]) : value - pose[axis];
  nudge(...by);
}

function removeSelected() {
  if (selected.kind !== "obstacle" || !scene.obstacles.has(selected.id)) return;
  scene.note();
  edit({remove: [selected.id]});
  listSelected();
}

function selectNext(step) {
  const names = [...$("selected").options].map((option) => option.value);
  const at = (names.indexOf($("selected").value) + step + names.length) % names.length;
  select(at < 2 ? {kind: "end", end: names[at]} : {kind: "obstacle", id: names[at]});
  $("told").textContent = `${names[at]} selected`;
}

// ---- robot

function showRobot() {
  const robot = scene.robot;
  $("shape").value = robot.shape;
  $("radius").value = robot.radius ?? "";
  $("length").value = robot.length ?? "";
  $("width").value = robot.width ?? "";
  $("turning").value = robot.turning_radius ?? "";
  $("radius-label").hidden = robot.shape !== "disc";
  $("length-label").hidden = $("width-label").hidden = robot.shape !== "rectangle";
}

async function changeRobot() {
  const kind = $("shape").value, reach = reachOf(scene.robot), given = (id, other) => Number($(id).value) || other;
  const {length = 2 * reach, width = 1.4 * reach, radius = reach} = scene.robot;
  const shapes = {disc: {shape: "disc", radius: given("radius", radius)},
    rectangle: {shape: "rectangle", length: given("length", length), width: given("width", width)}};
  const robot = shapes[kind] ?? {shape: "polygon", vertices: scene.robot.vertices};
  const turning = Number($("turning").value);
  if (turning > 0) robot.turning_radius = turning;
  else if (scene.robot.drive === "differential") robot.drive = "differential";
  scene.note();
  await setWorld({...scene.content(), robot}, false, scene);
}
