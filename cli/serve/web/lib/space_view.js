// A verification in space: the fields of camera and code, where the artefacts shall stand and where they stood, and the
// points of each fit coloured by their deviation from it.
import {el, replace} from './dom.js';
import {number, t} from './texts.js';
import {parsePly} from './ply.js';
import {get} from './server.js';

const kField = 0x7f93a8, kCode = 0x5f7f5f, kMissing = 0xffc46b, kDone = 0x7fdca0, kChosen = 0xffffff;
const kFrom = [0.45, -0.55, 1];

const three = (flat) => Array.from({length: flat.length / 3}, (_, i) => flat.slice(3 * i, 3 * i + 3));

/// Outlines of one field at several heights, and lines that join their corners.
function fieldLines(outlines, colour) {
  const out = outlines.map((flat) => ({points: [...flat, ...flat.slice(0, 3)], colour}));
  const corners = outlines.map(three);
  for (let k = 0; k < (corners[0]?.length ?? 0); ++k) out.push({points: corners.flatMap((c) => c[k] ?? []), colour});
  return out;
}

/// A cross where only the place is known.
function cross([x, y, z]) {
  const a = 8;
  return [[x - a, y, z, x + a, y, z], [x, y - a, z, x, y + a, z], [x, y, z - a, x, y, z + a]];
}

function joined(clouds) {
  const n = clouds.reduce((sum, c) => sum + c.n, 0), columns = {};
  for (const key of ['x', 'y', 'z', 'deviation']) columns[key] = new Float32Array(n);
  let at = 0;
  for (const cloud of clouds) {
    for (const key of Object.keys(columns)) columns[key].set(cloud.columns[key], at);
    at += cloud.n;
  }
  return {n, columns};
}

/// From where an artefact was planned to where it was found: of a fit without a diameter, a plane, only along its normal.
function shiftOf(artefact, fits) {
  const own = fits.filter((f) => f.artefact === artefact.name);
  if (!own.length) return [0, 0, 0];
  const shift = [0, 1, 2].map((k) => own.reduce((sum, f) => sum + f.place_mm[k], 0) / own.length - artefact.place[k]);
  if (own[0].diameter_mm !== undefined || !artefact.lines) return shift;
  const [a, b, c] = three(artefact.lines[0]), u = b.map((v, k) => v - a[k]), v = c.map((w, k) => w - b[k]);
  const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]], length = Math.hypot(...n);
  const along = shift.reduce((sum, s, k) => sum + s * n[k] / length, 0);
  return n.map((m) => along * m / length);
}

/// The deviation that all but one of forty points stay below; the scale goes as far to either side.
function scaleOf(deviations) {
  const step = Math.max(1, Math.floor(deviations.length / 20000));
  const sizes = deviations.filter((_, i) => i % step === 0).map(Math.abs).sort();
  return sizes[Math.floor(0.975 * (sizes.length - 1))] || 1e-3;
}

