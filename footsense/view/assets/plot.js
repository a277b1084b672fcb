// Signals over time, by uPlot: a lane for each leg, in one scale; a line's colour and dash are those of its signal.

import { OFFERED } from "./columns.js";
import { css, element, number, setText, svg } from "./format.js";

const DASHES = [[], [6, 4], [2, 3]];
const SHORTEST_ZOOM_S = 0.02;
const AXIS_PX = 22; // of the times under the last lane
const dash = (place) => DASHES[place % DASHES.length];
const colour = (place, lightness) => `hsl(${187 + (360 * 5 * place) / OFFERED.length} 70% ${lightness})`;

export class Plot {
  constructor(parent, hello) {
    this.chart = parent.querySelector("#chart");
    this.legs = hello.legs;
    this.signals = new Set(["fz"]);
    this.hidden = new Set();
    this.zoom = null;
    this.#legend(parent.querySelector("#choose-signals"));
    this.#make();
    new ResizeObserver(() => this.shown.forEach((lane) => lane.uplot.setSize(size(lane)))).observe(this.chart);
  }

  #legend(parent) {
    parent.replaceChildren(...OFFERED.map(([name, label, unit], place) => {
      const line = coloured(place, svg("svg", { width: 20, height: 4 }, svg("path", { d: "M0 2 H20", "stroke-dasharray": dash(place) })));
      const button = element("button", { type: "button", "aria-pressed": this.signals.has(name), "data-signal": name },
        line, unit ? `${label} [${unit}]` : label);
      button.onclick = () => {
        button.setAttribute("aria-pressed", toggle(this.signals, name));
        this.#make();
      };
      return button;
    }));
  }

  // Shows the lane of a leg, or its name alone.
  toggleLeg(row) {
    if (row >= this.legs.length) return;
    toggle(this.hidden, row);
    this.#make();
  }

  // Makes the lanes anew: after a choice, a change of theme.
  #make() {
    this.shown?.forEach(({ uplot }) => uplot.destroy());
    this.chosen = OFFERED.map((offered, place) => [...offered, place]).filter(([name]) => this.signals.has(name));
    this.ranges = {};
    const lanes = this.legs.map((leg, row) => {
      const button = element("button", { type: "button", "aria-pressed": !this.hidden.has(row), title: `key ${row + 1}` },
        leg.toUpperCase());
      button.onclick = () => this.toggleLeg(row);
      const plot = element("div", { class: "plot" }), nothing = element("p");
      const values = this.chosen.map(([, , , , place]) => coloured(place, element("span")));
      const node = element("div", { class: "lane", "data-leg": leg }, button, plot, nothing,
        element("div", { class: "values" }, ...values));
      return { row, node, plot, nothing, values };
    });
    this.time = element("span", { class: "at" });
    this.chart.replaceChildren(...lanes.map(({ node }) => node));
    this.shown = lanes.filter(({ row }) => !this.hidden.has(row));
    this.shown.forEach(({ node }) => node.classList.add("shown"));
    this.shown.at(-1)?.node.append(this.time);
    this.shown.at(-1)?.node.classList.add("last");
    for (const lane of this.shown) lane.uplot = new window.uPlot(this.#options(lane), null, lane.plot);
  }

  #options(lane) {
    const units = [...new Set(this.chosen.map(([, , unit]) => unit))];
    const last = lane === this.shown.at(-1), lightness = css("--lightness");
    const axis = { stroke: css("--muted"), grid: { stroke: css("--grid"), width: 1 }, ticks: { show: false },
      font: "11px system-ui, sans-serif" };
    return {
      ...size(lane), pxAlign: 0, padding: [5, 28, last ? 0 : 5, this.chosen.length ? 0 : 48], legend: { show: false },
      series: [{}, ...this.chosen.map(([, , unit, , place]) => ({ scale: unit || "1", stroke: colour(place, lightness), width: 1.5,
        dash: dash(place), points: { show: false } }))],
      scales: { x: { time: false }, ...Object.fromEntries(units.map((unit) => [unit || "1",
        { range: () => this.ranges[unit] ?? [0, 1] }])) },
      axes: [
        { ...axis, size: last ? AXIS_PX : 0, gap: 6, values: (_, ticks) => ticks.map((t) => (last ? `${+t.toFixed(3)} s` : "")) },
        ...units.slice(0, 2).map((unit, k) => ({ ...axis, scale: unit || "1", side: k ? 1 : 3, size: 48,
          grid: { ...axis.grid, show: k === 0 }, space: (...[, , , , height]) => Math.min(0.6 * height, 26),
          values: (_, ticks) => ticks.map((value, n) => (!(unit in this.ranges) ? ""
            : `${+value.toFixed(3)}${n === ticks.length - 1 && unit ? ` ${unit}` : ""}`)) })),
      ],
      cursor: { y: false, points: { show: false }, drag: { x: true, setScale: false }, sync: { key: "lanes" },
        bind: { dblclick: () => () => { this.zoom = null; } } },
      hooks: { draw: [(u) => this.#now(u)], setSelect: [(u) => this.#zoom(u)] },
    };
  }

  colours() { this.#make(); }

  // Zooms to what was drawn over with the mouse.
  #zoom(u) {
    const { left, width } = u.select;
    const [from, to] = [left, left + width].map((x) => u.posToVal(x, "x"));
    if (to - from > SHORTEST_ZOOM_S) this.zoom = [from, to];
    u.setSelect({ left: 0, width: 0 }, false);
  }

  // The present time as a line, where the plot shows what comes after it.
  #now(u) {
    const { min, max } = u.scales.x;
    if (!(this.now >= min && this.now < max - 1e-6)) return;
    const x = u.valToPos(this.now, "x", true);
    u.ctx.save();
    u.ctx.strokeStyle = css("--ink");
    u.ctx.lineWidth = devicePixelRatio;
    u.ctx.beginPath();
    u.ctx.moveTo(x, u.bbox.top);
    u.ctx.lineTo(x, u.bbox.top + u.bbox.height);
    u.ctx.stroke();
    u.ctx.restore();
  }

  draw(store, from, to, now) {
    if (this.zoom?.[1] < store.begin) this.zoom = null; // what it showed is no longer kept
    const [min, max] = this.zoom ?? [from, to], n = this.chosen.length;
    this.now = now;
    const [times, ...values] = store.between(min, max,
      this.shown.flatMap(({ row }) => this.chosen.map(([name]) => [row, store.column[name]])));
    const extremes = values.map(extremesOf);
    this.chosen.forEach(([, , unit]) => {
      const those = extremes.filter(([low], k) => this.chosen[k % n][2] === unit && low < Infinity);
      if (!those.length) return;
      const zero = unit === "°C" ? [] : [0];
      this.ranges[unit] = window.uPlot.rangeNum(Math.min(...zero, ...those.map(([low]) => low)),
        Math.max(...zero, ...those.map(([, high]) => high)), 0.1, true);
    });
    const pointed = this.shown.find(({ uplot }) => uplot.cursor.left >= 0)?.uplot;
    const sample = store.at(pointed ? pointed.posToVal(pointed.cursor.left, "x") : now);
    setText(this.time, pointed && sample ? `${number(sample.t, 3)} s` : "");
    this.shown.forEach((lane, k) => {
      lane.uplot.batch(() => {
        lane.uplot.setData([times, ...values.slice(k * n, (k + 1) * n)], false);
        lane.uplot.setScale("x", { min, max });
      });
      const without = this.chosen.filter((_, m) => extremes[k * n + m][0] === Infinity);
      setText(lane.nothing, without.map(([, label]) => `${label}: no data`).join(", "));
      this.chosen.forEach(([name, , , digits], m) =>
        setText(lane.values[m], sample ? number(sample.get(lane.row, name), digits) : ""));
    });
  }
}

function coloured(place, node) {
  node.style.color = colour(place, "var(--lightness)");
  return node;
}

// The smallest and the largest value; Infinity and -Infinity of none.
function extremesOf(values) {
  let low = Infinity, high = -Infinity;
  for (const value of values) {
    if (value === null) continue;
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return [low, high];
}

function size({ plot }) {
  const { width, height } = plot.getBoundingClientRect();
  return { width: Math.floor(width), height: Math.floor(height) };
}

// Puts a value into a set, or takes it out; returns whether it is in.
function toggle(set, value) {
  if (!set.delete(value)) set.add(value);
  return set.has(value);
}
