// Controls: keys, files, and everything that is clicked; then the page begins.

// ---- keyboard

document.addEventListener("keydown", (event) => {
  const typing = /^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName);
  if ((event.ctrlKey || event.metaKey) && !typing) {
    const key = event.key.toLowerCase();
    if (key === "z" || key === "y") {
      event.preventDefault();
      restore(key === "y" || event.shiftKey ? scene.redo() : scene.undo());
    }
    return;
  }
  if (typing || event.target.tagName === "BUTTON" || event.altKey) return;
  const step = (event.shiftKey ? 20 : 2) / view.scale, turn = ((event.shiftKey ? 15 : 3) * Math.PI) / 180;
  const actions = {
    ArrowLeft: () => nudge(-step, 0, 0), ArrowRight: () => nudge(step, 0, 0), ArrowUp: () => nudge(0, step, 0),
    ArrowDown: () => nudge(0, -step, 0), "[": () => nudge(0, 0, turn), "]": () => nudge(0, 0, -turn),
    "{": () => nudge(0, 0, turn), "}": () => nudge(0, 0, -turn), n: () => selectNext(1), N: () => selectNext(-1),
    Delete: removeSelected, Backspace: removeSelected, " ": togglePlay, f: () => view.fit(scene.world.bounds),
    "+": () => view.zoom(1.25, view.width / 2, view.height / 2), "=": () => view.zoom(1.25, view.width / 2, view.height / 2),
    "-": () => view.zoom(0.8, view.width / 2, view.height / 2), Enter: () => draft?.points && finishDraft(),
    Escape: () => { draft = null; setTool("move"); },
  };
  if (actions[event.key] && scene.world) {
    event.preventDefault();
    actions[event.key]();
    dirty = true;
  }
});

// ---- files, and everything else that is clicked

async function open(files) {
  try {
    const {text, world} = await worldOfFiles(files, scene.robot);
    scene.note();
    if (text !== undefined) takeWorld(await ask("open", {text}), true);
    else await setWorld(world.states ? scene.content() : world, true);
  } catch (error) {
    $("error").textContent = error.message;
  }
}

const clicks = {
  undo: () => restore(scene.undo()), redo: () => restore(scene.redo()), delete: removeSelected, play: togglePlay,
  fit: () => view.fit(scene.world.bounds),
  theme: () => {
    const dark = document.documentElement.dataset.theme !== "dark";
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    $("theme").textContent = dark ? "Light" : "Dark";
    readColours();
  },
  save: async () => {
    sendEdits();
    const {text} = await ask("save", {start: scene.start, goal: scene.goal});
    download(`${scene.world.name}.yaml`, text, "text/yaml");
  },
  png: () => canvas.toBlob((blob) => download(`${scene.world.name}.png`, blob)),
  svg: () => download(`${scene.world.name}.svg`, svgOf(scene, colours), "image/svg+xml"),
  json: () => scene.path && download(`${scene.world.name}.json`, JSON.stringify({...scene.path, type: undefined, final: undefined, id: undefined}, null, 1), "application/json"),
  python: async () => {
    const text = pythonOf(scene, `${scene.world.name}.yaml`, plannerOptions());
    const copied = await copy(text);
    if (!copied) download("plan.py", text, "text/x-python");
    $("told").textContent = copied ? "Copied." : "Nothing can be copied here: plan.py holds it.";
  },
  share: async () => {
    location.hash = await packed({world: scene.content(), start: scene.start, goal: scene.goal});
    await copy(location.href);
    $("told").textContent = "The address holds the world now.";
  },
};
for (const [id, act] of Object.entries(clicks)) {
  $(id).addEventListener("click", () => {
    if (scene.world) act();
    dirty = true;
  });
}
$("tools").addEventListener("click", ({target}) => target.dataset.tool && setTool(target.dataset.tool));
$("worlds").addEventListener("change", async ({target}) => {
  if (!target.value) return;
  scene.note();
  try {
    takeWorld(await ask("open", {name: target.value}), true);
  } catch (error) {
    $("error").textContent = error.message;
  }
});
$("open").addEventListener("change", ({target}) => target.files.length && open(target.files));
for (const id of ["shape", "radius", "length", "width", "turning"]) $(id).addEventListener("change", changeRobot);
for (const id of ["margin", "objective"]) $(id).addEventListener("change", () => setWorld(scene.content(), false, scene));
$("selected").addEventListener("change", ({target: {value}}) =>
  select(value === "start" || value === "goal" ? {kind: "end", end: value} : {kind: "obstacle", id: value}));
["sx", "sy", "st"].forEach((id, axis) => $(id).addEventListener("change", ({target}) => setPose(axis, Number(target.value))));
for (const name of ["dragover", "drop"]) {
  document.addEventListener(name, (event) => {
    event.preventDefault();
    if (name === "drop" && event.dataTransfer.files.length) open(event.dataTransfer.files);
  });
}
new ResizeObserver(() => {
  view.resize();
  dirty = true;
}).observe(canvas);

if (matchMedia("(prefers-color-scheme: dark)").matches) {
  document.documentElement.dataset.theme = "dark";
  $("theme").textContent = "Light";
}
// What tests and the curious may look at.
window.trailmark = {scene, view, latencies, inFlight};
readColours();
connect();
requestAnimationFrame(frame);
