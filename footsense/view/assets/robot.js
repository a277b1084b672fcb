// The robot from above: each foot's closures as a heat map, its force as an arrow, the load along the leg as a bar.

import { footing } from "./columns.js";
import { css, number, setText, svg } from "./format.js";

const PLACES = {
  lf: [112, 112], lm: [112, 306], lr: [112, 500], rf: [408, 112], rm: [408, 306], rr: [408, 500], l4: [112, 694], r4: [408, 694],
};
const ROWS = 3, GAP = 3, HALF = 54; // of the cells of a foot: rows, room between, and half the side
const FULL_LOAD_N = 1.5; // of the bar; it grows with the largest load
const REACH_PX = 48; // of the longest arrow, or the widest cone: it stays in its foot's frame
const STEPS = [0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100];

export class Robot {
  constructor(parent, hello) {
    this.words = hello.words;
    this.loads = FULL_LOAD_N;
    this.reach = 0.1;
    const longer = hello.legs.some((leg) => PLACES[leg][1] > PLACES.rr[1]) ? PLACES.r4[1] - PLACES.rr[1] : 0;
    const root = svg("svg", { viewBox: `0 0 520 ${612 + longer}`, role: "img", "aria-label": "the feet from above" });
    root.append(
      svg("path", { class: "body", d: `M260 40 L304 92 V${520 + longer} L260 ${572 + longer} L216 ${520 + longer} V92 Z` }),
      svg("path", { class: "front", d: "M260 56 L272 78 L248 78 Z" }),
    );
    const front = svg("text", { x: 260, y: 96, "text-anchor": "middle", class: "small" });
    front.textContent = "front";
    root.append(front);
    this.feet = hello.legs.map((leg) => new Foot(root, leg));
    const legend = svg("g", { transform: `translate(0 ${longer})` });
    root.append(legend);
    this.#legend(legend);
    parent.replaceChildren(root);
    this.colours();
  }

  // Reads the colours of the theme.
  colours() {
    const stops = ["--cold", "--warm", "--hot"].map((name) => css(name).match(/\w\w/g).map((hex) => parseInt(hex, 16)));
    this.map = Array.from({ length: 65 }, (_, k) => {
      const at = k / 32, first = Math.min(Math.floor(at), 1), share = at - first;
      const mixed = stops[first].map((from, c) => Math.round(from + share * (stops[first + 1][c] - from)));
      return `rgb(${mixed})`;
    });
    this.ramp.forEach((cell, k) => cell.setAttribute("fill", this.map[Math.round((k * 64) / 7)]));
    for (const foot of this.feet) foot.shown.fill(-1);
  }

  #legend(root) {
    this.ramp = Array.from({ length: 8 }, (_, k) => svg("rect", { x: 222 + k * 9.6, y: 540, width: 9.6, height: 7 }));
    const gap = svg("text", { x: 260, y: 535, "text-anchor": "middle", class: "key" });
    gap.textContent = "gap closed, 0 to 100 %";
    const box = svg("rect", { x: 190, y: 522, width: 140, height: 30, fill: "var(--panel)" });
    box.setAttribute("class", "box");
    this.bar = svg("path", { class: "scale" });
    this.barText = svg("text", { x: 260, y: 584, "text-anchor": "middle", class: "key" });
    root.append(box, gap, ...this.ramp, this.bar, this.barText);
  }

  draw(sample) {
    // Scales that only ever grow: a picture that jumps cannot be read.
    this.feet.forEach((_, leg) => {
      const fz = sample.get(leg, "fz"), across = Math.hypot(sample.get(leg, "fx"), sample.get(leg, "fy"));
      const cone = sample.get(leg, "friction") * fz;
      if (across > this.reach) this.reach = across;
      if (cone > this.reach) this.reach = cone;
      if (fz > this.loads) this.loads = fz;
    });
    const scale = REACH_PX / this.reach;
    const step = STEPS.findLast((n) => n * scale <= 70) ?? STEPS[0];
    if (step !== this.step || scale !== this.scale) {
      Object.assign(this, { step, scale });
      const half = (step * scale) / 2;
      this.bar.setAttribute("d", `M${260 - half} 592 v6 M${260 - half} 595 h${2 * half} M${260 + half} 592 v6`);
      this.barText.textContent = `${step} N across`;
    }
    this.feet.forEach((foot, leg) => foot.draw(sample, leg, this));
  }
}

