// The figures: which charts, tables and pictures there are, and what each of them shows.

const figure = (title, caption, drawn, wide = false) =>
  `<figure${wide ? ' class="wide"' : ''}><figcaption><b>${escaped(title)}</b>${escaped(caption)}</figcaption>${drawn}</figure>`;

const CLOCKS = {call: 'from the planner’s call', file: 'from the world’s file on'};

const highestRatio = rows => {
  // One planner far behind must not press all the others to the left edge.
  const finite = ascending(rows.flatMap(r => r.five).filter(Number.isFinite));
  return finite.length ? 1 + 1.08 * Math.max(0.02, Math.min(finite.at(-1), 2.5 * quantile(finite, finite.length, 0.85) - 1.5) - 1) : 2;
};

const rowFigures = (found, planners, where, clock) => {
  const rows = found.map(s => ({
    planner: planners[s.planner], share: s.success / s.n, claimed: s.claimed / s.n,
    interval: wilson(s.success, s.n), words: `${s.success}/${s.n}`,
  })).sort((a, b) => b.share - a.share);
  const success = rowChart(rows, {
    label: `Success rate of ${rows.length} planners, ${where}, with 95 % Wilson intervals`, axis: 'runs [%]', head: 'solved',
    low: 0, high: 1, shown: v => tick(100 * v), draw: drawShare,
  });
  const times = found.map(s => ({planner: planners[s.planner], five: s.time, words: seconds(s.mean)}));
  const known = times.flatMap(r => r.five).filter(v => Number.isFinite(v) && v > 0);
  const low = known.length ? 0.8 * Math.min(...known) : 0.01, high = known.length ? 1.25 * Math.max(...known) : 1;
  const time = rowChart(times, {
    label: `Time to the first path, ${where}`, axis: 'time to the first path [s]', head: 'mean', low, high: Math.max(high, 4 * low),
    log: true, draw: drawBox,
  });
  const costs = [...found].sort((a, b) => compare(a.cost[2], b.cost[2]) || b.success / b.n - a.success / a.n)
    .map(s => ({planner: planners[s.planner], five: s.cost, words: percent(1 - s.success / s.n)}));
  const cost = rowChart(costs, {
    label: `Final cost over the best known, ${where}`, axis: 'final cost / best known', head: 'no path', low: 1,
    high: highestRatio(costs), draw: drawBox,
  });
  return figure('Success rate', 'Mark: solved and correct, with its 95 % Wilson interval. Ring: the planner’s own claim, where it differs.', success)
    + figure('Time to the first path', `Counted ${CLOCKS[clock]}. Box: quartiles, median; whiskers: 5 and 95 % of all runs; arrow: the rest `
      + 'failed. Right: shifted geometric mean, failures at the limit.', time)
    + figure('Cost ratio to the best known', 'The same of the cost at the end of planning. Right: share of runs without a correct path.', cost);
};

const compare = (a, b) => a === b ? 0 : a - b;

// A curve that rises by a step at each of the values, from `low` to `high`; of many values evenly chosen ones.
const rising = (sorted, n, low, high) => {
  const points = [[low, 0]], count = sorted.length, every = Math.max(1, count / 120);
  for (let k = 0; k < count; k += every) {
    const i = Math.floor(k);
    points.push([sorted[i], points.at(-1)[1]], [sorted[i], (i + 1) / n]);
  }
  if (count) points.push([sorted[count - 1], count / n]);
  return [...points, [high, points.at(-1)[1]]];
};

const shareFigure = (found, planners, where, limit, clock) => {
  const firsts = found.filter(s => s.times.length).map(s => s.times[0]);
  const low = Math.min(0.8 * Math.min(...firsts, limit), 0.5 * limit), high = Math.max(limit, ...found.map(s => s.times.at(-1) ?? 0));
  const lines = found.map(s => ({planner: planners[s.planner], points: rising(s.times, s.n, low, high)}));
  return figure('Runs with a path', `Share of the runs whose first path was there by then, counted ${CLOCKS[clock]}.`, lineChart(lines, {
    label: `Share of runs that have a path over time, ${where}`, xName: 'time [s]', yName: 'runs with a path [%]',
    low, high, bottom: 0, top: 1, shown: v => tick(100 * v),
  }));
};

