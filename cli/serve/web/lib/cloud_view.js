// Clouds and lines in three.js, smooth without a graphics processor too. Points are shuffled once, so that any part of
// them is an even sample:
//   moving   as many points as the time of the frames before allows (budget), the fewer the larger; a frame's time is that
//            of drawing it until a pixel of it can be read back                                                        (1)
//   at rest  budget by budget the others are drawn on top, a frame each, until all are there; moving breaks this off   (2)
import * as THREE from '/three/build/three.module.js';
import {OrbitControls} from '/three/examples/jsm/controls/OrbitControls.js';

const kFrameMs = 25;  // of the 33 that 30 frames per second leave; the rest is for the page
const kFewest = 5000, kMost = 8e6, kRestMs = 200, kPointPx = 2, kLargestPx = 4;

/// Blue over green to red; 256 steps of red, green, blue.
const kColours = Uint8Array.from({length: 3 * 256}, (_, at) => {
  const v = Math.floor(at / 3) / 255, channel = Math.abs(4 * v - [3, 2, 1][at % 3]);
  return 255 * Math.min(1, Math.max(0, 1.5 - channel));
});

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

export class CloudView {
  /// onShown(count): how many points are drawn.
  constructor(canvas, onShown) {
    this.canvas = canvas;
    this.onShown = onShown;
    this.renderer = new THREE.WebGLRenderer({canvas, antialias: false, preserveDrawingBuffer: true});
    this.renderer.setClearColor(0x0c1116);
    this.renderer.autoClear = false;
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(35, 1, 1, 10000);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableKeys = false;
    this.controls.addEventListener('change', () => this.moved());
    this.marks = new THREE.Group();
    this.lines = new THREE.Group();
    this.scene.add(this.marks, this.lines);
    this.bounds = new THREE.Sphere(new THREE.Vector3(), 0);
    this.budget = 100000;
    this.frames = 0;
    this.pixel = new Uint8Array(4);
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(canvas);
  }

  end() {
    this.observer.disconnect();
    this.controls.dispose();
    this.points?.geometry.dispose();
    this.renderer.dispose();
    clearTimeout(this.rest);
    cancelAnimationFrame(this.next);
  }

  resize() {
    const {clientWidth: w, clientHeight: h} = this.canvas;
    if (!w || !h) return;
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.renderer.setSize(w, h, false);
    this.camera.aspect = w / h;
    this.camera.updateProjectionMatrix();
    this.refresh();
  }

  /// values(i): what colours point i, from low to high.
  set(cloud, kept, values, [low, high]) {
    if (this.points) {
      this.scene.remove(this.points);
      this.points.geometry.dispose();
    }
    const {x, y, z} = cloud.columns, order = shuffled(kept), n = order.length;
    const place = new Float32Array(3 * n), colours = new Uint8Array(3 * n), steps = 255 / (high - low || 1);
    this.centre ??= [x, y, z].map((c) => kept.reduce((s, i) => s + c[i], 0) / (n || 1));
    const [cx, cy, cz] = this.centre;
    for (let k = 0; k < n; ++k) {
      const i = order[k], c = 3 * Math.min(255, Math.max(0, Math.round((values(i) - low) * steps)));
      place[3 * k] = x[i] - cx;
      place[3 * k + 1] = y[i] - cy;
      place[3 * k + 2] = z[i] - cz;
      colours[3 * k] = kColours[c];
      colours[3 * k + 1] = kColours[c + 1];
      colours[3 * k + 2] = kColours[c + 2];
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(place, 3));
    geometry.setAttribute('color', new THREE.BufferAttribute(colours, 3, true));
    this.points = new THREE.Points(geometry, new THREE.PointsMaterial({size: kPointPx, sizeAttenuation: false, vertexColors: THREE.VertexColors}));
    this.points.frustumCulled = false;
    this.scene.add(this.points);
    this.place = place;
    if (n) {
      geometry.computeBoundingSphere();
      this.bounds.copy(geometry.boundingSphere);
    }
    this.refresh();
  }