class Foot {
  constructor(root, leg) {
    const [x, y] = PLACES[leg];
    const left = x < 260, out = left ? -1 : 1;
    Object.assign(this, { x, y, shown: new Array(ROWS * ROWS).fill(-1) });
    this.group = svg("g", { class: "foot", "data-leg": leg });
    root.append(svg("line", { class: "limb", x1: left ? 216 : 304, x2: x - out * (HALF + 8), y1: y, y2: y }), this.group);
    this.cells = [];
    this.dead = [];
    const cell = (2 * HALF + GAP) / ROWS - GAP, edge = (cell - 16) / 2;
    for (let e = 0; e < ROWS * ROWS; e++) {
      const cx = x - HALF + (e % ROWS) * (cell + GAP), cy = y - HALF + Math.floor(e / ROWS) * (cell + GAP);
      this.cells.push(svg("rect", { class: "cell", x: cx, y: cy, width: cell, height: cell, rx: 3 }));
      this.dead.push(svg("path", { class: "dead", d: `M${cx + edge} ${cy + edge} l16 16 m0 -16 l-16 16` }));
    }
    const side = HALF + 5;
    this.frame = svg("rect", { class: "frame", x: x - side, y: y - side, width: 2 * side, height: 2 * side, rx: 8 });
    const rail = { x: x + out * (side + 10) - 3.5, width: 7, rx: 3 };
    this.load = svg("rect", { class: "load", ...rail, y: y + side, height: 0 });
    this.side = side;
    this.cone = svg("circle", { class: "cone", cx: x, cy: y, r: 0 });
    this.sigma = svg("ellipse", { class: "sigma" });
    this.halo = svg("line", { class: "halo", x1: x, y1: y });
    this.arrow = svg("line", { class: "arrow", x1: x, y1: y });
    this.head = svg("path", { class: "head", d: "M0 0 L-11 5.5 L-11 -5.5 Z" });
    const name = svg("text", { class: "name", x: x - side, y: y - side - 8 });
    name.textContent = leg.toUpperCase();
    this.force = svg("tspan", { class: "fz" });
    this.error = svg("tspan", { class: "small" });
    this.state = svg("text", { x: x - side, y: y + side + 17 });
    this.ground = svg("text", { x: x + side + 12, y: y + side + 17, "text-anchor": "end", class: "small" });
    const room = { x: x - side, y: y - side, width: 2 * side, height: 2 * side }; // an <svg> in it cuts what is outside
    this.group.append(
      this.frame, ...this.cells, ...this.dead, svg("rect", { class: "rail", ...rail, y: y - side, height: 2 * side }), this.load,
      svg("svg", { ...room, viewBox: Object.values(room).join(" ") }, this.cone, this.sigma, this.halo, this.arrow, this.head),
      name, svg("text", { x: x - side + 34, y: y - side - 8 }, this.force, this.error), this.state, this.ground,
    );
  }

  draw(sample, leg, robot) {
    const get = (name) => sample.get(leg, name);
    const state = robot.words.states[get("state")];
    const mask = get("fault_mask"), scale = robot.scale;
    for (let e = 0; e < this.cells.length; e++) {
      const closure = get(`closure_${e}`);
      const level = Number.isNaN(closure) ? 0 : Math.round(64 * Math.min(1, Math.max(0, closure)));
      if (level !== this.shown[e]) {
        this.cells[e].setAttribute("fill", robot.map[level]);
        this.cells[e].style.fill = robot.map[level];
        this.shown[e] = level;
      }
      this.dead[e].classList.toggle("on", Boolean((mask >> e) & 1));
    }
    const fx = get("fx"), fy = get("fy"), fz = get("fz");
    const usable = !Number.isNaN(fz);
    const ground = footing(get), contact = ground === "contact" || ground === "slips", slips = ground === "slips";
    const friction = get("friction"), ratio = get("tangential_over_normal");
    const near = contact && ratio > 0.8 * friction;
    const css = `foot${contact ? " contact" : ""}${slips ? " slips" : ""}${near ? " near" : ""}`
      + (state.phase === "absent" ? " empty" : "");
    if (this.group.getAttribute("class") !== css) {
      this.group.setAttribute("class", css);
      if (state.phase === "absent") for (const cell of this.cells) cell.style.fill = "";
      this.shown.fill(-1);
    }
    this.#arrow(usable && Math.hypot(fx, fy) * scale > 2, -fy * scale, -fx * scale, get, scale);
    const radius = contact && friction > 0 ? friction * fz * scale : 0;
    this.cone.setAttribute("r", Math.max(0, radius));
    const height = usable ? 2 * this.side * Math.min(1, Math.max(0, fz / robot.loads)) : 0;
    this.load.setAttribute("y", this.y + this.side - height);
    this.load.setAttribute("height", height);
    setText(this.force, usable ? `${number(fz, 2)} N` : "– N");
    setText(this.error, usable ? ` ±${number(get("sigma_z"), 2)}` : "");
    setText(this.state, state.name);
    this.state.setAttribute("class", state.phase);
    setText(this.ground, ground);
  }

  // From above, x forward is up on the screen and y left is left.
  #arrow(shown, dx, dy, get, scale) {
    const display = shown ? "inline" : "none";
    for (const part of [this.halo, this.arrow, this.head, this.sigma]) part.style.display = display;
    if (!shown) return;
    const length = Math.hypot(dx, dy), turn = (Math.atan2(dy, dx) * 180) / Math.PI;
    const tip = [this.x + dx, this.y + dy], shaft = Math.max(0, 1 - 8 / length);
    for (const line of [this.halo, this.arrow]) {
      line.setAttribute("x2", this.x + dx * shaft);
      line.setAttribute("y2", this.y + dy * shaft);
    }
    this.head.setAttribute("transform", `translate(${tip}) rotate(${turn})`);
    for (const [key, value] of Object.entries({ cx: tip[0], cy: tip[1], rx: get("sigma_y") * scale, ry: get("sigma_x") * scale })) {
      this.sigma.setAttribute(key, value);
    }
  }
}
