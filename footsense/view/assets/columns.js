// The numbers of a leg by the names of their signals: the columns of the table, and what the plot offers.

import { FLAG, number, percent } from "./format.js";

// Tangential over normal force, and the ground's coefficient of friction where that is known.
function ratioAndFriction(get) {
  const ratio = number(get("tangential_over_normal"), 2);
  return get("tangential_over_normal") >= 0 && get("friction") > 0 ? `${ratio} of ${number(get("friction"), 2)}` : ratio;
}

// What the foot does, in the words of the terminal; empty without a usable force.
export function footing(get) {
  if (Number.isNaN(get("fz"))) return "";
  return get("slip") === 2 ? "slips" : get("flags") & FLAG.CONTACT ? "contact" : "swing";
}

// Title, class and text of each column.
export const COLUMNS = [
  ["state", "text", (get, words) => words.states[get("state")].name],
  ["foot", "opt text", (get) => footing(get) || "–"],
  ["fx [N]", "", (get) => number(get("fx"), 3, true)],
  ["fy [N]", "", (get) => number(get("fy"), 3, true)],
  ["fz [N]", "", (get) => number(get("fz"), 3, true)],
  ["σ [mN]", "opt", (get) => number(1e3 * Math.max(get("sigma_x"), get("sigma_y"), get("sigma_z")), 0)],
  ["age [ms]", "", (get) => (Number.isNaN(get("fz")) ? "–" : number(get("age"), 1))],
  ["holds", "opt", (get) => percent(get("holds"))],
  ["share", "opt", (get) => percent(get("load_share"))],
  ["ft/fn", "opt", ratioAndFriction],
  ["baseline", "opt text", (get, words) => words.baselines[get("baseline_status")]],
  ["drift [fF]", "opt wide", (get) => number(get("baseline_mean"), 1, true)],
];

// Signal, label, unit and digits of each curve.
export const OFFERED = [
  ["fz", "fz", "N", 3], ["fx", "fx", "N", 3], ["fy", "fy", "N", 3], ["sigma_z", "σz", "N", 3], ["closure_4", "mid gap", "", 2],
  ["contact_probability", "contact", "", 2], ["holds", "holds", "", 2], ["load_share", "share", "", 2], ["tangential_over_normal", "ft/fn", "", 2],
  ["age", "age", "ms", 1], ["baseline_mean", "drift", "fF", 1], ["temperature", "temperature", "°C", 1],
];
