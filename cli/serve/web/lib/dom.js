// Building pieces of the page. Texts become text nodes only: nothing that a file holds can become markup.

const kSvg = 'http://www.w3.org/2000/svg';

function fill(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith('on')) node.addEventListener(name.slice(2), value);
    else if (name === 'value' || name === 'checked' || name === 'disabled' || name === 'selected') node[name] = value;
    else node.setAttribute(name, value === true ? '' : value);
  }
  for (const child of children.flat(Infinity)) {
    if (child === undefined || child === null || child === false || child === '') continue;
    node.append(child instanceof Node ? child : document.createTextNode(String(child)));
  }
  return node;
}

/// el('p.soft', {id: 'x'}, 'text', otherNode)
export function el(what, ...rest) {
  const attributes = rest.length && rest[0] && rest[0].constructor === Object ? rest.shift() : {};
  const [tag, ...classes] = what.split('.');
  const node = document.createElement(tag);
  if (classes.length) node.className = classes.join(' ');
  return fill(node, attributes, rest);
}

export function svg(tag, attributes = {}, ...children) {
  return fill(document.createElementNS(kSvg, tag), attributes, children);
}

export function replace(node, ...children) {
  node.replaceChildren(...children.flat(Infinity).filter((child) => child));
}

/// Says a change to those who do not see the page.
export function say(text) {
  document.getElementById('say').textContent = text;
}

export function table(head, rows, caption) {
  const cell = (kind, content, numeric) => el(numeric ? `${kind}.number` : kind, kind === 'th' ? {scope: 'col'} : {}, content);
  return el('div.scroll', {tabindex: '0', role: 'region', 'aria-label': caption},
    el('table', el('caption.unseen', caption),
      el('thead', el('tr', head.map((h) => cell('th', h.text ?? h, h.numeric)))),
      el('tbody', rows.map((row) => el('tr', row.map((content, i) => cell('td', content, head[i].numeric)))))));
}
