// A verification: its progress, its verdict, each quantity with its interval against its limits.
import {el, replace, svg, table} from '../lib/dom.js';
import {number, plusMinus, t, when} from '../lib/texts.js';
import {get, watch} from '../lib/server.js';
import {start} from '../lib/job.js';

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

function results(record) {
  const head = [{text: t('verify.quantity')}, {text: t('verify.artefact')}, {text: t('verify.position')}, {text: t('verify.value'), numeric: true},
    {text: t('verify.limits'), numeric: true}, {text: t('verify.picture')}, {text: t('verify.verdict')}];
  return table(head, record.quantities.map((q) => [`${q.symbol} · ${q.name}`, q.artefact, q.position, `${plusMinus(q.value, q.uncertainty.U)} ${q.unit}`,
    limits(q), bar(q), q.judgement ? badge(q.judgement.verdict) : '–']), t('verify.results'));
}

function progress(v, plans, captures) {
  const plan = plans.find((p) => p.name === v.plan);
  if (!plan) return [];
  return plan.series.map((s) => el('div', el('h3.small', `${s.scene}: ${s.artefacts.join(', ')}`),
    el('ul.tiles', Array.from({length: s.captures}, (_, i) => {
      const done = captures.includes(`${s.scene}-${String(i).padStart(2, '0')}`);
      return el(done ? 'li.done' : 'li', {'aria-label': t(done ? 'verify.capture.done' : 'verify.capture.missing', {n: i})}, done ? `✓ ${i}` : String(i));
    }))));
}

export function show(main) {
  const begin = el('section.card'), list = el('section.card'), detail = el('div'), answer = el('p.trouble', {role: 'alert'});
  replace(main, el('h1', t('nav.verify')), begin, list, detail);
  let plans = [], key, chosen = null;
  const drawDetail = async (state) => {
    const v = state.verifications.find((one) => one.name === chosen) ?? state.verifications.at(-1);
    if (!v) {
      replace(detail);
      return;
    }
    chosen = v.name;
    const data = await get(`/api/verification?name=${encodeURIComponent(v.name)}`);
    replace(detail, el('section.card', el('h2', v.name), el('p.figure', v.ended ? badge(v.verdict) : t('verify.captures', {done: v.done, of: v.planned})),
      v.ended && el('p.soft', `${when(v.ended)} · ${data.record.scanner} · ${data.record.plan_source}`),
      progress(v, plans, data.captures), data.record ? results(data.record) : null));
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
        drawDetail(state).catch((error) => replace(detail, el('p.trouble', error.message)));
      }}, v.name), v.plan, v.ended ? when(v.ended) : t('verify.captures', {done: v.done, of: v.planned}), v.ended ? badge(v.verdict) : t('home.under.way')]), t('verify.done')) : el('p.soft', t('verify.none')));
  };
  const ready = get('/api/plans').then((all) => { plans = all; });
  return watch(async (state) => {
    await ready;
    const now = JSON.stringify([state.verifications, state.job.state, state.commissioning.report?.date, document.documentElement.lang]);
    if (now === key) return;
    key = now;
    await drawDetail(state).catch((error) => replace(detail, el('p.trouble', error.message)));
    drawList(state);
  });
}
