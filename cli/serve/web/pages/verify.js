// A verification: its progress, its verdict, each quantity with its interval against its limits.
import {el, replace, svg, table} from '../lib/dom.js';
import {number, plusMinus, t, when} from '../lib/texts.js';
import {get, watch} from '../lib/server.js';
import {start} from '../lib/job.js';
import {SpaceView} from '../lib/space_view.js';

const kKinds = {pass: 'good', fail: 'bad'};
const badge = (verdict) => el(`span.state.${kKinds[verdict] ?? 'open'}`, t(`verdict.${verdict ?? 'none'}`));

/// One quantity on its own scale: limits, value, expanded uncertainty.
function bar(q) {
  const low = q.lower_limit, high = q.upper_limit, U = q.uncertainty.U;
  const from = Math.min(low ?? 0, q.value - U, 0), to = Math.max(high ?? 0, q.value + U, 0), span = to - from || 1;
  const X = (v) => 8 + 184 * (v - from + 0.05 * span) / (1.1 * span);
  const label = `${plusMinus(q.value, U)} ${q.unit}`;
  return svg('svg', {viewBox: '0 0 200 26', role: 'img', 'aria-label': label},
    svg('rect', {class: 'band', x: X(low ?? from), width: Math.max(0, X(high ?? to) - X(low ?? from)), y: 3, height: 20}),
    [low, high].filter((v) => v !== undefined).map((v) => svg('line', {class: 'limit', x1: X(v), x2: X(v), y1: 1, y2: 25})),
    svg('line', {class: 'axis', x1: X(0), x2: X(0), y1: 3, y2: 23}),
    svg('line', {class: 'whisker', x1: X(q.value - U), x2: X(q.value + U), y1: 13, y2: 13}),
    svg('circle', {class: q.judgement?.verdict === 'fail' ? 'bad' : 'dot', cx: X(q.value), cy: 13, r: 4.5}));
}

function limits(q) {
  if (q.lower_limit !== undefined && q.upper_limit !== undefined) return `${number(q.lower_limit)} … ${number(q.upper_limit)}`;
  if (q.upper_limit !== undefined) return `≤ ${number(q.upper_limit)}`;
  return q.lower_limit !== undefined ? `≥ ${number(q.lower_limit)}` : '–';
}

function resultTable(record) {
  const head = [{text: t('verify.quantity')}, {text: t('verify.artefact')}, {text: t('verify.position')}, {text: t('verify.value'), numeric: true},
    {text: t('verify.limits'), numeric: true}, {text: t('verify.picture')}, {text: t('verify.verdict')}];
  return table(head, record.quantities.map((q) => [`${q.symbol} · ${q.name}`, q.artefact, q.position, `${plusMinus(q.value, q.uncertainty.U)} ${q.unit}`,
    limits(q), bar(q), q.judgement ? badge(q.judgement.verdict) : '–']), t('verify.results'));
}

/// What is known of one position: its fits, and the quantities that rest on it alone.
function positionDetail(position, record) {
  if (!position) return el('p.soft', t('space.choose'));
  if (!position.fits) return el('p.soft', t('space.missing', {n: position.number}));
  const rows = position.fits.map((f) => [f.part ? `${f.artefact} (${f.part + 1})` : f.artefact,
    f.diameter_mm === undefined ? '–' : `${number(f.diameter_mm, 4)} mm`, number(1000 * f.sd_mm, 1), number(1000 * f.shell_95_mm, 1), number(f.n_points, 0), number(f.n_rejected, 0)]);
  const fits = table([{text: t('verify.artefact')}, {text: t('space.diameter'), numeric: true}, {text: t('space.sd'), numeric: true}, {text: t('space.shell'), numeric: true},
    {text: t('space.points'), numeric: true}, {text: t('space.rejected'), numeric: true}], rows, t('space.fits'));
  const names = position.fits.map((f) => f.artefact);
  const own = (record?.quantities ?? []).filter((q) => q.position === String(position.number) && names.includes(q.artefact));
  return el('div', el('h3', `${position.scene} ${position.number}`), fits, own.map((q) => el('div.quantity', el('p', `${q.symbol} ${q.artefact}: ${plusMinus(q.value, q.uncertainty.U)} ${q.unit}, `,
    `${t('verify.limits')} ${limits(q)} `, q.judgement && badge(q.judgement.verdict)), bar(q))));
}

