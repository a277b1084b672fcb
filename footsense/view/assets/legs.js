// The table of the legs: the numbers behind the picture.

import { COLUMNS } from "./columns.js";
import { element, setText } from "./format.js";

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
