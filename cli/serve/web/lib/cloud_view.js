// Clouds and lines in space, turned and zoomed by three.js, smooth with and without a graphics processor. Points are
// shuffled once, so that any part of them is an even sample:
//   moving   as many points as the time of the frames before allows (budget), the fewer the larger; a frame's time is that
//            of drawing it to its end                                                                                  (1)
//   at rest  budget by budget the others are drawn on top, a frame each, until all are there; moving breaks this off   (2)
import * as THREE from '/three/build/three.module.js';
import {OrbitControls} from '/three/examples/jsm/controls/OrbitControls.js';
import {GlSurface} from './gl_surface.js';
import {PixelSurface} from './pixel_surface.js';

const kFrameMs = 22;  // of the 33 that 30 frames per second leave; the rest is for the page
const kFewest = 5000, kMost = 8e6, kRestMs = 200, kPointPx = 2, kLargestPx = 4;

/// Blue over green to red; 256 steps of red, green, blue.
const kColours = Uint8Array.from({length: 3 * 256}, (_, at) => {
  const v = Math.floor(at / 3) / 255, channel = Math.abs(4 * v - [3, 2, 1][at % 3]);
  return 255 * Math.min(1, Math.max(0, 1.5 - channel));
});

/// Whether WebGL is there and is not drawn by software; localStorage's fringecal.drawing, "webgl" or "processor", overrules.
function hasGraphicsProcessor() {
  const wanted = localStorage.getItem('fringecal.drawing');
  if (wanted) return wanted === 'webgl';
  const gl = document.createElement('canvas').getContext('webgl');
  if (!gl) return false;
  const names = gl.getExtension('WEBGL_debug_renderer_info');
  const name = gl.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  gl.getExtension('WEBGL_lose_context')?.loseContext();
  return !/swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

function shuffled(indices) {
  const out = Uint32Array.from(indices);
  let seed = 12345;
  for (let i = out.length - 1; i > 0; --i) {
    seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0;
    const j = seed % (i + 1), other = out[j];
    out[j] = out[i];
    out[i] = other;
  }
  return out;
}

function sphereAround(place) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(place, 3));
  geometry.computeBoundingSphere();
  return geometry.boundingSphere;
}

export class CloudView {
  /// onShown(count): how many points are drawn.
  constructor(canvas, onShown) {
    this.canvas = canvas;
    this.onShown = onShown;
    this.surface = hasGraphicsProcessor() ? new GlSurface(canvas) : new PixelSurface(canvas);
    canvas.dataset.surface = this.surface.constructor.name;
    this.camera = new THREE.PerspectiveCamera(35, 1, 1, 10000);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableKeys = false;
    this.controls.addEventListener('change', () => this.moved());
    this.bounds = new THREE.Sphere(new THREE.Vector3(), 0);
    this.budget = 100000;
    this.frames = 0;
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(canvas);
  }

  end() {
    this.observer.disconnect();
    this.controls.dispose();
    this.surface.end();
    clearTimeout(this.rest);
    cancelAnimationFrame(this.next);
  }

  resize() {
    const {clientWidth: w, clientHeight: h} = this.canvas;
    if (!w || !h) return;
    this.surface.resize(w, h);
    this.camera.aspect = w / h;
    this.camera.updateProjectionMatrix();
    this.refresh();
  }

  /// values(i): what colours point i, from low to high.
  set(cloud, kept, values, [low, high]) {
    const {x, y, z} = cloud.columns, order = shuffled(kept), n = order.length;
    const place = new Float32Array(3 * n), colours = new Uint8Array(4 * n).fill(255), steps = 255 / (high - low || 1);
    this.centre ??= [x, y, z].map((c) => kept.reduce((s, i) => s + c[i], 0) / (n || 1));
    const [cx, cy, cz] = this.centre;
    for (let k = 0; k < n; ++k) {
      const i = order[k], c = 3 * Math.min(255, Math.max(0, Math.round((values(i) - low) * steps)));
      place[3 * k] = x[i] - cx;
      place[3 * k + 1] = y[i] - cy;
      place[3 * k + 2] = z[i] - cz;
      colours[4 * k] = kColours[c];
      colours[4 * k + 1] = kColours[c + 1];
      colours[4 * k + 2] = kColours[c + 2];
    }
    this.surface.setPoints(place, colours);
    this.place = place;
    if (n) this.bounds = sphereAround(place);
    this.refresh();
  }

  /// lines: [{points: [x, y, z, ...], colour, dashed}], in place of those before.
  setLines(lines) {
    this.centre ??= [0, 0, 0];
    const relative = lines.map((line) => ({...line, points: Float32Array.from(line.points, (v, i) => v - this.centre[i % 3])}));
    this.surface.setLines(relative);
    if (!this.place?.length && lines.length) this.bounds = sphereAround(Float32Array.from(relative.flatMap((line) => [...line.points])));
    this.refresh();
  }

