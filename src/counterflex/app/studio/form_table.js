// A table of measured values: one row for each pose. A block that is pasted from a spreadsheet fills cells from where it
// is pasted; arrows and Enter go from row to row.
export default {
  template: `
  <div class="st-form-scroll" data-test="form"><table class="st-table st-entry">
    <thead><tr><th>{{ words.row }}</th><th v-if="posed">{{ words.pose }}</th>
      <th v-for="c in columns" :key="c.name">{{ c.title }}</th><th></th></tr></thead>
    <tbody><tr v-for="(row, r) in rows" :key="r" :class="['st-row-' + state(r), { 'st-on': r === here }]" @focusin="go(r)" @click="go(r)">
      <th>{{ r + 1 }}</th><td v-if="posed" class="st-pose">{{ row.pose }}</td>
      <td v-for="(cell, c) in row.cells" :key="c"><label><span>{{ columns[c].title }}</span>
        <input :value="cell" :data-test="'cell-' + (r + 1) + '-' + columns[c].name" :aria-label="columns[c].title + ', ' + (r + 1)"
          autocomplete="off" @change="typed(r, c, $event)" @paste="pasted(r, c, $event)"
          @keydown.enter.prevent="step(r + 1, c)" @keydown.down.prevent="step(r + 1, c)" @keydown.up.prevent="step(r - 1, c)"></label></td>
      <td class="st-remark" :data-test="'row-' + (r + 1)">{{ (marks[r] || {}).text }}</td></tr></tbody>
  </table></div>`,
  props: { words: Object },
  data() {
    return { columns: [], rows: [], marks: [], posed: false, here: -1 };
  },
  methods: {
    fill(columns, rows) {
      this.posed = rows.some((row) => row.pose);
      [this.columns, this.rows, this.marks, this.here] = [columns, rows, [], -1];
    },
    mark(marks) {
      this.marks = marks;
    },
    state(r) {
      return (this.marks[r] || { state: "todo" }).state;
    },
    go(r) {
      if (r === this.here) return;
      this.here = r;
      this.$emit("pose", r);
    },
    typed(r, c, event) {
      this.enter([[r, c, event.target.value]]);
    },
    pasted(r, c, event) {
      const lines = event.clipboardData.getData("text").replace(/\r/g, "").replace(/\n$/, "").split("\n");
      const block = lines.map((line) => line.split("\t"));
      if (block.length === 1 && block[0].length === 1) return; // as typed
      event.preventDefault();
      this.enter(block.flatMap((line, i) => line.map((text, j) => [r + i, c + j, text.trim()]))
        .filter(([i, j]) => i < this.rows.length && j < this.columns.length));
    },
    enter(cells) {
      for (const [r, c, text] of cells) this.rows[r].cells[c] = text;
      this.$emit("enter", cells);
    },
    step(r, c) {
      const next = this.$el.querySelectorAll("tbody tr")[r];
      if (next) next.querySelectorAll("input")[c].focus();
    },
  },
};
