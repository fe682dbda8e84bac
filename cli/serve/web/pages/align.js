// The alignment, to be read from three metres: delta with its interval against the tolerance, and which way to turn.
import {el, replace, svg, table} from '../lib/dom.js';
import {decimals, number, plusMinus, signed, t} from '../lib/texts.js';
import {get, watch} from '../lib/server.js';
import {frame, path, range, stairs} from '../lib/charts.js';

/// delta with its interval (k = 2) on a scale with the tolerance as a band.
function scale(step) {
  const U = 2 * step.u_delta_um, limit = step.tolerance_um;
  const reach = 1.25 * Math.max(2.5 * limit, Math.abs(step.delta_um) + U);
  const X = (v) => 20 + 760 * (v + reach) / (2 * reach);
  const inside = Math.abs(step.delta_um) + U <= limit;
  return svg('svg', {viewBox: '0 0 800 120', role: 'img', 'aria-label': t('align.scale', {value: plusMinus(step.delta_um, U), limit: number(limit, 1)})},
    svg('rect', {class: 'band', x: X(-limit), width: X(limit) - X(-limit), y: 20, height: 60}),
    svg('line', {class: 'axis', x1: 20, x2: 780, y1: 80, y2: 80}),
    svg('line', {class: 'axis', x1: X(0), x2: X(0), y1: 20, y2: 88}),
    svg('line', {class: 'whisker', x1: X(step.delta_um - U), x2: X(step.delta_um + U), y1: 50, y2: 50, 'stroke-width': 6}),
    svg('circle', {class: inside ? 'good' : 'bad', cx: X(step.delta_um), cy: 50, r: 13}),
    // A band that is narrow beside the deviation has no room for three figures.
    X(limit) - X(-limit) < 200 ? svg('text', {class: 'strong large', x: X(0), y: 110, 'text-anchor': 'middle'}, `±${number(limit, 1)}`)
      : [-limit, 0, limit].map((v) => svg('text', {class: 'strong large', x: X(v), y: 110, 'text-anchor': 'middle'}, v === 0 ? '0' : signed(v, 1))));
}

/// A turning arrow: three quarters of a circle in the sense of the turn.
function arrow(clockwise) {
  const side = clockwise ? 1 : -1;
  const point = (degrees) => [100 + 70 * Math.sin(side * degrees * Math.PI / 180), 100 - 70 * Math.cos(degrees * Math.PI / 180)];
  const [x0, y0] = point(-120), [x1, y1] = point(105), [hx, hy] = point(140);
  const [ax, ay] = [x1 + 26 * (x1 - 100) / 70, y1 + 26 * (y1 - 100) / 70], [bx, by] = [x1 - 26 * (x1 - 100) / 70, y1 - 26 * (y1 - 100) / 70];
  return svg('svg', {viewBox: '0 0 200 200', role: 'img', 'aria-label': t(clockwise ? 'align.clockwise' : 'align.anticlockwise')},
    svg('path', {class: 'arrow', d: `M${x0} ${y0}A70 70 0 1 ${clockwise ? 1 : 0} ${x1} ${y1}`}),
    svg('path', {class: 'arrow-head', d: `M${ax} ${ay}L${hx} ${hy}L${bx} ${by}Z`}));
}

function divisions() {
  const value = Number(localStorage.getItem('fringecal.division_mrad'));
  return value > 0 ? value : null;
}

function instruction(step, again) {
  if (step.decision === 'aligned') return [el('p.turn', t('align.done'))];
  if (step.decision !== 'turn') return [el('p.turn', t(`align.decision.${step.decision}`)), el('p', step.sentence)];
  const clockwise = step.turn_mrad > 0, division = divisions();
  const field = el('input', {type: 'number', id: 'division', min: '0', step: 'any', value: division ?? '', onchange: () => {
    localStorage.setItem('fringecal.division_mrad', field.value);
    again();
  }});
  return [arrow(clockwise),
    el('p.turn', t(clockwise ? 'align.turn.clockwise' : 'align.turn.anticlockwise', {angle: number(Math.abs(step.turn_mrad), 3)})),
    division && el('p.turn', t('align.divisions', {n: number(Math.abs(step.turn_mrad) / division, 1)})),
    el('div.row', el('label', t('align.division'), field))];
}

