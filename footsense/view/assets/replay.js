// A recording: its clock, its time bar, and stepping from event to event.

import { css, number } from "./format.js";

const AHEAD_S = 11, BEHIND_S = 11, KEPT_S = 60;
const COLOURS = { fault: "--bad", warning: "--warn", good: "--good" };
const $ = (id) => document.getElementById(id);

export class Replay {
  constructor(store, connection, events) {
    Object.assign(this, { store, connection, events, t: 0, end: 0, known: 0, done: false, playing: true, speed: 1 });
    this.asked = new Set();
    $("play").onclick = () => this.toggle();
    $("previous").onclick = () => this.step(-1);
    $("next").onclick = () => this.step(1);
    $("seek").oninput = () => this.seek(Number($("seek").value));
    $("speed").onchange = () => { this.speed = Number($("speed").value); };
    this.speed = Number($("speed").value);
    new ResizeObserver(() => this.marks()).observe($("bar"));
    this.#label();
  }

  // How much of the file has been read.
  progress({ end, done }) {
    this.known = this.end = end;
    this.done = done;
    $("seek").max = this.end;
    this.marks();
  }

  // Advances the time, and returns it.
  tick(now) {
    const elapsed = Math.min((now - (this.last ?? now)) / 1000, 0.25);
    this.last = now;
    this.#fetch();
    if (this.playing && this.store.has(Math.floor(this.t))) {
      this.t = Math.min(this.t + elapsed * this.speed, this.known);
      if (this.t >= this.known && this.done) this.toggle();
    }
    const shown = `${number(this.t, 2)} / ${number(this.end, 1)} s`;
    if ($("time").textContent !== shown) {
      $("time").textContent = shown;
      $("seek").value = this.t;
    }
    return this.t;
  }

  #fetch() {
    const second = Math.floor(this.t), last = Math.floor(this.known);
    for (let n = second, k = 0; k < AHEAD_S + BEHIND_S; k++) {
      n = k < AHEAD_S ? second + k : second - (k - AHEAD_S) - 1;
      if (n < 0 || n > last || this.asked.has(n) || (n === last && !this.done)) continue;
      this.asked.add(n);
      this.connection.send({ type: "chunk", number: n });
    }
    if (this.store.segments.length > 2 * KEPT_S) {
      this.store.keepNear(second, KEPT_S);
      this.asked = new Set(this.store.segments.map((segment) => segment.number));
    }
  }

  toggle() {
    if (!this.playing && this.t >= this.end - 1e-3) this.t = 0;
    this.playing = !this.playing;
    this.#label();
  }

  #label() { $("play").textContent = this.playing ? "pause" : "play"; }

  seek(t) { this.t = Math.min(Math.max(t, 0), this.known); }

  // Pauses at the next event, or the one before; gait events count if they are shown.
  step(direction) {
    const gait = $("gait-events").checked;
    const times = this.events.all.filter(({ kind }) => gait || kind === "state" || kind === "command" || kind === "loss")
      .map(({ t }) => t).sort((a, b) => a - b);
    const t = direction > 0 ? times.find((time) => time > this.t + 1e-4) : times.findLast((time) => time < this.t - 1e-4);
    if (this.playing) this.toggle();
    if (t !== undefined) this.seek(t);
  }

  key({ key, shiftKey }) {
    const by = shiftKey ? 1 : 0.1, sample = this.store.at(this.t);
    const speeds = [...$("speed").options].map((option) => option.value);
    const keys = {
      ArrowLeft: () => this.seek(this.t - by), ArrowRight: () => this.seek(this.t + by),
      n: () => this.step(1), p: () => this.step(-1), Home: () => this.seek(0), End: () => this.seek(this.known),
      ",": () => this.#halt(sample?.neighbour(-1)), ".": () => this.#halt(sample?.neighbour(1)),
      "+": () => this.#faster(speeds, 1), "-": () => this.#faster(speeds, -1),
    };
    keys[key]?.();
    return key in keys;
  }

  #halt(t) {
    if (this.playing) this.toggle();
    if (t !== undefined) this.seek(t);
  }

  #faster(speeds, by) {
    const place = speeds.indexOf($("speed").value) + by;
    if (place in speeds) { $("speed").value = speeds[place]; this.speed = Number(speeds[place]); }
  }

  // Draws the bar: the part that is read, gait events as short lines, changes of state as long ones.
  marks() {
    const canvas = $("bar").querySelector("canvas"), ratio = devicePixelRatio;
    canvas.width = canvas.clientWidth * ratio;
    canvas.height = canvas.clientHeight * ratio;
    const context = canvas.getContext("2d"), { width, height } = canvas;
    const x = (t) => (t / (this.end || 1)) * width;
    context.fillStyle = css("--grid");
    context.fillRect(0, height * 0.36, width, height * 0.28);
    context.fillStyle = css("--faint");
    context.globalAlpha = 0.35;
    context.fillRect(0, height * 0.36, x(this.known), height * 0.28);
    context.globalAlpha = 1;
    for (const { t, kind, level } of this.events.all) {
      const long = kind !== "touchdown" && kind !== "lift-off";
      context.fillStyle = css(COLOURS[level] ?? "--faint");
      context.fillRect(x(t) - ratio / 2, height * (long ? 0.2 : 0.36), ratio * (long ? 2 : 1), height * (long ? 0.6 : 0.28));
    }
  }
}
