// Post-processing of a cloud in the browser: for looking and cutting, not for results. The filters use the camera's
// pixel grid, so they need the columns pixel_x and pixel_y of `fringecal measure`.

/// Plane z = a + b x + c y by least squares; its deviations along z. For colouring.
export function planeDeviation({columns: {x, y, z}}, kept) {
  let sx = 0, sy = 0, sz = 0;
  for (const i of kept) { sx += x[i]; sy += y[i]; sz += z[i]; }
  const n = kept.length, mx = sx / n, my = sy / n, mz = sz / n;
  let xx = 0, xy = 0, yy = 0, xz = 0, yz = 0;
  for (const i of kept) {
    const dx = x[i] - mx, dy = y[i] - my, dz = z[i] - mz;
    xx += dx * dx; xy += dx * dy; yy += dy * dy; xz += dx * dz; yz += dy * dz;
  }
  const det = xx * yy - xy * xy || 1, b = (xz * yy - yz * xy) / det, c = (yz * xx - xz * xy) / det;
  return (i) => z[i] - mz - b * (x[i] - mx) - c * (y[i] - my);
}

function grid({columns: {pixel_x: px, pixel_y: py}}, kept) {
  const width = 2 + kept.reduce((most, i) => Math.max(most, px[i]), 0), at = new Map();
  for (const i of kept) at.set(Math.round(py[i]) * width + Math.round(px[i]), i);
  return (i) => {
    const out = [], key = Math.round(py[i]) * width + Math.round(px[i]);
    for (const dy of [-width, 0, width]) for (const dx of [-1, 0, 1]) {
      const j = dx || dy ? at.get(key + dy + dx) : undefined;
      if (j !== undefined) out.push(j);
    }
    return out;
  };
}

export const hasPixels = (cloud) => Boolean(cloud?.columns.pixel_x && cloud.columns.pixel_y);

const middle = (values) => values.sort((a, b) => a - b)[values.length >> 1];

/// Points that stand further from their neighbours' median height than five times what is usual, or stand alone.
export function withoutOutliers(cloud, kept) {
  const {z} = cloud.columns, around = grid(cloud, kept);
  const off = kept.map((i) => {
    const near = around(i);
    return near.length < 3 ? Infinity : Math.abs(z[i] - middle(near.map((j) => z[j])));
  });
  const finite = off.filter(Number.isFinite), limit = 5 * 1.4826 * middle(finite);
  return kept.filter((_, k) => off[k] <= limit);
}

/// Each height becomes the mean of itself and its neighbours that are within five times the usual distance.
/// Returns the new heights and by how much they moved, rms.
export function smoothed(cloud, kept) {
  const {z} = cloud.columns, around = grid(cloud, kept), out = z.slice();
  const usual = middle(kept.filter((_, k) => k % 97 === 0).flatMap((i) => around(i).map((j) => Math.abs(z[i] - z[j])))) || Infinity;
  let sum = 0;
  for (const i of kept) {
    const near = around(i).filter((j) => Math.abs(z[j] - z[i]) <= 5 * usual);
    out[i] = (z[i] + near.reduce((s, j) => s + z[j], 0)) / (near.length + 1);
    sum += (out[i] - z[i]) ** 2;
  }
  return {z: out, rms: Math.sqrt(sum / kept.length)};
}
