// Asking the server; the newest state of the workbench for everybody on the page.

let state = null;
const watchers = new Set();

/// Calls back with every new state, and at once where there is one. Returns how to stop that.
export function watch(callback) {
  watchers.add(callback);
  if (state) callback(state);
  return () => watchers.delete(callback);
}

export function connect(onConnection) {
  const source = new EventSource('/api/events');
  source.addEventListener('state', (event) => {
    state = JSON.parse(event.data);
    onConnection(true);
    for (const callback of [...watchers]) callback(state);
  });
  source.addEventListener('error', async () => {
    onConnection(false);
    if (source.readyState !== EventSource.CLOSED) return;  // the browser tries again by itself
    setTimeout(() => connect(onConnection), 2000);
  });
}

async function answer(response) {
  const text = await response.text();
  if (response.ok) return text ? JSON.parse(text) : {};
  let sentence = text;
  try {
    sentence = JSON.parse(text).sentence ?? text;
  } catch {
    // plain text of the gate
  }
  throw new Error(sentence || String(response.status));
}

export const get = async (path) => answer(await fetch(path));

export const post = async (path, body = {}) => answer(await fetch(path, {
  method: 'POST', headers: {'Content-Type': 'application/json'}, body: JSON.stringify(body),
}));
