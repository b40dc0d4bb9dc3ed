// A clip under its frame: frames by number, its shots, a strip of grades over time, charts of the motion.

import { MARK_PATHS, chart, library } from "./chart.js";
import { NumberField } from "./controls.js";
import { answer, change, facts, job, run, store } from "./store.js";
import { Component, createRef, h } from "./vendor/preact.js";
import { fallInWords, shots, withError } from "./words.js";

/** @typedef {import("./api.js").Source} Source */

const LETTERS = /** @type {Record<string, string>} */ ({ confirmed: "C", plausible: "P", assumed: "A" });
const IN_PICTURE = /** @type {[string, string][]} */ ([["x", "x, pixels"], ["y", "y, pixels"]]);
const IN_SPACE = /** @type {[string, string][]} */ ([["ball_x", "x, m"], ["ball_y", "y, m, down"], ["ball_z", "depth, m"]]);
const SIZES = /** @type {[string, string][]} */ ([["speed", "speed"], ["ball_speed", "speed in space, m/s"], ["radius", "radius, pixels"]]);

const MOST_LETTERS = 80; // cells that are wide enough for one
const COLORS = 6; // of objects, in the style sheet
const MARKS = Object.keys(MARK_PATHS);
const CHART_WIDTH = 380; // pixels, at which another column begins

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

/** The numbers of the objects, and the color and mark of each. @param {any[]} all */
export function objectsOf(all) {
  const numbers = [...new Set(all.filter((row) => row.x !== null).map((row) => row.object ?? 1))].sort((a, b) => a - b);
  return numbers.map((number, k) => ({ number, alone: numbers.length < 2, color: `--object-${k % COLORS}`, mark: MARKS[k % MARKS.length] }));
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
      h(Shots, null),
      store.frames && h("span", null, `frames ${store.frames}`),
      store.frames && h("button", { onClick: () => change({ frames: "" }) }, "All frames")),
    h("input", { type: "range", class: "scrub", min: 0, max: last, value: store.frame, "aria-label": "Frames of the clip",
      "aria-valuetext": `frame ${store.frame} of ${last}`, onInput: (/** @type {any} */ e) => go(Number(e.target.value)) }),
    h(Strip, { last }),
    h(FrameInWords, { frame: store.pointed ?? store.frame }),
    rows().length > 1 && h(Charts, { rows: rows(), frame: store.frame, falls: falls() }));
}

/** The shots of the clip, to choose from: the marks follow. */
function Shots() {
  const all = answer("shots")?.shots ?? answer("solve")?.shots;
  if (!all) {
    const looking = ["waiting", "running"].includes(job("shots")?.state);
    return h("button", { disabled: looking, onClick: () => run("shots", shots(/** @type {Source} */ (store.picture)), "shots") },
      looking ? "Finding the shots …" : "Find its shots");
  }
  if (all.length < 2) return h("span", null, "one shot");
  const frames = (/** @type {any} */ one) => `${one.start}:${one.stop}`;
  const begins = /** @type {Record<string, string>} */ ({ cut: ", after a cut", light: ", after a change of light" });
  return h("label", null, "Shot ", h("select", { "aria-label": "Shot", onChange: (/** @type {any} */ e) => {
    const one = all[Number(e.target.value)];
    change(one ? { frames: frames(one), frame: one.start } : { frames: "" });
  } }, h("option", { value: -1, selected: !store.frames }, `all ${all.length}`), all.map((/** @type {any} */ one, /** @type {number} */ k) =>
    h("option", { value: k, selected: store.frames === frames(one) },
      `${k + 1}: frames ${one.start} to ${one.stop - 1}${begins[one.begins_with] ?? ""}${one.moving ? ": the camera moves" : ""}`))));
}

/** What was measured of the objects, by frame. */
function byFrame() {
  const by = /** @type {Map<number, any[]>} */ (new Map());
  for (const row of rows()) by.set(row.frame, [...by.get(row.frame) ?? [], row]);
  return by;
}

/** The kind of a frame's cell: its lowest grade, or whether an object was found. @param {any[]} there */
function kindOf(there) {
  const graded = ["assumed", "plausible", "confirmed"].find((grade) => there.some((row) => row.grade === grade));
  return graded ?? (there.some((row) => row.x !== null) ? "seen" : "none");
}

/** A cell for each frame: the letter of its grade, or a point where the object was found. @param {{last: number}} props */
function Strip({ last }) {
  const by = byFrame();
  const running = job("track")?.state === "running" ? job("track") : job("solve")?.state === "running" ? job("solve") : null;
  const count = Math.min(last + 1, 400);
  const cells = Array.from({ length: count }, (_, k) => Math.floor((k * (last + 1)) / count));
  const kind = (/** @type {any[] | undefined} */ there, /** @type {number} */ k) => there ? kindOf(there)
    : running?.of && k < (count * running.done) / running.of ? "done" : "";
  return h("div", { class: "strip", role: "img", "aria-label": stripInWords(by), style: { gridTemplateColumns: `repeat(${count}, 1fr)` } },
    cells.map((frame, k) => h("span", {
      key: frame, class: `cell ${kind(by.get(frame), k)}${frame === store.frame ? " here" : ""}`, onClick: () => go(frame),
      title: `frame ${frame} ${(by.get(frame) ?? []).map((row) => [row.grade, row.doubts].filter(Boolean).join(": ")).join("; ")}`,
    }, count <= MOST_LETTERS ? LETTERS[kind(by.get(frame), k)] ?? "" : "")));
}

