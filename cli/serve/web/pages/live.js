// The camera's picture from the capture path itself, and figures to turn a ring by.
import {el, replace, svg} from '../lib/dom.js';
import {number, t} from '../lib/texts.js';
import {paint} from '../lib/picture.js';

function histogram(shares) {
  const top = Math.sqrt(Math.max(...shares)) || 1, n = shares.length;  // roots: small classes stay visible
  return svg('svg', {viewBox: '0 0 320 90', role: 'img', 'aria-label': t('live.histogram')},
    shares.map((s, i) => svg('rect', {class: i === n - 1 ? 'bad' : 'dot', x: 320 * i / n + 1, width: 320 / n - 2, y: 85 - 80 * Math.sqrt(s) / top, height: 80 * Math.sqrt(s) / top})),
    svg('path', {class: 'axis', d: 'M0 85H320'}));
}

export function show(main) {
  const canvas = el('canvas.picture', {role: 'img', 'aria-label': t('live.picture'), width: '480', height: '358'});
  const figures = el('dl'), bars = el('div'), trouble = el('p.trouble', {role: 'alert'});
  const whose = el('p.soft.small', {id: 'whose'}, t('live.none'));
  const mark = el('input', {type: 'checkbox', id: 'mark', checked: true});
  const button = el('button.primary', {type: 'button', id: 'live', onclick: () => (source ? stop() : begin())}, t('live.start'));
  let source = null, best = 0, times = [];
  replace(main, el('h1', t('nav.live')), el('div.view', el('div', canvas),
    el('section.card.panel', button, el('label.inline', mark, t('live.mark')), whose, figures, bars, trouble)));
  const row = (label, value, id) => [el('dt', label), el('dd', {id}, value)];
  const stop = () => {
    source?.close();
    source = null;
    button.textContent = t('live.start');
  };
  const show = (frame) => {
    const begin = performance.now();
    times = [...times.filter((time) => begin - time < 2000), begin];
    const rate = times.length > 1 ? 1000 * (times.length - 1) / (begin - times[0]) : 0;
    best = Math.max(best, frame.sharpness);
    paint(canvas, frame, mark.checked);
    whose.textContent = t(frame.capture ? 'live.of.job' : 'live.none');
    replace(figures, [row(t('live.sharpness'), `${number(frame.sharpness, 5)} (${t('live.best', {percent: number(100 * frame.sharpness / best, 0)})})`, 'sharpness'),
      row(t('live.level'), `${number(100 * frame.level, 1)} %`), row(t('live.saturated'), `${number(100 * frame.saturated, 3)} %`),
      row(t('live.modulation'), frame.modulation === undefined ? t('live.unlit') : `${number(100 * frame.modulation, 1)} %`),
      frame.capture ? row(t('live.capture'), `${frame.capture}, ${frame.frame}`, 'capture') : row(t('live.rate'), number(rate, 1), 'rate')]);
    replace(bars, histogram(frame.histogram));
    canvas.dataset.ms = (performance.now() - begin).toFixed(1);
  };
  const begin = () => {
    trouble.textContent = '';
    best = 0;
    times = [];
    button.textContent = t('live.stop');
    source = new EventSource('/api/live');
    source.addEventListener('job', () => { whose.textContent = t('live.of.job'); });
    source.addEventListener('live', (event) => show(JSON.parse(event.data)));
    source.addEventListener('trouble', (event) => {
      trouble.textContent = event.data;
      stop();
    });
    // A job that begins or ends changes whose the pictures are: the browser asks again by itself.
    source.addEventListener('error', () => { if (source?.readyState === EventSource.CLOSED) stop(); });
  };
  return stop;
}
