// The choice of problems and planners, and what follows from it.

const MAX_LISTED = 400;
const find = id => document.getElementById(id);

const shadeTables = () => {
  for (const box of document.querySelectorAll('.scroll')) {
    box.parentNode.classList.toggle('more', box.scrollLeft + box.clientWidth < box.scrollWidth - 2);
  }
};

const begin = async () => {
  const [data, details] = await Promise.all([unpacked('runs'), unpacked('details')]);
  const runs = new Runs(data), {planners, families} = data, {problems} = runs;
  const byName = new Map(planners.map(p => [p.name, p]));
  const state = {planners: new Set(planners.keys()), problems: new Set(problems.keys()), clock: 'call', shown: 0};

  const key = p => `<svg class="key" viewBox="0 0 28 14" aria-hidden="true"><use href="#k${p.number}"/></svg>`;
  find('planners').innerHTML = Object.entries(families).map(([family, title]) => {
    const members = planners.filter(p => p.family === family);
    return members.length ? `<div class="family"><button type="button" data-family="${family}">${escaped(title)}</button>${members.map(p =>
      `<label class="s" data-s="${p.number}"><input type="checkbox" value="${p.number}" checked>${key(p)}${escaped(p.name)}</label>`).join('')}</div>` : '';
  }).join('');

  const matching = () => {
    const words = find('filter').value.toLowerCase().split(/\s+/);
    return [...problems.keys()].filter(p => words.every(w => problems[p].name.toLowerCase().includes(w)));
  };

  const list = () => {
    const all = matching(), some = all.slice(0, MAX_LISTED);
    find('problems').innerHTML = some.map(p => `<div><input type="checkbox" value="${p}" aria-label="${escaped(problems[p].name)}"`
      + `${state.problems.has(p) ? ' checked' : ''}><button type="button" data-problem="${p}"${p === state.shown ? ' aria-current="true"' : ''}>`
      + `${escaped(problems[p].name)}</button></div>`).join('')
      + (some.length < all.length ? `<p class="note">${(all.length - some.length).toLocaleString('en-US')} more: write a part of the name above.</p>` : '');
  };

  const chosen = () => [...planners.keys()].filter(s => state.planners.has(s));
  const drawSingle = () => {
    const problem = problems[state.shown];
    find('name').textContent = problem.name;
    find('limit').textContent = `Limit ${problem.limit} s; problem ${state.shown + 1} of ${problems.length}.`;
    find('single').innerHTML = single(runs, details, chosen(), state.shown, state.clock, byName);
  };
  const drawTogether = () => {
    if (!find('together')) return;
    const some = [...problems.keys()].filter(p => state.problems.has(p));
    find('chosen').textContent = `${chosen().length} of ${planners.length} planners, ${some.length} of ${problems.length} problems`;
    find('together').innerHTML = together(runs, chosen(), some, state.clock, byName);
  };

  let waiting = 0;
  const redraw = (...parts) => {
    cancelAnimationFrame(waiting);
    waiting = requestAnimationFrame(() => { for (const draw of parts) draw(); shadeTables(); });
  };
  const show = p => {
    state.shown = (p + problems.length) % problems.length;
    list();
    redraw(drawTogether, drawSingle);
  };

  find('planners').addEventListener('change', ({target}) => {
    state.planners[target.checked ? 'add' : 'delete'](Number(target.value));
    redraw(drawTogether, drawSingle);
  });
  // Of a family all or, where all are chosen already, none.
  const take = some => {
    const all = some.every(s => state.planners.has(s));
    for (const s of some) state.planners[all ? 'delete' : 'add'](s);
    for (const box of find('planners').querySelectorAll('input')) box.checked = state.planners.has(Number(box.value));
    redraw(drawTogether, drawSingle);
  };
  find('planners').addEventListener('click', ({target}) => {
    const family = target.dataset.family;
    if (family) take([...planners.keys()].filter(s => planners[s].family === family));
  });
  find('all-planners').addEventListener('click', () => take([...planners.keys()]));
  find('problems').addEventListener('change', ({target}) => {
    state.problems[target.checked ? 'add' : 'delete'](Number(target.value));
    redraw(drawTogether);
  });
  find('problems').addEventListener('click', ({target}) => {
    if (target.dataset.problem === undefined) return;
    show(Number(target.dataset.problem));
    find('one').scrollIntoView();
  });
  find('all-problems').addEventListener('click', () => {
    const some = matching(), all = some.every(p => state.problems.has(p));
    for (const p of some) state.problems[all ? 'delete' : 'add'](p);
    list();
    redraw(drawTogether);
  });
  find('filter').addEventListener('input', list);
  find('before').addEventListener('click', () => show(state.shown - 1));
  find('after').addEventListener('click', () => show(state.shown + 1));
  find('clocks').addEventListener('change', ({target}) => {
    state.clock = target.value;
    redraw(drawTogether, drawSingle);
  });

  // The planner that is pointed at, or has the focus, stands out in all charts.
  const lit = document.head.appendChild(document.createElement('style'));
  const light = ({target}) => {
    const s = target.closest?.('[data-s]')?.dataset.s;
    lit.textContent = s === undefined ? '' : `#explore svg.chart .s{opacity:.13}#explore svg.chart .s[data-s="${s}"]{opacity:1}`
      + `#explore .s[data-s="${s}"] .line{stroke-width:4}#explore label.s[data-s="${s}"]{background:#e8edf5}`;
    find('pointed').innerHTML = s === undefined ? '' : key(planners[s]) + escaped(planners[s].name);
  };
  for (const kind of ['pointerover', 'focusin']) find('explore').addEventListener(kind, light);

  list();
  drawTogether();
  drawSingle();
  if (matchMedia('(min-width: 1000px)').matches) for (const fold of document.querySelectorAll('#choice details')) fold.open = true;
  find('explore').classList.add('ready');
};

const settle = () => { shadeTables(); document.documentElement.dataset.ready = Math.round(performance.now()); };
document.addEventListener('scroll', shadeTables, true);
document.addEventListener('toggle', shadeTables, true);
addEventListener('resize', shadeTables);
shadeTables();
begin().then(settle, error => {
  find('failed').textContent = `The charts cannot be drawn in this browser: ${error.message}`;
  settle();
});
