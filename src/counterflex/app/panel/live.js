// The live page of the operator panel: figures, charts and the cell in 3-D, drawn from one message per tick.
import { THREE, OrbitControls } from "nicegui-scene";

const OLD_MS = 1000; // without a message for so long, what is shown is old
const CHART_S = 60;
const COLOURS = [
  [0.0, 0x2c7bb6],
  [0.35, 0x00ccbc],
  [0.6, 0xf9e04c],
  [0.85, 0xf29305],
  [1.0, 0xff3b30],
];
const STATE_WORDS = {
  IDLE: "IDLE",
  READY: "READY",
  ARMED: "ARMED",
  ACTIVE: "CORRECTING",
  HOLD: "HOLD",
  RAMP_OUT: "RAMP OUT",
  FAULT: "FAULT",
};

function colourOf(share) {
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
class CellView {
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

// Curves of the last minute; each has a colour and a name that the tiles beside use, too.
class Chart {
  constructor(canvas, unit, curves) {
    Object.assign(this, { canvas, unit, curves, rows: [] });
  }

  add(time, values) {
    this.rows.push([time, ...values]);
    while (this.rows.length && this.rows[0][0] < time - CHART_S) this.rows.shift();
  }

  draw() {
    const ratio = window.devicePixelRatio || 1;
    const { clientWidth: w, clientHeight: h } = this.canvas;
    if (!w || !h) return;
    if (this.canvas.width !== Math.round(w * ratio)) this.canvas.width = Math.round(w * ratio);
    if (this.canvas.height !== Math.round(h * ratio)) this.canvas.height = Math.round(h * ratio);
    const g = this.canvas.getContext("2d");
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, w, h);
    const numbers = this.rows.flatMap((row) => row.slice(1)).filter((v) => v !== null);
    const most = numbers.reduce((a, v) => Math.max(a, Math.abs(v)), 1e-9);
    const step = 10 ** Math.floor(Math.log10(most));
    const top = Math.max(Math.ceil((1.15 * most) / step) * step, this.unit === "N" ? 20 : 20);
    const low = numbers.some((v) => v < 0) ? -top : 0;
    const y = (v) => h - 6 - ((v - low) / (top - low)) * (h - 14);
    const end = this.rows.length ? this.rows[this.rows.length - 1][0] : 0;
    const x = (t) => w - 4 - ((end - t) / CHART_S) * (w - 76);
    g.font = "16px sans-serif";
    g.textBaseline = "middle";
    for (const v of low < 0 ? [top, 0, low] : [top, top / 2, 0]) {
      g.strokeStyle = v === 0 ? "#5b6b7a" : "#26323d";
      g.beginPath();
      g.moveTo(70, y(v));
      g.lineTo(w, y(v));
      g.stroke();
      g.fillStyle = "#9fb0c0";
      g.textAlign = "right";
      g.fillText(`${Number(v.toPrecision(3))}`, 64, Math.min(h - 9, Math.max(9, y(v))));
    }
    this.curves.forEach((colour, k) => {
      g.strokeStyle = colour;
      g.lineWidth = 2.5;
      g.beginPath();
      let open = false;
      for (const row of this.rows) {
        const v = row[k + 1];
        if (v === null) open = false;
        else if (open) g.lineTo(x(row[0]), y(v));
        else {
          g.moveTo(x(row[0]), y(v));
          open = true;
        }
      }
      g.stroke();
    });
  }
}

const PREDICTED = "#59a9ff";
const CORRECTED = "#b987ff";
const REMAINING = "#ffffff";
const MEASURED = "#40e0a0";
const PLANNED = "#f2b134";

export default {
  props: { role: String, user: String, range: Number },
  template: `
  <div class="cf-live" :class="{ 'cf-stale': stale }">
    <section class="cf-left">
      <div class="cf-state" :data-state="f.state || 'NONE'">
        <div class="cf-word" data-test="state">{{ word }}</div>
        <div class="cf-cause" data-test="cause">{{ cause }}</div>
      </div>
      <div class="cf-tile cf-incident" v-if="f.incident" data-test="incident">
        <b>{{ f.incident.over ? 'LAST INCIDENT' : 'INCIDENT' }}</b> {{ f.incident.cause }}
        <small>{{ f.incident.state.toLowerCase().replace('_', ' ') }}, {{ clock(f.incident.time_s) }}</small>
      </div>
      <div class="cf-tile">
        <label>correction against limit</label>
        <div class="cf-big"><span data-test="correction">{{ n(f.correction_um, 0) }}</span><small>of {{ n(f.limit_um, 0) }} µm</small></div>
        <div class="cf-bar"><div :style="bar(f.correction_um, f.limit_um)"></div></div>
        <label class="cf-second">rotation {{ n(f.turn_mdeg, 0) }} of {{ n(f.turn_limit_mdeg, 0) }} mdeg<span v-if="f.limited" class="cf-warn"> LIMITED</span></label>
      </div>
      <div class="cf-tile">
        <label>deviation, µm <span class="cf-columns"><i>across feed</i><i>along tool</i></span></label>
        <div class="cf-row" v-for="row in rows" :key="row.name" :style="{ color: row.colour }">
          <span>{{ row.name }}<small v-if="row.of"> ({{ row.of }})</small></span><b>{{ s(row.value && row.value[0]) }}</b><b>{{ s(row.value && row.value[1]) }}</b>
        </div>
      </div>
      <div class="cf-tile">
        <label>force, N <span class="cf-columns cf-three"><i>feed</i><i>across</i><i>tool</i></span></label>
        <div class="cf-row cf-force" style="color:${MEASURED}"><span>measured</span><b v-for="k in 3">{{ s(f.force_n && f.force_n[k - 1]) }}</b></div>
        <div class="cf-row cf-force" style="color:${PLANNED}"><span>planned</span><b v-for="k in 3">{{ s(f.planned_n && f.planned_n[k - 1]) }}</b></div>
      </div>
    </section>
    <section class="cf-middle">
      <div class="cf-tile cf-scene">
        <canvas ref="cell" data-test="cell"></canvas>
        <div class="cf-scale"><i v-for="k in 5" :style="{ background: scale[k - 1] }"></i><span>0</span><span>{{ range }} µm remaining (model)</span></div>
        <button class="cf-view" @click="view">{{ near ? 'WHOLE CELL' : 'PART' }}</button>
      </div>
      <div class="cf-tile cf-chart"><label>deviation across the feed, µm, last minute</label><canvas ref="deviation"></canvas></div>
      <div class="cf-tile cf-chart"><label>force, N</label><canvas ref="force"></canvas></div>
    </section>
    <section class="cf-right">
      <div class="cf-tile">
        <label>share of the path<span v-if="f.speed < 100" class="cf-warn"> SPEED {{ n(f.speed, 0) }} % ({{ f.slowed }})</span></label>
        <div class="cf-big"><span data-test="share">{{ f.share === null || f.share === undefined ? '–' : n(f.share, 1) }}</span><small>%</small></div>
        <div class="cf-bar cf-path"><div :style="{ width: (f.share || 0) + '%' }"></div></div>
      </div>
      <div class="cf-tile">
        <label>link {{ f.peer || 'no robot yet' }}</label>
        <div class="cf-row cf-pair" v-for="(age, name) in f.ages_ms || {}"><span>{{ name }}</span><b :class="{ 'cf-bad': m.seen === 'running' && (age === null || age > 100) }">{{ age === null ? 'nothing yet' : n(age, 0) + ' ms' }}</b></div>
        <div class="cf-small">{{ n(f.rate_hz, 0) }} Hz · answer {{ f.answer_us ? f.answer_us.join(' / ') : '–' }} µs · lost {{ t('lost') }} · late {{ t('late') }} · malformed {{ t('malformed') }} · unknown sender {{ t('foreign') }}</div>
        <div class="cf-small cf-bad" v-if="f.log || f.records_lost" data-test="log">LOGGING STOPPED {{ f.log }} ({{ f.records_lost }} records)</div>
        <div class="cf-small" v-else-if="m.seen === 'running' && f.state" data-test="log-written">log is written</div>
      </div>
      <div class="cf-tile">
        <label>process</label>
        <div class="cf-events"><span v-for="e in f.events || []" :class="{ 'cf-on': e.on, 'cf-off': !e.watched }" :data-event="e.event">{{ e.event }}<em v-if="e.share !== null">{{ n(100 * e.share, 0) }} %</em></span></div>
      </div>
      <div class="cf-tile cf-actions">
        <label>operators</label>
        <div class="cf-small" v-for="a in m.actions || []">{{ a }}</div>
      </div>
      <slot></slot>
    </section>
    <div class="cf-lost" v-if="stale" data-test="lost">
      <b>{{ lostTitle }}</b>
      <span>{{ lostText }}</span>
    </div>
  </div>`,

  data() {
    return { f: {}, m: {}, stale: true, near: true, scale: COLOURS.map((c) => "#" + c[1].toString(16).padStart(6, "0")) };
  },

  computed: {
    word() {
      if (this.m.seen === "waiting") return "NO RUN";
      if (this.m.seen === "ended") return "ENDED";
      return STATE_WORDS[this.f.state] || "WAITING";
    },
    cause() {
      if (this.m.seen === "waiting") return this.m.why || "waiting for counterflex run";
      if (this.m.seen === "ended") return "the report is below";
      const parts = [];
      const idle = this.f.state === "IDLE" || this.f.state === "READY";
      if (idle && this.f.not_ready) parts.push("not ready: " + this.f.not_ready);
      else if (this.f.cause) parts.push(this.f.cause);
      if (this.f.feed_hold) parts.push("FEED HELD");
      if (this.f.trouble) parts.push("INTERNAL FAULT");
      if (this.f.state && !this.f.may_arm) parts.push("monitoring only");
      return parts.join(" · ");
    },
    rows() {
      return [
        { name: "predicted", value: this.f.predicted_um, colour: PREDICTED },
        { name: "corrected", value: this.f.corrected_um, colour: CORRECTED },
        { name: "remaining", of: "model", value: this.f.remaining_um, colour: REMAINING },
        { name: "measured", value: this.f.measured_um, colour: MEASURED },
      ];
    },
    lostTitle() {
      return this.m.seen === "silent" && this.fresh() ? "THE LOOP IS SILENT" : "NO CONNECTION TO THE PANEL";
    },
    lostText() {
      return "What is shown is old and the buttons may do nothing. Stop the robot at its own controller.";
    },
  },

  mounted() {
    this.last = 0;
    this.count = 0;
    this.began = performance.now();
    try {
      this.cell = new CellView(this.$refs.cell, [], this.range);
    } catch (fault) {
      this.$refs.cell.replaceWith(document.createTextNode("This browser cannot draw in 3-D (WebGL)."));
    }
    this.deviation = new Chart(this.$refs.deviation, "um", [PREDICTED, CORRECTED, REMAINING, MEASURED]);
    this.force = new Chart(this.$refs.force, "N", [MEASURED, PLANNED]);
    this.watch = setInterval(() => (this.stale = !this.fresh() || this.m.seen === "silent"), 200);
    this.curves = setInterval(() => {
      this.deviation.draw();
      this.force.draw();
    }, 200);
    const draw = () => {
      if (this.gone) return;
      if (this.cell && !document.hidden) this.cell.draw();
      setTimeout(() => requestAnimationFrame(draw), 45);
    };
    draw();
    this.$emit("ready", 0);
  },

  unmounted() {
    this.gone = true;
    clearInterval(this.watch);
    clearInterval(this.curves);
  },

  methods: {
    fresh() {
      return this.last && performance.now() - this.last < OLD_MS;
    },
    n(value, digits) {
      return value === null || value === undefined ? "–" : value.toFixed(digits);
    },
    s(value) {
      return value === null || value === undefined ? "–" : (value > 0 ? "+" : "") + value.toFixed(0);
    },
    t(name) {
      return this.f.tally ? this.f.tally[name] : "–";
    },
    clock(seconds) {
      return seconds ? new Date(seconds * 1000).toLocaleTimeString("en-GB") : "";
    },
    bar(value, limit) {
      const share = limit ? Math.min(1, (value || 0) / limit) : 0;
      return { width: 100 * share + "%", background: share > 0.9 ? "#ff3b30" : share > 0.7 ? "#f2b134" : "#40e0a0" };
    },
    view() {
      this.near = !this.near;
      if (this.cell) {
        this.cell.near = this.near;
        this.cell.look();
      }
    },
    bodies(list) {
      if (!this.cell) return;
      const canvas = this.$refs.cell;
      this.cell.renderer.dispose();
      this.cell = new CellView(canvas, list, this.range);
    },
    show(message) {
      this.last = performance.now();
      this.count += 1;
      if (message.figures) this.f = message.figures;
      else if (message.seen === "waiting") this.f = {};
      this.m = message;
      const f = this.f;
      if (message.figures) {
        const time = (this.last - this.began) / 1000;
        const across = (pair) => (pair ? pair[0] : null);
        this.deviation.add(time, [f.predicted_um, f.corrected_um, f.remaining_um, f.measured_um].map(across));
        this.force.add(time, [f.force_size_n, f.planned_size_n]);
      }
      if (this.cell && message.frames) this.cell.place(message.frames, f.tool);
      if (this.cell && message.trail) this.cell.trail(message.trail);
      this.$emit("seen", message.number);
    },
  },
};