/** @param {Map<number, any[]>} by */
function stripInWords(by) {
  const seen = [...by.values()].filter((there) => there.some((row) => row.x !== null)).length;
  return by.size ? `the object was found in ${seen} of ${by.size} frames` : "no frame was measured yet";
}

/** What was measured in a frame, and what is doubtful there. @param {{frame: number}} props */
function FrameInWords({ frame }) {
  const there = rows().filter((/** @type {any} */ row) => row.frame === frame);
  const several = objectsOf(rows()).length > 1;
  const said = there.map((/** @type {any} */ row) => {
    const numbers = ["x", "y", "speed", "radius"].filter((name) => row[name] != null)
      .map((name) => `${name} ${withError(row[name], row[`${name}_std`])}${name === "speed" ? ` ${row.speed_unit}` : ""}`);
    return [several && row.object ? `object ${row.object}` : "", row.grade, numbers.join(", "), row.doubts ? `in doubt: ${row.doubts}` : "", row.reason]
      .filter(Boolean).join(": ");
  });
  return h("p", { class: "doubts", "aria-live": playing ? "off" : "polite" }, said.length ? `Frame ${frame}: ${said.join("; ")}` : "");
}

/** The parabolas that were fitted to the flights, in pixels of the frames or in space. @returns {any[]} */
function falls() {
  const found = answer("track");
  return found?.camera_moves ? [] : [...found?.falls ?? [], found?.fall].filter(Boolean);
}

/** Charts of the motion, with a cursor at the frame; below them the fall in words. */
class Charts extends Component {
  constructor(/** @type {any} */ props) {
    super(props);
    this.place = createRef();
    this.plots = /** @type {any[]} */ ([]);
    this.drawn = /** @type {any} */ (null);
  }

  componentDidMount() {
    library().then(() => this.componentDidUpdate());
    this.watch = new ResizeObserver(() => this.componentDidUpdate());
    this.watch.observe(this.place.current);
    this.scheme = matchMedia("(prefers-color-scheme: dark)");
    this.scheme.onchange = () => this.componentDidUpdate();
  }

  componentDidUpdate() {
    const place = this.place.current;
    if (!(/** @type {any} */ (window).uPlot) || !place) return;
    const { rows: all, falls: fallen } = this.props;
    const room = place.clientWidth - 20; // without its padding
    const key = JSON.stringify([all.length, all[0], all[all.length - 1], fallen, room, this.scheme?.matches]);
    if (this.drawn !== key) {
      this.drawn = key;
      this.plots.forEach((one) => one.destroy());
      const asked = charts(all, fallen);
      const columns = Math.max(1, Math.min(3, Math.floor(room / CHART_WIDTH)));
      const width = Math.floor(room / columns) - 7;
      this.plots = asked.map((one) => chart(place, width, all, objectsOf(all), one, { go, point: (frame) => change({ pointed: frame }) }));
    }
    this.plots.forEach((one) => one.setCursor({ left: one.valToPos(this.props.frame, "x"), top: 0 }, false));
  }

  componentWillUnmount() {
    this.watch?.disconnect();
    this.plots.forEach((one) => one.destroy());
  }

  render() {
    const objects = objectsOf(this.props.rows);
    return [
      objects.length > 1 && h("ul", { class: "objects", "aria-label": "Objects" }, objects.map((one) => h("li", null,
        h("svg", { viewBox: "-8 -8 16 16", "aria-hidden": "true" }, h("path", { d: MARK_PATHS[one.mark], style: { stroke: `var(${one.color})`, fill: `var(${one.color})` } })),
        ` object ${one.number}`))),
      h("div", { class: "charts", ref: this.place }),
      this.props.falls.map((/** @type {any} */ fall) => h("p", { class: "fall" }, objects.length > 1 ? `Object ${fall.object}: ` : "", fallInWords(fall))),
    ];
  }
}

/** What there is to draw: places, sizes, and how far places are off the parabola. @param {any[]} all @param {any[]} fallen
 * @returns {import("./chart.js").Chart[]} */
function charts(all, fallen) {
  const has = (/** @type {string} */ name) => all.some((row) => row[name] != null);
  const places = has("ball_x") ? IN_SPACE : IN_PICTURE;
  const unit = all.find((row) => row.speed_unit)?.speed_unit ?? "";
  const made = /** @type {import("./chart.js").Chart[]} */ ([]);
  places.forEach(([name, title], axis) => {
    if (has(name)) made.push({ name, title, down: axis === 1, axis: "xyz"[axis], falls: fallen, off: false });
  });
  for (const [name, title] of SIZES) {
    if (has(name)) made.push({ name, title: name === "speed" ? `${title}, ${unit}` : title, down: false, axis: "", falls: [], off: false });
  }
  if (fallen.length) {
    places.forEach(([name, title], axis) => made.push({ name, title: `off the parabola: ${title}`, down: axis === 1, axis: "xyz"[axis], falls: fallen, off: true }));
  }
  return made;
}
