// The page: what is shown, from what the store knows.

import { post } from "./api.js";
import { ClipBar, objectsOf } from "./clip.js";
import { NumberField, Slider } from "./controls.js";
import { Edit, Measure, Sharp, Solve } from "./panels.js";
import { active, answer, cancel, change, drop, example, exchange, facts, follow, isClip, job, onChange, resume, solution, store, takeExample, trying } from "./store.js";
import { Viewer, pickAt, useMask, views } from "./viewer.js";
import { createRef, h, render } from "./vendor/preact.js";
import { quoted } from "./words.js";

const viewer = createRef();
const TABS = { Solve, Edit, Measure, Sharp };
const TOOLS = ["Pan", "Box", "Mask", "Pick color", "Ruler"];

function Header() {
  const { server } = store;
  const says = {
    starting: "warming up; on a new machine for half a minute", ready: "ready", ending: "cancelling", off: "starts",
  }[/** @type {"starting" | "ready" | "ending" | "off"} */ (server?.worker ?? "off")];
  return h("header", null,
    h("h1", null, "blurmatte"),
    h("div", { role: "tablist", "aria-label": "Work" }, Object.keys(TABS).map((name) => h("button", {
      role: "tab", id: `tab-${name}`, "aria-selected": String(store.tab === name), "aria-controls": "panel",
      tabIndex: store.tab === name ? 0 : -1,
      onClick: () => change({ tab: name }), onKeyDown: turnTabs,
    }, name))),
    h("span", { class: "worker" }, active() ? "" : says),
    h("button", { class: "quiet", onClick: () => trying(() => post("/api/quit")).then(() => change({ gone: true })) }, "Quit"),
  );
}

/** Arrows go from tab to tab. @param {KeyboardEvent} event */
function turnTabs(event) {
  const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
  if (!step) return;
  const names = Object.keys(TABS);
  const next = names[(names.indexOf(store.tab) + step + names.length) % names.length];
  change({ tab: next });
  requestAnimationFrame(() => document.getElementById(`tab-${next}`)?.focus());
}

function ViewBar() {
  return h("div", { class: "bar", role: "toolbar", "aria-label": "View" },
    h("label", null, h("span", null, "View "), h("select", {
      "aria-label": "View", value: store.mode, onChange: (/** @type {any} */ e) => change({ mode: e.target.value }),
    }, views().map(([mode, name]) => h("option", { value: mode, selected: mode === store.mode }, name)))),
    h(Slider, { name: "Exposure", value: store.stops, from: -6, to: 6, step: 0.25, words: `${store.stops > 0 ? "+" : ""}${store.stops} stops`,
      onInput: (/** @type {number} */ stops) => change({ stops }) }),
    h(Slider, { name: "Before and after", value: store.wipe, from: 0, to: 1, step: 0.01, words: `${Math.round(100 * store.wipe)} % before`,
      onInput: (/** @type {number} */ wipe) => change({ wipe }) }),
    h("label", null, h("input", { type: "checkbox", checked: store.falseColor,
      onChange: (/** @type {any} */ e) => change({ falseColor: e.target.checked }) }), " False color"),
    h("span", { class: "buttons" },
      h("button", { onClick: () => viewer.current?.fit(), title: "The whole picture (0)" }, "Fit"),
      solution() && h("button", { onClick: () => viewer.current?.show(solution().stats.streak_box) }, "Streak"),
      h("button", { onClick: () => viewer.current?.zoomBy(1 / viewer.current.view.zoom), title: "A pixel of the picture as one of the screen (1)" }, "1:1"),
      h("button", { "aria-label": "Zoom in", onClick: () => viewer.current?.zoomBy(1.5) }, "+"),
      h("button", { "aria-label": "Zoom out", onClick: () => viewer.current?.zoomBy(1 / 1.5) }, "−")),
  );
}

