// The chained record: control charts with zoom, entries, their documents.
import {el, replace, svg, table} from '../lib/dom.js';
import {number, plusMinus, t, when} from '../lib/texts.js';
import {get, watch} from '../lib/server.js';
import {frame, path, range} from '../lib/charts.js';

const kDay = 86400000;
const dateOf = (day) => new Intl.DateTimeFormat(document.documentElement.lang, {dateStyle: 'short'}).format(new Date(day * kDay));

function draw(chart, zoom) {
  const all = chart.points, n = all.length;
  const from = Math.floor(zoom.from * (n - 1)), to = Math.max(from + 1, Math.ceil(zoom.to * (n - 1)));
  const points = all.slice(from, to + 1).map((p, i) => ({...p, x: from + i + 1}));
  const lines = [chart.lower_limit, chart.upper_limit].filter((v) => v !== undefined);
  const control = chart.s === undefined ? [] : [chart.mean - 3 * chart.s, chart.mean, chart.mean + 3 * chart.s];
  const x = [points[0].x - 0.5, Math.max(points.at(-1).x, points[0].x + 1) + 0.5];
  const f = frame({x, y: range([...points.flatMap((p) => [p.value - (p.U ?? 0), p.value + (p.U ?? 0)]), ...lines, ...control]), width: 1100, height: 380,
    xLabel: t('history.axis'), yLabel: `${chart.name} / ${chart.unit}`, label: t('history.chart.label', {name: chart.name, n: points.length}),
    xText: (v) => {
      const p = points.find((q) => q.x === v);
      return p ? `${p.number}: ${dateOf(p.day)}` : '';
    }});
  const across = (cls, v) => svg('line', {class: cls, x1: f.X(x[0]), x2: f.X(x[1]), y1: f.Y(v), y2: f.Y(v)});
  f.add(...lines.map((v) => across('limit', v)), ...control.map((v) => across('control', v)),
    svg('path', {class: 'line', d: path(points.map((p) => [p.x, p.value]), f.X, f.Y)}),
    ...points.flatMap((p) => [svg('line', {class: 'whisker', x1: f.X(p.x), x2: f.X(p.x), y1: f.Y(p.value - (p.U ?? 0)), y2: f.Y(p.value + (p.U ?? 0))}),
      svg('circle', {class: p.signals?.length ? 'bad' : 'dot', cx: f.X(p.x), cy: f.Y(p.value), r: 5},
        svg('title', {}, `${p.number}: ${plusMinus(p.value, p.U)} ${chart.unit}`))]));
  return f.node;
}

function chartCard(chart, symbol, artefact) {
  const place = el('div'), zoom = {from: 0, to: 1};
  const again = () => replace(place, draw(chart, zoom));
  const slider = (key, text) => el('label', text, el('input', {type: 'range', min: '0', max: '1', step: '0.01', value: String(zoom[key]), oninput: (event) => {
    zoom[key] = Number(event.target.value);
    if (zoom.from > zoom.to - 0.02) zoom.from = Math.max(0, zoom.to - 0.02);
    again();
  }}));
  again();
  const words = [];
  if (chart.no_chart) words.push(chart.no_chart);
  else words.push(t('history.control', {n: chart.n_baseline, mean: number(chart.mean, 5), s: number(chart.s, 5)}));
  if (chart.slope_per_day !== undefined) words.push(t('history.trend', {slope: number(chart.slope_per_day), u: number(chart.u_slope_per_day)}));
  if (chart.earliest_in_days !== undefined) words.push(t('history.forecast', {days: number(chart.earliest_in_days, 0)}));
  return el('section.card', el('h2', `${chart.name}, ${symbol} ${artefact}`), place,
    chart.points.length > 3 && el('div.row', slider('from', t('history.from')), slider('to', t('history.to'))), words.map((w) => el('p.soft.small', w)),
    el('details', el('summary', t('history.numbers')), table([{text: '#', numeric: true}, {text: t('history.date')}, {text: `${chart.name} / ${chart.unit}`, numeric: true}, {text: t('history.signals')}],
      chart.points.map((p) => [String(p.number), dateOf(p.day), plusMinus(p.value, p.U), (p.signals ?? []).join(', ')]), chart.name)));
}

function save(name, text) {
  const link = el('a', {href: URL.createObjectURL(new Blob([text], {type: 'application/json'})), download: name});
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

async function entry(number, into) {
  const e = await get(`/api/history/entry?number=${number}`);
  const text = JSON.stringify(e.document, null, 2), d = e.document;
  replace(into, el('section.card', el('h2', t('history.entry', {n: e.number, kind: t(`kind.${e.kind}`)})),
    el('dl', el('dt', t('history.date')), el('dd', when(e.date)), el('dt', 'SHA-256'), el('dd', e.hash),
      d.plan && [el('dt', t('verify.plan')), el('dd', d.plan), el('dt', t('history.scanner')), el('dd', d.scanner)]),
    el('div.row', el('button', {type: 'button', onclick: () => save(`entry-${e.number}.json`, text)}, t('history.save'))),
    el('details', el('summary', t('history.document')), el('pre', {tabindex: '0'}, text))));
}

export function show(main) {
  const pick = el('section.card'), chart = el('div'), entries = el('section.card'), detail = el('div'), files = el('section.card');
  replace(main, el('h1', t('nav.history')), pick, chart, entries, detail, files);
  let key;
  const drawAll = async () => {
    const {entries: all, quantities} = await get('/api/history');
    const {certificates} = await get('/api/certificates');
    if (!all.length) {
      replace(pick, el('p', t('home.no.history')));
      replace(chart);
      replace(entries);
      return;
    }
    const select = el('select', {id: 'quantity', onchange: () => one()}, quantities.map((q, i) => el('option', {value: String(i)}, `${q.symbol} ${q.artefact}`)));
    const one = async () => {
      const q = quantities[Number(select.value)];
      replace(chart, chartCard(await get(`/api/history/chart?symbol=${encodeURIComponent(q.symbol)}&artefact=${encodeURIComponent(q.artefact)}`), q.symbol, q.artefact));
    };
    replace(pick, el('div.row', el('label', t('history.quantity'), select)));
    replace(entries, el('h2', t('history.entries', {n: all.length})), table([{text: '#', numeric: true}, {text: t('history.date')}, {text: t('history.kind')}, {text: t('verify.plan')}, {text: t('verify.verdict')}, {text: 'SHA-256'}],
      [...all].reverse().slice(0, 200).map((e) => [el('button', {type: 'button', 'aria-label': t('history.open', {n: e.number}), onclick: () => entry(e.number, detail)}, String(e.number)), when(e.date), t(`kind.${e.kind}`), e.plan ?? '–',
        e.verdict ? t(`verdict.${e.verdict}`) : '–', e.hash.slice(0, 12)]), t('history.entries', {n: all.length})));
    replace(files, el('h2', t('history.certificates')), certificates.length ? el('ul', certificates.map((c) => el('li', el('a', {href: `/certificate?folder=${encodeURIComponent(c.folder)}&file=${encodeURIComponent(c.file)}`, download: c.file}, `${c.folder}/${c.file}`)))) : el('p.soft', t('history.no.certificates')));
    await one();
  };
  return watch((state) => {
    if (key === state.history) return;
    key = state.history;
    drawAll().catch((error) => replace(pick, el('p.trouble', error.message)));
  });
}
