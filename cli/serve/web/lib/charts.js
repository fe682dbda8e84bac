// Charts as SVG: axes with round steps, lines, dots with intervals, bands. Every chart has a text for those who do not
// see it, and the pages give its numbers as a table too.
import {svg} from './dom.js';
import {number} from './texts.js';

/// Round steps for about `count` of them.
export function steps(low, high, count = 5) {
  [low, high] = [Math.min(low, high), Math.max(low, high)];
  const span = high - low || Math.abs(high) || 1;
  const rough = span / count, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= rough) ?? 10 * power;
  const out = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * span; ++k) out.push(k * step || 0);
  return {values: out, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9))};
}

export function range(values, margin = 0.06) {
  let low = Infinity, high = -Infinity;
  for (const v of values) {
    if (v === undefined || v === null || !Number.isFinite(v)) continue;
    if (v < low) low = v;
    if (v > high) high = v;
  }
  if (low > high) return [0, 1];
  const span = high - low || Math.abs(high) || 1;
  return [low - margin * span, high + margin * span];
}

/// A frame with axes. options: {width, height, x: [low, high], y: [low, high], xLabel, yLabel, label, square}
/// Returns {node, X, Y, add}: X and Y from data to the drawing, add() puts shapes under the axes.
export function frame(options) {
  const {width = 600, height = 260, x, y, xLabel = '', yLabel = '', label, xText} = options;
  const left = 64, right = 14, top = 14, bottom = 42;
  const X = (v) => left + (width - left - right) * (v - x[0]) / (x[1] - x[0]);
  const Y = (v) => height - bottom - (height - top - bottom) * (v - y[0]) / (y[1] - y[0]);
  const shapes = svg('g');
  const node = svg('svg', {viewBox: `0 0 ${width} ${height}`, role: 'img', 'aria-label': label});
  const xs = steps(x[0], x[1], 7), ys = steps(y[0], y[1], 5);
  for (const v of ys.values) {
    node.append(svg('line', {class: 'grid', x1: left, x2: width - right, y1: Y(v), y2: Y(v)}),
      svg('text', {x: left - 6, y: Y(v) + 4, 'text-anchor': 'end'}, number(v, ys.digits)));
  }
  for (const v of xs.values) {
    node.append(svg('text', {x: X(v), y: height - bottom + 16, 'text-anchor': 'middle'}, xText ? xText(v) : number(v, xs.digits)));
  }
  node.append(shapes,
    svg('path', {class: 'axis', d: `M${left} ${top}V${height - bottom}H${width - right}`}),
    svg('text', {x: (left + width - right) / 2, y: height - 6, 'text-anchor': 'middle'}, xLabel),
    svg('text', {x: 14, y: (top + height - bottom) / 2, 'text-anchor': 'middle',
      transform: `rotate(-90 14 ${(top + height - bottom) / 2})`}, yLabel));
  return {node, X, Y, add: (...children) => shapes.append(...children.flat(Infinity))};
}

export function path(points, X, Y) {
  return points.map(([a, b], i) => `${i ? 'L' : 'M'}${X(a).toFixed(1)} ${Y(b).toFixed(1)}`).join('');
}

/// A step function, as Gray numbers are.
export function stairs(points, X, Y) {
  return points.map(([a, b], i) => (i ? `H${X(a).toFixed(1)}V${Y(b).toFixed(1)}` : `M${X(a).toFixed(1)} ${Y(b).toFixed(1)}`)).join('');
}

/// A trend without axes; limits are drawn where they are given.
export function sparkline(values, label, limits = []) {
  const [low, high] = range([...values, ...limits], 0.1);
  const X = (i) => 6 + (values.length > 1 ? 148 * i / (values.length - 1) : 74);
  const Y = (v) => 38 - 34 * (v - low) / (high - low);
  return svg('svg', {viewBox: '0 0 160 42', role: 'img', 'aria-label': label, class: 'spark'},
    limits.map((v) => svg('line', {class: 'limit', x1: 2, x2: 158, y1: Y(v), y2: Y(v)})),
    svg('path', {class: 'line', d: path(values.map((v, i) => [i, v]), X, Y)}),
    svg('circle', {class: 'dot', cx: X(values.length - 1), cy: Y(values.at(-1)), r: 4}));
}
