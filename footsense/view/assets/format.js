// Numbers and elements of the page.

export const number = (value, digits, sign = false) => {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  let text = Math.abs(value).toFixed(digits);
  const negative = value < 0 && Number(text) !== 0;
  if (!sign) return (negative ? "−" : "") + text;
  return (negative ? "−" : "+") + text;
};

export const percent = (value) => (Number.isNaN(value) ? "–" : `${Math.round(value * 100)} %`);

// Makes an element with attributes and children.
export function element(name, attributes = {}, ...children) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...children);
  return node;
}

export function svg(name, attributes = {}, ...children) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...children);
  return node;
}

// The parts of a text in which commands and keys stand between backticks.
export const withCode = (text) => text.split("`").map((part, k) => (k % 2 ? element("code", {}, part) : part));

// Sets a text only if it has changed: an unchanged one would still be laid out again.
export function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

export const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export const FLAG = { SIMULATED: 1, DEGRADED_TIMING: 2, TARE_REFUSED: 4, CONTACT: 8 };