function ToolBar() {
  const box = Array.isArray(store.region) ? store.region : null;
  const line = store.line;
  const set = (/** @type {number[]} */ all, /** @type {number} */ k, /** @type {number} */ value) =>
    all.map((one, j) => (j === k ? value : one));
  const found = facts(store.picture);
  const whole = [0, 0, found?.width ?? 1, found?.height ?? 1];
  return h("div", { class: "bar", role: "toolbar", "aria-label": "Tools" },
    h("span", { class: "buttons" }, TOOLS.map((name) => h("button", {
      "aria-pressed": String(store.tool === name), onClick: () => change({ tool: name }),
    }, name))),
    store.tool === "Box" && ["left", "top", "right", "bottom"].map((name, k) => h(NumberField, {
      name: `Box ${name}`, value: box ? box[k] : "", onChange: (/** @type {number} */ v) => change({ region: set(Array.isArray(store.region) ? store.region : whole, k, v) }) })),
    store.tool === "Box" && box && h("button", { onClick: () => change({ region: null }) }, "No box"),
    store.tool === "Ruler" && ["x0", "y0", "x1", "y1"].map((name, k) => h(NumberField, {
      name: `Ruler ${name}`, value: line ? Math.round(10 * line[k]) / 10 : "", onChange: (/** @type {number} */ v) => change({ line: set(store.line ?? [0, 0, 100, 0], k, v) }) })),
    store.tool === "Pick color" && h(PickFields, null),
    store.tool === "Mask" && [
      h(NumberField, { name: "Brush", value: store.brush, onChange: (/** @type {number} */ brush) => change({ brush: Math.max(1, brush) }) }),
      store.strokes.length > 0 && [
        h("button", { onClick: () => useMask("Region") }, "It moved here"),
        h("button", { onClick: () => useMask("Occluder") }, "This is in front"),
        h("button", { onClick: () => change({ strokes: [] }) }, "No mask")]],
    h("span", { class: "values" }, valuesInWords()),
  );
}

function PickFields() {
  const { picked } = store;
  return [
    h(NumberField, { name: "Radius", value: store.radius, onChange: (/** @type {number} */ radius) => change({ radius: Math.max(0, Math.round(radius)) }) }),
    h(NumberField, { name: "Pick x", value: picked?.x ?? "", onChange: (/** @type {number} */ x) => pickAt(Math.round(x), picked?.y ?? 0) }),
    h(NumberField, { name: "Pick y", value: picked?.y ?? "", onChange: (/** @type {number} */ y) => pickAt(picked?.x ?? 0, Math.round(y)) }),
    picked && h("span", { class: "swatch", style: { background: picked.hex } }),
    picked && h("button", { onClick: () => change({ colors: [`${picked.x},${picked.y},${store.radius}`] }) }, `Take ${picked.hex}`),
  ];
}

function valuesInWords() {
  const seen = store.under;
  if (!seen) return "";
  const three = (/** @type {number[]} */ all) => all.map((v) => v.toFixed(3)).join(" ");
  const std = seen.alpha_std === undefined ? "" : ` ± ${seen.alpha_std.toFixed(3)}`;
  const alpha = seen.alpha === undefined ? "" : `  alpha ${seen.alpha.toFixed(3)}${std}`;
  const flags = seen.flags?.length ? `  ${seen.flags.join(", ").replaceAll("_", " ")}` : "";
  return `${seen.x}, ${seen.y}: light ${three(seen.light)}${alpha}${flags}`;
}

