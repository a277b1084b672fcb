// The table of the legs: the numbers behind the picture.

import { element, number, percent, setText } from "./format.js";

// Tangential over normal force, and the ground's coefficient of friction where that is known.
function friction(get) {
  const ratio = number(get("tangential_over_normal"), 2);
  return get("tangential_over_normal") >= 0 && get("friction") > 0 ? `${ratio} of ${number(get("friction"), 2)}` : ratio;
}

const COLUMNS = [
  ["state", "text", (get, words) => words.states[get("state")].name],
  ["fx [N]", "", (get) => number(get("fx"), 3, true)],
  ["fy [N]", "", (get) => number(get("fy"), 3, true)],
  ["fz [N]", "", (get) => number(get("fz"), 3, true)],
  ["σ [mN]", "opt", (get) => number(1e3 * Math.max(get("sigma_x"), get("sigma_y"), get("sigma_z")), 0)],
  ["age [ms]", "", (get) => (Number.isNaN(get("fz")) ? "–" : number(get("age"), 1))],
  ["contact", "opt", (get) => percent(get("probability"))],
  ["share", "opt", (get) => percent(get("load_share"))],
  ["friction", "opt", friction],
  ["baseline", "opt text", (get, words) => words.baselines[get("baseline_status")]],
  ["drift [fF]", "opt wide", (get) => number(get("baseline_mean"), 1, true)],
];

export class Legs {
  constructor(parent, hello) {
    this.words = hello.words;
    const head = element("tr", {}, element("th", {}, "leg"),
      ...COLUMNS.map(([title, kind]) => element("th", { class: kind }, title)));
    this.rows = hello.legs.map((leg) => {
      const cells = COLUMNS.map(([, kind]) => element("td", { class: kind }));
      return { cells, row: element("tr", { "data-leg": leg }, element("td", {}, leg.toUpperCase()), ...cells) };
    });
    parent.replaceChildren(element("table", {}, element("thead", {}, head),
      element("tbody", {}, ...this.rows.map(({ row }) => row))));
  }

  draw(sample) {
    this.rows.forEach(({ cells }, leg) => {
      const get = (name) => sample.get(leg, name);
      COLUMNS.forEach(([, kind, text], column) => setText(cells[column], text(get, this.words) ?? "–"));
      cells[0].className = `text ${this.words.states[get("state")].phase}`;
    });
  }
}