const profileFigure = (runs, chosen, problems, what, title, words) => {
  const {count, ratios} = runs.profile(chosen, problems, what);
  if (count < 2) return '';
  const finite = ascending(ratios.flatMap(r => [...r]));
  const high = Math.min(1000, Math.max(1.1, 1.05 * (finite.at(-1) ?? 2)));
  const lines = chosen.map((s, i) => ({
    planner: runs.data.planners[s], points: rising(ratios[i].filter(r => r <= high), count, 1, high),
  })).sort((a, b) => b.points[2]?.[1] - a.points[2]?.[1]);
  const caption = `Share of ${count.toLocaleString('en-US')} problems that all chosen planners ran on, whose ${words} is at most so many times `
    + 'the best of the chosen planners’. Left: how often it is the best; right: how often it solves at least half of its runs. '
    + 'Who is second best changes with who is chosen: compare two planners by choosing these two.';
  return figure(title, caption, lineChart(lines, {
    label: `${title} of ${chosen.length} planners`, xName: 'ratio to the best', yName: 'problems [%]',
    low: 1, high, bottom: 0, top: 1, shown: v => tick(100 * v),
  }));
};

// The cost at the top of a chart: it shows where all planners end, and where most of them begin.
const highestCost = (curves, best) => {
  const ends = ascending(curves.flatMap(c => [c[1].at(-1), c[2].at(-1)]).filter(Number.isFinite));
  if (!ends.length) return 1.5 * best;
  const firsts = ascending(curves.map(c => c[1].find(Number.isFinite)).filter(Number.isFinite));
  const end = quantile(ends, ends.length, 0.9), first = quantile(firsts, firsts.length, 0.75);
  const high = Math.max(end, Math.min(first, best + 4 * (end - best) + 0.1 * best));
  return Math.max(high + 0.05 * (high - best), 1.01 * best);
};

// Curves: for each planner its quartiles [lower, middle, upper], each a list of costs at the times.
const costFigure = (curves, times, best, axis, caption, where) => {
  const top = highestCost(curves.map(c => c.quartiles), best);
  const lines = curves.map(({planner, quartiles: [lower, middle, upper]}) => ({
    planner, points: times.map((t, i) => [t, middle[i]]), band: [lower, upper].map(row => times.map((t, i) => [t, row[i]])),
  }));
  return figure('Cost against time', caption, lineChart(lines, {
    label: `${axis} over planning time, ${where}`, xName: 'planning time [s]', yName: axis,
    low: times[0], high: times.at(-1), bottom: best - 0.03 * (top - best), top,
  }));
};

const table = ({caption, columns, rows, texts = []}, byName) => {
  const long = i => i && rows.some(r => r[i].length > 45);
  const kind = i => !i || texts.includes(i) ? ` class="words${long(i) ? ' long' : ''}"` : '';
  const row = cells => {
    const planner = byName.get(cells[0]);
    const mark = planner ? `<svg class="key" viewBox="0 0 28 14" aria-hidden="true"><use href="#k${planner.number}"/></svg>` : '';
    const head = escaped(cells[0]).replace(/[+:]/g, '<wbr>$&');
    return `<tr${planner ? ` class="s" data-s="${planner.number}"` : ''}><th scope="row">${mark}${head}</th>`
      + cells.slice(1).map((c, i) => `<td${kind(i + 1)}>${escaped(c)}</td>`).join('') + '</tr>';
  };
  return `<p class="caption">${escaped(caption)}</p><div class="table"><div class="scroll" role="region" tabindex="0" aria-label="${escaped(caption)}">`
    + `<table><thead><tr>${columns.map((c, i) => `<th scope="col"${kind(i)}>${escaped(c)}</th>`).join('')}</tr></thead>`
    + `<tbody>${rows.map(row).join('')}</tbody></table></div></div>`;
};

const ratio = v => Number.isFinite(v) ? v < 9.9995 ? v.toFixed(3) : number(v) : 'none';

const summaryTable = (found, planners, clock) => ({
  caption: `The chosen problems and planners, the quickest first; times counted ${CLOCKS[clock]}`,
  columns: ['planner', 'problems', 'runs', 'solved and correct', 'first path: mean [ms]', 'median [ms]', 'final cost / best', 'quartiles'],
  rows: found.map(s => [
    planners[s.planner].name, s.problems, s.n, percent(s.success / s.n), number(1e3 * s.mean),
    Number.isFinite(s.time[2]) ? number(1e3 * s.time[2]) : 'none', ratio(s.cost[2]), `${ratio(s.cost[1])} to ${ratio(s.cost[3])}`,
  ]),
});

