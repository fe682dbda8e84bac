// The page's frame: navigation, theme, language, the running job; each page is a module that fills <main>.
import {el, replace, say} from './lib/dom.js';
import {kLanguages, language, load, t} from './lib/texts.js';
import {connect, watch} from './lib/server.js';
import {showJob} from './lib/job.js';

const kPages = ['home', 'live', 'align', 'calibrate', 'verify', 'cloud', 'history'];
const main = document.getElementById('main');
let leave = () => {};
let visit = 0;

const stored = (key) => localStorage.getItem(`fringecal.${key}`);
const store = (key, value) => localStorage.setItem(`fringecal.${key}`, value);

function current() {
  const name = location.hash.replace(/^#\//, '').split('?')[0];
  return kPages.includes(name) ? name : 'home';
}

function showNavigation() {
  replace(document.getElementById('nav'), el('ul', kPages.map((name) => el('li',
    el('a', {href: `#/${name}`, 'aria-current': name === current() ? 'page' : null}, t(`nav.${name}`))))));
  document.getElementById('nav').setAttribute('aria-label', t('nav.label'));
  document.getElementById('skip').textContent = t('nav.skip');
  document.getElementById('theme').textContent = t(theme() === 'dark' ? 'theme.light' : 'theme.dark');
  document.getElementById('language').textContent = t('language.other');
  document.getElementById('language').lang = kLanguages.find((l) => l !== language);
}

function theme() {
  return stored('theme') ?? (matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light');
}

function applyTheme() {
  document.documentElement.dataset.theme = theme();
}

/// Pages export show(main) and return what ends them. focus: after a change of page, not at the first.
async function show(focus) {
  const name = current(), mine = ++visit;
  leave();
  leave = () => {};
  showNavigation();
  document.title = `${t(`nav.${name}`)} – fringecal`;
  const module = await import(`./pages/${name}.js`);
  if (mine !== visit) return;
  replace(main);
  leave = module.show(main) ?? (() => {});
  if (focus) {
    main.focus();
    say(t(`nav.${name}`));
  }
}

function onConnection(good) {
  const banner = document.getElementById('connection');
  banner.hidden = good;
  if (!good) banner.textContent = t('connection.lost');
}

document.getElementById('theme').addEventListener('click', () => {
  store('theme', theme() === 'dark' ? 'light' : 'dark');
  applyTheme();
  showNavigation();
});
document.getElementById('language').addEventListener('click', async () => {
  store('language', kLanguages.find((l) => l !== language));
  await load(stored('language'));
  show(false);
});
document.getElementById('skip').addEventListener('click', (event) => {
  event.preventDefault();
  main.focus();
});
addEventListener('hashchange', () => show(true));

applyTheme();
await load(stored('language') ?? navigator.language.slice(0, 2));
connect(onConnection);
watch(showJob);
await show(false);
