// The scene: the world as the server has it, start and goal, the path, and what was before for undo.

const MOST_UNDONE = 200;

class Scene {
  world = null;
  obstacles = new Map();  // by id, the last drawn on top
  areas = new Map();  // what each of them covers
  start = [0, 0, 0];
  goal = [0, 0, 0];
  via = [];  // places to pass in this order
  unknown = [];  // what the regions cover of which the map says nothing
  path = null;
  before = [];
  after = [];

  take(world, unknown) {
    this.world = world;
    if (unknown) this.unknown = unknown.map((region) => areaOf(region));
    this.path = null;
    this.obstacles.clear();
    this.areas.clear();
    for (const shape of world.obstacles ?? []) this.set(shape);
  }

  set(shape) {
    this.obstacles.set(shape.id, shape);
    this.areas.set(shape.id, areaOf(shape));
  }

  remove(id) {
    this.obstacles.delete(id);
    this.areas.delete(id);
  }

  get robot() { return this.world.robot; }

  // Start and goal of the world's first query, or two corners.
  takeQuery() {
    const query = this.world.queries?.[0], [xmin, ymin, xmax, ymax] = this.world.bounds;
    const inset = Math.min(1.2 * reachOf(this.robot), (xmax - xmin) / 2, (ymax - ymin) / 2);
    const pose = Array.isArray(query?.goal) ? query.goal : query?.goal?.pose;
    this.via = [];
    this.start = query?.start ?? [xmin + inset, ymin + inset, 0];
    this.goal = Array.isArray(pose) && typeof pose[0] === "number"
      ? [pose[0], pose[1], pose[2] ?? 0] : [xmax - inset, ymax - inset, 0];
  }

  content() { return {...this.world, obstacles: [...this.obstacles.values()]}; }

  // What undo brings back, and what an address that is shared holds: all of it, as a text.
  snapshot() {
    return JSON.stringify({world: this.content(), start: this.start, goal: this.goal, via: this.via});
  }

  // To be called before something changes.
  note() {
    const now = this.snapshot();
    if (this.before.at(-1) !== now) this.before.push(now);
    if (this.before.length > MOST_UNDONE) this.before.shift();
    this.after = [];
  }

  // Returns what was before or, back again, after; null if there is nothing.
  step(back) {
    const now = this.snapshot(), [from, to] = back ? [this.before, this.after] : [this.after, this.before];
    let found = from.pop();
    while (found === now) found = from.pop();
    if (found === undefined) return null;
    to.push(now);
    return JSON.parse(found);
  }

  freshId() {
    let n = this.obstacles.size;
    while (this.obstacles.has(`o${n}`)) n++;
    return `o${n}`;
  }

  // Adds a via point, or takes away the one within reach.
  changeVia(x, y, reach) {
    const near = this.via.findIndex(([vx, vy]) => Math.hypot(x - vx, y - vy) <= reach);
    this.via = near < 0 ? [...this.via, [x, y]] : this.via.filter((_, i) => i !== near);
  }

  // What lies under a point, handles within reach: an end's turning handle, an end, or the topmost obstacle.
  under(x, y, reach) {
    const near = ([px, py]) => Math.hypot(x - px, y - py) <= reach, ends = ["goal", "start"];
    const turned = ends.find((end) => near(handlePlace(end)));
    if (turned) return {kind: "turn", id: turned};
    const held = ends.find((end) => near(this[end]) || view.covers(bodyOf(this.robot, this[end]), x, y));
    if (held) return {kind: "end", id: held};
    const id = [...this.areas.keys()].reverse().find((id) => view.covers(this.areas.get(id), x, y));
    return id === undefined ? null : {kind: "obstacle", id};
  }
}
