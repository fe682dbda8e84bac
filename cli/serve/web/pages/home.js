// The scanner's state on one screen, and the next step as one button.
import {el, replace} from '../lib/dom.js';
import {decimals, number, plusMinus, t, when} from '../lib/texts.js';
import {get, watch} from '../lib/server.js';
import {start} from '../lib/job.js';
import {sparkline} from '../lib/charts.js';

const badge = (kind, text) => el(`span.state.${kind}`, text);

function card(title, state, figure, lines, link) {
  return el('section.card', el('h2', el('a', {href: link}, title)), el('p', state), figure && el('p.figure', figure),
    lines.map((line) => el('p.soft.small', line)));
}

function devices(state) {
  const d = state.devices;
  const name = state.commissioning.choices ? t('home.virtual', {preset: state.commissioning.choices.preset, seed: state.commissioning.choices.seed}) : t('home.virtual.none');
  return card(t('home.devices'), badge(d ? 'good' : 'open', t('home.virtual.badge')), null,
    [name, d && `${t('home.camera')} ${d.camera}`, d && `${t('home.plc')} ${d.plc}`].filter(Boolean), '#/live');
}

function aligned(c) {
  const a = c.alignment;
  if (!a) return card(t('home.aligned'), badge('open', t('home.not.yet')), null, [], '#/align');
  const good = a.decision === 'aligned';
  return card(t('home.aligned'), badge(good ? 'good' : 'open', good ? t('home.yes') : t('home.under.way')),
    `δ ${plusMinus(a.delta_um, 2 * a.u_delta_um)} µm`,
    [t('home.tolerance', {value: number(a.tolerance_um, 1), bit: a.bit}), when(a.date)], '#/align');
}

/// Opens beside the page: it is a document of its own.
function reportLink(c) {
  return c.report && el('p', el('a', {href: '/report.html', target: '_blank', rel: 'noopener'}, t('home.report')), ` (${when(c.report.date)})`);
}

function calibrated(c) {
  const k = c.calibration;
  if (!k) {
    const begun = c.poses > 0;
    return card(t('home.calibrated'), badge('open', begun ? t('home.poses', {done: c.poses, of: c.poses_planned}) : t('home.not.yet')), null, [], '#/calibrate');
  }
  return card(t('home.calibrated'), badge('good', t('home.yes')), `${number(k.camera_rms_px, 3)} px`,
    [t('home.calibrated.how', {poses: k.poses, board: number(1000 * k.grid_rms_mm, 1)}), when(k.date)], '#/calibrate');
}

const kKinds = {pass: 'good', fail: 'bad'};

function verified(state) {
  const done = state.verifications.filter((v) => v.ended).sort((a, b) => a.ended.localeCompare(b.ended));
  const last = done.at(-1);
  if (last) {
    return card(t('home.verified'), badge(kKinds[last.verdict] ?? 'open', t(`verdict.${last.verdict ?? 'none'}`)), last.plan,
      [t('home.quantities', {n: last.quantities}), when(last.ended)], '#/verify');
  }
  const report = state.commissioning.report;
  return card(t('home.verified'), badge(report?.verdict === 'met' ? 'good' : 'open', report ? t('home.by.commissioning') : t('home.not.yet')), null,
    report ? [report.verdict_text, when(report.date)] : [], '#/verify');
}

function nextStep(state) {
  const answer = el('p.trouble', {role: 'alert'});
  const act = (label, request) => el('button.primary', {type: 'button', id: 'next', onclick: async (event) => {
    event.target.disabled = true;
    if (!await start(request(), answer)) event.target.disabled = false;
  }}, label);
  const text = t(`next.${state.next}`);
  if (state.next === 'wait') return [el('p', text), answer];
  if (state.next === 'commission') {
    const seed = el('input', {type: 'number', id: 'seed', min: '0', max: '2147483647', step: '1', value: '1'});
    const repeats = el('input', {type: 'number', id: 'repeats', min: '1', max: '99', step: '1', value: '10'});
    return [el('p', text), el('div.row', el('label', t('home.seed'), seed), el('label', t('home.repeats'), repeats),
      act(t('do.commission'), () => ({command: 'commission', seed: Number(seed.value), repeats: Number(repeats.value)}))), answer];
  }
  if (state.next === 'continue') return [el('p', text), act(t('do.continue'), () => ({command: 'commission'})), answer];
  return [el('p', text), act(t('do.verify'), () => ({command: 'verify', plan: 'quick'})), answer];
}

async function trends(into) {
  const {quantities} = await get('/api/history');
  if (!quantities.length) {
    replace(into, el('p.soft', t('home.no.history')));
    return;
  }
  const shown = await Promise.all(quantities.slice(0, 6).map(async (q) => ({...q,
    chart: await get(`/api/history/chart?symbol=${encodeURIComponent(q.symbol)}&artefact=${encodeURIComponent(q.artefact)}`)})));
  replace(into, el('div.cards', shown.map(({symbol, artefact, chart}) => {
    const values = chart.points.map((p) => p.value), last = chart.points.at(-1);
    const limits = [chart.lower_limit, chart.upper_limit].filter((v) => v !== undefined);
    const figure = `${plusMinus(last.value, last.U)} ${chart.unit}`;
    return el('div', el('h3.small', `${symbol} ${artefact}`), sparkline(values, t('home.trend', {symbol, artefact, n: values.length, last: figure}), limits),
      el('p.small', figure));
  })));
}

export function show(main) {
  const next = el('section.card.next', {'aria-label': t('home.next')}), cards = el('div.cards'), trend = el('div'), trouble = el('div');
  replace(main, el('h1', t('nav.home')), next, cards, el('section.card.wide-card', el('h2', t('home.trends')), trend), trouble);
  let history, asked;
  return watch((state) => {
    if (asked !== `${state.next} ${document.documentElement.lang}`) {
      asked = `${state.next} ${document.documentElement.lang}`;
      replace(next, nextStep(state));
    }
    replace(cards, devices(state), aligned(state.commissioning), calibrated(state.commissioning), verified(state));
    replace(trouble, reportLink(state.commissioning), state.trouble.map((line) => el('p.trouble', line)));
    if (history !== state.history) {
      history = state.history;
      trends(trend).catch((error) => replace(trend, el('p.trouble', error.message)));
    }
  });
}