/** What lies over the picture: regions, box, path, ruler. */
function overlay() {
  if (["over", "reference"].includes(store.mode)) return null;
  const found = answer("find")?.regions ?? [];
  const box = Array.isArray(store.region) ? store.region : null;
  const sweep = store.mode === "picture" || store.mode === "result" || store.tab === "Measure" ? solution()?.stats.sweep : null;
  const line = (/** @type {number[][]} */ all) => all.map(([x, y]) => `${x + 0.5},${y + 0.5}`).join(" ");
  const rect = (/** @type {number[]} */ [x0, y0, x1, y1], /** @type {any} */ more) =>
    h("rect", { x: x0, y: y0, width: Math.max(x1 - x0, 0), height: Math.max(y1 - y0, 0), ...more });
  const showsPath = store.tab === "Measure" || store.tab === "Sharp";
  return [
    !solution() && !isClip() && found.map((/** @type {number[]} */ region, /** @type {number} */ k) => rect(region, { class: "found", key: `r${k}` })),
    box && rect(box, { class: "box" }),
    store.strokes.map((stroke, k) => h("polyline", { key: `s${k}`, class: "stroke", "stroke-width": store.brush, points: stroke.concat(stroke.slice(-1)).map((one) => one.join()).join(" ") })),
    sweep && showsPath && h("polyline", { class: "path", points: line(sweep.xy) }),
    sweep && showsPath && sweep.outlines.map((/** @type {number[][]} */ one, /** @type {number} */ k) => [
      h("path", { class: "band", "fill-rule": "evenodd", d: band(one, sweep.outlines_std[k] ?? []) }), h("polygon", { class: k ? "outline last" : "outline", points: line(one) })]),
    store.line && h("line", { class: "ruler", x1: store.line[0], y1: store.line[1], x2: store.line[2], y2: store.line[3] }),
    ...clipMarks(),
  ];
}

/** What lies within one standard deviation of an outline, on both sides. @param {number[][]} points @param {number[]} std */
function band(points, std) {
  const n = points.length - 1; // the last is the first
  const side = (/** @type {number} */ sign) => points.slice(0, n).map(([x, y], k) => {
    const [before, after] = [points[(k + n - 1) % n], points[(k + 1) % n]];
    const along = [after[0] - before[0], after[1] - before[1]];
    const far = sign * (std[k] ?? 0) / (Math.hypot(along[0], along[1]) || 1);
    return `${x + 0.5 + far * along[1]},${y + 0.5 - far * along[0]}`;
  });
  return [1, -1].map((sign) => `M${side(sign).join("L")}Z`).join("");
}

/** Places of tracked objects: the path of each, and where it is in this frame. */
function clipMarks() {
  if (!isClip()) return [];
  const rows = (answer("track")?.rows ?? []).filter((/** @type {any} */ row) => row.x !== null);
  return objectsOf(rows).flatMap(({ number, alone, color }) => {
    const all = rows.filter((/** @type {any} */ row) => (row.object ?? 1) === number);
    const style = alone ? {} : { stroke: `var(${color})` };
    return [
      all.length > 1 && h("polyline", { class: "track", style, points: all.map((/** @type {any} */ r) => `${r.x + 0.5},${r.y + 0.5}`).join(" ") }),
      ...all.filter((/** @type {any} */ row) => row.frame === store.frame).flatMap((/** @type {any} */ row) => [
        h("line", { class: "path", style, x1: row.first_x + 0.5, y1: row.first_y + 0.5, x2: row.last_x + 0.5, y2: row.last_y + 0.5 }),
        h("circle", { class: "outline", style, cx: row.x + 0.5, cy: row.y + 0.5, r: row.radius ?? 4 }),
        !alone && h("text", { class: "number", x: row.x + 0.5 + (row.radius ?? 4), y: row.y + 0.5 - (row.radius ?? 4), style: { fill: `var(${color})` } }, number),
      ]),
    ];
  });
}

function Progress() {
  const now = active();
  if (!now) return null;
  const { stage, done, of, seconds_left: left } = now;
  const waits = store.server.worker === "starting" ? "waits for the worker to warm up" : "waits";
  const words = now.state === "waiting" ? waits : stage ?? "begins";
  const time = left === null || left === undefined ? "" : `, ${inTime(left)} left`;
  return h("div", { class: "progress" },
    h("span", { "aria-live": "polite" }, `${now.title}: ${words}`),
    of ? h("progress", { max: of, value: done, "aria-label": `${now.title}: ${done} of ${of}` }) : h("progress", { "aria-label": now.title }),
    h("span", null, of ? `${done} of ${of}${time}` : now.seconds ? `${inTime(now.seconds)} so far` : ""),
    h("button", { onClick: () => cancel(now.number) }, "Cancel"));
}

