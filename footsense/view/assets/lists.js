// What is wrong and what to do, and the events.

import { FLAG, element, number, withCode } from "./format.js";

const SHOWN_EVENTS = 200;

// The problems of the legs at one time.
export function problems(sample, hello) {
  const found = [], refused = [];
  hello.legs.forEach((leg, row) => {
    const state = hello.words.states[sample.get(row, "state")], cause = hello.words.causes[sample.get(row, "cause")];
    const flags = sample.get(row, "flags");
    if (cause?.what || (!state.fault_free && state.what)) {
      found.push({
        leg, phase: state.phase, name: cause?.what ? `${state.name}: ${cause.name}` : state.name,
        what: cause?.what || state.what, check: cause?.check || state.check,
      });
    } else if (flags & FLAG.TARE_REFUSED) {
      refused.push(leg);
    }
  });
  if (refused.length) {
    found.push({ leg: refused.length > 1 ? "" : refused[0], phase: "degraded",
      name: refused.length > 1 ? `tare refused of ${refused.join(", ").toUpperCase()}` : "tare refused",
      what: "the older baseline is in use", check: "that nothing presses the foot and it hangs still; then `footsense tare LEG`" });
  }
  const timing = hello.legs.map((_, row) => sample.get(row, "flags")).find((flags) => flags & FLAG.DEGRADED_TIMING);
  if (timing & FLAG.SIMULATED) {
    found.push({ leg: "", phase: "degraded", name: "timing degraded", what: "the simulation cannot keep pace with real time",
      check: "what else runs on this computer" });
  } else if (timing) {
    found.push({ leg: "", phase: "degraded", name: "timing degraded", what: "the loop runs without the scheduling that it asked for",
      check: "`realtime` in the configuration, and the rights of the service; its log names what was refused" });
  }
  return found;
}

export class Problems {
  constructor(parent) {
    this.parent = parent;
    this.shown = null;
  }

  // Shows the problems of the legs; the banner's text is another one, or empty.
  draw(found, banner) {
    const key = JSON.stringify([found, Boolean(banner)]);
    if (key === this.shown) return;
    this.shown = key;
    const list = found.length
      ? element("ul", {}, ...found.map(({ leg, phase, name, what, check }) =>
        element("li", {}, element("b", {}, leg.toUpperCase()),
          element("span", {}, element("span", { class: phase }, name), ` — ${what}. `,
            element("span", { class: "check" }, ...withCode(check ? `Check ${check}.` : ""))))))
      : element("p", { class: "fine" }, banner ? "Nothing else is wrong." : "Nothing is wrong.");
    this.parent.replaceChildren(element("h2", {}, "What is wrong"), list);
  }
}

export class Events {
  constructor(parent, onPick) {
    this.parent = parent;
    this.list = parent.querySelector("ol");
    Object.assign(this, { all: [], first: null, place: null });
    const gait = parent.querySelector("#gait-events");
    gait.onchange = () => parent.classList.toggle("no-gait", !gait.checked);
    this.list.onclick = (event) => {
      const item = event.target.closest("li");
      if (item && onPick) onPick(Number(item.dataset.t));
    };
  }

  clear() { this.all = []; this.first = null; this.list.replaceChildren(); }

  // Adds events. Those of a recording are all kept, and shown around its time; of live ones the newest are shown.
  add(events, recorded) {
    this.all.push(...events);
    this.first = null;
    if (recorded) {
      this.all.sort((a, b) => a.t - b.t);
      return;
    }
    if (this.all.length > 1000) this.all.splice(0, this.all.length - 1000);
    this.list.prepend(...events.slice(-SHOWN_EVENTS).reverse().map((event) => this.#item(event)));
    while (this.list.childElementCount > SHOWN_EVENTS) this.list.lastElementChild.remove();
  }

  // Shows the events of a recording around a time, the last one before it marked.
  show(t) {
    const place = this.all.findLastIndex((event) => event.t <= t + 1e-4);
    if (this.first === null || place < this.first || place >= this.first + SHOWN_EVENTS) {
      this.first = Math.max(0, Math.min(place - SHOWN_EVENTS / 2, this.all.length - SHOWN_EVENTS));
      this.place = null;
      const shown = this.all.slice(this.first, this.first + SHOWN_EVENTS);
      this.list.replaceChildren(...shown.map((event) => this.#item(event)));
    }
    if (place === this.place) return;
    this.place = place;
    this.list.querySelector(".now")?.classList.remove("now");
    const item = this.list.children[place - this.first];
    if (!item) return;
    item.classList.add("now");
    this.list.scrollTop = item.offsetTop - this.list.offsetTop - this.list.clientHeight / 2;
  }

  #item({ t, leg, kind, level, text }) {
    const gait = ["touchdown", "lift-off", "slip"].includes(kind) ? " gait" : "";
    return element("li", { class: level + gait, "data-t": t }, element("span", { class: "t" }, `${number(t, 3)} s`),
      element("b", {}, (leg ?? "").toUpperCase()), element("span", {}, text));
  }
}
