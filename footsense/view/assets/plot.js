// Signals over time, by uPlot: any signals of any legs.

import { OFFERED } from "./columns.js";
import { css, element, number } from "./format.js";

const DASHES = [[], [6, 4], [2, 3], [9, 3, 2, 3]];

export class Plot {
  constructor(parent, hello) {
    this.parent = parent;
    this.chart = parent.querySelector("#chart");
    this.chart.replaceChildren(); // the chart of the former service
    this.legs = hello.legs;
    this.signals = new Set(["fz"]);
    this.shown = new Set(hello.legs.keys());
    this.#choosers(parent);
    this.#make();
    new ResizeObserver(() => this.#resize()).observe(this.chart);
  }

  #choosers(parent) {
    const toggle = (set, value, button) => {
      if (set.has(value)) set.delete(value); else set.add(value);
      button.setAttribute("aria-pressed", set.has(value));
      this.#make();
    };
    parent.querySelector("#choose-signals").replaceChildren(...OFFERED.map(([name, label, unit]) => {
      const button = element("button", { type: "button", "aria-pressed": this.signals.has(name), "data-signal": name },
        unit ? `${label} [${unit}]` : label);
      button.onclick = () => toggle(this.signals, name, button);
      return button;
    }));
    this.legButtons = this.legs.map((leg, row) => {
      const button = element("button", { type: "button", "aria-pressed": "true", title: `key ${row + 1}` }, leg.toUpperCase());
      button.style.setProperty("--c", `var(--leg-${row % 8})`);
      button.onclick = () => toggle(this.shown, row, button);
      return button;
    });
    parent.querySelector("#choose-legs").replaceChildren(...this.legButtons);
  }

  toggleLeg(row) { this.legButtons[row]?.click(); }

  // Makes the chart anew: after a choice, a change of theme.
  #make() {
    this.uplot?.destroy();
    const chosen = OFFERED.filter(([name]) => this.signals.has(name));
    const units = [...new Set(chosen.map(([, , unit]) => unit))];
    this.pairs = [];
    const series = [{ value: (_, t) => (t === null ? "" : `${number(t, 3)} s`) }];
    chosen.forEach(([name, label, unit], place) => [...this.shown].sort().forEach((row) => {
      this.pairs.push([row, name]);
      series.push({
        label: `${this.legs[row].toUpperCase()} ${label}`, scale: unit || "1", stroke: css(`--leg-${row % 8}`),
        width: 1.5, dash: DASHES[place % DASHES.length], points: { show: false }, spanGaps: false,
      });
    }));
    const axis = { stroke: css("--muted"), grid: { stroke: css("--grid"), width: 1 }, ticks: { show: false },
      font: "12px system-ui, sans-serif" };
    const options = {
      ...this.#size(), series, legend: { show: false }, cursor: { y: false, drag: { x: false, y: false } }, pxAlign: 0,
      scales: { x: { time: false }, ...Object.fromEntries(units.map((unit) => [unit || "1", {}])) },
      axes: [
        { ...axis, size: 26, values: (_, ticks) => ticks.map((t) => (t < 0 ? "" : `${+t.toFixed(3)} s`)) },
        ...units.map((unit, k) => ({ ...axis, scale: unit || "1", side: k % 2 ? 1 : 3, size: 52,
          grid: { ...axis.grid, show: k === 0 },
          values: (_, ticks) => ticks.map((value, n) => `${+value.toFixed(3)}${n === ticks.length - 1 && unit ? ` ${unit}` : ""}`) })),
      ],
      hooks: { draw: [(u) => this.#now(u)] },
    };
    this.uplot = new window.uPlot(options, [[], ...this.pairs.map(() => [])], this.chart);
    this.last = null;
  }

  colours() { this.#make(); }

  #size() { return { width: Math.max(this.chart.clientWidth, 100), height: Math.max(this.chart.clientHeight, 100) }; }
  #resize() { this.uplot.setSize(this.#size()); }

  // The present time as a line, where the plot shows what comes after it.
  #now(u) {
    if (!this.window || this.now > this.window[1] - 1e-6) return;
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
    this.window = [from, to];
    this.now = now;
    const pairs = this.pairs.map(([row, name]) => [row, store.column[name]]);
    this.uplot.batch(() => {
      this.uplot.setData(store.between(from, to, pairs), false);
      this.uplot.setScale("x", { min: from, max: to });
    });
  }
}
