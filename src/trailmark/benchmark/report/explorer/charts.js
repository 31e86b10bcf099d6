// Charts as SVG: rows with shares or boxes, and lines with marks. Their unit is about a pixel of a phone.

const WIDTH = 400, LINE = 14, ROW = 21, HEAD = 22, PLOT = 230, MAX_LABELS = 12, MAX_BANDS = 6;

const escaped = words => String(words).replace(/[&<>"']/g, c => `&#${c.charCodeAt(0)};`);
const round = v => Math.round(v * 10) / 10;

const pen = document.createElement('canvas').getContext('2d');
const widthOf = words => {
  pen.font = '12px system-ui, "Segoe UI", Roboto, Arial, sans-serif';
  return pen.measureText(words).width;
};

// Three significant digits, as the tables write numbers.
const number = (value, digits = 3) => {
  if (Number.isNaN(value)) return '–';
  if (!Number.isFinite(value)) return '∞';
  if (value === 0) return '0';
  let places = Math.max(0, digits - 1 - Math.floor(Math.log10(Math.abs(value))));
  const carried = Number(value.toFixed(places)) || value;
  places = Math.max(0, digits - 1 - Math.floor(Math.log10(Math.abs(carried))));
  return value.toLocaleString('en-US', {minimumFractionDigits: places, maximumFractionDigits: places});
};
const seconds = t => t < 1e-3 ? `${number(1e6 * t)} µs` : t < 0.9995 ? `${number(1e3 * t)} ms` : `${number(t)} s`;
const percent = share => {
  const shown = 100 * share;
  if (shown > 0 && shown < 0.1) return '< 0.1 %';
  if (shown > 99.9 && shown < 100) return '> 99.9 %';
  if (shown === 0 || shown === 100) return `${shown} %`;
  // Halves to even, as in the tables.
  const tenths = 10 * shown, even = tenths % 1 === 0.5 ? 2 * Math.round(tenths / 2) : Math.round(tenths);
  return `${(even / 10).toFixed(1)} %`;
};
const tick = v => String(Number(v.toPrecision(6)));

const scale = (low, high, begin, end, log = false) => {
  const f = log ? Math.log : v => v;
  const at = v => begin + (f(Math.min(Math.max(v, low), high)) - f(low)) / (f(high) - f(low)) * (end - begin);
  return {low, high, begin, end, log, at};
};

// Round values whose labels do not touch: of the sets that there are the one with most of them.
const ticks = (s, shown, upright) => {
  const sets = [], inside = v => v >= s.low * (1 - 1e-9) - 1e-12 && v <= s.high * (1 + 1e-9);
  if (s.log) {
    const first = Math.floor(Math.log10(s.low)), last = Math.ceil(Math.log10(s.high));
    const powers = Array.from({length: last - first + 1}, (_, i) => first + i);
    for (const steps of [[1, 2, 5], [1, 3], [1]]) sets.push(powers.flatMap(e => steps.map(m => m * 10 ** e)));
    for (let every = 2; every < powers.length; every++) sets.push(powers.filter((_, i) => i % every === 0).map(e => 10 ** e));
  }
  for (let count = 10; count > 0; count--) {
    const rough = (s.high - s.low) / count, power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 2.5, 5, 10].map(m => m * power).find(m => m >= rough * (1 - 1e-9));
    const first = Math.ceil(s.low / step - 1e-9), last = Math.floor(s.high / step + 1e-9);
    sets.push(Array.from({length: last - first + 1}, (_, i) => (first + i) * step));
  }
  const room = v => upright ? LINE + 2 : widthOf(shown(v)) + 10;
  const apart = set => set.every((v, i) => !i || Math.abs(s.at(v) - s.at(set[i - 1])) >= (room(v) + room(set[i - 1])) / 2);
  const found = sets.map(set => set.filter(inside)).filter(set => set.length > 1 && apart(set));
  return found[0] ?? [s.low];
};

const text = (x, y, words, kind, anchor = 'start', more = '') =>
  `<text x="${round(x)}" y="${round(y)}" class="${kind}" text-anchor="${anchor}"${more}>${escaped(words)}</text>`;
const path = (points, more) => points.length
  ? `<path d="M${points.map(([x, y]) => `${round(x)} ${round(y)}`).join('L')}" ${more}/>` : '';
const drawing = (height, label, parts, kind, width = WIDTH) =>
  `<svg viewBox="0 0 ${width} ${round(height)}" role="img" aria-label="${escaped(label)}" class="chart ${kind}">${parts.join('')}</svg>`;
// What belongs to a planner: pointing at it, in a chart or in the list, makes it stand out everywhere.
const owned = (planner, content) => `<g class="s" data-s="${planner.number}">${content}</g>`;
const named = planner => `<title>${escaped(planner.name)}</title>`;
// A name that is too long for its place is drawn narrower.
const squeezed = (words, room) => widthOf(words) > room ? ` textLength="${round(room)}" lengthAdjust="spacingAndGlyphs"` : '';

const stroke = (planner, points) =>
  path(points, `class="line mark" stroke="${planner.colour}" stroke-width="${planner.width}" stroke-dasharray="${planner.dash}"`);

// A chart with a row for each planner: its name, what `draw` makes of it, and words at the right.
const rowChart = (rows, {label, axis, head, low, high, log = false, shown = tick, draw}) => {
  const left = Math.min(0.42 * WIDTH, Math.max(...rows.map(r => widthOf(r.planner.name)))) + 8;
  const right = WIDTH - Math.max(...rows.map(r => widthOf(r.words)), widthOf(head)) - 8;
  const bottom = HEAD + rows.length * ROW, x = scale(low, high, left + 4, right - 6, log), parts = [];
  for (const v of ticks(x, shown, false)) {
    parts.push(path([[x.at(v), HEAD], [x.at(v), bottom + 4]], 'class="grid"'));
    parts.push(text(x.at(v), bottom + 17, shown(v), 'tick', 'middle'));
  }
  parts.push(path([[left, bottom], [right, bottom]], 'class="axis"'));
  parts.push(text((left + right) / 2, bottom + 33, axis, 'name', 'middle'), text(WIDTH, HEAD - 7, head, 'tick', 'end'));
  rows.forEach((row, i) => {
    const y = HEAD + (i + 0.5) * ROW, {name} = row.planner;
    parts.push(owned(row.planner, named(row.planner)
      + text(left - 8, y + 4, name, 'name', 'end', squeezed(name, left - 8))
      + text(WIDTH, y + 4, row.words, 'value', 'end') + draw(row, x, y)));
  });
  return drawing(bottom + 40, label, parts, 'rows');
};

// A mark with its interval for the referee's share, a ring for the planner's own where it differs.
const drawShare = ({planner, share, interval, claimed}, x, y) => {
  const {colour} = planner;
  const [a, b] = interval.map(x.at), ends = [a, b].map(v => path([[v, y - 3.5], [v, y + 3.5]], `class="share" stroke="${colour}"`));
  const ring = claimed === share ? '' : `<circle cx="${round(x.at(claimed))}" cy="${y}" r="4.2" fill="#fff" stroke="${colour}"/>`;
  return path([[a, y], [b, y]], `class="share mark" stroke="${colour}"`) + ends.join('') + ring
    + `<use href="#m${planner.number}" x="${round(x.at(share))}" y="${y}"/>`;
};

// Quartiles and median as a box, 5 and 95 % as whiskers; what lies beyond the axis runs off to the right.
const drawBox = ({planner: {colour}, five}, x, y) => {
  if (!Number.isFinite(five[0])) return text(x.begin + 4, y + 4, 'no path', 'tick');
  const [first, lower, middle, upper, last] = five.map(x.at), end = x.end + 5;
  const box = `<rect x="${round(lower)}" y="${y - 6}" width="${round(Math.max(0.8, upper - lower))}" height="12"`
    + ` class="box mark" fill="${colour}" stroke="${colour}"/>`;
  return path([[first, y], [last, y]], `class="mark" stroke="${colour}"`) + box
    + (five[2] <= x.high ? path([[middle, y - 6], [middle, y + 6]], `class="median" stroke="${colour}"`) : '')
    + (five[4] > x.high ? path([[end - 5, y - 4], [end, y], [end - 5, y + 4]], `fill="${colour}"`) : '');
};

// Places near the wanted ones, ascending, at least `gap` apart and within the ends.
const moved = (wanted, gap, top, bottom) => {
  const places = [];
  for (const w of wanted) places.push(Math.max(w, top, places.length ? places.at(-1) + gap : top));
  for (let i = places.length - 1, limit = bottom; i >= 0; i--) { places[i] = Math.min(places[i], limit); limit = places[i] - gap; }
  return places;
};

// Four marks along a line, elsewhere for each planner, so that lines on top of one another can be told apart; none on
// the floor, where no run has a path yet.
const marks = (planner, points, i, of, x, floor) => {
  const found = [];
  for (let k = 0; k < 4; k++) {
    const at = x.begin + (k + (i + 0.5) / of) / 4 * (x.end - x.begin);
    const next = points.findIndex(p => p[0] >= at);
    if (next < 1) continue;
    const [[ax, ay], [bx, by]] = [points[next - 1], points[next]];
    const y = bx > ax ? ay + (by - ay) * (at - ax) / (bx - ax) : by;
    if (y < floor - 0.5) found.push(`<use href="#m${planner.number}" x="${round(at)}" y="${round(y)}"/>`);
  }
  return found.join('');
};

let clips = 0;

// A chart of lines, a planner each: {planner, points: [[x, y], …] with y possibly infinite, band: [lower, upper] or null}.
const lineChart = (lines, {label, xName, yName, low, high, bottom, top, log = true, shown = tick}) => {
  const labelled = lines.length <= MAX_LABELS, clip = `clip${clips++}`;
  const room = labelled ? Math.min(0.36 * WIDTH, Math.max(...lines.map(l => widthOf(l.planner.name)))) + 22 : 8;
  const right = WIDTH - room, y0 = 12, y = scale(bottom, top, y0 + PLOT, y0);
  const levels = ticks(y, shown, true), left = 26 + Math.max(...levels.map(v => widthOf(shown(v))));
  const x = scale(low, Math.max(high, 1.05 * low), left, right, log), parts = [];
  for (const v of ticks(x, tick, false)) {
    parts.push(path([[x.at(v), y0], [x.at(v), y0 + PLOT + 4]], 'class="grid"'), text(x.at(v), y0 + PLOT + 17, tick(v), 'tick', 'middle'));
  }
  for (const v of levels) {
    parts.push(path([[left, y.at(v)], [right, y.at(v)]], 'class="grid"'), text(left - 5, y.at(v) + 4, shown(v), 'tick', 'end'));
  }
  parts.push(path([[left, y0 + PLOT], [right, y0 + PLOT]], 'class="axis"'));
  parts.push(text((left + right) / 2, y0 + PLOT + 34, xName, 'name', 'middle'));
  parts.push(text(11, y0 + PLOT / 2, yName, 'name', 'middle', ` transform="rotate(-90 11 ${y0 + PLOT / 2})"`));
  parts.push(`<clipPath id="${clip}"><rect x="${round(left)}" y="${y0 - 3}" width="${round(right - left)}" height="${PLOT + 6}"/></clipPath>`);
  // Far above the top is enough: the line leaves the picture, it does not lie level at its edge.
  const place = ([a, b]) => [x.at(a), b > top ? y0 - 4 * PLOT * Math.min(1, (b - top) / (top - bottom)) : y.at(b)];
  const drawn = lines.map((line, i) => {
    const points = line.points.filter(p => Number.isFinite(p[1])).map(place);
    const [lower, upper] = (line.band ?? [[], []]).map(b => b.filter(p => Number.isFinite(p[1])).map(place));
    const band = lines.length <= MAX_BANDS && upper.length > 1
      ? path([...lower.slice(-upper.length), ...upper.reverse()], `fill="${line.planner.colour}" fill-opacity=".13"`) : '';
    return owned(line.planner, named(line.planner) + band + stroke(line.planner, points) + marks(line.planner, points, i, lines.length, x, y0 + PLOT));
  });
  parts.push(`<g clip-path="url(#${clip})">${drawn.join('')}</g>`);
  if (labelled) parts.push(...labels(lines, y, right, y0));
  return drawing(y0 + PLOT + 42, label, parts, 'lines');
};

// A name at the end of each line, moved apart where they would lie upon each other; lines without an end at the top.
const labels = (lines, y, right, y0) => {
  const ends = lines.map(l => {
    const end = l.points.at(-1)?.[1];
    return [l.planner, Number.isFinite(end) ? Math.max(y0, y.at(end)) : -Infinity];
  }).sort((a, b) => a[1] - b[1]);
  const places = moved(ends.map(e => Math.max(y0, e[1])), Math.min(LINE, PLOT / Math.max(1, lines.length - 1)), y0, y0 + PLOT);
  return ends.map(([planner, end], i) => {
    const words = planner.name + (Number.isFinite(end) ? '' : ' (none)');
    const leader = Number.isFinite(end) ? path([[right, end], [right + 8, places[i]]], `stroke="${planner.colour}"`) : '';
    return owned(planner, leader + `<use href="#m${planner.number}" x="${round(right + 11)}" y="${round(places[i])}"/>`
      + text(right + 18, places[i] + 4, words, 'name', 'start', squeezed(words, WIDTH - right - 19)));
  });
};
