// The pointer: dragging, panning, pinching, and drawing new obstacles.

// ---- pointer

function place(event) {
  const box = canvas.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
}

canvas.addEventListener("pointerdown", (event) => {
  if (!scene.world) return;
  canvas.setPointerCapture(event.pointerId);
  canvas.focus({preventScroll: true});
  const [px, py] = place(event), [x, y] = view.toWorld(px, py);
  pointers.set(event.pointerId, [px, py]);
  if (pointers.size === 2) {
    view.forget("obstacles");
    drag = draft = null;
    const [a, b] = [...pointers.values()];
    pinch = {apart: Math.hypot(a[0] - b[0], a[1] - b[1]), middle: [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]};
    return;
  }
  if (tool === "polygon") {
    draft ??= {points: []};
    draft.points.push([x, y]);
    if (event.detail > 1 && draft.points.length > 3) finishDraft();
  } else if (tool !== "move") {
    draft = {from: [x, y], to: [x, y]};
  } else {
    const reach = (event.pointerType === "touch" ? 22 : 10) / view.scale;
    const found = scene.under(x, y, reach, {start: handlePlace("start"), goal: handlePlace("goal")});
    if (found) {
      scene.note();
      select(found.kind === "turn" ? {kind: "end", end: found.end} : found);
    }
    drag = {...(found ?? {kind: "pan"}), last: [x, y], screen: [px, py]};
    if (drag.id) view.forget("obstacles");
    canvas.classList.add("busy");
  }
  dirty = true;
});

// Where the browser tells of moves as they come, a path is on its way before the frame that shows the move.
canvas.addEventListener("onpointerrawupdate" in canvas ? "pointerrawupdate" : "pointermove", (event) => {
  if (!pointers.has(event.pointerId)) return;
  const [px, py] = place(event), [x, y] = view.toWorld(px, py);
  pointers.set(event.pointerId, [px, py]);
  if (pinch && pointers.size === 2) {
    const [a, b] = [...pointers.values()], apart = Math.hypot(a[0] - b[0], a[1] - b[1]);
    const middle = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
    view.zoom(apart / Math.max(pinch.apart, 1), ...middle);
    view.pan(middle[0] - pinch.middle[0], middle[1] - pinch.middle[1]);
    pinch = {apart, middle};
    dirty = true;
  } else if (draft?.from) {
    draft.to = [x, y];
    dirty = true;
  } else if (drag) moveDragged(px, py, x, y, event.timeStamp);
});

function moveDragged(px, py, x, y, at) {
  const dx = x - drag.last[0], dy = y - drag.last[1];
  if (drag.kind === "pan") {
    view.pan(px - drag.screen[0], py - drag.screen[1]);
    drag.screen = [px, py];
    dirty = true;
    return;
  }
  drag.last = [x, y];
  if (drag.kind === "end") {
    const [ex, ey, theta] = scene[drag.end];
    scene[drag.end] = [ex + dx, ey + dy, theta];
  } else if (drag.kind === "turn") {
    const [ex, ey] = scene[drag.end];
    scene[drag.end] = [ex, ey, Math.atan2(y - ey, x - ex)];
  } else edit({move: {[drag.id]: [dx, dy, 0]}}, at);
  if (drag.kind !== "obstacle") changed(at);
  plan(performance.now());  // at once: the next frame is a while off
  showSelected();
}

function release(event) {
  pointers.delete(event.pointerId);
  if (pointers.size < 2) pinch = null;
  if (drag?.id) view.forget("obstacles");
  drag = null;
  dirty = true;
  canvas.classList.remove("busy");
  if (draft?.from) finishDraft();
}
canvas.addEventListener("pointerup", release);
canvas.addEventListener("pointercancel", release);
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  view.zoom(Math.exp(-event.deltaY * 0.0015), ...place(event));
  dirty = true;
}, {passive: false});

// ---- drawing obstacles

function draftShape() {
  if (draft.points) return draft.points.length > 2 ? {shape: "polygon", vertices: draft.points} : null;
  const [[ax, ay], [bx, by]] = [draft.from, draft.to];
  if (tool === "disc") return {shape: "disc", center: [ax, ay], radius: Math.hypot(bx - ax, by - ay)};
  return {shape: "rectangle", center: [(ax + bx) / 2, (ay + by) / 2], length: Math.abs(bx - ax), width: Math.abs(by - ay)};
}

async function finishDraft() {
  const shape = draftShape(), least = 3 / view.scale;
  draft = null;
  dirty = true;
  if (!shape || (shape.radius ?? Math.min(shape.length ?? 1, shape.width ?? 1)) < least) return;
  scene.note();
  const id = scene.freshId();
  try {
    // A polygon may cross itself: the server says so before it is taken over.
    await ask("edit", {add: [{...shape, id}]});
    scene.obstacles.set(id, {...shape, id});
    view.forget("obstacles");
    select({kind: "obstacle", id});
    changed();
  } catch (error) {
    $("error").textContent = error.message;
  }
}

function setTool(name) {
  tool = name;
  draft = null;
  for (const button of $("tools").children) button.setAttribute("aria-pressed", String(button.dataset.tool === name));
  canvas.classList.toggle("draw", name !== "move");
  $("told").textContent = {disc: "Drag from the middle to the rim.", rectangle: "Drag from corner to corner.",
    polygon: "Click the corners; a double click or Enter closes it."}[name] ?? "";
  dirty = true;
}
