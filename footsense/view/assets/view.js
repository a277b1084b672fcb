// The page: connects to the server, keeps the cycles, and draws the newest, or those of a recording.

import { Connection } from "./connection.js";
import { withCode } from "./format.js";
import { Legs } from "./legs.js";
import { Events, Problems, problems } from "./lists.js";
import { Plot } from "./plot.js";
import { Recordings } from "./recordings.js";
import { Replay } from "./replay.js";
import { Robot } from "./robot.js";
import { Store } from "./store.js";

const PLOT_S = 10, SHORTEST_PLOT_S = 0.1, TEXT_MS = 100, PLOT_MS = 33;
const STALE_MS = 500; // without a new cycle for so long, the picture is old

const $ = (id) => document.getElementById(id);
const page = {
  hello: null, store: null, frames: 0, fps: 0, rate: 0, drawn: NaN, paused: null, problem: "", offline: false,
  arrived: 0, n: 0, cost: 0,
};
window.footsense = page; // for the console, and for tests

const events = new Events($("events"), (t) => page.replay?.seek(t));
const problemList = new Problems($("problems"));
new Recordings($("recordings"));
const connection = new Connection({
  hello(message) {
    page.hello = message;
    page.store = new Store(message.signals, message.legs);
    page.drawn = NaN;
    page.paused = null;
    events.clear();
    $("title").textContent = message.title;
    $("simulated").hidden = !message.simulated;
    document.title = `footsense: ${message.title}`;
    document.body.classList.toggle("replay", message.mode === "replay");
    $("replay").hidden = message.mode !== "replay";
    $("pause").hidden = message.mode === "replay";
    document.body.classList.toggle("empty", !message.legs.length);
    $("empty").hidden = message.legs.length > 0;
    if (!message.legs.length) return;
    page.robot = new Robot($("robot"), message);
    page.legs = new Legs($("legs"), message);
    page.plot = new Plot($("plot"), message);
    page.replay = message.mode === "replay" ? new Replay(page.store, connection, events) : null;
  },
  status(message) { page.problem = message.problem; page.status = message; page.replay?.progress(message); status(); },
  events(message) { events.add(message.events, Boolean(page.replay)); page.replay?.marks(); },
  cycles(kind, t, v) {
    page.arrived = performance.now();
    page.n += t.length;
    if (kind === 0) page.store.append(t, v);
    else page.store.insert(kind - 1, t, v);
  },
  offline(reason) { page.offline = reason; },
});

function banner(text) {
  const node = $("banner");
  node.hidden = !text;
  if (text === node.dataset.text) return;
  node.dataset.text = text;
  node.replaceChildren(...withCode(text));
}

// ---------------------------------------------------------------- drawing
let textDue = 0, plotDue = 0, fpsDue = 0, frames = 0, cycles = 0;

function frame(now) {
  requestAnimationFrame(frame);
  frames++;
  const start = performance.now();
  draw(now);
  page.cost = 0.95 * page.cost + 0.05 * (performance.now() - start);
}

function draw(now) {
  if (now >= fpsDue) {
    const seconds = (now - fpsDue + 1000) / 1000;
    Object.assign(page, { fps: frames / seconds, rate: (page.n - cycles) / seconds });
    frames = 0;
    cycles = page.n;
    fpsDue = now + 1000;
    status();
  }
  if (!page.store) return;
  const t = page.replay ? page.replay.tick(now) : page.paused ?? page.store.end;
  const sample = page.store.at(t);
  connection.drawn();
  if (!sample || !page.robot) return;
  page.frames++;
  if (sample.t !== page.drawn) {
    page.robot.draw(sample);
    page.drawn = sample.t;
  }
  if (now >= textDue) {
    textDue = now + TEXT_MS;
    page.legs.draw(sample);
    problemList.draw(problems(sample, page.hello), $("banner").dataset.text);
    if (page.replay) events.show(t);
  }
  if (now >= plotDue) {
    plotDue = now + PLOT_MS;
    const begin = page.replay ? 0 : page.store.begin, end = page.replay ? page.replay.end : t;
    const from = Math.max(begin, Math.min(t + (page.replay ? PLOT_S / 4 : 0), end) - PLOT_S);
    page.plot.draw(page.store, from, Math.max(Math.min(from + PLOT_S, end), from + SHORTEST_PLOT_S), t);
  }
}

function status() {
  const old = page.arrived && performance.now() - page.arrived > STALE_MS;
  let link = "live", text = `${Math.round(page.rate)} Hz`, problem = "";
  if (page.offline) {
    [link, text] = ["lost", "no connection"];
    problem = `${page.offline} The values are the last ones; this page tries again.`;
  } else if (page.replay) {
    [link, text] = ["replay", "recording"];
    problem = page.problem;
  } else if (page.problem) {
    const why = page.problem, shown = page.store?.segments.length;
    [link, text] = ["ended", shown ? "ended" : "no service"];
    problem = `${why[0].toUpperCase()}${why.slice(1)}.`;
    // Without values the page says below what to start.
    if (shown) problem += " The values are the last ones. Start it again as before"
      + ($("simulated").hidden ? ", or look into its log: `journalctl -u footsense`." : "; what it said stands in its terminal.");
  } else if (page.paused !== null) {
    [link, text] = ["paused", "paused"];
  } else if (old || !page.arrived) {
    [link, text] = [page.arrived ? "ended" : "connecting", page.arrived ? "no new cycles" : "connecting"];
    if (page.arrived) problem = "The service runs, but its loop has stopped: look into "
      + ($("simulated").hidden ? "its log, `journalctl -u footsense`." : "its terminal.");
  } else if (page.status?.bus_off && !page.status.can_sent) {
    problem = "CAN: the controller is off the bus. Check its termination, its bit rate and whether another node is on.";
  }
  document.body.dataset.link = link;
  $("status").textContent = text;
  banner(problem);
}

// ---------------------------------------------------------------- controls
function toggleTheme() {
  const root = document.documentElement;
  const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  root.dataset.theme = dark ? "light" : "dark";
  try { localStorage.setItem("footsense-theme", root.dataset.theme); } catch { /* it lasts for this page */ }
  recolour();
}

function recolour() {
  page.robot?.colours();
  page.drawn = NaN;
  page.plot?.colours();
  page.replay?.marks();
}

function pause() {
  if (page.replay) { page.replay.toggle(); return; }
  page.paused = page.paused === null && page.store ? page.store.end : null;
  $("pause").textContent = page.paused === null ? "pause" : "go on";
  status();
}

$("theme").onclick = toggleTheme;
$("pause").onclick = pause;
$("help").onclick = () => $("keys").showModal();
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches("select, input[type=text]")) return;
  const key = event.key;
  if (key === " ") pause();
  else if (key === "t") toggleTheme();
  else if (key === "?") $("keys").showModal();
  else if (key >= "1" && key <= "8") page.plot?.toggleLeg(Number(key) - 1);
  else if (!page.replay?.key(event)) return;
  event.preventDefault();
});

requestAnimationFrame(frame);
