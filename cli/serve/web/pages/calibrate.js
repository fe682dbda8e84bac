// Where the board has been, over the image and in the volume, and what is left over.
import {el, replace, svg, table} from '../lib/dom.js';
import {decimals, number, t} from '../lib/texts.js';
import {get, watch} from '../lib/server.js';
import {frame, path, range} from '../lib/charts.js';
import {paint} from '../lib/picture.js';

/// A row of an observation's corners: column, row, pixel x, pixel y, u, used, ... (calib/model/scanner.h).
/// Before there is a result: what the poses so far have left.
function corners(data) {
  if (!data.observations || data.so_far) return data.seen.flatMap((s, pose) => (s ? s.x_px.map((x, i) => ({pose, x, y: s.y_px[i], used: true})) : []));
  return (data.observations ?? []).flatMap((o, pose) => o.corners.map(([, , x, y, , used]) => ({pose, x, y, used: used === 1})));
}

function sizeOf(data) {
  const any = data.camera ?? data.seen.find(Boolean);
  return [any.width_px, any.height_px];
}

/// The middle of the cell that is furthest from every corner.
function emptiest(all, w, h, nx, ny) {
  let best = null;
  for (let j = 0; j < ny; ++j) for (let i = 0; i < nx; ++i) {
    const x = (i + 0.5) * w / nx, y = (j + 0.5) * h / ny, far = all.reduce((least, c) => Math.min(least, (c.x - x) ** 2 + (c.y - y) ** 2), Infinity);
    if (!best || far > best.far) best = {x, y, far};
  }
  return best;
}

/// Corners per cell of the image; an empty cell is where the board has not been.
function coverage(data, next) {
  const all = corners(data), [w, h] = sizeOf(data);
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
  const first = next?.[0], target = first ? {x: first.x_px, y: first.y_px} : emptiest(all, w, h, nx, ny);
  f.add(target_mark(f.X(target.x), f.Y(target.y)));
  return [f.node, el('p.strong', {id: 'where-next'}, nextWords(first, target, w, h)), el('p.soft.small', t('calibrate.coverage.words', {n: all.length, empty, of: nx * ny}))];
}

const target_mark = (x, y) => [svg('circle', {class: 'target', cx: x, cy: y, r: 16}), svg('path', {class: 'target', d: `M${x - 24} ${y}H${x + 24}M${x} ${y - 24}V${y + 24}`})];

/// What the Scanner so far would gain most from, or else where no corner has been.
function nextWords(first, target, w, h) {
  if (!first) return t('calibrate.next.empty', {x: number(100 * target.x / w, 0), y: number(100 * target.y / h, 0)});
  const turn = first.about_x_deg ? t('calibrate.next.turn', {angle: number(first.about_x_deg, 0), axis: 'x'}) : first.about_y_deg ? t('calibrate.next.turn', {angle: number(first.about_y_deg, 0), axis: 'y'}) : t('calibrate.next.facing');
  return t('calibrate.next', {distance: number(first.distance_mm, 0), turn, now: number(1000 * first.worst_now_mm, 1), then: number(1000 * first.worst_mm, 1)});
}

/// The board as the camera saw it, with the corners that were found. data.seen[pose]: its corners.
function detection(data, pose, trouble) {
  const canvas = el('canvas.picture', {role: 'img', 'aria-label': t('calibrate.picture', {n: pose + 1})}), place = el('div.overlaid', canvas);
  const found = data.seen[pose] ?? null;
  get(`/api/calibration/picture?pose=${pose}`).then((picture) => {
    paint(canvas, picture, false);
    const w = picture.image_width_px, h = picture.image_height_px, r = w / 170;
    place.append(svg('svg', {viewBox: `0 0 ${w} ${h}`, 'aria-hidden': 'true', id: 'corners'},
      (found?.x_px ?? []).map((x, i) => svg('circle', {class: 'corner', cx: x + 0.5, cy: found.y_px[i] + 0.5, r}))));
  }).catch((error) => { trouble.textContent = error.message; });
  return [place, el('p.soft.small', found ? t('calibrate.found', {n: found.x_px.length, pose: pose + 1}) : t('calibrate.not.found', {pose: pose + 1}))];
}

