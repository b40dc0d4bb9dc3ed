// A clip under its frame: frames by number, a strip of grades over time, charts of the motion.

import { NumberField } from "./controls.js";
import { answer, change, facts, job, store } from "./store.js";
import { Component, createRef, h } from "./vendor/preact.js";

const LETTERS = /** @type {Record<string, string>} */ ({ confirmed: "C", plausible: "P", assumed: "A" });
const CHARTS = /** @type {[string, string, string][]} */ ([
  ["x", "x, pixels", "x_std"], ["y", "y, pixels", "y_std"], ["speed", "speed", "speed_std"], ["radius", "radius, pixels", "radius_std"]]);

const MOST_LETTERS = 80; // cells that are wide enough for one

let playing = 0;

/** @param {number} frame */
function go(frame) {
  const last = (facts(store.picture)?.frames ?? 1) - 1;
  change({ frame: Math.min(Math.max(Math.round(frame), 0), last) });
}

function play() {
  if (playing) {
    clearInterval(playing);
    playing = 0;
    change();
    return;
  }
  const found = facts(store.picture);
  playing = setInterval(() => {
    if (store.frame >= found.frames - 1) play();
    else go(store.frame + 1);
  }, 1000 / Math.min(found.rate ?? 25, 25));
  change();
}

/** Rows of the last run, tracked or solved. */
function rows() {
  const found = answer("track") ?? answer("solve");
  return (found?.rows ?? found?.frames ?? []).filter((/** @type {any} */ row) => Number.isInteger(row.frame));
}

export function ClipBar() {
  const found = facts(store.picture);
  const last = found.frames - 1;
  const marks = store.frames.split(":");
  const mark = (/** @type {number} */ k) => {
    const next = [marks[0] ?? "", marks[1] ?? ""];
    next[k] = String(store.frame + k);
    change({ frames: next.join(":") });
  };
  return h("div", { class: "clip" },
    h("div", { class: "bar", role: "toolbar", "aria-label": "Frames" },
      h("button", { "aria-label": "Frame before", onClick: () => go(store.frame - 1) }, "◀"),
      h("button", { onClick: play }, playing ? "Pause" : "Play"),
      h("button", { "aria-label": "Frame after", onClick: () => go(store.frame + 1) }, "▶"),
      h(NumberField, { name: "Frame", value: store.frame, onChange: go }),
      h("span", null, `of ${last}${found.rate ? `, ${(store.frame / found.rate).toFixed(3)} s` : ""}`),
      h("button", { onClick: () => mark(0) }, "From here"),
      h("button", { onClick: () => mark(1) }, "To here"),
      store.frames && h("span", null, `frames ${store.frames}`),
      store.frames && h("button", { onClick: () => change({ frames: "" }) }, "All frames")),
    h("input", { type: "range", class: "scrub", min: 0, max: last, value: store.frame, "aria-label": "Frames of the clip",
      "aria-valuetext": `frame ${store.frame} of ${last}`, onInput: (/** @type {any} */ e) => go(Number(e.target.value)) }),
    h(Strip, { last }),
    h(Doubts, null),
    rows().length > 1 && h(Charts, { rows: rows(), frame: store.frame }));
}

/** A cell for each frame: the letter of its grade, or a point where the object was found. @param {{last: number}} props */
function Strip({ last }) {
  const by = new Map(rows().map((/** @type {any} */ row) => [row.frame, row]));
  const running = job("track")?.state === "running" ? job("track") : job("solve")?.state === "running" ? job("solve") : null;
  const count = Math.min(last + 1, 400);
  const cells = Array.from({ length: count }, (_, k) => Math.floor((k * (last + 1)) / count));
  const kind = (/** @type {any} */ row, /** @type {number} */ k) => row ? row.grade ?? (row.x === null ? "none" : "seen")
    : running?.of && k < (count * running.done) / running.of ? "done" : "";
  return h("div", { class: "strip", role: "img", "aria-label": stripInWords(by), style: { gridTemplateColumns: `repeat(${count}, 1fr)` } },
    cells.map((frame, k) => h("span", {
      key: frame, class: `cell ${kind(by.get(frame), k)}${frame === store.frame ? " here" : ""}`, onClick: () => go(frame),
      title: `frame ${frame} ${by.get(frame)?.grade ?? ""} ${by.get(frame)?.doubts ?? ""}`,
    }, count <= MOST_LETTERS ? LETTERS[by.get(frame)?.grade] ?? "" : "")));
}

