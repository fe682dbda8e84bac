// Post-processing of a cloud in the browser: for looking and cutting, not for results. Any cloud will do: what belongs
// together is found by distance alone.
//
//   neighbourhood  the points within r of a point, r such that there are kNeighbours of them on average (for smoothing
//                  kSmoothOver: a plane over more of a curved surface is off by more)                                (1)
//   deviation      distance of the point from the plane of its neighbours (least squares, itself left out), in the
//                  standard deviation that it has where every point has the same: at the rim planes tell less      (2)
//   usual          1.4826 times the median of the deviations: their standard deviation where they are noise          (3)

const kNeighbours = 20, kSmoothOver = 12, kMost = 64, kFewest = 4, kUsual = 5, kPasses = 6;

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

const middle = (values) => Float64Array.from(values).sort()[values.length >> 1];

function bounds(column, kept) {
  let low = Infinity, high = -Infinity;
  for (const i of kept) {
    if (column[i] < low) low = column[i];
    if (column[i] > high) high = column[i];
  }
  return [low, high];
}

/// Points in cubes of side r, the cubes in buckets by a hash, the points in the order of the buckets.
class Cells {
  constructor({columns: {x, y, z}}, kept, r) {
    this.columns = [x, y, z];
    this.r = r;
    this.low = [x, y, z].map((c) => bounds(c, kept)[0]);
    this.mask = 2 ** Math.ceil(Math.log2(kept.length / 4 + 2)) - 1;
    this.start = new Int32Array(this.mask + 2);
    this.order = new Int32Array(kept.length);
    const at = Int32Array.from(kept, (i) => this.bucket(...this.cell(i)));
    for (const b of at) ++this.start[b + 1];
    for (let b = 0; b <= this.mask; ++b) this.start[b + 1] += this.start[b];
    const next = this.start.slice();
    kept.forEach((i, k) => { this.order[next[at[k]]++] = i; });
  }

  cell(i) {
    const [x, y, z] = this.columns, [a, b, c] = this.low;
    return [Math.floor((x[i] - a) / this.r), Math.floor((y[i] - b) / this.r), Math.floor((z[i] - c) / this.r)];
  }

  bucket(a, b, c) {
    return (Math.imul(a, 73856093) ^ Math.imul(b, 19349663) ^ Math.imul(c, 83492791)) & this.mask;
  }

  /// The points within r of point i, i left out, into `found`; how many they are.
  near(i, found) {
    const [x, y, z] = this.columns, {r, start, order} = this, [lx, ly, lz] = this.low, [ca, cb, cc] = this.cell(i), xi = x[i], yi = y[i], zi = z[i];
    let n = 0;
    for (let a = ca - 1; a <= ca + 1; ++a) for (let b = cb - 1; b <= cb + 1; ++b) for (let c = cc - 1; c <= cc + 1; ++c) {
      const bucket = this.bucket(a, b, c);
      for (let k = start[bucket]; k < start[bucket + 1]; ++k) {
        const j = order[k], dx = x[j] - xi, dy = y[j] - yi, dz = z[j] - zi;
        if (dx * dx + dy * dy + dz * dz > r * r || j === i) continue;
        // Another cube of the same bucket is visited at its own turn.
        if (Math.floor((x[j] - lx) / r) !== a || Math.floor((y[j] - ly) / r) !== b || Math.floor((z[j] - lz) / r) !== c) continue;
        found[n++] = j;
        if (n === found.length) return n;
      }
    }
    return n;
  }
}


/// Eq. 1: from a guess, by the counts of a sample; on a surface they grow as r squared.
function cellsOf(cloud, kept, wanted) {
  const sides = ['x', 'y', 'z'].map((a) => bounds(cloud.columns[a], kept)).map(([low, high]) => high - low).sort((a, b) => b - a);
  const step = Math.ceil(kept.length / 1000), sample = kept.filter((_, k) => k % step === 0), found = new Int32Array(kMost);
  let r = Math.sqrt(wanted / Math.PI * Math.max(sides[0] * sides[1], 1e-6 * sides[0] ** 2, 1e-300) / kept.length), cells;
  for (let pass = 0; pass < 5; ++pass) {
    cells = new Cells(cloud, kept, r);
    const mean = sample.reduce((sum, i) => sum + cells.near(i, found), 0) / sample.length;
    if (mean > 0.75 * wanted && mean < 1.4 * wanted) break;
    r *= Math.min(3, Math.max(0.4, Math.sqrt(wanted / Math.max(mean, 0.5))));
  }
  return cells;
}

/// Normal of the plane of the points that were summed: the direction in which they scatter least. Power iteration on
/// trace - covariance; twenty steps leave less than the noise of any cloud.
function normal(xx, xy, xz, yy, yz, zz) {
  const t = xx + yy + zz;
  let a = t - xx > t - yy ? 1 : 0.5, b = 0.3, c = 0.7;
  for (let k = 0; k < 20; ++k) {
    const u = (t - xx) * a - xy * b - xz * c, v = -xy * a + (t - yy) * b - yz * c, w = -xz * a - yz * b + (t - zz) * c, n = Math.hypot(u, v, w) || 1;
    [a, b, c] = [u / n, v / n, w / n];
  }
  return [a, b, c];
}

