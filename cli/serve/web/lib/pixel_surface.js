// Points and lines drawn by the processor into a picture with a depth for each pixel. Where there is no graphics
// processor this is a hundred times as fast as WebGL drawn by software, whose points cost microseconds each.
//
//   (x, y, w) = P V p,  column W/2 (1 + x/w),  row H/2 (1 - y/w); of several points in a pixel the one of least w     (1)

const kBackground = 0xff16110c, kMark = 0xffffffff, kDash = 6;  // alpha, blue, green, red
const abgr = (rgb) => (0xff000000 | (rgb & 0xff) << 16 | (rgb & 0xff00) | rgb >> 16) >>> 0;

export class PixelSurface {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext('2d', {alpha: false});
    this.lines = [];
    this.marks = [];
    this.limit = null;
    this.resize(canvas.clientWidth || 1, canvas.clientHeight || 1);
  }

  end() {}

  resize(w, h) {
    this.canvas.width = w;
    this.canvas.height = h;
    this.image = new ImageData(w, h);
    this.pixels = new Uint32Array(this.image.data.buffer);
    this.depth = new Float32Array(w * h);
  }

  setPoints(place, colours) {
    this.place = place;
    this.colours = new Uint32Array(colours.buffer);
  }

  setLines(lines) { this.lines = lines; }
  setMarks(places) { this.marks = places; }
  section(axis, at) { this.limit = axis === null ? null : {axis, at}; }

  draw(camera, from, count, size, first) {
    camera.updateMatrixWorld();
    const m = camera.projectionMatrix.clone().multiply(camera.matrixWorldInverse).elements;
    if (first) {
      this.pixels.fill(kBackground);
      this.depth.fill(Infinity);
      for (const line of this.lines) this.drawLine(m, line.points, abgr(line.colour), line.dashed);
    }
    if (count) this.drawPoints(m, from, count, Math.round(size));
    this.drawMarks(m);
    this.context.putImageData(this.image, 0, 0);
  }

  /// Eq. 1, points as squares.
  drawPoints(m, from, count, size) {
    const {place: p, colours, pixels, depth, limit} = this, {width: w, height: h} = this.image, [m0, m1, , m3, m4, m5, , m7, m8, m9, , m11, m12, m13, , m15] = m;
    const cx = w / 2, cy = h / 2, right = w - size, bottom = h - size, beyond = limit ? limit.at : Infinity, axis = limit ? limit.axis : 0, shift = (size - 1) / 2;
    for (let k = from; k < from + count; ++k) {
      const at = 3 * k, x = p[at], y = p[at + 1], z = p[at + 2], q = m3 * x + m7 * y + m11 * z + m15;
      if (q <= 0 || p[at + axis] > beyond) continue;
      const column = (cx + cx * (m0 * x + m4 * y + m8 * z + m12) / q - shift) | 0, row = (cy - cy * (m1 * x + m5 * y + m9 * z + m13) / q - shift) | 0;
      if (column < 0 || row < 0 || column > right || row > bottom) continue;
      const colour = colours[k];
      for (let v = row * w + column, end = v + size * w; v < end; v += w) {
        for (let u = v; u < v + size; ++u) {
          if (q >= depth[u]) continue;
          depth[u] = q;
          pixels[u] = colour;
        }
      }
    }
  }

  /// [column, row, w] or null behind the camera.
  project(m, x, y, z) {
    const q = m[3] * x + m[7] * y + m[11] * z + m[15];
    if (q <= 1e-6) return null;
    const {width: w, height: h} = this.image;
    return [w / 2 * (1 + (m[0] * x + m[4] * y + m[8] * z + m[12]) / q), h / 2 * (1 - (m[1] * x + m[5] * y + m[9] * z + m[13]) / q), q];
  }

  drawLine(m, points, colour, dashed, always = false) {
    const {width: w, height: h} = this.image, kLongest = 4 * (w + h);
    let before = null, drawn = 0;
    for (let k = 0; k < points.length; k += 3) {
      const to = this.project(m, points[k], points[k + 1], points[k + 2]);
      if (before && to) {
        const steps = Math.min(kLongest, Math.ceil(Math.max(Math.abs(to[0] - before[0]), Math.abs(to[1] - before[1])))) || 1;
        for (let s = 0; s <= steps; ++s, ++drawn) {
          if (dashed && drawn % (2 * kDash) >= kDash) continue;
          const share = s / steps, column = Math.round(before[0] + share * (to[0] - before[0])), row = Math.round(before[1] + share * (to[1] - before[1]));
          if (column < 0 || row < 0 || column >= w || row >= h) continue;
          const u = row * w + column, q = 1 / ((1 - share) / before[2] + share / to[2]);  // w is linear in 1/w over the picture
          if (!always && q >= this.depth[u]) continue;
          this.depth[u] = always ? 0 : q;
          this.pixels[u] = colour;
        }
      }
      before = to;
    }
  }

  drawMarks(m) {
    for (let k = 0; k < this.marks.length; k += 3) {
      const at = this.project(m, ...this.marks.slice(k, k + 3));
      if (!at) continue;
      for (let v = -5; v < 5; ++v) for (let u = -5; u < 5; ++u) {
        const column = Math.round(at[0] + u), row = Math.round(at[1] + v);
        if (column >= 0 && row >= 0 && column < this.image.width && row < this.image.height) this.pixels[row * this.image.width + column] = kMark;
      }
    }
    if (this.marks.length === 6) this.drawLine(m, this.marks, kMark, false, true);
  }
}