/// What the calibration is uncertain by, over the plane through the volume.
function uncertainty(map) {
  const s = map.section;
  if (!s) return [el('p.soft', t('calibrate.map.later'))];
  const known = s.calibration_mm.filter((v) => v !== null), top = Math.max(...known), low = Math.min(...known), half = s.step_mm / 2;
  const f = frame({x: [s.first_x_mm - half, s.first_x_mm + (s.columns - 0.5) * s.step_mm], y: [s.first_y_mm - half, s.first_y_mm + (s.rows - 0.5) * s.step_mm], height: 400,
    xLabel: 'X / mm', yLabel: 'Y / mm', label: t('calibrate.map.label', {rms: number(1000 * map.rms_mm, 1), worst: number(1000 * map.worst_mm, 1)})});
  s.calibration_mm.forEach((v, k) => {
    if (v === null) return;
    const x = s.first_x_mm + (k % s.columns) * s.step_mm, y = s.first_y_mm + Math.floor(k / s.columns) * s.step_mm;
    f.add(svg('rect', {class: `heat heat${Math.min(7, Math.floor(8 * (v - low) / (top - low || 1)))}`, x: f.X(x - half), y: f.Y(y + half), width: f.X(half) - f.X(-half) + 0.5, height: f.Y(-half) - f.Y(half) + 0.5}));
  });
  const steps = Array.from({length: 8}, (_, i) => svg('rect', {class: `heat heat${i}`, x: 40 * i, y: 0, width: 40, height: 12}));
  return [f.node, el('div.deviation-scale', el('span', `${number(1000 * low, 1)} µm`), svg('svg', {viewBox: '0 0 320 12', 'aria-hidden': 'true', preserveAspectRatio: 'none'}, steps), el('span', `${number(1000 * top, 1)} µm`)),
    el('p.soft.small', t('calibrate.map.words', {rms: number(1000 * map.rms_mm, 1), worst: number(1000 * map.worst_mm, 1), z: number(s.at_mm, 0)})), map.open.map((line) => el('p.small', line))];
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

/// Residuals as lines from the corner, drawn so that a usual one is well seen.
function residuals(data) {
  const r = data.camera_residuals;
  const [w, h] = sizeOf(data), rms = Math.sqrt(r.residual_x_px.reduce((sum, v, i) => sum + v * v + r.residual_y_px[i] ** 2, 0) / (r.residual_x_px.length || 1));
  const kStretch = Number((0.012 * w / (rms || 1)).toPrecision(1));  // a usual one as long as a hundredth of the picture
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
  const head = el('section.card'), grid = el('div.wide'), below = el('section.card', {hidden: true}), picture = el('section.card'), trouble = el('p.trouble', {role: 'alert'});
  replace(main, el('h1', t('nav.calibrate')), head, grid, below, trouble);
  let key, chosen = null, drawn = 0;
  const card = (title, content) => el('section.card', el('h2', t(title)), content);
  const draw = async (c) => {
    const mine = ++drawn, data = await get('/api/calibration'), k = c.calibration, planned = c.poses_planned ?? 0;
    if (mine !== drawn) return;
    // Unless one is chosen: the newest whose corners are found, else the newest.
    const found = data.seen.reduce((last, s, i) => (s ? i : last), data.poses - 1), pose = Math.min(chosen ?? found, data.poses - 1);
    const showPose = (i) => {
      chosen = i;
      draw(c).catch((error) => { trouble.textContent = error.message; });
    };
    const tiles = el('ul.tiles', Array.from({length: planned}, (_, i) => (i < data.poses
      ? el(data.seen[i] ? 'li.done' : 'li', el('button', {type: 'button', 'aria-pressed': String(i === pose), 'aria-label': t('calibrate.show', {n: i + 1}), onclick: () => showPose(i)}, `✓ ${i + 1}`)) : el('li', String(i + 1)))));
    const result = k ?? data.residuals;
    replace(head, el('h2', t('calibrate.poses', {done: data.poses, of: planned})), tiles,
      result ? el('p', t(k ? 'calibrate.summary' : 'calibrate.so.far', {n: data.observations?.length ?? 0, px: number(result.camera_rms_px, 3), ...projector(result), board: number(1000 * result.grid_rms_mm, 1)}))
        : el('p.soft', t(data.poses ? 'calibrate.under.way' : 'calibrate.none')));
    if (!data.seen.some(Boolean)) {
      replace(grid);
      return;
    }
    const where = card('calibrate.coverage', coverage(data)), map = card('calibrate.map', el('p.soft', t(result ? 'cloud.loading' : 'calibrate.map.later')));
    replace(picture, el('h2', t('calibrate.detection')), pose >= 0 && detection(data, pose, trouble));
    replace(grid, picture, where, result && card('calibrate.residuals', residuals(data)), map, result && card('calibrate.volume', volume(data)),
      data.parameters && card('calibrate.parameters', parameters(data)));
    if (!result) return;
    const known = await get('/api/calibration/map');
    if (mine !== drawn) return;
    replace(where, el('h2', t('calibrate.coverage')), coverage(data, known.next));
    replace(map, el('h2', t('calibrate.map')), uncertainty(known));
  };
  return watch((state) => {
    const c = state.commissioning, now = JSON.stringify([c.poses, c.seen, c.so_far, c.calibration?.date, c.report?.date, document.documentElement.lang]);
    if (now === key) return;
    if (key) chosen = null;  // something new: the newest pose
    key = now;
    draw(c).catch((error) => { trouble.textContent = error.message; });
  });
}
