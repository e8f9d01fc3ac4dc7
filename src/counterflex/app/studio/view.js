// The cell of the studio in 3-D: robot and part, the way of the tool in colours, its source text beside it.
import { THREE, CellView, colourOf } from "counterflex-cell-view";

const ROW = 20; // px, height of a line of the source
const PICK = 14; // px, how near a click has to be to a point
const BLANK = new THREE.Color(0x6f8496); // faces of the blank, and what the tool has made
const CUT = new THREE.Color(0xd8dee4);
const UM = 2000; // an ellipsoid of 100 um is drawn 0.2 m large

class StudioView extends CellView {
  constructor(canvas, bodies, dark) {
    super(canvas, bodies, 1);
    this.near = false;
    this.theme(dark);
  }

  theme(dark) {
    this.scene.background = new THREE.Color(dark ? 0x10161c : 0xeef2f6);
    Object.assign(this.grid.material, { vertexColors: false, needsUpdate: true });
    this.grid.material.color.set(dark ? 0x2a3a48 : 0xc9d3dc);
    this.dirty = true;
  }

  way(points) {
    this.points = points;
    if (this.lines) this.frame("part").remove(this.lines, this.dots, this.mark);
    const count = points.length / 3;
    const position = new Float32Array(points.length);
    for (let k = 0; k < points.length; k++) position[k] = points[k] / 1000;
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(position, 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(3 * count), 3));
    this.lines = new THREE.Line(geometry, new THREE.LineBasicMaterial({ vertexColors: true }));
    const dots = { vertexColors: true, size: 5, sizeAttenuation: false };
    this.dots = new THREE.Points(geometry, new THREE.PointsMaterial(dots));
    this.lines.frustumCulled = this.dots.frustumCulled = false;
    const ball = new THREE.SphereGeometry(0.0015, 16, 12);
    this.mark = new THREE.Mesh(ball, new THREE.MeshBasicMaterial({ color: 0xff2d95, depthTest: false }));
    this.mark.renderOrder = 5;
    this.frame("part").add(this.lines, this.dots, this.mark);
  }

  colour(values, low, high, cutting) {
    const attribute = this.lines.geometry.getAttribute("color");
    const grey = new THREE.Color(0x8794a0);
    values.forEach((value, k) => {
      const c = value === null || !cutting[k] ? grey : colourOf((value - low) / (high - low || 1));
      attribute.setXYZ(k, c.r, c.g, c.b);
    });
    attribute.needsUpdate = true;
    this.dirty = true;
  }

  // The stock: per cell a flat top of four corners; neighbours are joined by walls. Two rims of cells without width close
  // the sides: one as high as its neighbours, in the colour of the blank, and one at the bottom.
  film(data) {
    if (this.cut) {
      this.frame("part").remove(this.cut.mesh, this.hidden);
      this.cut.mesh.geometry.dispose();
    }
    const nx = data.nx + 4, ny = data.ny + 4, position = new Float32Array(12 * nx * ny);
    const edge = (i, n, low) => low + data.side * Math.min(Math.max(i, 0), n);
    for (let j = 0; j < ny; j++) {
      for (let i = 0; i < nx; i++) {
        for (let c = 0; c < 4; c++) {
          const at = 3 * (4 * (j * nx + i) + c);
          position[at] = edge(i - 2 + (c & 1), data.nx, data.corner[0]);
          position[at + 1] = edge(j - 2 + (c >> 1), data.ny, data.corner[1]);
          position[at + 2] = data.bottom;
        }
      }
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(position, 3));
    const colour = new Float32Array(12 * nx * ny);
    for (let k = 0; k < colour.length; k += 3) (colour[k] = BLANK.r), (colour[k + 1] = BLANK.g), (colour[k + 2] = BLANK.b);
    geometry.setAttribute("color", new THREE.BufferAttribute(colour, 3));
    geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(18 * nx * ny), 1));
    const material = new THREE.MeshLambertMaterial({
      vertexColors: true, flatShading: true, side: THREE.DoubleSide,
      polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 2, // the path lies on what it has cut
    });
    const mesh = new THREE.Mesh(geometry, material);
    mesh.frustumCulled = false;
    mesh.matrixAutoUpdate = false;
    const t = data.turn;
    mesh.matrix.set(t[0], t[1], t[2], 0, t[3], t[4], t[5], 0, t[6], t[7], t[8], 0, 0, 0, 0, 1);
    const bytes = (text) => Uint8Array.from(atob(text), (one) => one.charCodeAt(0)).buffer;
    const [blank, top] = [new Float32Array(bytes(data.blank)), new Float32Array(bytes(data.top))];
    this.cut = { ...data, mesh, blank, top, cell: new Uint32Array(bytes(data.cell)), done: -1 };
    if (this.stock) this.stock.visible = false;
    this.frame("part").add(mesh);
    const faint = { vertexColors: true, transparent: true, opacity: 0.5, depthWrite: false, size: 3, sizeAttenuation: false };
    const later = new THREE.PointsMaterial({ ...faint, depthFunc: THREE.GreaterDepth }); // still in the stock
    this.hidden = new THREE.Points(this.lines.geometry, later);
    this.hidden.frustumCulled = false;
    this.frame("part").add(this.hidden);
  }

  lower(cell, top) {
    const { nx, ny, mesh, blank } = this.cut, { position, color } = mesh.geometry.attributes;
    const i = cell % nx, j = Math.floor(cell / nx);
    for (let y = j ? j : -1; y <= (j < ny - 1 ? j : ny); y++) {
      for (let x = i ? i : -1; x <= (i < nx - 1 ? i : nx); x++) {
        const shade = x === i && y === j && top < blank[cell] - 1e-6 ? CUT : BLANK;
        for (let c = 0, v = 4 * ((y + 2) * (nx + 4) + x + 2); c < 4; c++, v++) {
          position.setZ(v, top);
          color.setXYZ(v, shade.r, shade.g, shade.b);
        }
      }
    }
  }

  // Triangles of what is there to be seen: along a row, cells and walls that are alike are drawn as one.
  join() {
    const { attributes, index } = this.cut.mesh.geometry, to = index.array;
    const nx = this.cut.nx + 4, ny = this.cut.ny + 4, z = attributes.position.array, red = attributes.color.array;
    const high = (cell) => z[12 * cell + 2], alike = (a, b) => high(a) === high(b) && red[12 * a] === red[12 * b];
    let n = 0;
    const quad = (a, b, c, d) => {
      to[n++] = a, to[n++] = b, to[n++] = c, to[n++] = c, to[n++] = b, to[n++] = d;
    };
    for (let j = 0; j < ny; j++) {
      for (let i = 0, from = 0, wall = 0; i < nx; i++) {
        const cell = j * nx + i, last = i + 1 === nx, end = last || !alike(cell, cell + 1);
        if (end) {
          const first = j * nx + from;
          quad(4 * first, 4 * cell + 1, 4 * first + 2, 4 * cell + 3);
          if (!last && high(cell) !== high(cell + 1)) quad(4 * cell + 1, 4 * cell + 4, 4 * cell + 3, 4 * cell + 6);
          from = i + 1;
        }
        if (j + 1 < ny && (end || !alike(cell + nx, cell + nx + 1))) {
          const first = j * nx + wall;
          if (high(cell) !== high(cell + nx)) quad(4 * first + 2, 4 * cell + 3, 4 * (first + nx), 4 * (cell + nx) + 1);
          wall = i + 1;
        }
      }
    }
    index.needsUpdate = true;
    this.cut.mesh.geometry.setDrawRange(0, n);
  }

  // Cut up to a point; the number of changes until there, -1 without a stock.
  cutTo(k) {
    const film = this.cut;
    if (!film) return -1;
    let state = 0;
    while (state < film.point.length && film.point[state] <= k) state++;
    const upTo = state ? film.end[state - 1] : 0;
    if (upTo === film.done) return upTo;
    if (upTo < film.done || film.done < 0) {
      film.blank.forEach((top, cell) => this.lower(cell, top));
      film.done = 0;
    }
    for (let e = film.done; e < upTo; e++) this.lower(film.cell[e], film.top[e]);
    film.done = upTo;
    for (const one of ["position", "color"]) film.mesh.geometry.attributes[one].needsUpdate = true;
    this.join();
    this.dirty = true;
    return upTo;
  }

  select(k) {
    this.mark.position.set(...[0, 1, 2].map((i) => this.points[3 * k + i] / 1000));
    this.dirty = true;
  }

  // Number of the point that is drawn nearest to a place of the canvas; -1 where none is near.
  nearest(x, y) {
    const w = this.canvas.clientWidth, h = this.canvas.clientHeight;
    const m = new THREE.Matrix4().multiplyMatrices(this.camera.projectionMatrix, this.camera.matrixWorldInverse);
    m.multiply(this.frame("part").matrix);
    const p = new THREE.Vector3();
    let best = -1, least = PICK * PICK;
    for (let k = 0; k < this.points.length / 3; k++) {
      p.set(this.points[3 * k] / 1000, this.points[3 * k + 1] / 1000, this.points[3 * k + 2] / 1000).applyMatrix4(m);
      const dx = ((p.x + 1) / 2) * w - x, dy = ((1 - p.y) / 2) * h - y;
      if (p.z < 1 && dx * dx + dy * dy < least) [best, least] = [k, dx * dx + dy * dy];
    }
    return best;
  }

  ellipsoid(c) {
    if (!this.soft) {
      const material = new THREE.MeshStandardMaterial({ color: 0x2e9bff, transparent: true, opacity: 0.55 });
      this.soft = new THREE.Mesh(new THREE.SphereGeometry(1, 32, 20), material);
      this.soft.matrixAutoUpdate = false;
      this.scene.add(this.soft);
    }
    const s = 100 * UM * 1e-6;
    const at = this.frame("tcp").matrix.elements;
    this.soft.matrix.set(
      s * c[0], s * c[1], s * c[2], at[12],
      s * c[3], s * c[4], s * c[5], at[13],
      s * c[6], s * c[7], s * c[8], at[14],
      0, 0, 0, 1,
    );
    this.soft.matrixWorldNeedsUpdate = true;
    this.dirty = true;
  }
}