function history(iterations) {
  const points = iterations.map((it, i) => ({x: i + 1, y: it.measured.theta_mrad, U: 2 * it.measured.u_theta_mrad}));
  const f = frame({x: [0.5, Math.max(2.5, points.length + 0.5)], y: range([0, ...points.flatMap((p) => [p.y - p.U, p.y + p.U])]),
    height: 220, xText: (v) => (Number.isInteger(v) ? String(v) : ''), xLabel: t('align.iteration'), yLabel: 'θ / mrad', label: t('align.history.label', {n: points.length})});
  f.add(svg('line', {class: 'axis', x1: f.X(0.5), x2: f.X(Math.max(2.5, points.length + 0.5)), y1: f.Y(0), y2: f.Y(0)}),
    svg('path', {class: 'line', d: path(points.map((p) => [p.x, p.y]), f.X, f.Y)}),
    points.map((p) => [svg('line', {class: 'whisker', x1: f.X(p.x), x2: f.X(p.x), y1: f.Y(p.y - p.U), y2: f.Y(p.y + p.U)}),
      svg('circle', {class: 'dot', cx: f.X(p.x), cy: f.Y(p.y), r: 5})]).flat());
  return [f.node, table(
    [{text: t('align.iteration'), numeric: true}, {text: 'θ / mrad (k = 2)', numeric: true}, {text: 'δ / µm (k = 2)', numeric: true}, {text: t('align.turned'), numeric: true}],
    iterations.map((it, i) => [String(i + 1), plusMinus(it.measured.theta_mrad, 2 * it.measured.u_theta_mrad),
      plusMinus(it.step.delta_um, 2 * it.step.u_delta_um), it.step.decision === 'turn' ? signed(it.step.turn_mrad, 3) : '–']), t('align.history'))];
}

/// The paper's figure 5 along one row: the Gray number as stairs, the absolute phase in periods.
function profile(columns, title) {
  const n = columns.column_px.length, from = Math.floor(n * 0.45), to = Math.min(n, from + 260);
  const periods = columns.phase_rad.slice(from, to).map((phase) => (phase + Math.PI) / (2 * Math.PI));
  const perStripe = (columns.gray_number[to - 1] - columns.gray_number[from]) / (periods.at(-1) - periods[0]) > 1.5 ? 2 : 1;
  const gray = columns.gray_number.slice(from, to).map((g) => Math.floor(g / perStripe)), x = columns.column_px.slice(from, to);
  const f = frame({x: [x[0], x.at(-1)], y: range([...periods, ...gray, gray.at(-1) + 1]), height: 240,
    xLabel: t('align.column'), yLabel: t('align.periods'), label: t('align.profile.label', {title, row: columns.row_px})});
  f.add(svg('path', {class: 'line2', d: stairs(gray.map((g, i) => [x[i], g]), f.X, f.Y)}),
    svg('path', {class: 'line', d: path(periods.map((p, i) => [x[i], p]), f.X, f.Y)}));
  return el('div', el('h3.small', title), f.node);
}

export function show(main) {
  const large = el('div.giant'), lower = el('div.wide');
  replace(main, el('h1', t('nav.align')), large, lower);
  let key;
  const draw = async () => {
    const data = await get('/api/alignment');
    const iterations = data.iterations ?? [];
    if (!iterations.length) {
      replace(large, el('section.card', el('p', t('align.none'))));
      replace(lower);
      return;
    }
    const {step, measured} = iterations.at(-1), digits = decimals(2 * step.u_delta_um);
    large.className = step.decision === 'aligned' ? 'giant good' : 'giant';
    replace(large,
      el('section.card', {'aria-label': t('align.delta')}, el('h2', t('align.delta.bit', {bit: step.bit})),
        el('p.figure', {id: 'delta'}, `${signed(step.delta_um, digits)} µm`),
        el('p.interval', `± ${number(2 * step.u_delta_um, digits)} µm (k = 2)`), el('p.interval', t('align.tolerance', {limit: number(step.tolerance_um, 1)})),
        scale(step), el('p', `θ = ${plusMinus(measured.theta_mrad, 2 * measured.u_theta_mrad)} mrad (k = 2)`)),
      el('section.card', {'aria-label': t('align.instruction')}, el('h2', t('align.instruction')), instruction(step, draw)));
    replace(lower, el('section.card', el('h2', t('align.history')), history(iterations)),
      el('section.card', el('h2', t('align.profile')), data.before ? [profile(data.before, t('align.before')), profile(data.after, t('align.after'))]
        : el('p.soft', t('align.profile.later'))));
  };
  return watch((state) => {
    const now = `${state.commissioning.alignment?.date} ${state.commissioning.alignment?.iterations} ${state.commissioning.report?.date} ${document.documentElement.lang}`;
    if (now === key) return;
    key = now;
    draw().catch((error) => replace(large, el('p.trouble', error.message)));
  });
}