  /// From a direction, so that everything is seen. up: the axis that points upwards, y unless seen along it.
  look([dx, dy, dz], centre = this.bounds.center, radius = this.bounds.radius) {
    if (!radius) return;
    const d = 1.15 * radius / Math.sin(this.camera.fov * Math.PI / 360), length = Math.hypot(dx, dy, dz), c = centre;
    this.camera.up.set(0, Math.abs(dy) > 0.9 * length ? 0 : 1, Math.abs(dy) > 0.9 * length ? -1 : 0);
    this.camera.position.set(c.x + d * dx / length, c.y + d * dy / length, c.z + d * dz / length);
    this.camera.near = d / 100;
    this.camera.far = 10 * d;
    this.camera.updateProjectionMatrix();
    this.controls.target.copy(c);
    this.controls.update();
    this.refresh();
  }

  /// Looks at a place of the world from where it looks now, near enough for that radius.
  approach(place, radius) {
    const from = this.camera.position.clone().sub(this.controls.target);
    this.look(from.toArray(), new THREE.Vector3(...place.map((v, i) => v - this.centre[i])), radius);
  }

  turn(right, down) {
    const offset = this.camera.position.clone().sub(this.controls.target), s = new THREE.Spherical().setFromVector3(offset);
    s.theta += right;
    s.phi = Math.min(Math.PI - 0.01, Math.max(0.01, s.phi + down));
    this.camera.position.setFromSpherical(s).add(this.controls.target);
    this.controls.update();
    this.moved();
  }

  zoom(factor) {
    this.camera.position.sub(this.controls.target).multiplyScalar(factor).add(this.controls.target);
    this.controls.update();
    this.moved();
  }

  /// Nothing beyond the plane is drawn. axis 0, 1, 2; null: the whole cloud.
  section(axis, at) {
    this.limit = axis === null ? null : {axis, at: at - this.centre[axis]};
    this.surface.section(axis, this.limit?.at);
    this.refresh();
  }

  /// Eq. 1. Several moves of one frame are drawn once.
  moved() {
    clearTimeout(this.rest);
    this.rest = setTimeout(() => this.refresh(), kRestMs);
    this.whenNext(() => this.drawFirst());
  }

  /// Eq. 2, from the beginning.
  refresh() {
    clearTimeout(this.rest);
    this.whenNext(() => {
      this.drawFirst();
      const more = () => this.whenNext(() => this.drawMore() && more());
      more();
    });
  }

  whenNext(action) {
    cancelAnimationFrame(this.next);
    this.next = requestAnimationFrame(action);
  }

  count() {
    return this.place ? this.place.length / 3 : 0;
  }

  drawFirst() {
    const some = Math.min(this.count(), Math.floor(this.budget));
    // As much of the picture as all points would cover, as far as larger points can.
    this.draw(0, some, some ? Math.min(kLargestPx, Math.max(kPointPx, Math.sqrt(this.count() / some))) : 0, true);
  }

  /// Whether there are more.
  drawMore() {
    if (this.shown >= this.count()) return false;
    this.draw(this.shown, Math.min(this.count() - this.shown, Math.floor(this.budget)), kPointPx, false);
    return true;
  }

  draw(from, count, size, first) {
    const begin = performance.now();
    this.surface.draw(this.camera, from, count, size, first);
    const ms = performance.now() - begin;
    if (count > this.budget / 2 || ms > kFrameMs) this.budget = Math.min(kMost, Math.max(kFewest, this.budget * Math.min(1.3, Math.max(0.5, kFrameMs / ms))));
    this.shown = from + count;
    this.canvas.dataset.frames = ++this.frames;
    this.onShown(this.shown);
  }

  /// The point drawn nearest to a place of the canvas (-1 .. 1 each), within 12 pixels; the nearer one of two. Or null.
  pick(px, py) {
    const m = new THREE.Matrix4().multiplyMatrices(this.camera.projectionMatrix, this.camera.matrixWorldInverse).elements, p = this.place;
    if (!p) return null;
    const w = this.canvas.clientWidth / 2, h = this.canvas.clientHeight / 2;
    let best = null, bestScore = 12;
    for (let k = 0; k < p.length; k += 3) {
      const x = p[k], y = p[k + 1], z = p[k + 2], q = m[3] * x + m[7] * y + m[11] * z + m[15];
      if (q <= 0) continue;
      const dx = ((m[0] * x + m[4] * y + m[8] * z + m[12]) / q - px) * w, dy = ((m[1] * x + m[5] * y + m[9] * z + m[13]) / q - py) * h;
      const score = Math.hypot(dx, dy) + 1e-3 * q;
      if (score - 1e-3 * q < 12 && (best === null || score < bestScore)) {
        if (this.limit && p[k + this.limit.axis] > this.limit.at) continue;
        best = [x, y, z];
        bestScore = score;
      }
    }
    return best && best.map((v, i) => v + this.centre[i]);
  }

  /// Marks for picked points, joined by a line.
  mark(places) {
    this.surface.setMarks(Float32Array.from(places.flatMap((p) => p.map((v, i) => v - this.centre[i]))));
    this.refresh();
  }
}