const around = new Int32Array(kMost);

/// The plane of the neighbours that are not `gone`: {direction, off: signed distance of the point, sure: its standard
/// deviation where every point has 1}; nothing where they are fewer than kFewest.
function planeAround(cells, i, gone) {
  const [x, y, z] = cells.columns, count = cells.near(i, around);
  let n = 0, sx = 0, sy = 0, sz = 0, xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
  for (let k = 0; k < count; ++k) {
    const j = around[k];
    if (gone && gone[j]) continue;
    const dx = x[j] - x[i], dy = y[j] - y[i], dz = z[j] - z[i];
    ++n; sx += dx; sy += dy; sz += dz;
    xx += dx * dx; xy += dx * dy; xz += dx * dz; yy += dy * dy; yz += dy * dz; zz += dz * dz;
  }
  if (n < kFewest) return null;
  xx -= sx * sx / n; xy -= sx * sy / n; xz -= sx * sz / n; yy -= sy * sy / n; yz -= sy * sz / n; zz -= sz * sz / n;
  const direction = normal(xx, xy, xz, yy, yz, zz);
  const off = -(sx * direction[0] + sy * direction[1] + sz * direction[2]) / n;
  const aside = (sx * sx + sy * sy + sz * sz) / (n * n) - off * off;  // squared distance from the middle, in the plane
  return {direction, off, sure: Math.sqrt(1 + 1 / n + Math.max(0, aside) / ((xx + yy + zz) / 2 || 1))};
}

/// Calls for every point, and lets the page breathe in between. onShare(0 .. 1).
async function inSlices(points, action, onShare) {
  const kSlice = 2000, kSliceMs = 60;
  let begin = performance.now();
  for (let k = 0; k < points.length; ++k) {
    action(points[k], k);
    if (k % kSlice !== 0 || performance.now() - begin < kSliceMs) continue;
    onShare(k / points.length);
    await new Promise((resolve) => setTimeout(resolve));
    begin = performance.now();
  }
}

/// Points that deviate more than kUsual times what is usual, or stand alone, left out. Of a group that pull each other's
/// planes only the worst goes, and the others are looked at again.
export async function withoutOutliers(cloud, kept, onShare = () => {}) {
  const cells = cellsOf(cloud, kept, kNeighbours), size = cloud.columns.x.length, gone = new Uint8Array(size), off = new Float64Array(size);
  const measure = (i) => {
    const plane = planeAround(cells, i, gone);
    off[i] = plane ? Math.abs(plane.off) / plane.sure : Infinity;
  };
  await inSlices(kept, measure, onShare);
  const finite = kept.filter((i) => Number.isFinite(off[i])).map((i) => off[i]);
  if (!finite.length) return kept;
  const limit = kUsual * 1.4826 * middle(finite);
  const worstAround = (i) => {
    const count = cells.near(i, around);
    for (let k = 0; k < count; ++k) {
      const j = around[k];
      if (!gone[j] && Number.isFinite(off[j]) && off[j] > off[i]) return false;
    }
    return true;
  };
  let suspects = kept.filter((i) => off[i] > limit);
  for (let pass = 0; pass < kPasses && suspects.length; ++pass) {
    for (const i of suspects.filter(worstAround)) gone[i] = 1;
    suspects = suspects.filter((i) => !gone[i]);
    for (const i of suspects) measure(i);
    suspects = suspects.filter((i) => off[i] > limit);
  }
  for (const i of suspects) gone[i] = 1;
  return kept.filter((i) => !gone[i]);
}

/// Each point moves onto the plane of itself and its neighbours where that is not further than kUsual times what is usual: an edge
/// stays. Returns the new columns, how many points moved, and by how much, rms.
export async function smoothed(cloud, kept, onShare = () => {}) {
  const cells = cellsOf(cloud, kept, kSmoothOver), offs = new Float64Array(kept.length).fill(NaN), normals = new Float32Array(3 * kept.length);
  await inSlices(kept, (i, k) => {
    const plane = planeAround(cells, i, null);
    if (!plane) return;
    offs[k] = plane.off / plane.sure ** 2;  // the plane of neighbours and point: the point's own weight is 1 - 1/sure^2
    normals.set(plane.direction, 3 * k);
  }, onShare);
  const found = offs.filter(Number.isFinite).map(Math.abs), limit = found.length ? kUsual * 1.4826 * middle(found) : 0;
  const columns = {...cloud.columns};
  let moved = 0, sum = 0;
  ['x', 'y', 'z'].forEach((a, axis) => {
    columns[a] = Float64Array.from(columns[a]);
    kept.forEach((i, k) => { if (Math.abs(offs[k]) <= limit) columns[a][i] -= offs[k] * normals[3 * k + axis]; });
  });
  for (const off of found) if (off <= limit) { ++moved; sum += off ** 2; }
  return {columns, moved, rms: Math.sqrt(sum / (moved || 1))};
}