/** @param {number} seconds */
const inTime = (seconds) => seconds < 90 ? `${Math.ceil(seconds)} s` : `${Math.ceil(seconds / 60)} min`;

/** The command line of the last job, to copy, and what it said. */
function CommandLine() {
  const jobs = store.server?.jobs ?? [];
  const last = [...jobs].reverse().find((/** @type {any} */ one) => one.title !== "regions") ?? jobs[jobs.length - 1];
  const line = last ? quoted(last.line) : "";
  return h("section", { class: "command", role: "group", "aria-label": "Command" },
    h("code", { tabIndex: 0 }, line || "The command line of a job is shown here."),
    line && h("button", { onClick: () => navigator.clipboard.writeText(line) }, "Copy"),
    last && ["cancelled", "failed"].includes(last.state) && h("button", { onClick: () => resume(last.number) }, "Resume"),
    last && h("span", { class: "state" }, last.state + (last.seconds ? `, ${last.seconds.toFixed(1)} s` : "")));
}

function Said() {
  const jobs = [...(store.server?.jobs ?? [])].reverse();
  const last = jobs.find((/** @type {any} */ one) => Object.values(store.jobs).includes(one.number) && one.said.length);
  const lines = (last?.said ?? []).slice(-6).map((/** @type {string} */ line) => line.replace(/^blurmatte: /, ""));
  return h("div", { class: "said", role: "alert" }, [
    store.error && h("p", { class: "error" }, store.error),
    ...lines.map((/** @type {string} */ line) => h("p", { class: last.state === "refused" ? "error" : "" }, line))]);
}

/** An empty page: what to bring. */
function Empty() {
  const rendering = job("render");
  return h("div", { class: "empty" },
    h("h2", null, "Drop a picture with something that moved, and the same scene without it"),
    h("p", null, "Or a clip, or several pictures from a tripod. Nothing leaves this machine."),
    h("button", { disabled: rendering && rendering.state !== "refused", onClick: example }, rendering ? "Rendering the example …" : "Try an example"));
}

function App() {
  if (store.gone) return h("main", { class: "gone" }, h("h1", null, "blurmatte has ended"), h("p", null, "Start it again in the terminal: blurmatte ui"));
  const Panel = /** @type {any} */ (TABS)[store.tab];
  return [
    h(Header, null),
    h("main", null,
      h("section", { class: "stage", "aria-label": "Picture" },
        store.picture ? [
          h(ViewBar, null), h(ToolBar, null),
          h(Viewer, { held: viewer }, overlay()),
          isClip() && h(ClipBar, null),
        ] : h(Empty, null)),
      h("div", { id: "panel", class: "panel", role: "tabpanel", "aria-labelledby": `tab-${store.tab}` },
        h(Progress, null), h(Said, null), h(Panel, null))),
    h("footer", null, h(CommandLine, null)),
  ];
}

/** @param {DragEvent} event */
function over(event) {
  event.preventDefault();
}

/** @param {DragEvent} event */
function dropped(event) {
  event.preventDefault();
  drop(event.dataTransfer?.files ?? []);
}

const root = /** @type {Element} */ (document.getElementById("app"));
onChange(() => {
  takeExample();
  render(h(App, null), root);
});
document.addEventListener("dragover", over);
document.addEventListener("drop", dropped);
document.addEventListener("keydown", (event) => { // regions are chosen by their number
  const typed = event.target instanceof HTMLInputElement || event.target instanceof HTMLSelectElement;
  if (!typed && event.key === "x" && store.plate) exchange();
});
root.replaceChildren();
change();
follow();
