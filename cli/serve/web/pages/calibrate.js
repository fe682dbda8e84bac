// Where the board has been, over the image and in the volume, and what is left over.
import {el, replace, svg, table} from '../lib/dom.js';
import {decimals, number, t} from '../lib/texts.js';
import {get, watch} from '../lib/server.js';
import {frame, path, range} from '../lib/charts.js';

/// A row of an observation's corners: column, row, pixel x, pixel y, u, used, ... (calib/model/scanner.h).
/// Before there is a result: what the poses so far have left.
function corners(data) {
  if (!data.observations) return data.seen.flatMap((s, pose) => s.x_px.map((x, i) => ({pose, x, y: s.y_px[i], used: true})));
  return (data.observations ?? []).flatMap((o, pose) => o.corners.map(([, , x, y, , used]) => ({pose, x, y, used: used === 1})));
}

/// Corners per cell of the image; an empty cell is where the board has not been.
function coverage(data) {
  const all = corners(data), w = data.camera?.width_px ?? data.seen[0].width_px, h = data.camera?.height_px ?? data.seen[0].height_px;
  const nx = 16, ny = 12, count = Array.from({length: ny}, () => new Array(nx).fill(0));
  for (const c of all) {
    const i = Math.min(nx - 1, Math.max(0, Math.floor(nx * c.x / w))), j = Math.min(ny - 1, Math.max(0, Math.floor(ny * c.y / h)));
    count[j][i] += 1;
  }
  const empty = count.flat().filter((n) => n === 0).length;
  const f = frame({x: [0, w], y: [h, 0], height: 400, xLabel: t('calibrate.x'), yLabel: t('calibrate.y'),
    label: t('calibrate.coverage.label', {n: all.length, empty, of: nx * ny})});
  count.forEach((row, j) => row.forEach((n, i) => f.add(svg('rect', {class: n ? 'band' : 'todo', x: f.X(i * w / nx), y: f.Y(j * h / ny),
    width: f.X(w / nx) - f.X(0), height: f.Y(h / ny) - f.Y(0)}))));
  f.add(...all.map((c) => svg('circle', {class: c.used ? 'dot' : 'bad', cx: f.X(c.x), cy: f.Y(c.y), r: 1.6})));
  return [f.node, el('p.soft.small', t('calibrate.coverage.words', {n: all.length, empty, of: nx * ny}))];
}

/// q v q*, q = (w, x, y, z).
function rotated([w, x, y, z], [a, b, c]) {
  const u = [y * c - z * b + w * a, z * a - x * c + w * b, x * b - y * a + w * c];
  return [a + 2 * (y * u[2] - z * u[1]), b + 2 * (z * u[0] - x * u[2]), c + 2 * (x * u[1] - y * u[0])];
}

/// The board in each pose, seen along the rows of the picture (X, Z) of the camera's frame.
function volume(data) {
  const {board} = data, right = (board.columns - 1) * board.pitch_x_mm, down = (board.rows - 1) * board.pitch_y_mm;
  const outline = [[0, 0, 0], [right, 0, 0], [right, down, 0], [0, down, 0]];
  const boards = (data.cam_from_board ?? []).map((p) => outline.map((corner) => rotated(p.rotation_wxyz, corner).map((v, i) => v + p.translation_mm[i])));
  if (!boards.length) return [];
  const all = boards.flat(), f = frame({x: range(all.map((p) => p[0])), y: range(all.map((p) => p[2])), height: 400,
    xLabel: t('calibrate.across'), yLabel: t('calibrate.distance'), label: t('calibrate.volume.label', {n: boards.length})});
  f.add(...boards.flatMap((b, i) => [svg('path', {class: i % 2 ? 'line2' : 'line', d: `${path(b.map((p) => [p[0], p[2]]), f.X, f.Y)}Z`}),
    svg('text', {class: 'strong', x: f.X(b[1][0]) + 4, y: f.Y(b[1][2])}, String(i + 1))]));
  return [f.node, el('p.soft.small', t('calibrate.volume.words'))];
}

/// Residuals as lines from the corner, drawn a thousand times as long as they are in the picture.
function residuals(data) {
  const r = data.camera_residuals;
  if (!r) return [el('p.soft', t('calibrate.residuals.later'))];
  const kStretch = 300, w = data.image_width_px, h = data.image_height_px;
  const f = frame({x: [0, w], y: [h, 0], height: 400, xLabel: t('calibrate.x'), yLabel: t('calibrate.y'), label: t('calibrate.residuals.label', {n: r.pixel_x_px.length})});
  f.add(svg('path', {class: 'line2', d: r.pixel_x_px.map((x, i) => `M${f.X(x).toFixed(1)} ${f.Y(r.pixel_y_px[i]).toFixed(1)}L${
    f.X(x + kStretch * r.residual_x_px[i]).toFixed(1)} ${f.Y(r.pixel_y_px[i] + kStretch * r.residual_y_px[i]).toFixed(1)}`).join('')}));
  return [f.node, el('p.soft.small', t('calibrate.residuals.words', {n: kStretch}))];
}

/// On a glass grating the remainder is far below a micrometre.
function projector(k) {
  return k.projector_unit === 'mm' ? {projector: number(1e6 * k.projector_rms, 1), unit: 'nm'} : {projector: number(k.projector_rms), unit: k.projector_unit};
}

function parameters(data) {
  if (!data.parameters) return [];
  return [table([{text: t('calibrate.parameter')}, {text: t('calibrate.value'), numeric: true}, {text: 'u', numeric: true}, {text: t('unit')}],
    data.parameters.map((p) => [p.name, number(p.value, p.u ? decimals(p.u) : undefined), p.u === undefined ? '–' : number(p.u, decimals(p.u)), p.unit ?? '']),
    t('calibrate.parameters'))];
}

export function show(main) {
  const head = el('section.card'), grid = el('div.wide'), below = el('section.card', {hidden: true});
  replace(main, el('h1', t('nav.calibrate')), head, grid, below);
  let key;
  const draw = async (c) => {
    const done = Math.min(c.poses ?? 0, c.poses_planned ?? 0);
    const tiles = el('ul.tiles', Array.from({length: c.poses_planned ?? 0}, (_, i) => el(i < done ? 'li.done' : 'li', i < done ? `✓ ${i + 1}` : String(i + 1))));
    const k = c.calibration;
    replace(head, el('h2', t('calibrate.poses', {done, of: c.poses_planned ?? 0})), tiles,
      k ? el('p', t('calibrate.summary', {px: number(k.camera_rms_px, 3), ...projector(k), board: number(1000 * k.grid_rms_mm, 1)}))
        : el('p.soft', t(done ? 'calibrate.under.way' : 'calibrate.none')));
    const data = await get('/api/calibration');
    if (!k) {
      replace(grid, data.seen.length && el('section.card', el('h2', t('calibrate.coverage')), coverage(data)));
      return;
    }
    replace(grid, el('section.card', el('h2', t('calibrate.coverage')), coverage(data)),
      el('section.card', el('h2', t('calibrate.volume')), volume(data)),
      el('section.card', el('h2', t('calibrate.residuals')), residuals(data)),
      el('section.card', el('h2', t('calibrate.parameters')), parameters(data)));
  };
  return watch((state) => {
    const c = state.commissioning;
    const now = `${c.poses} ${c.calibration?.date} ${c.report?.date} ${document.documentElement.lang}`;
    if (now === key) return;
    key = now;
    draw(c).catch((error) => replace(grid, el('p.trouble', error.message)));
  });
}
