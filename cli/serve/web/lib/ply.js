// PLY: point clouds of any program, binary (little endian) or as text. Columns become arrays of their own.

const kTypes = {
  char: ['getInt8', 1, Int8Array], int8: ['getInt8', 1, Int8Array], uchar: ['getUint8', 1, Uint8Array], uint8: ['getUint8', 1, Uint8Array],
  short: ['getInt16', 2, Int16Array], int16: ['getInt16', 2, Int16Array], ushort: ['getUint16', 2, Uint16Array], uint16: ['getUint16', 2, Uint16Array],
  int: ['getInt32', 4, Int32Array], int32: ['getInt32', 4, Int32Array], uint: ['getUint32', 4, Uint32Array], uint32: ['getUint32', 4, Uint32Array],
  float: ['getFloat32', 4, Float32Array], float32: ['getFloat32', 4, Float32Array], double: ['getFloat64', 8, Float64Array], float64: ['getFloat64', 8, Float64Array],
};

function header(buffer) {
  const text = new TextDecoder('latin1').decode(buffer.slice(0, 65536)), end = text.search(/end_header\r?\n/);
  if (!/^ply\r?\n/.test(text) || end < 0) throw new Error('header');
  const out = {start: text.indexOf('\n', end) + 1, format: '', n: 0, properties: []};
  let element = '', before = true;
  for (const line of text.slice(0, end).split(/\r?\n/)) {
    const w = line.trim().split(/\s+/);
    if (w[0] === 'format') out.format = w[1];
    if (w[0] === 'element') {
      if (element === 'vertex') before = false;
      element = w[1];
      if (element === 'vertex') out.n = Number(w[2]);
      else if (before && Number(w[2]) > 0) throw new Error('element order');
    }
    if (w[0] === 'property' && element === 'vertex') {
      if (!kTypes[w[1]]) throw new Error(`property ${w[1]}`);
      out.properties.push({type: w[1], name: w[2]});
    }
  }
  for (const axis of ['x', 'y', 'z']) if (!out.properties.some((p) => p.name === axis)) throw new Error(`no ${axis}`);
  if (!Number.isSafeInteger(out.n) || out.n < 1) throw new Error('vertex');
  return out;
}

/// {n, properties, columns: {x: Float64Array, ...}}. Throws Error with the part that cannot be read.
export function parsePly(buffer) {
  const h = header(buffer), columns = {};
  for (const p of h.properties) columns[p.name] = new kTypes[p.type][2](0);
  if (h.format === 'binary_little_endian') {
    const stride = h.properties.reduce((sum, p) => sum + kTypes[p.type][1], 0);
    if (h.start + h.n * stride > buffer.byteLength) throw new Error('length');
    const view = new DataView(buffer, h.start);
    let offset = 0;
    for (const p of h.properties) {
      const [get, size, Kind] = kTypes[p.type], column = new Kind(h.n);
      for (let i = 0, at = offset; i < h.n; ++i, at += stride) column[i] = view[get](at, true);
      columns[p.name] = column;
      offset += size;
    }
  } else if (h.format === 'ascii') {
    const words = new TextDecoder('latin1').decode(buffer.slice(h.start)).trim().split(/\s+/), m = h.properties.length;
    if (words.length < h.n * m) throw new Error('length');
    h.properties.forEach((p, j) => { columns[p.name] = kTypes[p.type][2].from({length: h.n}, (_, i) => Number(words[i * m + j])); });
  } else {
    throw new Error(`format ${h.format}`);
  }
  return {n: h.n, properties: h.properties, columns};
}

/// The points of `kept` (indices), binary, with all their properties.
export function writePly(cloud, kept) {
  const lines = ['ply', 'format binary_little_endian 1.0', 'comment fringecal serve', `element vertex ${kept.length}`,
    ...cloud.properties.map((p) => `property ${p.type} ${p.name}`), 'end_header', ''];
  const set = cloud.properties.map((p) => [kTypes[p.type][0].replace('get', 'set'), kTypes[p.type][1], cloud.columns[p.name]]);
  const stride = set.reduce((sum, [, size]) => sum + size, 0), body = new DataView(new ArrayBuffer(kept.length * stride));
  let at = 0;
  for (const i of kept) for (const [put, size, column] of set) {
    body[put](at, column[i], true);
    at += size;
  }
  return new Blob([lines.join('\n'), body.buffer], {type: 'application/octet-stream'});
}
