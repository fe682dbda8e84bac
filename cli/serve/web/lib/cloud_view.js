// A cloud in three.js. Points are shuffled once, so that any first part of them is an even sample: while the view moves,
// as many are drawn as keep it smooth; at rest, all.
import * as THREE from '/three/build/three.module.js';
import {OrbitControls} from '/three/examples/jsm/controls/OrbitControls.js';

const kSmoothMs = 33, kFewest = 20000;

/// Blue over green to red; u from 0 to 1.
function colour(u) {
  const v = Math.min(1, Math.max(0, u));
  return [Math.min(1, Math.max(0, 1.5 - Math.abs(4 * v - 3))), Math.min(1, Math.max(0, 1.5 - Math.abs(4 * v - 2))), Math.min(1, Math.max(0, 1.5 - Math.abs(4 * v - 1)))];
}

function shuffled(indices) {
  const out = Uint32Array.from(indices);
  let seed = 12345;
  for (let i = out.length - 1; i > 0; --i) {
    seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0;
    const j = seed % (i + 1);
    [out[i], out[j]] = [out[j], out[i]];
  }
  return out;
}

export class CloudView {
  /// onShown(count): how many points were drawn.
  constructor(canvas, onShown) {
    this.canvas = canvas;
    this.onShown = onShown;
    this.renderer = new THREE.WebGLRenderer({canvas, antialias: false, preserveDrawingBuffer: true});
    this.renderer.setClearColor(0x0c1116);
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(35, 1, 1, 10000);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableKeys = false;
    this.controls.addEventListener('change', () => this.moved());
    this.marks = new THREE.Group();
    this.scene.add(this.marks);
    this.budget = 400000;
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(canvas);
  }

  end() {
    this.observer.disconnect();
    this.controls.dispose();
    this.points?.geometry.dispose();
    this.renderer.dispose();
    clearTimeout(this.rest);
  }

  resize() {
    const {clientWidth: w, clientHeight: h} = this.canvas;
    if (!w || !h) return;
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.renderer.setSize(w, h, false);
    this.camera.aspect = w / h;
    this.camera.updateProjectionMatrix();
    this.draw(Infinity);
  }

  /// values(i): what colours point i, from low to high.
  set(cloud, kept, values, [low, high]) {
    if (this.points) {
      this.scene.remove(this.points);
      this.points.geometry.dispose();
    }
    const {x, y, z} = cloud.columns, order = shuffled(kept), n = order.length;
    const place = new Float32Array(3 * n), colours = new Float32Array(3 * n);
    this.centre ??= [x, y, z].map((c) => kept.reduce((s, i) => s + c[i], 0) / n);
    order.forEach((i, k) => {
      place[3 * k] = x[i] - this.centre[0];
      place[3 * k + 1] = y[i] - this.centre[1];
      place[3 * k + 2] = z[i] - this.centre[2];
      colours.set(colour((values(i) - low) / (high - low || 1)), 3 * k);
    });
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(place, 3));
    geometry.setAttribute('color', new THREE.BufferAttribute(colours, 3));
    this.points = new THREE.Points(geometry, new THREE.PointsMaterial({size: 2, sizeAttenuation: false, vertexColors: THREE.VertexColors}));
    this.scene.add(this.points);
    this.place = place;
    geometry.computeBoundingSphere();
    this.draw(Infinity);
  }

  /// From a direction, so that everything is seen.
  look([dx, dy, dz]) {
    if (!this.points) return;
    const r = this.points.geometry.boundingSphere.radius, c = this.points.geometry.boundingSphere.center;
    const d = 1.15 * r / Math.sin(this.camera.fov * Math.PI / 360), length = Math.hypot(dx, dy, dz);
    this.camera.up.set(0, Math.abs(dy) > 0.9 * length ? 0 : 1, Math.abs(dy) > 0.9 * length ? -1 : 0);
    this.camera.position.set(c.x + d * dx / length, c.y + d * dy / length, c.z + d * dz / length);
    this.camera.near = d / 100;
    this.camera.far = 10 * d;
    this.camera.updateProjectionMatrix();
    this.controls.target.copy(c);
    this.controls.update();
    this.draw(Infinity);
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
    this.draw(Infinity);
  }

  moved() {
    if (!this.waiting) {
      this.waiting = true;
      requestAnimationFrame(() => {
        this.waiting = false;
        const begin = performance.now();
        this.draw(this.budget);
        this.renderer.getContext().finish();
        const ms = performance.now() - begin;
        if (ms > kSmoothMs) this.budget = Math.max(kFewest, this.budget * 0.7);
        else if (ms < kSmoothMs / 2) this.budget = Math.min(4e6, this.budget * 1.15);
      });
    }
    clearTimeout(this.rest);
    this.rest = setTimeout(() => this.draw(Infinity), 250);
  }

  draw(most) {
    if (!this.points) return;
    const shown = Math.min(this.place.length / 3, Math.floor(most));
    this.points.geometry.setDrawRange(0, shown);
    this.renderer.render(this.scene, this.camera);
    this.onShown(shown);
  }

  /// The point drawn nearest to a place of the canvas (-1 .. 1 each), within 12 pixels; the nearer one of two. Or null.
  pick(px, py) {
    const m = new THREE.Matrix4().multiplyMatrices(this.camera.projectionMatrix, this.camera.matrixWorldInverse).elements, p = this.place;
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
    this.marks.clear?.();
    while (this.marks.children.length) this.marks.remove(this.marks.children[0]);
    if (places.length) {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute('position', new THREE.BufferAttribute(Float32Array.from(places.flatMap((p) => p.map((v, i) => v - this.centre[i]))), 3));
      this.marks.add(new THREE.Points(geometry, new THREE.PointsMaterial({size: 10, sizeAttenuation: false, color: 0xffffff, depthTest: false})));
      if (places.length === 2) this.marks.add(new THREE.Line(geometry, new THREE.LineBasicMaterial({color: 0xffffff, depthTest: false})));
    }
    this.draw(Infinity);
  }
}
