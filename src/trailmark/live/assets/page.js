// The page: what is dragged goes to the server at once, and the newest certified path is shown as it comes.

const $ = (id) => document.getElementById(id);
const canvas = $("map"), view = new View(canvas), scene = new Scene();
const COLOURS = ["page", "ink", "soft", "line", "free", "outside", "obstacle", "way", "goal", "start", "other", "bad", "shade"];
const SHORTEST = 0.004, LONGEST = 0.5, SETTLED = 2.0;  // seconds that a plan may take: while dragging, and after it
const CHANGED_WITHIN = 300;  // milliseconds of rest after which the plan that takes longer is asked for

let socket, colours, nextId = 1, ready = false;
let tool = "move", selected = {kind: "end", end: "goal"}, drag = null, draft = null, pinch = null;
let dirty = true, pending = null, settle = 0, playing = null;
const edits = new Set(), pointers = new Map(), inFlight = new Map(), waiting = new Map(), latencies = [], drawn = [];
let shownPlan = 0, history = [], badEnd = null;
