// Cycles by time: segments of tables, legs by signals. A live page keeps the last minute, a recording what it fetched.

const KEPT_S = 60;
const SEGMENT = 512;
// No line joins two cycles between which others are missing.
const GAP_S = 0.05, GAP_PERIODS = 4;

export class Store {
  constructor(signals, legs) {
    this.legs = legs;
    this.width = signals.length;
    this.stride = signals.length * legs.length;
    this.column = Object.fromEntries(signals.map((name, column) => [name, column]));
    this.segments = []; // in the order of time: {number, n, t, v}
  }

  // Appends live cycles.
  append(t, v) {
    let last = this.segments.at(-1);
    for (let k = 0; k < t.length; k++) {
      if (!last || last.n === SEGMENT) {
        last = { n: 0, t: new Float64Array(SEGMENT), v: new Float32Array(SEGMENT * this.stride) };
        this.segments.push(last);
      }
      last.t[last.n] = t[k];
      last.v.set(v.subarray(k * this.stride, (k + 1) * this.stride), last.n * this.stride);
      last.n++;
    }
    while (this.segments.length > 1 && this.segments[1].t[0] < this.end - KEPT_S) this.segments.shift();
  }

  // Inserts a second of a recording.
  insert(number, t, v) {
    if (!t.length || this.segments.some((segment) => segment.number === number)) return;
    const at = this.segments.findIndex((segment) => segment.number > number);
    this.segments.splice(at < 0 ? this.segments.length : at, 0, { number, n: t.length, t, v });
  }

  // Drops the seconds of a recording that are far from one.
  keepNear(number, distance) {
    this.segments = this.segments.filter((segment) => Math.abs(segment.number - number) <= distance);
  }

  has(number) { return this.segments.some((segment) => segment.number === number); }
  get begin() { return this.segments[0]?.t[0] ?? 0; }
  get end() { const last = this.segments.at(-1); return last ? last.t[last.n - 1] : NaN; }

  // The last cycle at or before a time.
  at(t) {
    for (let s = this.segments.length - 1; s >= 0; s--) {
      const segment = this.segments[s];
      if (segment.t[0] > t) continue;
      let low = 0, high = segment.n - 1;
      while (low < high) {
        const middle = (low + high + 1) >> 1;
        if (segment.t[middle] <= t) low = middle; else high = middle - 1;
      }
      return new Sample(this, segment, low, s);
    }
    return null;
  }

  // Times of the cycles between two times, and values of some (leg, column) pairs; null in each gap.
  between(t0, t1, pairs) {
    const times = [], values = pairs.map(() => []);
    let period = Infinity;
    for (const { n, t, v } of this.segments) {
      if (t[n - 1] < t0 || t[0] > t1) continue;
      for (let k = 0; k < n; k++) {
        if (t[k] < t0 || t[k] > t1) continue;
        const elapsed = times.length ? t[k] - times.at(-1) : Infinity;
        if (times.length && elapsed > Math.max(GAP_S, GAP_PERIODS * period)) {
          times.push((times.at(-1) + t[k]) / 2);
          values.forEach((column) => column.push(null));
        }
        period = Math.min(period, elapsed);
        times.push(t[k]);
        for (let p = 0; p < pairs.length; p++) {
          const value = v[k * this.stride + pairs[p][0] * this.width + pairs[p][1]];
          values[p].push(Number.isNaN(value) ? null : value);
        }
      }
    }
    return [times, ...values];
  }
}

// One cycle.
class Sample {
  constructor(store, segment, index, place) {
    Object.assign(this, { store, segment, index, place });
    this.t = segment.t[index];
  }

  get(leg, name) {
    return this.segment.v[this.index * this.store.stride + leg * this.store.width + this.store.column[name]];
  }

  // Time of the neighbouring cycle; its own at an end.
  neighbour(step) {
    const { segments } = this.store;
    const index = this.index + step;
    if (index >= 0 && index < this.segment.n) return this.segment.t[index];
    const next = segments[this.place + step];
    return next ? next.t[step < 0 ? next.n - 1 : 0] : this.t;
  }
}