export function show(main) {
  const begin = el('section.card'), list = el('section.card'), detail = el('div.stack'), answer = el('p.trouble', {role: 'alert'});
  const words = el('section.card'), beside = el('div.panel.card'), results = el('section.card', {hidden: true});
  replace(main, el('h1', t('nav.verify')), begin, detail, list);
  let plans = [], key, chosen = null, space = null, record = null;
  const drawDetail = async (state) => {
    const v = state.verifications.find((one) => one.name === chosen);
    if (!v) {
      replace(detail);
      return;
    }
    ({record} = await get(`/api/verification?name=${encodeURIComponent(v.name)}`));
    replace(words, el('h2', v.name), el('p.figure', v.ended ? badge(v.verdict) : t('verify.captures', {done: v.done, of: v.planned})),
      v.ended && record && el('p.soft', `${when(v.ended)} · ${record.scanner} · ${record.plan_source}`));
    results.hidden = !record;
    replace(results, record && resultTable(record));
    if (space?.name !== v.name) {
      space?.end();
      const place = el('div');
      space = new SpaceView(v.name, (position) => replace(place, positionDetail(position, record)));
      replace(place, positionDetail(null));
      replace(beside, el('h2', t('space.positions')), space.tiles, place);
      replace(detail, words, el('div.view.space', space.node, beside), results);
    }
    await space.update().catch((error) => { space.trouble.textContent = error.message; });
  };
  const drawList = (state) => {
    const plan = el('select', {id: 'plan'}, plans.map((p) => el('option', {value: p.name, selected: p.name === 'quick'}, `${p.name}: ${p.title} (${p.captures})`)));
    const ready = Boolean(state.commissioning.report) && state.job.state !== 'running';
    replace(begin, el('div.row', el('label', t('verify.plan'), plan), el('button.primary', {type: 'button', id: 'verify', disabled: !ready,
      onclick: () => start({command: 'verify', plan: plan.value}, answer)}, t('do.verify.plan'))), !state.commissioning.report && el('p.soft', t('verify.needs')), answer);
    replace(list, el('h2', t('verify.done')), state.verifications.length ? table(
      [{text: t('verify.name')}, {text: t('verify.plan')}, {text: t('verify.when')}, {text: t('verify.verdict')}],
      [...state.verifications].reverse().map((v) => [el('button', {type: 'button', 'aria-pressed': String(v.name === chosen), onclick: () => {
        chosen = v.name;
        drawList(state);
        drawDetail(state).catch((error) => replace(detail, el('p.trouble', error.message)));
      }}, v.name), v.plan, v.ended ? when(v.ended) : t('verify.captures', {done: v.done, of: v.planned}), v.ended ? badge(v.verdict) : t('home.under.way')]), t('verify.done')) : el('p.soft', t('verify.none')));
  };
  const ready = get('/api/plans').then((all) => { plans = all; });
  const unwatch = watch(async (state) => {
    await ready;
    const now = JSON.stringify([state.verifications, state.job.state, state.commissioning.report?.date, document.documentElement.lang]);
    if (now === key) return;
    key = now;
    chosen = (state.verifications.find((one) => one.name === chosen) ?? state.verifications.at(-1))?.name ?? null;
    drawList(state);
    await drawDetail(state).catch((error) => replace(detail, el('p.trouble', error.message)));
  });
  return () => {
    unwatch();
    space?.end();
  };
}
