// Points and lines drawn by a graphics processor, through three.js. The same as PixelSurface to its callers.
import * as THREE from '/three/build/three.module.js';

export class GlSurface {
  constructor(canvas) {
    this.renderer = new THREE.WebGLRenderer({canvas, antialias: false, preserveDrawingBuffer: true});
    this.renderer.setClearColor(0x0c1116);
    this.renderer.autoClear = false;
    this.scene = new THREE.Scene();
    this.marks = new THREE.Group();
    this.lines = new THREE.Group();
    this.scene.add(this.marks, this.lines);
    this.pixel = new Uint8Array(4);
  }

  end() {
    this.points?.geometry.dispose();
    this.renderer.dispose();
  }

  resize(w, h) {
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.renderer.setSize(w, h, false);
  }

  /// place: x, y, z each; colours: red, green, blue, 255 each.
  setPoints(place, colours) {
    if (this.points) {
      this.scene.remove(this.points);
      this.points.geometry.dispose();
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(place, 3));
    geometry.setAttribute('color', new THREE.BufferAttribute(colours, 4, true));
    this.points = new THREE.Points(geometry, new THREE.PointsMaterial({sizeAttenuation: false, vertexColors: THREE.VertexColors}));
    this.points.frustumCulled = false;
    this.scene.add(this.points);
  }

  setLines(lines) {
    for (const old of [...this.lines.children]) {
      this.lines.remove(old);
      old.geometry.dispose();
      old.material.dispose();
    }
    for (const {points, colour, dashed} of lines) {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute('position', new THREE.BufferAttribute(points, 3));
      const line = new THREE.Line(geometry, dashed ? new THREE.LineDashedMaterial({color: colour, dashSize: 6, gapSize: 5}) : new THREE.LineBasicMaterial({color: colour}));
      if (dashed) line.computeLineDistances();
      this.lines.add(line);
    }
  }

  /// One or two points, joined; in front of everything.
  setMarks(places) {
    while (this.marks.children.length) this.marks.remove(this.marks.children[0]);
    if (!places.length) return;
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(places, 3));
    this.marks.add(new THREE.Points(geometry, new THREE.PointsMaterial({size: 10, sizeAttenuation: false, color: 0xffffff, depthTest: false})));
    if (places.length === 6) this.marks.add(new THREE.Line(geometry, new THREE.LineBasicMaterial({color: 0xffffff, depthTest: false})));
  }

  /// Nothing beyond `at` along axis 0, 1 or 2 is drawn; null: no limit.
  section(axis, at) {
    const normal = new THREE.Vector3();
    if (axis !== null) normal.setComponent(axis, -1);
    this.renderer.clippingPlanes = axis === null ? [] : [new THREE.Plane(normal, at)];
  }

  /// Points from ... from + count, of that size in pixels; `first` clears, and draws lines and marks. Returns when it is drawn.
  draw(camera, from, count, size, first) {
    if (first) this.renderer.clear();
    this.lines.visible = this.marks.visible = first;
    if (this.points) {
      this.points.material.size = size;
      this.points.geometry.setDrawRange(from, count);
    }
    this.renderer.render(this.scene, camera);
    const gl = this.renderer.getContext();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, this.pixel);  // waits; finish() does not
  }
}