export default {
  template: `
  <div class="st-view" :class="{ 'st-with-source': source.length }">
    <div class="st-canvas" data-test="canvas">
      <canvas ref="canvas" @pointerdown="press" @pointerup="pick"></canvas>
      <i v-if="changes >= 0" data-test="stock" :data-changes="changes" hidden></i>
      <p v-if="!drawn" class="st-empty">{{ words.empty }}</p>
      <button v-if="drawn" class="st-small st-corner" type="button" @click="look">{{ near ? words.far : words.near }}</button>
      <div v-if="way && shown" class="st-legend"><b>{{ shown.title }}</b><i></i>
        <span>{{ number(shown.low) }}</span><span>{{ number(shown.high) }} {{ shown.unit }}</span>
        <em v-if="shown.most < shown.high">{{ words.most }} {{ number(shown.most) }} {{ shown.unit }}</em></div>
    </div>
    <div v-if="way" class="st-time">
      <button class="st-small" type="button" data-test="play" @click="play">{{ playing ? words.pause : words.play }}</button>
      <input type="range" min="0" :max="last" v-model.number="at" :aria-label="words.slider" data-test="time" @input="moved">
      <output data-test="at">{{ readout }}</output>
    </div>
    <div v-if="source.length" class="st-source" ref="source" tabindex="0" data-test="source"
      @scroll="scrolled" @keydown.up.prevent="step(-1)" @keydown.down.prevent="step(1)">
      <div :style="{ height: source.length * ${ROW} + 'px' }"><div :style="{ transform: 'translateY(' + first * ${ROW} + 'px)' }">
        <div v-for="row in rows" :key="row.number" class="st-line" :data-line="row.number" @click="toLine(row.number)"
          :class="{ 'st-on': row.number === line, 'st-still': !byLine.has(row.number) }"
          ><u>{{ row.number }}</u><span>{{ row.text }}</span></div>
      </div></div>
    </div>
  </div>`,
  props: { words: Object },
  data() {
    return { way: false, shown: null, at: 0, last: 0, line: 0, source: [], first: 0, rows: [], near: false, drawn: false,
      changes: -1, playing: false, readout: "", byLine: new Map() };
  },
  mounted() {
    this.dark = document.body.classList.contains("body--dark");
    this.resize = new ResizeObserver(() => this.scrolled());
    const draw = () => {
      if (this.gone) return;
      if (this.playing) this.tick();
      if (this.view && this.$refs.canvas.clientWidth) this.view.draw();
      requestAnimationFrame(draw);
    };
    draw();
    this.watcher = new MutationObserver(() => this.view && this.view.theme(document.body.classList.contains("body--dark")));
    this.watcher.observe(document.body, { attributes: true, attributeFilter: ["class"] });
    this.$emit("ready", 0);
  },
  unmounted() {
    this.gone = true;
    this.watcher.disconnect();
    this.resize.disconnect();
    if (this.view) this.view.renderer.dispose();
  },
  methods: {
    number(value) {
      return Math.abs(value) >= 100 ? value.toFixed(0) : value.toFixed(1);
    },
    cell(bodies, frames) {
      const canvas = this.$refs.canvas;
      if (this.view) this.view.renderer.dispose();
      this.view = new StudioView(canvas, bodies, document.body.classList.contains("body--dark"));
      this.view.near = this.near;
      this.way = false;
      this.changes = -1;
      this.drawn = true;
      this.view.place(frames, 1);
    },
    pose(frames, compliance) {
      if (!this.view) return;
      this.view.place(frames, 1);
      if (compliance) this.view.ellipsoid(compliance);
    },
    path(data, text, near) {
      if (!this.view) return;
      this.d = Object.freeze(data);
      this.near = this.view.near = near;
      this.view.way(data.p);
      [this.way, this.last, this.at] = [true, data.line.length - 1, 0];
      this.source = Object.freeze(text);
      this.byLine = new Map();
      data.line.forEach((line, k) => this.byLine.has(line) || this.byLine.set(line, k));
      this.view.looked = false;
      this.$nextTick(() => {
        if (this.$refs.source) this.resize.observe(this.$refs.source);
        this.scrolled();
        this.moved();
      });
    },
    film(data) {
      if (!this.way) return;
      this.view.film(data);
      this.changes = this.view.cutTo(this.at);
    },
    paint(channel, title, unit) {
      const values = this.d.values[channel] || [];
      // Before and after have one scale, so that the gain is seen.
      const both = ["before", "after"].includes(channel) ? ["before", "after"] : [channel];
      const counted = (name) => (this.d.values[name] || []).filter((v, k) => v !== null && this.d.cutting[k]);
      const range = (all) => all.reduce(([a, b], v) => [Math.min(a, v), Math.max(b, v)], [Infinity, -Infinity]);
      const [low, high] = range(both.flatMap(counted)), most = range(counted(channel))[1];
      if (low > high) return;
      this.shown = { channel, title, unit, low, high, most };
      this.view.colour(values, low, high, this.d.cutting);
      this.moved();
    },
    moved() {
      if (!this.d) return;
      const k = this.at, d = this.d;
      if (d.poses.length) {
        let j = 0;
        while (j + 1 < d.posed.length && d.posed[j + 1] <= k) j++;
        this.view.place(d.poses[j], d.tool[k]);
      }
      this.view.select(k);
      this.changes = this.view.cutTo(k);
      if (this.line !== d.line[k]) {
        this.line = d.line[k];
        this.reveal();
      }
      const place = [0, 1, 2].map((i) => "XYZ"[i] + d.p[3 * k + i].toFixed(2)).join(" ");
      const value = this.shown && d.values[this.shown.channel][k];
      const more = typeof value === "number" ? `, ${this.shown.title} ${this.number(value)} ${this.shown.unit}` : "";
      this.readout = `${this.words.line} ${this.line}, ${d.time[k].toFixed(2)} ${this.words.time}, ${place}${more}`;
    },
    play() {
      this.playing = !this.playing;
      if (this.at >= this.last) this.at = 0;
      this.from = performance.now() - 1000 * this.d.time[this.at];
    },
    tick() {
      const now = (performance.now() - this.from) / 1000;
      while (this.at < this.last && this.d.time[this.at + 1] <= now) this.at++;
      if (this.at >= this.last) this.playing = false;
      this.moved();
    },
    toLine(number) {
      if (!this.byLine.has(number)) return;
      this.at = this.byLine.get(number);
      this.moved();
    },
    step(by) {
      for (let n = this.line + by; n > 0 && n <= this.source.length; n += by) {
        if (this.byLine.has(n)) return this.toLine(n);
      }
    },
    press(event) {
      this.pressed = [event.offsetX, event.offsetY];
    },
    pick(event) {
      const [x, y] = this.pressed || [-99, -99];
      if (!this.way || Math.hypot(event.offsetX - x, event.offsetY - y) > 3) return; // the view was turned
      const k = this.view.nearest(x, y);
      if (k >= 0) {
        this.at = k;
        this.moved();
      }
    },
    look() {
      this.near = !this.near;
      this.view.near = this.near;
      this.view.look();
    },
    reveal() {
      const box = this.$refs.source;
      if (!box) return;
      const top = (this.line - 1) * ROW;
      if (top < box.scrollTop || top + ROW > box.scrollTop + box.clientHeight) box.scrollTop = top - box.clientHeight / 3;
    },
    scrolled() {
      const box = this.$refs.source;
      if (!box) return;
      this.first = Math.floor(box.scrollTop / ROW);
      const count = Math.ceil(box.clientHeight / ROW) + 1;
      this.rows = this.source.slice(this.first, this.first + count).map((text, k) => ({ text, number: this.first + k + 1 }));
    },
  },
};
