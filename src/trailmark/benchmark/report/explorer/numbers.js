// The runs that the page holds, and what they come to for the problems and planners that were chosen.
// A run that failed has no value in a list: it counts as infinite wherever the number of runs is given.

const unpacked = async id => {
  const text = atob(document.getElementById(id).textContent);
  const bytes = Uint8Array.from(text, c => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip'));
  return new Response(stream).json();
};

// Differences of whole steps of the logarithm, ascending: the values.
const values = (differences, steps) => {
  let sum = 0;
  return differences.map(d => Math.exp((sum += d) / steps));
};

// A curve that only falls: how many moments are without a value, the first one, and by how much it falls.
const falling = (stairs, count, steps) => {
  const found = new Array(count).fill(Infinity);
  for (let i = stairs[0], k = 1, sum = 0; i < count; i++, k++) {
    sum += k === 1 ? stairs[1] : -(stairs[k] ?? 0);
    found[i] = Math.exp(sum / steps);
  }
  return found;
};

// Definition 2 of Hyndman and Fan (1996), as the tables have it; infinite beyond the values of n runs that are known.
const quantile = (sorted, n, share) => {
  const value = i => i < sorted.length ? sorted[i] : Infinity;
  const at = share * n, near = Math.round(at), whole = Math.abs(at - near) < 1e-9;
  const upper = Math.min(n - 1, whole ? near : Math.floor(at));
  return whole && near > 0 && near < n ? 0.5 * value(upper - 1) + 0.5 * value(upper) : value(upper);
};

const FIVE = [0.05, 0.25, 0.5, 0.75, 0.95];
const median = (sorted, n) => quantile(sorted, n, 0.5);
const ascending = list => Float64Array.from(list).sort();
const sum = list => list.reduce((a, b) => a + b, 0);

const joined = lists => {
  const found = new Float64Array(sum(lists.map(l => l.length)));
  let at = 0;
  for (const list of lists) for (const value of list) found[at++] = value;
  return found.sort();
};

// Wilson's score interval, 95 %.
const wilson = (k, n) => {
  const z = 1.959964, p = k / n, middle = p + z * z / (2 * n);
  const half = z * Math.sqrt(p * (1 - p) / n + z * z / (4 * n * n)), scale = 1 + z * z / n;
  return [Math.max(0, (middle - half) / scale), Math.min(1, (middle + half) / scale)];
};

class Runs {
  constructor(data) {
    this.data = data;
    this.problems = data.problems.map(([name, limit, best, cells]) => ({
      name, limit, best, cells: cells.map(cell => cell && this.cell(cell)),
    }));
  }

  cell([n, claimed, first, cold, cost, curve, setup]) {
    const {steps, moments} = this.data;
    return {
      n, claimed, setup,
      call: values(first, steps), file: cold && values(cold, steps), cost: values(cost, steps),
      curve: falling(curve, moments.length, steps),
    };
  }

  // The figures of a planner over the chosen problems; null where it ran on none of them, or nothing is known of it.
  summary(planner, problems, clock) {
    const parts = problems.map(p => [this.problems[p], this.problems[p].cells[planner]]).filter(([, c]) => c && c[clock]);
    const n = sum(parts.map(([, c]) => c.n));
    if (!n) return null;
    const times = joined(parts.map(([, c]) => c[clock])), costs = joined(parts.map(([, c]) => c.cost));
    const shift = this.data.shift;
    const logs = parts.map(([p, c]) => {
      const late = p.limit + (clock === 'file' ? c.setup : 0), failed = (c.n - c[clock].length) * Math.log(late + shift);
      return (sum(c[clock].map(t => Math.log(t + shift))) + failed) / c.n;
    });
    return {
      planner, n, problems: parts.length, times, costs,
      claimed: sum(parts.map(([, c]) => c.claimed)), success: times.length,
      mean: Math.exp(sum(logs) / logs.length) - shift,
      time: FIVE.map(s => quantile(times, n, s)), cost: FIVE.map(s => quantile(costs, n, s)),
    };
  }

  // E. D. Dolan and J. J. Moré (2002), Benchmarking optimization software with performance profiles: for each planner
  // the ratios of its median to the best of the chosen ones, a problem each, ascending; those it did not solve left out.
  profile(planners, problems, what) {
    const shared = problems.map(p => planners.map(s => this.problems[p].cells[s])).filter(row => row.every(c => c && c[what]));
    const rows = shared.map(row => {
      const middle = row.map(c => median(c[what], c.n)), best = Math.min(...middle);
      return middle.map(m => Number.isFinite(m) ? m / best : Infinity);
    });
    return {count: rows.length, ratios: planners.map((_, i) => ascending(rows.map(r => r[i]).filter(Number.isFinite)))};
  }

  // Quartiles over the chosen problems of the median cost by each moment; null where the planner ran on none of them.
  curve(planner, problems) {
    const cells = problems.map(p => this.problems[p].cells[planner]).filter(Boolean);
    if (!cells.length) return null;
    const columns = this.data.moments.map((_, i) => ascending(cells.map(c => c.curve[i])));
    return [0.25, 0.5, 0.75].map(s => columns.map(c => quantile(c, c.length, s)));
  }
}
