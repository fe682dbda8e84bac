// Point clouds: any PLY, coloured, cut, measured, filtered, saved.
import {el, replace, say} from '../lib/dom.js';
import {number, t} from '../lib/texts.js';
import {get, watch} from '../lib/server.js';
import {start} from '../lib/job.js';
import {parsePly, writePly} from '../lib/ply.js';
import {planeDeviation, smoothed, withoutOutliers} from '../lib/cloud_filters.js';

const kAxes = ['x', 'y', 'z'];
const kColours = {height: 'z', uncertainty: 'u_mm', quality: 'modulation'};

function spread(values) {
  const sample = values.filter((v) => Number.isFinite(v)).sort((a, b) => a - b);
  return [sample[Math.floor(0.01 * sample.length)], sample[Math.floor(0.99 * (sample.length - 1))]];
}

export function show(main) {
  let view = null, cloud = null, kept = [], name = '', picked = [], ended = false;
  const message = el('p', {role: 'status'}), trouble = el('p.trouble', {role: 'alert'}), shown = el('p.soft.small', {id: 'shown'}), scale = el('p.soft.small');
  const canvas = el('canvas', {tabindex: '0', role: 'img', 'aria-label': t('cloud.canvas')});
  const panel = el('div.panel.card'), source = el('section.card');
  replace(main, el('h1', t('nav.cloud')), source, el('div.view', el('div', el('div.cloud-place', canvas), shown, scale, message, trouble), panel));

  const paint = (kind) => {
    const c = cloud.columns, key = kColours[kind] ?? '';
    const values = kind === 'deviation' ? planeDeviation(cloud, kept) : (i) => c[key][i];
    const step = Math.max(1, Math.floor(kept.length / 20000)), range = spread(kept.filter((_, k) => k % step === 0).map(values));
    view.set(cloud, kept, values, range);
    scale.textContent = `${t('cloud.colour')}: ${number(range[0])} … ${number(range[1])}${kind === 'quality' ? '' : ' mm'}`;
  };
  const pick = (px, py) => {
    const p = view.pick(px, py);
    if (!p) return;
    picked = picked.length === 2 ? [p] : [...picked, p];
    view.mark(picked);
    const d = picked.length === 2 ? picked[1].map((v, i) => v - picked[0][i]) : null;
    message.textContent = d ? t('cloud.distance', {d: number(Math.hypot(...d), 3), x: number(d[0], 3), y: number(d[1], 3), z: number(d[2], 3)})
      : p.map((v) => number(v, 3)).join(' / ');
  };
  const button = (text, action, id) => el('button', {type: 'button', id, onclick: action}, text);
  const buildPanel = () => {
    const colours = ['height', 'deviation', ...['uncertainty', 'quality'].filter((k) => cloud.columns[kColours[k]])];
    const colour = el('select', {id: 'colour', onchange: () => paint(colour.value)}, colours.map((k) => el('option', {value: k}, t(`cloud.colour.${k}`))));
    const bounds = kAxes.map((a) => kept.reduce(([low, high], i) => [Math.min(low, cloud.columns[a][i]), Math.max(high, cloud.columns[a][i])], [Infinity, -Infinity]));
    const cut = el('input', {type: 'range', min: '0', max: '1', step: '0.005', value: '1', 'aria-label': t('cloud.section.at'), oninput: () => section()});
    const axis = el('select', {id: 'axis', onchange: () => section()}, el('option', {value: ''}, t('cloud.section.off')), kAxes.map((a) => el('option', {value: a}, a.toUpperCase())));
    const section = () => {
      const k = kAxes.indexOf(axis.value);
      view.section(k < 0 ? null : k, k < 0 ? 0 : bounds[k][0] + Number(cut.value) * (bounds[k][1] - bounds[k][0]));
    };
    const box = kAxes.map((a, k) => bounds[k].map((v, end) => el('input', {type: 'number', step: 'any', value: String(end ? Math.ceil(v) : Math.floor(v)),
      'aria-label': `${a.toUpperCase()} ${t(end ? 'cloud.crop.to' : 'cloud.crop.from')}`})));
    const change = (next, text) => {
      kept = next;
      say(text);
      message.textContent = text;
      paint(colour.value);
    };
    /// One at a time; what was asked of a cloud that is gone by then is dropped.
    const filter = async (work) => {
      const mine = cloud, buttons = panel.querySelectorAll('button');
      for (const b of buttons) b.disabled = true;
      const apply = await work((share) => { message.textContent = t('cloud.working', {percent: number(100 * share, 0)}); });
      for (const b of buttons) b.disabled = false;
      if (!ended && mine === cloud) apply();
    };
    replace(panel,
      el('label', t('cloud.colour'), colour),
      el('label', t('cloud.section'), axis), cut,
      el('div.row', button(t('cloud.view.front'), () => view.look([0, 0, 1])), button(t('cloud.view.side'), () => view.look([1, 0, 0.2])), button(t('cloud.view.top'), () => view.look([0, 1, 0.01]))),
      el('p.small', `${t('cloud.measure')}: ${t('cloud.measure.words')}`),
      el('details', el('summary', t('cloud.crop')), box.map((pair, k) => el('div.row', kAxes[k].toUpperCase(), pair)),
        button(t('cloud.crop'), () => {
          const limits = box.map((pair) => pair.map((input) => Number(input.value))), before = kept.length;
          const next = kept.filter((i) => kAxes.every((a, k) => cloud.columns[a][i] >= limits[k][0] && cloud.columns[a][i] <= limits[k][1]));
          if (next.length) change(next, t('cloud.removed', {n: number(before - next.length, 0)}));
        }, 'crop')),
      el('div.row', button(t('cloud.outliers'), () => filter(async (share) => {
        const before = kept.length, next = await withoutOutliers(cloud, kept, share);
        return () => next.length && change(next, t('cloud.removed', {n: number(before - next.length, 0)}));
      }), 'outliers'), button(t('cloud.smooth'), () => filter(async (share) => {
        const {columns, moved, rms} = await smoothed(cloud, kept, share);
        return () => {
          cloud = {...cloud, columns};
          change(kept, t('cloud.smoothed', {n: number(moved, 0), rms: number(rms, 4)}));
        };
      }), 'smooth')),
      el('div.row', button(t('cloud.uncrop'), () => open(name, cloud.buffer)), button(t('cloud.save'), () => {
        const link = el('a', {href: URL.createObjectURL(writePly(cloud, kept)), download: name.replace(/(\.ply)?$/i, '-edited.ply')});
        link.click();
        setTimeout(() => URL.revokeObjectURL(link.href), 5000);
      }, 'save')));
  };
  const open = async (label, buffer) => {
    trouble.textContent = '';
    try {
      const parsed = parsePly(buffer);
      if (ended) return;
      cloud = {...parsed, buffer};
    } catch (error) {
      trouble.textContent = t('cloud.bad', {file: label, why: error.message});
      return;
    }
    name = label;
    kept = Array.from({length: cloud.n}, (_, i) => i).filter((i) => Number.isFinite(cloud.columns.x[i] + cloud.columns.y[i] + cloud.columns.z[i]));
    picked = [];
    view.centre = null;
    view.resize();
    paint('height');
    view.look([0.25, 0.35, 1]);
    view.mark([]);
    buildPanel();
  };
  const keys = {ArrowLeft: () => view.turn(-0.1, 0), ArrowRight: () => view.turn(0.1, 0), ArrowUp: () => view.turn(0, -0.1), ArrowDown: () => view.turn(0, 0.1),
    '+': () => view.zoom(0.9), '-': () => view.zoom(1.1), Enter: () => pick(0, 0)};
  let down = null;
  canvas.addEventListener('keydown', (event) => {
    if (!view || !cloud || !keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
  });
  canvas.addEventListener('pointerdown', (event) => { down = [event.clientX, event.clientY]; });
  canvas.addEventListener('pointerup', (event) => {
    if (!cloud || !down || Math.hypot(event.clientX - down[0], event.clientY - down[1]) > 4) return;
    const box = canvas.getBoundingClientRect();
    pick(2 * (event.clientX - box.left) / box.width - 1, 1 - 2 * (event.clientY - box.top) / box.height);
  });
  const fetchCloud = async (file) => {
    message.textContent = t('cloud.loading');
    const response = await fetch(`/api/cloud?name=${encodeURIComponent(file)}`);
    message.textContent = '';
    if (response.ok) await open(file, await response.arrayBuffer());
  };
  const list = async () => {
    const {clouds, captures} = await get('/api/clouds');
    const choose = el('select', {id: 'cloud', onchange: () => fetchCloud(choose.value)}, clouds.map((c) => el('option', {value: c.name}, `${c.name} (${number(c.bytes / 1e6, 0)} MB)`)));
    const from = el('select', {id: 'capture'}, captures.map((c) => el('option', {value: c}, c)));
    const file = el('input', {type: 'file', accept: '.ply', onchange: async () => { if (file.files[0]) await open(file.files[0].name, await file.files[0].arrayBuffer()); }});
    replace(source, el('div.row', clouds.length ? el('label', t('cloud.choose'), choose) : el('p', t('cloud.none')), el('label', t('cloud.file'), file),
      captures.length && el('label', t('cloud.make'), from), captures.length && button(t('cloud.do.make'), () => start({command: 'measure', capture: from.value}, trouble), 'measure')));
    if (clouds.length && !cloud) await fetchCloud(choose.value);
  };
  (async () => {
    try {
      const {CloudView} = await import('../lib/cloud_view.js');
      if (ended) return;
      try {
        view = new CloudView(canvas, (n) => { shown.textContent = t('cloud.points', {shown: number(n, 0), n: number(kept.length, 0)}); });
      } catch {
        trouble.textContent = t('cloud.no.webgl');
        return;
      }
    } catch {
      trouble.textContent = t('cloud.no.three');
      return;
    }
    let key;
    stop = watch((state) => {
      const now = `${state.job.number} ${state.job.state}`;
      if (key === now) return;
      key = now;
      list().catch((error) => { trouble.textContent = error.message; });
    });
  })();
  let stop = () => {};
  return () => {
    ended = true;
    stop();
    view?.end();
  };
}