  /// lines: [{points: [x, y, z, ...], colour, dashed}], in place of those before.
  setLines(lines) {
    this.centre ??= [0, 0, 0];
    for (const old of [...this.lines.children]) {
      this.lines.remove(old);
      old.geometry.dispose();
      old.material.dispose();
    }
    for (const {points, colour, dashed} of lines) {
      const geometry = new THREE.BufferGeometry(), options = {color: colour};
      geometry.setAttribute('position', new THREE.BufferAttribute(Float32Array.from(points, (v, i) => v - this.centre[i % 3]), 3));
      const line = new THREE.Line(geometry, dashed ? new THREE.LineDashedMaterial({...options, dashSize: 6, gapSize: 5}) : new THREE.LineBasicMaterial(options));
      if (dashed) line.computeLineDistances();
      this.lines.add(line);
    }
    if (!this.place?.length && lines.length) new THREE.Box3().setFromObject(this.lines).getBoundingSphere(this.bounds);
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

  /// Nothing beyond the plane is drawn. axis 0, 1, 2; nothing: the whole cloud.
  section(axis, at) {
    if (axis === null) {
      this.renderer.clippingPlanes = [];
    } else {
      const normal = new THREE.Vector3();
      normal.setComponent(axis, -1);
      this.renderer.clippingPlanes = [new THREE.Plane(normal, at - this.centre[axis])];
    }
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
    this.renderer.clear();
    this.lines.visible = this.marks.visible = true;
    const some = this.points && Math.min(this.count(), Math.floor(this.budget));
    if (some) this.points.material.size = Math.min(kLargestPx, Math.max(kPointPx, kPointPx * Math.sqrt(0.2 * this.count() / some)));
    this.draw(0, some ?? 0);
  }

  /// Whether there are more.
  drawMore() {
    if (this.shown >= this.count()) return false;
    this.lines.visible = this.marks.visible = false;
    this.points.material.size = kPointPx;
    this.draw(this.shown, Math.min(this.count() - this.shown, Math.floor(this.budget)));
    return true;
  }

  draw(from, count) {
    const begin = performance.now(), gl = this.renderer.getContext();
    this.points?.geometry.setDrawRange(from, count);
    this.renderer.render(this.scene, this.camera);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, this.pixel);
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
    const planes = this.renderer.clippingPlanes, w = this.canvas.clientWidth / 2, h = this.canvas.clientHeight / 2;
    let best = null, bestScore = 12;
    for (let k = 0; k < p.length; k += 3) {
      const x = p[k], y = p[k + 1], z = p[k + 2], q = m[3] * x + m[7] * y + m[11] * z + m[15];
      if (q <= 0) continue;
      const dx = ((m[0] * x + m[4] * y + m[8] * z + m[12]) / q - px) * w, dy = ((m[1] * x + m[5] * y + m[9] * z + m[13]) / q - py) * h;
      const score = Math.hypot(dx, dy) + 1e-3 * q;
      if (score - 1e-3 * q < 12 && (best === null || score < bestScore)) {
        if (planes.length && planes[0].distanceToPoint(new THREE.Vector3(x, y, z)) < 0) continue;
        best = [x, y, z];
        bestScore = score;
      }
    }
    return best && best.map((v, i) => v + this.centre[i]);
  }

  /// Marks for picked points, joined by a line.
  mark(places) {
    while (this.marks.children.length) this.marks.remove(this.marks.children[0]);
    if (places.length) {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute('position', new THREE.BufferAttribute(Float32Array.from(places.flatMap((p) => p.map((v, i) => v - this.centre[i]))), 3));
      this.marks.add(new THREE.Points(geometry, new THREE.PointsMaterial({size: 10, sizeAttenuation: false, color: 0xffffff, depthTest: false})));
      if (places.length === 2) this.marks.add(new THREE.Line(geometry, new THREE.LineBasicMaterial({color: 0xffffff, depthTest: false})));
    }
    this.refresh();
  }
}
