// The recordings of faults that the robot's computer keeps: a list, and each to download.

import { element } from "./format.js";

const PERIOD_MS = 10000;

export class Recordings {
  constructor(parent) {
    this.parent = parent;
    this.shown = "";
    this.#look();
    setInterval(() => document.hidden || this.#look(), PERIOD_MS);
  }

  async #look() {
    const answer = await fetch("/faults").catch(() => null);
    const text = answer?.ok ? await answer.text() : this.shown;
    if (text === this.shown) return;
    this.shown = text;
    const { part_bytes, recordings } = JSON.parse(text);
    this.parent.hidden = !recordings.length;
    this.parent.querySelector("summary").textContent = `Recordings of faults (${recordings.length})`;
    this.parent.querySelector("ul").replaceChildren(...recordings.map(({ name, bytes }) => {
      const [, day, time, leg, cause] = name.match(/^(.*)T(.*)Z-([^-]*)-(.*)\.mcap$/) ?? [, "", "", "", name];
      const button = element("button", { type: "button", title: name }, `download ${(bytes / 1e6).toFixed(1)} MB`);
      button.onclick = () => download(button, name, Math.ceil(bytes / part_bytes));
      return element("li", {}, `${day} ${time.replaceAll("-", ":")} UTC `, element("b", {}, leg.toUpperCase()),
        ` ${cause.replaceAll("-", " ")} `, button);
    }));
  }
}

// Saves a recording, which comes in parts; the button says how far it is.
async function download(button, name, n) {
  const parts = [], label = button.textContent;
  button.disabled = true;
  try {
    for (let k = 0; k < n; k++) {
      const answer = await fetch(`/faults/${encodeURIComponent(name)}/${k}`);
      if (!answer.ok) throw new Error(answer.status);
      parts.push(await answer.blob());
      button.textContent = `${Math.round(100 * (k + 1) / n)} %`;
    }
    const url = URL.createObjectURL(new Blob(parts));
    element("a", { href: url, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(url), PERIOD_MS);
    button.textContent = label;
  } catch {
    button.textContent = "could not be read, try again";
  }
  button.disabled = false;
}