// All figures of the chosen problems together.
const together = (runs, chosen, problems, clock, byName) => {
  const found = chosen.map(s => runs.summary(s, problems, clock)).filter(Boolean).sort((a, b) => a.mean - b.mean);
  if (!found.length) return '<p class="note">Nothing is known of this choice: choose at least one planner and one problem.</p>';
  const {planners, moments} = runs.data, where = problems.length === 1 ? runs.problems[problems[0]].name : `${problems.length} problems`;
  const limit = Math.max(...problems.map(p => runs.problems[p].limit)), order = found.map(s => s.planner);
  const curves = order.map(s => ({planner: planners[s], quartiles: runs.curve(s, problems)})).filter(c => c.quartiles);
  const caption = 'Median over the problems of each one’s median so far; shaded: quartiles over the problems, of up to six planners. A line begins '
    + 'where half of the problems have a median.';
  return `<div class="figures">${rowFigures(found, planners, where, clock)}${shareFigure(found, planners, where, limit, clock)}`
    + profileFigure(runs, order, problems, clock, 'Performance profile of time', 'median time to the first path')
    + profileFigure(runs, order, problems, 'cost', 'Performance profile of cost', 'median final cost')
    + `${costFigure(curves, moments, 1, 'cost / best known', caption, where)}</div>`
    + table(summaryTable(found, planners, clock), byName);
};

const scene = (detail, worlds, planners, chosen, name) => {
  const {world, size, ends, paths, bodies, refused} = detail;
  const lines = chosen.filter(s => paths[s]).reverse().map(s => owned(planners[s], named(planners[s])
    + `<path d="${paths[s]}" class="halo-line" stroke-width="${planners[s].width + 1.6}"/>`
    + `<path d="${paths[s]}" class="line mark" stroke="${planners[s].colour}" stroke-width="${planners[s].width}" stroke-dasharray="${planners[s].dash}"/>`));
  const parts = [worlds[world], `<path d="${bodies}" class="body"/>`, ...refused.map(d => `<path d="${d}" class="refused mark"/>`), ...lines, ends];
  return drawing(size[1], `${name}: the world with start S, goal G and the paths of ${lines.length} planners`, parts, 'world', size[0]);
};

// All that is known of one problem.
const single = (runs, details, chosen, p, clock, byName) => {
  const {planners, steps} = runs.data, problem = runs.problems[p], detail = details.problems[p];
  const found = chosen.map(s => runs.summary(s, [p], clock)).filter(Boolean).sort((a, b) => a.mean - b.mean);
  if (!found.length) return '<p class="note">None of the chosen planners ran on this problem.</p>';
  const order = found.map(s => s.planner), rows = rowFigures(found, planners, problem.name, clock);
  const share = shareFigure(found, planners, problem.name, problem.limit, clock);
  if (!detail) {
    return '<p class="note">To keep the page small, tables and picture of this problem were left out: a report on a database with fewer '
      + `problems has them.</p><div class="figures">${rows}${share}</div>`;
  }
  const names = new Set(order.map(s => planners[s].name)), only = t => ({...t, rows: t.rows.filter(r => names.has(r[0]))});
  const folded = (title, content) => `<details><summary>${title}</summary>${content}</details>`;
  const picture = detail.scene
    ? figure('Paths', 'Each planner’s middle run by cost; the robot along the best path.' + (detail.scene.refused.length ? ' Red: refused paths.' : ''),
      scene(detail.scene, details.worlds, planners, order, problem.name), true)
    : '<p class="note">The database holds no world for this problem that can be drawn.</p>';
  let curves = '';
  if (detail.curves) {
    const {times, cells} = detail.curves;
    const quartiles = s => cells[s].map(row => [...falling(row, times.length, steps)].map(r => r * problem.best));
    const drawn = order.filter(s => cells[s]).map(s => ({planner: planners[s], quartiles: quartiles(s)}));
    const caption = `Best path so far, median and quartiles over the runs. Best known: ${number(problem.best, 4)} m.`;
    curves = costFigure(drawn, times, problem.best, 'cost [m]', caption, problem.name);
  }
  return `<div class="figures">${picture}</div>${table(only(detail.table), byName)}<div class="figures">${rows}${share}${curves}</div>`
    + folded('Effort and shape: checks, graphs, memory, turning, clearance', table(only(detail.effort), byName))
    + (detail.failures ? folded('Reasons of failures', table(only(detail.failures), byName)) : '')
    + folded('How to pose it again', `<dl>${detail.facts.map(([k, v]) => `<dt>${escaped(k)}</dt><dd>${escaped(v)}</dd>`).join('')}</dl>`);
};
