// The job that runs, at the foot of every page, and buttons that start one.
import {el, replace, say} from './dom.js';
import {minutes, progressText, t} from './texts.js';
import {post} from './server.js';

const foot = document.getElementById('job');
let shown = '', parts = null;

async function stop(button) {
  button.disabled = true;
  try {
    await post('/api/job/stop');
    say(t('job.stopping'));
  } catch (error) {
    say(error.message);
  }
  setTimeout(() => { button.disabled = false; }, 3000);
}

function build() {
  const button = el('button', {type: 'button', id: 'stop', onclick: () => stop(button)}, t('job.stop'));
  parts = {what: el('span'), bar: el('progress', {max: '1', 'aria-label': t('job.progress')}), lines: el('pre', {tabindex: '0'}), button};
  replace(foot, el('div', parts.what, parts.bar), button,
    el('details', el('summary', t('job.lines')), parts.lines));
}

export function showJob(state) {
  const {job} = state;
  const key = `${job.number} ${job.state} ${document.documentElement.lang}`;
  const changed = key !== shown;
  foot.hidden = job.state === 'none' || (job.state === 'ended' && job.exit_code === 0);
  if (changed) {
    shown = key;
    build();
    foot.dataset.state = job.state;
    if (job.state === 'running') say(t('job.begun', {command: t(`command.${job.arguments[0]}`)}));
    if (job.state === 'ended') say(job.exit_code === 0 ? t('job.done') : t('job.failed'));
  }
  const name = t(`command.${job.arguments?.[0]}`);
  parts.button.hidden = job.state !== 'running';
  parts.bar.hidden = job.state !== 'running';
  if (job.state === 'running') {
    const p = job.progress;
    if (p) parts.bar.value = p.fraction;
    else parts.bar.removeAttribute('value');
    parts.what.textContent = p ? `${name}: ${progressText(p.what)} · ${Math.round(100 * p.fraction)} %` +
      (p.left_s === undefined ? '' : ` · ${t('job.left', {time: minutes(p.left_s)})}`) : `${name} …`;
  } else if (job.state === 'ended' && job.exit_code !== 0) {
    const why = job.exit_code === 130 ? t('job.stopped') : (job.lines.at(-1) ?? '').replace(/^fringecal: /, '');
    parts.what.textContent = `${name}: ${why}`;
  } else if (job.state === 'broken') {
    parts.what.textContent = `${name}: ${t('job.broken')}`;
  }
  const text = (job.lines ?? []).join('\n');
  if (parts.lines.textContent !== text) {
    parts.lines.textContent = text;
    parts.lines.scrollTop = parts.lines.scrollHeight;
  }
}

/// Starts a command; what the server says against it appears in `answer`.
export async function start(request, answer) {
  answer.textContent = '';
  try {
    await post('/api/job/start', request);
    return true;
  } catch (error) {
    answer.textContent = error.message;
    return false;
  }
}
