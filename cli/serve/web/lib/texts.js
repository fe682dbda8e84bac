// The words of the page, one catalogue per language, and numbers as that language writes them.

let words = {}, progress = [];
export let language = 'en';

export const kLanguages = ['en', 'de'];

export async function load(wanted) {
  language = kLanguages.includes(wanted) ? wanted : 'en';
  const response = await fetch(`/texts/${language}.json`);
  if (!response.ok) throw new Error(String(response.status));
  words = await response.json();
  progress = (words['progress.sentences'] ?? []).map(([from, to]) => [new RegExp(from), to]);
  document.documentElement.lang = language;
}

/// t('home.due', {days: 3}): {days} in the text is replaced. A missing word shows its key.
export function t(key, values = {}) {
  const text = words[key] ?? key;
  return text.replace(/\{(\w+)\}/g, (whole, name) => (name in values ? values[name] : whole));
}

export const has = (key) => key in words;

/// What a command says it is doing, in the page's language where the catalogue knows the sentence.
export function progressText(text) {
  for (const [from, to] of progress) if (from.test(text)) return text.replace(from, to);
  return text;
}

export function number(value, digits) {
  if (value === undefined || value === null) return '–';
  const options = digits === undefined ? {maximumSignificantDigits: 4} : {minimumFractionDigits: digits, maximumFractionDigits: digits};
  return new Intl.NumberFormat(language, options).format(value).replace('-', '−');
}

export function signed(value, digits) {
  return (value >= 0 ? '+' : '') + number(value, digits);
}

/// Decimals that leave two significant digits of an uncertainty [GUM, 7.2.6].
export function decimals(u) {
  return u > 0 ? Math.min(9, Math.max(0, 1 - Math.floor(Math.log10(u)))) : 4;
}

/// "+0.0059 ± 0.0010"; without an uncertainty three digits: "+2.13e-7"
export function plusMinus(value, U) {
  if (!(U > 0)) return (value >= 0 ? '+' : '−') + Math.abs(value).toPrecision(3);
  const digits = decimals(U);
  return `${signed(value, digits)} ± ${number(U, digits)}`;
}

export function when(date) {
  if (!date) return '–';
  return new Intl.DateTimeFormat(language, {dateStyle: 'medium', timeStyle: 'short'}).format(new Date(date));
}

export function minutes(seconds) {
  const s = Math.max(0, Math.round(seconds));
  return `${Math.floor(s / 60)}:${String(s % 60).padStart(2, '0')}`;
}