/** @param {Map<number, any>} by */
function stripInWords(by) {
  const seen = [...by.values()].filter((row) => row.x !== null).length;
  return by.size ? `the object was found in ${seen} of ${by.size} frames` : "no frame was measured yet";
}

/** What is doubtful in this frame. */
function Doubts() {
  const here = rows().find((/** @type {any} */ row) => row.frame === store.frame);
  const words = here ? [here.grade, here.doubts || here.reason].filter(Boolean).join(": ") : "";
  return h("p", { class: "doubts", "aria-live": "polite" }, words);
}

/** Charts of the motion, with a cursor at the frame. */
class Charts extends Component {
  constructor(/** @type {any} */ props) {
    super(props);
    this.place = createRef();
    this.plots = /** @type {any[]} */ ([]);
    this.drawn = /** @type {any} */ (null);
  }

  componentDidMount() {
    library().then(() => this.componentDidUpdate());
  }

  componentDidUpdate() {
    const plot = /** @type {any} */ (window).uPlot;
    const place = this.place.current;
    if (!plot || !place) return;
    const all = this.props.rows;
    const last = all[all.length - 1];
    const key = `${all.length} ${last.frame} ${last.x}`;
    if (this.drawn !== key) {
      this.drawn = key;
      this.plots.forEach((one) => one.destroy());
      this.plots = CHARTS.filter(([name]) => all.some((/** @type {any} */ row) => row[name] != null))
        .map(([name, title, std]) => chart(plot, place, all, name, title, std));
    }
    const frame = this.props.frame;
    this.plots.forEach((one) => one.setCursor({ left: one.valToPos(frame, "x"), top: 0 }, false));
  }

  componentWillUnmount() {
    this.plots.forEach((one) => one.destroy());
  }

  render() {
    return h("div", { class: "charts", ref: this.place });
  }
}

/** @param {any} plot @param {Element} place @param {any[]} all @param {string} name @param {string} title @param {string} std */
function chart(plot, place, all, name, title, std) {
  const value = (/** @type {number} */ sign) => all.map((row) => (row[name] == null ? null : row[name] + sign * (row[std] ?? 0)));
  const ink = getComputedStyle(document.body).color;
  const unit = name === "speed" ? all.find((row) => row.speed_unit)?.speed_unit : "";
  const axis = { stroke: ink, grid: { stroke: "#8884" }, ticks: { stroke: "#8884" } };
  return new plot({
    width: Math.max(Math.floor((place.clientWidth - 32) / 2), 220), height: 120, title: unit ? `${title}, ${unit}` : title,
    scales: { x: { time: false } }, legend: { show: false }, cursor: { y: false, drag: { x: false, y: false } },
    series: [{}, { stroke: ink, width: 1, points: { show: true, size: 4, fill: ink } }, { stroke: "#0000" }, { stroke: "#0000" }],
    bands: [{ series: [2, 3], fill: "#f608" }],
    axes: [axis, axis],
    hooks: { ready: [(/** @type {any} */ made) => made.over.addEventListener("click", () => {
      if (made.cursor.idx != null) go(all[made.cursor.idx].frame);
    })] },
  }, [all.map((row) => row.frame), value(0), value(1), value(-1)], place);
}

let loading = /** @type {Promise<void> | null} */ (null);

/** Load the charts' library when the first one is drawn. */
function library() {
  loading ??= new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = "/page/vendor/uplot.js";
    script.onload = () => resolve();
    script.onerror = reject;
    document.head.append(script);
  });
  return loading;
}