export class SpaceView {
  /// name: of the verification. onChoose(position): one was chosen, or none (null).
  constructor(name, onChoose) {
    this.name = name;
    this.onChoose = onChoose;
    this.kept = new Map();
    this.chosen = null;
    this.canvas = el('canvas', {tabindex: '0', role: 'img', id: 'space'});
    this.legend = el('p.soft.small');
    this.scale = el('div.deviation-scale', {hidden: true}, el('span'), el('i', {'aria-hidden': 'true'}), el('span'));
    this.tiles = el('div');
    this.trouble = el('p.trouble', {role: 'alert'});
    this.node = el('div', this.canvas, this.scale, this.legend, this.trouble);
    const keys = {ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1], '+': 0.9, '-': 1.1};
    this.canvas.addEventListener('keydown', (event) => {
      const move = keys[event.key];
      if (!move || !this.view) return;
      event.preventDefault();
      if (move.length) this.view.turn(...move);
      else this.view.zoom(move);
    });
  }

  end() {
    this.ended = true;
    this.view?.end();
  }

  async open() {
    let module;
    try {
      module = await import('./cloud_view.js');
    } catch {
      this.trouble.textContent = t('cloud.no.three');
      return;
    }
    if (this.ended || this.view) return;
    try {
      this.view = new module.CloudView(this.canvas, (n) => { this.canvas.dataset.shown = n; });
      this.view.centre = [0, 0, 0];
    } catch {
      this.trouble.textContent = t('cloud.no.webgl');
    }
  }

  /// Reads what is there now, and draws it.
  async update() {
    this.space = await get(`/api/verification/space?name=${encodeURIComponent(this.name)}`);
    this.chosen = this.space.positions.find((p) => p.capture === this.chosen?.capture) ?? null;
    this.onChoose(this.chosen);
    this.canvas.setAttribute('aria-label', this.words());
    this.legend.textContent = this.words();
    this.showTiles();
    for (const fit of this.space.positions.flatMap((p) => p.fits ?? []).filter((f) => f.cloud)) {
      if (this.kept.has(fit.cloud)) continue;
      const response = await fetch(`/api/verification/cloud?name=${encodeURIComponent(this.name)}&cloud=${encodeURIComponent(fit.cloud)}`);
      if (this.ended) return;
      if (response.ok) this.kept.set(fit.cloud, parsePly(await response.arrayBuffer()));
    }
    await this.open();
    if (this.ended || !this.view) return;
    this.draw();
  }

  words() {
    const {positions} = this.space, done = positions.filter((p) => p.fits).length;
    return t('space.words', {done, of: positions.length});
  }

  linesOf(position) {
    const colour = position.capture === this.chosen?.capture ? kChosen : this.chosen ? kField : position.fits ? kDone : kMissing;
    return position.artefacts.flatMap((artefact) => {
      const shift = shiftOf(artefact, position.fits ?? []);
      return (artefact.lines ?? cross(artefact.place)).map((points) => ({points: points.map((v, i) => v + shift[i % 3]), colour, dashed: !position.fits}));
    });
  }

  draw() {
    const {camera = [], code = [], positions} = this.space, of = this.chosen ? [this.chosen] : positions;
    const clouds = of.flatMap((p) => p.fits ?? []).filter((f) => this.kept.has(f.cloud)), key = clouds.map((f) => f.cloud).join(' ');
    if (key !== this.key) {
      this.key = key;
      const all = joined(clouds.map((f) => this.kept.get(f.cloud))), d = all.columns.deviation, limit = scaleOf(d);
      this.view.set(all, Array.from({length: all.n}, (_, i) => i), (i) => d[i], [-limit, limit]);
      const [low, , high] = this.scale.children;
      low.textContent = `${number(-limit, 3)} mm`;
      high.textContent = `${number(limit, 3)} mm`;
      this.scale.hidden = !all.n;
    }
    this.view.setLines([...fieldLines(camera, kField), ...fieldLines(code, kCode), ...positions.flatMap((p) => this.linesOf(p))]);
    if (this.looked) return;
    this.looked = true;
    this.view.resize();
    this.view.look(kFrom);
  }

  showTiles() {
    const scenes = [...new Set(this.space.positions.map((p) => p.scene))];
    replace(this.tiles, scenes.map((scene) => el('div', el('h3.small', scene), el('ul.tiles', this.space.positions.filter((p) => p.scene === scene).map((p) =>
      el(p.fits ? 'li.done' : 'li', el('button', {type: 'button', 'aria-pressed': String(p.capture === this.chosen?.capture),
        'aria-label': t(p.fits ? 'verify.capture.done' : 'verify.capture.missing', {n: p.number}), onclick: () => this.choose(p)}, p.fits ? `✓ ${p.number}` : String(p.number))))))));
  }

  choose(position) {
    this.chosen = this.chosen?.capture === position.capture ? null : position;
    this.showTiles();
    this.onChoose(this.chosen);
    if (!this.view) return;
    this.draw();
    const places = (this.chosen?.fits ?? []).map((f) => f.place_mm), planned = (this.chosen?.artefacts ?? []).map((a) => a.place), at = places.length ? places : planned;
    if (!at.length) {
      this.view.look(kFrom);
      return;
    }
    const middle = [0, 1, 2].map((k) => at.reduce((sum, p) => sum + p[k], 0) / at.length);
    this.view.approach(middle, 40 + Math.max(...at.map((p) => Math.hypot(...p.map((v, k) => v - middle[k])))));
  }
}
