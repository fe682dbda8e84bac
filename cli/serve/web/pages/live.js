// The camera's picture from the capture path itself, and figures to turn a ring by.
import {el, replace, svg} from '../lib/dom.js';
import {number, t} from '../lib/texts.js';
import {running} from '../lib/job.js';

const kSaturated = [230, 30, 60];

function paint(canvas, frame, mark) {
  const bytes = Uint8Array.from(atob(frame.grey_base64), (c) => c.charCodeAt(0));
  if (canvas.width !== frame.width_px || canvas.height !== frame.height_px) {
    canvas.width = frame.width_px;
    canvas.height = frame.height_px;
  }
  const context = canvas.getContext('2d'), image = context.createImageData(frame.width_px, frame.height_px), p = image.data;
  bytes.forEach((v, i) => {
    const over = mark && v === 255;
    p[4 * i] = over ? kSaturated[0] : v;
    p[4 * i + 1] = over ? kSaturated[1] : v;
    p[4 * i + 2] = over ? kSaturated[2] : v;
    p[4 * i + 3] = 255;
  });
  context.putImageData(image, 0, 0);
}

function histogram(shares) {
  const top = Math.sqrt(Math.max(...shares)) || 1, n = shares.length;  // roots: small classes stay visible
  return svg('svg', {viewBox: '0 0 320 90', role: 'img', 'aria-label': t('live.histogram')},
    shares.map((s, i) => svg('rect', {class: i === n - 1 ? 'bad' : 'dot', x: 320 * i / n + 1, width: 320 / n - 2, y: 85 - 80 * Math.sqrt(s) / top, height: 80 * Math.sqrt(s) / top})),
    svg('path', {class: 'axis', d: 'M0 85H320'}));
}

export function show(main) {
  const canvas = el('canvas.picture', {role: 'img', 'aria-label': t('live.picture'), width: '480', height: '358'});
  const figures = el('dl'), bars = el('div'), trouble = el('p.trouble', {role: 'alert'});
  const mark = el('input', {type: 'checkbox', id: 'mark', checked: true});
  const button = el('button.primary', {type: 'button', id: 'live', onclick: () => (source ? stop() : begin())}, t('live.start'));
  let source = null, best = 0, times = [];
  replace(main, el('h1', t('nav.live')), el('div.view', el('div', canvas),
    el('section.card.panel', button, el('label.inline', mark, t('live.mark')), el('p.soft.small', t('live.none')), figures, bars, trouble)));
  const row = (label, value, id) => [el('dt', label), el('dd', {id}, value)];
  const stop = () => {
    source?.close();
    source = null;
    button.textContent = t('live.start');
  };
  const show = (frame) => {
    const now = performance.now();
    times = [...times.filter((time) => now - time < 2000), now];
    const rate = times.length > 1 ? 1000 * (times.length - 1) / (now - times[0]) : 0;
    best = Math.max(best, frame.sharpness);
    paint(canvas, frame, mark.checked);
    replace(figures, [row(t('live.sharpness'), `${number(frame.sharpness, 5)} (${t('live.best', {percent: number(100 * frame.sharpness / best, 0)})})`, 'sharpness'),
      row(t('live.level'), `${number(100 * frame.level, 1)} %`), row(t('live.saturated'), `${number(100 * frame.saturated, 3)} %`),
      row(t('live.modulation'), frame.modulation === undefined ? t('live.unlit') : `${number(100 * frame.modulation, 1)} %`),
      row(t('live.rate'), number(rate, 1), 'rate')]);
    replace(bars, histogram(frame.histogram));
  };
  const begin = () => {
    trouble.textContent = running() ? t('live.busy') : '';
    if (running()) return;
    best = 0;
    times = [];
    button.textContent = t('live.stop');
    source = new EventSource('/api/live');
    source.addEventListener('live', (event) => show(JSON.parse(event.data)));
    source.addEventListener('trouble', (event) => {
      trouble.textContent = event.data;
      stop();
    });
    source.addEventListener('error', stop);
  };
  return stop;
}
