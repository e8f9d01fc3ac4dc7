// The live page of the operator panel: figures, charts and the cell in 3-D, drawn from one message per tick.
import { CellView, COLOURS } from "counterflex-cell-view";

const OLD_MS = 1000; // without a message for so long, what is shown is old
const CHART_S = 60;
const STATE_WORDS = {
  IDLE: "IDLE",
  READY: "READY",
  ARMED: "ARMED",
  ACTIVE: "CORRECTING",
  HOLD: "HOLD",
  RAMP_OUT: "RAMP OUT",
  FAULT: "FAULT",
};

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
