// The numbers of a leg by the names of their signals: the columns of the table, and what the plot offers.

import { number, percent } from "./format.js";

// Tangential over normal force, and the ground's coefficient of friction where that is known.
function friction(get) {
  const ratio = number(get("tangential_over_normal"), 2);
  return get("tangential_over_normal") >= 0 && get("friction") > 0 ? `${ratio} of ${number(get("friction"), 2)}` : ratio;
}

// Title, class and text of each column.
export const COLUMNS = [
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

// Signal, label and unit of each curve.
export const OFFERED = [
  ["fz", "fz", "N"], ["fx", "fx", "N"], ["fy", "fy", "N"], ["sigma_z", "σz", "N"], ["closure_4", "middle gap", ""],
  ["probability", "contact", ""], ["load_share", "share", ""], ["tangential_over_normal", "ft / fn", ""], ["age", "age", "ms"],
  ["baseline_mean", "drift", "fF"], ["temperature", "temperature", "°C"],
];
