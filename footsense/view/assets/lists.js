// What is wrong and what to do, and the events.

import { FLAG, element, number } from "./format.js";

const SHOWN_EVENTS = 200;

// The problems of the legs at one time.
export function problems(sample, hello) {
  const found = [];
  hello.legs.forEach((leg, row) => {
    const state = hello.words.states[sample.get(row, "state")], cause = hello.words.causes[sample.get(row, "cause")];
    const flags = sample.get(row, "flags");
    if (cause?.what || (!state.fault_free && state.what)) {
      found.push({
        leg, phase: state.phase, name: cause?.what ? `${state.name}: ${cause.name}` : state.name,
        what: cause?.what || state.what, check: cause?.check || state.check,
      });
    } else if (flags & FLAG.TARE_REFUSED) {
      found.push({ leg, phase: "degraded", name: "tare refused", what: "its older baseline is in use",
        check: "that nothing presses the foot and it hangs still; then tare it again" });
    }
  });
  if (hello.legs.some((_, row) => sample.get(row, "flags") & FLAG.DEGRADED_TIMING)) {
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

  draw(found) {
    const key = JSON.stringify(found);
    if (key === this.shown) return;
    this.shown = key;
    const list = found.length
      ? element("ul", {}, ...found.map(({ leg, phase, name, what, check }) =>
        element("li", {}, element("b", {}, leg.toUpperCase()),
          element("span", {}, element("span", { class: phase }, name), ` — ${what}. `,
            element("span", { class: "check" }, check ? `Check ${check}.` : "")))))
      : element("p", { class: "fine" }, "Nothing is wrong.");
    this.parent.replaceChildren(element("h2", {}, "What is wrong"), list);
  }
}

export class Events {
  constructor(parent, onPick) {
    this.parent = parent;
    this.list = parent.querySelector("ol");
    this.all = [];
    const gait = parent.querySelector("#gait-events");
    gait.onchange = () => parent.classList.toggle("no-gait", !gait.checked);
    this.list.onclick = (event) => {
      const item = event.target.closest("li");
      if (item && onPick) onPick(Number(item.dataset.t));
    };
  }

  clear() { this.all = []; this.list.replaceChildren(); }

  // Adds events; those of a recording come in order of time, and all are kept.
  add(events, keep) {
    this.all.push(...events);
    if (!keep && this.all.length > 1000) this.all.splice(0, this.all.length - 1000);
    this.list.prepend(...events.slice(-SHOWN_EVENTS).reverse().map((event) => this.#item(event)));
    if (!keep) while (this.list.childElementCount > SHOWN_EVENTS) this.list.lastElementChild.remove();
  }

  #item({ t, leg, kind, level, text }) {
    const gait = ["touchdown", "lift-off", "slip"].includes(kind) ? " gait" : "";
    return element("li", { class: level + gait, "data-t": t }, element("span", { class: "t" }, `${number(t, 3)} s`),
      element("b", {}, (leg ?? "").toUpperCase()), element("span", {}, text));
  }
}
