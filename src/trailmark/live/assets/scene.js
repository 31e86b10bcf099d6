// The scene: the world as the server has it, start and goal, the path, and what was before for undo.

const MOST_UNDONE = 200;

class Scene {
  constructor() {
    this.world = null;
    this.obstacles = new Map();  // by id
    this.start = [0, 0, 0];
    this.goal = [0, 0, 0];
    this.path = null;
    this.before = [];
    this.after = [];
  }

  take(world) {
    this.world = world;
    this.obstacles = new Map((world.obstacles ?? []).map((shape) => [shape.id, shape]));
    this.path = null;
  }

  get robot() {
    return this.world.robot;
  }

  // Start and goal of the world's first query, or two corners.
  takeQuery() {
    const query = this.world.queries?.[0], [xmin, ymin, xmax, ymax] = this.world.bounds;
    const inset = Math.min(1.2 * reachOf(this.robot), (xmax - xmin) / 2, (ymax - ymin) / 2);
    const pose = Array.isArray(query?.goal) ? query.goal : query?.goal?.pose;
    this.start = query?.start ?? [xmin + inset, ymin + inset, 0];
    this.goal = Array.isArray(pose) && typeof pose[0] === "number"
      ? [pose[0], pose[1], pose[2] ?? 0] : [xmax - inset, ymax - inset, 0];
  }

  content() {
    return {...this.world, obstacles: [...this.obstacles.values()]};
  }

  // What undo brings back: all of it, as a text that is compared and kept.
  snapshot() {
    return JSON.stringify({world: this.content(), start: this.start, goal: this.goal});
  }

  // To be called before something changes.
  note() {
    const now = this.snapshot();
    if (this.before.at(-1) !== now) this.before.push(now);
    if (this.before.length > MOST_UNDONE) this.before.shift();
    this.after = [];
  }

  // Returns what was before (or, back again, after), or null if there is nothing.
  step(from, to) {
    const now = this.snapshot();
    let found = from.pop();
    while (found === now) found = from.pop();
    if (found === undefined) return null;
    to.push(now);
    return JSON.parse(found);
  }

  undo() {
    return this.step(this.before, this.after);
  }

  redo() {
    return this.step(this.after, this.before);
  }

  freshId() {
    let n = this.obstacles.size;
    while (this.obstacles.has(`o${n}`)) n++;
    return `o${n}`;
  }

  // What lies under a point: an end's turning handle, an end, or the smallest obstacle.
  under(x, y, handleReach, handles) {
    for (const end of ["goal", "start"]) {
      const [hx, hy] = handles[end];
      if (Math.hypot(x - hx, y - hy) <= handleReach) return {kind: "turn", end};
    }
    for (const end of ["goal", "start"]) {
      const [ex, ey, theta] = this[end], outline = footprintOf(this.robot);
      const near = Math.hypot(x - ex, y - ey) <= Math.max(handleReach, outline ? 0 : this.robot.radius);
      if (near || (outline && insideRing(placed(outline, [ex, ey, theta]), x, y))) return {kind: "end", end};
    }
    const hit = [...this.obstacles.values()].filter((shape) => covers(shape, x, y));
    hit.sort((a, b) => areaOf(a) - areaOf(b));
    return hit.length ? {kind: "obstacle", id: hit[0].id} : null;
  }
}
