// A cell in 3-D: coarse bodies in their frames, and the part as it is cut; shared by the operator panel and the studio.
import { THREE, OrbitControls } from "nicegui-scene";

const COLOURS = [
  [0.0, 0x2c7bb6],
  [0.35, 0x00ccbc],
  [0.6, 0xf9e04c],
  [0.85, 0xf29305],
  [1.0, 0xff3b30],
];
export function colourOf(share) {
  const s = Math.min(1, Math.max(0, share));
  for (let k = 1; k < COLOURS.length; k++) {
    if (s <= COLOURS[k][0]) {
      const [a, low] = COLOURS[k - 1];
      const [b, high] = COLOURS[k];
      return new THREE.Color(low).lerp(new THREE.Color(high), (s - a) / (b - a));
    }
  }
  return new THREE.Color(COLOURS[COLOURS.length - 1][1]);
}

function matrixOf(p) {
  return new THREE.Matrix4().set(
    p[0], p[1], p[2], p[9],
    p[3], p[4], p[5], p[10],
    p[6], p[7], p[8], p[11],
    0, 0, 0, 1,
  );
}

// The cell: coarse bodies in their frames, and the part as it is cut as a ribbon as wide as the tool.
export class CellView {
  constructor(canvas, bodies, rangeUm) {
    this.canvas = canvas;
    this.rangeUm = rangeUm;
    this.scene = new THREE.Scene();
    this.scene.background = new THREE.Color(0x0b0f14);
    this.camera = new THREE.PerspectiveCamera(40, 1, 0.01, 50);
    this.camera.up.set(0, 0, 1);
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x30404f, 2.2));
    const sun = new THREE.DirectionalLight(0xffffff, 1.6);
    sun.position.set(-2, -3, 5);
    this.scene.add(sun);
    const grid = new THREE.GridHelper(6, 24, 0x2a3a48, 0x18222c);
    grid.rotation.x = Math.PI / 2;
    this.scene.add(grid);
    this.grid = grid;
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => (this.dirty = true));
    this.frames = {};
    this.tools = [];
    this.diameter = 0.01;
    this.ribbon = [];
    this.drawn = 0;
    this.generation = -1;
    this.near = true;
    this.setBodies(bodies);
  }

  frame(name) {
    if (!this.frames[name]) {
      const group = new THREE.Group();
      group.matrixAutoUpdate = false;
      this.scene.add(group);
      this.frames[name] = group;
    }
    return this.frames[name];
  }

  setBodies(bodies) {
    for (const body of bodies) {
      const [a, b, c] = body.size;
      let shape;
      if (body.shape === "box") shape = new THREE.BoxGeometry(2 * a, 2 * b, 2 * c);
      else if (body.shape === "capsule") shape = new THREE.CapsuleGeometry(a, 2 * b, 6, 20).rotateX(Math.PI / 2);
      else shape = new THREE.CylinderGeometry(a, a, 2 * b, 28).rotateX(Math.PI / 2);
      const stock = body.name === "stock";
      const colour = stock ? 0x8fa3b5 : body.tool !== null ? 0xd9e2ec : body.frame === "part" ? 0x33424f : 0xc8651b;
      const material = new THREE.MeshStandardMaterial({
        color: colour,
        roughness: 0.75,
        metalness: 0.1,
        transparent: stock,
        opacity: stock ? 0.35 : 1,
        depthWrite: !stock,
      });
      const mesh = new THREE.Mesh(shape, material);
      mesh.matrixAutoUpdate = false;
      mesh.matrix.copy(matrixOf(body.pose));
      if (body.tool !== null) {
        mesh.userData = { tool: body.tool, radius: a };
        this.tools.push(mesh);
      }
      if (stock) this.stock = mesh;
      this.frame(body.frame).add(mesh);
    }
    this.dirty = true;
  }

  place(frames, tool) {
    const now = JSON.stringify(frames) + tool;
    if (now === this.placed) return;
    this.placed = now;
    for (const [name, pose] of Object.entries(frames)) {
      this.frame(name).matrix.copy(matrixOf(pose));
      this.frame(name).matrixWorldNeedsUpdate = true;
    }
    const known = this.tools.some((mesh) => mesh.userData.tool === tool);
    this.tools.forEach((mesh, k) => {
      mesh.visible = known ? mesh.userData.tool === tool : k === 0;
      if (mesh.visible) this.diameter = 2 * mesh.userData.radius;
    });
    if (!this.looked) {
      this.looked = true;
      this.look();
    }
    this.dirty = true;
  }

  // Near: at the part; else the whole cell.
  look() {
    this.scene.updateMatrixWorld(true);
    const what = this.near && this.stock ? this.stock : this.scene;
    const box = new THREE.Box3().setFromObject(what);
    const centre = box.getCenter(new THREE.Vector3());
    const size = Math.max(box.getSize(new THREE.Vector3()).length(), 0.05);
    if (!(this.near && this.stock)) centre.set(0.9, 0, 0.9);
    const away = this.near && this.stock ? 2.3 * size : 4.4;
    this.camera.position.copy(centre).add(new THREE.Vector3(-0.55, -0.75, 0.62).normalize().multiplyScalar(away));
    this.controls.target.copy(centre);
    this.controls.update();
    this.dirty = true;
  }

  trail(message) {
    if (message.generation !== this.generation) {
      this.generation = message.generation;
      if (this.line) {
        this.frame("part").remove(this.line);
        this.line.geometry.dispose();
        this.line = undefined;
      }
      this.ribbon = [];
    }
    if (!message.points.length) return;
    for (const p of message.points) this.ribbon.push(p);
    const rows = this.ribbon;
    const position = new Float32Array(rows.length * 6);
    const colour = new Float32Array(rows.length * 6);
    const index = [];
    const r = this.diameter / 2;
    for (let k = 0; k < rows.length; k++) {
      const here = rows[k];
      const before = k && !here[4] ? rows[k - 1] : here;
      const behind = k + 1 < rows.length && !rows[k + 1][4] ? rows[k + 1] : here;
      const along = new THREE.Vector3(behind[0] - before[0], behind[1] - before[1], behind[2] - before[2]).normalize();
      const side = new THREE.Vector3(here[5], here[6], here[7]).cross(along).normalize();
      const lift = 0.0003;
      const c = colourOf(Math.abs(here[3]) / this.rangeUm);
      for (let s = 0; s < 2; s++) {
        const w = s ? r : -r;
        position.set(
          [
            here[0] / 1e3 + w * side.x - lift * here[5],
            here[1] / 1e3 + w * side.y - lift * here[6],
            here[2] / 1e3 + w * side.z - lift * here[7],
          ],
          6 * k + 3 * s,
        );
        colour.set([c.r, c.g, c.b], 6 * k + 3 * s);
      }
      if (k && !here[4]) index.push(2 * k - 2, 2 * k - 1, 2 * k, 2 * k, 2 * k - 1, 2 * k + 1);
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(position, 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(colour, 3));
    geometry.setIndex(index);
    if (this.line) {
      this.line.geometry.dispose();
      this.line.geometry = geometry;
    } else {
      const material = new THREE.MeshBasicMaterial({ vertexColors: true, side: THREE.DoubleSide });
      this.line = new THREE.Mesh(geometry, material);
      this.line.frustumCulled = false;
      this.frame("part").add(this.line);
    }
    this.dirty = true;
  }

  draw() {
    const { clientWidth: w, clientHeight: h } = this.canvas;
    if (w && h && (this.width !== w || this.height !== h)) {
      [this.width, this.height] = [w, h];
      this.renderer.setSize(w, h, false);
      this.camera.aspect = w / h;
      this.camera.updateProjectionMatrix();
      this.dirty = true;
    }
    if (this.dirty) {
      this.dirty = false;
      this.renderer.render(this.scene, this.camera);
    }
  }
}

export { COLOURS, THREE };
