// The panels: choices of each kind of work, and its answers.

import { download } from "./api.js";
import { Check, Field, FileField, Slider } from "./controls.js";
import { GRADES, answer, behind, change, choosePlate, edit, exchange, facts, isClip, job, layer, layers, makePlate,
  run, solution, store, trying } from "./store.js";
import { paintsOf, sharpRows } from "./viewer.js";
import { h } from "./vendor/preact.js";
import * as words from "./words.js";

/** @typedef {import("./api.js").Source} Source */

const Sending = () => [...store.sending].map(([name, done]) =>
  h("p", { class: "sending" }, `copying ${name} `, h("progress", { max: 1, value: done, "aria-label": `copying ${name}` })));

// Solve

function solveNow(colors = store.colors) {
  const { picture, plate } = store;
  if (!picture) return;
  change({ colors });
  const clip = isClip();
  const line = words.solve({ ...store, picture, plate: clip && plate === "none" ? null : plate, colors, clip });
  run("solve", line, "solve");
}

export function Solve() {
  const found = solution();
  const running = ["waiting", "running"].includes(job("solve")?.state);
  const ready = store.picture && (store.plate || isClip());
  return [
    found ? h(Answer, { found }) : isClip() ? h(ClipAnswer, null) : null,
    h("h2", null, "Pictures"),
    h(FileField, { label: "Picture or clip", source: store.picture }),
    h(FileField, { label: "Plate", source: store.plate, clear: () => choosePlate(null) }),
    h(Sending, null),
    store.burst.length > 1 && h("button", { onClick: makePlate }, `Make the plate of these ${store.burst.length} pictures`),
    store.picture && !store.plate && !isClip() && h("p", { class: "hint" }, "The plate is the same scene without the object. ",
      h("button", { class: "quiet", onClick: () => choosePlate("none") }, "There is none: guess it")),
    store.plate && store.plate !== "none" && !isClip() && h("button", { class: "quiet", onClick: exchange }, "Exchange picture and plate"),
    h(Regions, null),
    h(Colors, null),
    h(MoreOptions, null),
    h("button", { class: "main", disabled: !ready || running, onClick: () => solveNow() }, "Solve"),
  ];
}

/** Where something moved, to choose from. */
function Regions() {
  const regions = answer("find")?.regions ?? [];
  if (isClip() || !store.picture) return null;
  const same = (/** @type {number[]} */ one) => Array.isArray(store.region) && one.join() === store.region.join();
  return h("fieldset", null, h("legend", null, "Where it moved"),
    regions.slice(0, 6).map((/** @type {number[]} */ one, /** @type {number} */ k) => h("label", { class: "check" },
      h("input", { type: "radio", name: "region", checked: same(one), onChange: () => change({ region: one }) }),
      ` ${k + 1}: ${one[2] - one[0]} × ${one[3] - one[1]} pixels at ${one[0]}, ${one[1]}`)),
    regions.length > 0 && h("label", { class: "check" }, h("input", { type: "radio", name: "region", checked: !store.region,
      onChange: () => change({ region: null }) }), " the strongest"),
    h("p", { class: "hint" }, regions.length ? "Or drag a box with the tool Box." : store.plate === "none"
      ? "Drag a box with the tool Box around all places where it may have been." : "It is found; or drag a box with the tool Box."),
    h(FileField, { label: "Region", source: Array.isArray(store.region) ? null : store.region, clear: () => change({ region: null }) }));
}

function Colors() {
  const set = (/** @type {string[]} */ colors) => change({ colors });
  return h("fieldset", null, h("legend", null, "Its color"),
    h("label", { class: "check" }, h("input", { type: "radio", name: "color", checked: !store.colors.length, onChange: () => set([]) }), " is found"),
    h("label", { class: "check" }, h("input", { type: "radio", name: "color", checked: store.colors[0] === "core", onChange: () => set(["core"]) }),
      " that of its core, which is opaque"),
    [0, 1].map((k) => (k === 0 || (store.colors[0] ?? "").startsWith("#")) && h("label", { class: "check" },
      h("input", { type: "color", "aria-label": k ? "Second paint" : "Color", value: /^#/.test(store.colors[k] ?? "") ? store.colors[k] : "#808080",
        onChange: (/** @type {any} */ e) => set([...store.colors.filter((c) => c.startsWith("#")).slice(0, k), e.target.value]) }),
      k ? " and a second paint" : store.colors[0] && store.colors[0] !== "core" ? ` ${store.colors[0]}` : " this one, or pick it with the tool Pick color")));
}

function MoreOptions() {
  return h("details", null, h("summary", null, "More"),
    h(FileField, { label: "Sharp picture", source: store.colorFrom, clear: () => change({ colorFrom: null, mode: "picture" }) }),
    h(FileField, { label: "Occluder", source: store.occluder, clear: () => change({ occluder: null }) }),
    h(Field, { name: "Paints", value: store.rank, hint: "1, 2 or 3: any", onChange: (/** @type {string} */ rank) => change({ rank }) }),
    h(Field, { name: "Brightest light", value: store.maxBrightness, hint: "white is 1", onChange: (/** @type {string} */ maxBrightness) => change({ maxBrightness }) }),
    h(Field, { name: "Seconds at most", value: store.seconds, hint: "for new shapes", onChange: (/** @type {string} */ seconds) => change({ seconds }) }),
    h(Field, { name: "Opacity", value: store.opacity, hint: "solid, or any", onChange: (/** @type {string} */ opacity) => change({ opacity }) }),
    isClip() && [
      h(Field, { name: "Layers of a clip", value: store.layers, hint: "exr, png, tif, mov", onChange: (/** @type {string} */ layers) => change({ layers }) }),
      h(Several, null),
    ]);
}

const Several = () => h(Check, { name: "All objects of that color", checked: store.several, onChange: (/** @type {boolean} */ several) => change({ several }) });

/** The grade in words, the reasons, the colors that fit, and files. @param {{found: any}} props */
function Answer({ found }) {
  const [first, ...more] = found.in_words;
  return h("section", { class: "answer" },
    h("p", { role: "status", class: `grade ${found.grade}` }, h("strong", null, first.split(":")[0]), first.slice(first.indexOf(":"))),
    h(Alternatives, { found }),
    h("details", { open: found.grade !== "confirmed" }, h("summary", null, "What is known, and why"),
      more.map((/** @type {string} */ line) => h("p", null, line))),
    h(Downloads, { number: store.jobs.solve }));
}

let choosing = 0; // the timer of a choice: arrows pass over others
const SECONDS_TO_CHOOSE = 0.7;

/** @param {{found: any}} props */
function Alternatives({ found }) {
  const all = found.stats.alternatives;
  if (found.grade === "confirmed" || all.length < 2) return null;
  const choose = (/** @type {any} */ one, /** @type {number} */ alternative) => {
    clearTimeout(choosing);
    change({ colors: [one.hex], alternative });
    choosing = setTimeout(() => solveNow([one.hex]), 1000 * SECONDS_TO_CHOOSE);
  };
  const heaviest = Math.max(...all.map((/** @type {any} */ one) => one.weight));
  return h("fieldset", { role: "radiogroup", "aria-label": "Colors that fit" }, h("legend", null, "Colors that fit"),
    all.map((/** @type {any} */ one, /** @type {number} */ k) => h("label", { class: "check alternative" },
      h("input", { type: "radio", name: "alternative", checked: store.alternative === k, onChange: () => choose(one, k) }),
      h("span", { class: "swatch", style: { background: one.hex ?? "transparent" } }),
      h("span", null, `${one.name}: alpha × ${one.alpha_factor.toFixed(2)}`, one.radius ? `, radius ${one.radius.toFixed(1)} px` : "",
        one.weight < 0.05 * heaviest ? h("em", null, " fits less well") : k === 0 ? "" : ` (weight ${one.weight.toFixed(2)})`))));
}

/** Results of a job, one by one and all together. @param {{number: number}} props */
function Downloads({ number }) {
  const files = store.server?.jobs.find((/** @type {any} */ one) => one.number === number)?.files ?? [];
  const get = (/** @type {string} */ name) => trying(() => download(`/api/jobs/${number}/results/${encodeURI(name)}`, name.split("/").pop() ?? name));
  const known = /** @type {Record<string, string>} */ ({ "overview.png": "sheet", "report.json": "report" });
  const rows = files.filter((/** @type {string} */ name) => /\d{3,}\.\w+$/.test(name));
  const few = files.filter((/** @type {string} */ name) => rows.length < 3 || !rows.includes(name));
  return files.length > 0 && h("details", { class: "downloads", open: true }, h("summary", null, "Results"),
    few.map((/** @type {string} */ name) => h("button", { onClick: () => get(name) }, `Download ${known[name] ?? name}`)),
    h("button", { onClick: () => trying(() => download(`/api/jobs/${number}/results.zip`, "results.zip")) }, "Download all as ZIP"));
}

function ClipAnswer() {
  const found = answer("solve");
  if (!found) return null;
  const rows = found.rows ?? found.frames ?? [];
  const counts = GRADES.map((grade) => [grade, rows.filter((/** @type {any} */ row) => row.grade === grade).length]);
  return h("section", { class: "answer" },
    h("p", { role: "status", class: "grade" }, counts.filter(([, n]) => n).map(([grade, n]) => `${grade} ${n}`).join(", ") || "no frame was solved",
      ` of ${rows.length} frames`),
    h(Downloads, { number: store.jobs.solve }));
}

// Edit

export function Edit() {
  const own = layers();
  if (!own) return h("p", { class: "hint" }, "Solve a picture or a clip first: then its object can be changed.");
  const { changes } = store;
  const formats = isClip() ? ["mp4", "mov"] : ["png", "jpg", "tif", "exr"];
  const format = formats.includes(store.format) ? store.format : formats[0];
  const paints = paintsOf();
  const line = words.changeWords(changes, paints.map((one) => one.hex));
  const name = `changed.${format}`;
  const picture = /** @type {Source} */ (store.picture);
  const plate = /** @type {any} */ (behind());
  return [
    h("h2", null, "Change the object"),
    h(Slider, { name: "Fade", value: changes.fade, from: 0, to: 2, step: 0.01, words: `${changes.fade.toFixed(2)} × as opaque`, onInput: (/** @type {number} */ fade) => edit({ fade }) }),
    h(Slider, { name: "Amplify", value: changes.amplify, from: 1, to: 10, step: 0.1, words: changes.amplify === 1 ? "no" : `${changes.amplify} ×, and bright`, onInput: (/** @type {number} */ amplify) => edit({ amplify }) }),
    h(Slider, { name: "Expose", value: changes.expose, from: -4, to: 4, step: 0.1, words: `${changes.expose} stops`, onInput: (/** @type {number} */ expose) => edit({ expose }) }),
    h(Paints, { own, paints }),
    h("details", null, h("summary", null, "Gain of red, green and blue"), ["red", "green", "blue"].map((channel, k) => h(Slider, {
      name: `Gain of ${channel}`, value: changes.gain[k], from: 0, to: 3, step: 0.01, words: changes.gain[k].toFixed(2),
      onInput: (/** @type {number} */ value) => edit({ gain: changes.gain.map((g, j) => (j === k ? value : g)) }) }))),
    h("button", { class: "quiet", onClick: () => edit({ fade: 1, amplify: 1, paints: [], recolor: [], expose: 0, gain: [1, 1, 1] }) }, "As it was"),
    h("label", { class: "field" }, h("span", null, "Write as"), h("select", { "aria-label": "Write as", value: format, onChange: (/** @type {any} */ e) => change({ format: e.target.value }) },
      formats.map((one) => h("option", { value: one, selected: one === format }, one)))),
    h("button", { class: "main", disabled: !line.length, onClick: () => run("edit", words.edit(own, picture, plate, line, name), "edit") }, "Write the changed picture"),
    h("h2", null, "Remove it"),
    h(Slider, { name: "Grow", value: store.grow, from: 0, to: 20, step: 1, words: `${store.grow} pixels more`, onInput: (/** @type {number} */ grow) => change({ grow }) }),
    h("button", { onClick: () => { edit({ fade: 0 }); run("edit", words.remove(own, picture, plate, store.grow, `removed.${format}`), "remove"); } }, "Remove the object"),
    !isClip() && h(Compose, { own, line }),
    h(Written, { kind: "edit" }),
  ];
}

const MOST_PAINTS = 3; // of edit

/** The paints of the object, each with its new color. @param {{own: Source, paints: {hex: string}[]}} props */
function Paints({ own, paints }) {
  const { changes, picked } = store;
  const found = paints.length - changes.paints.length;
  const swap = (/** @type {string[]} */ all, /** @type {number} */ k, /** @type {string} */ hex) => paints.map((_, j) => (j === k ? hex : all[j] ?? ""));
  const old = (/** @type {string} */ hex, /** @type {number} */ k) => edit({ paints: changes.paints.map((one, j) => (j === k - found ? hex : one)) });
  return [
    paints.map((paint, k) => h("div", { class: "check" },
      k < found ? h("span", { class: "swatch", style: { background: paint.hex } })
        : h("input", { type: "color", "aria-label": `Paint ${k + 1} of the object`, value: paint.hex, onInput: (/** @type {any} */ e) => old(e.target.value, k) }),
      ` ${paint.hex} becomes `,
      h("input", { type: "color", "aria-label": `New color of paint ${k + 1}, ${paint.hex}`, value: changes.recolor[k] || paint.hex,
        onInput: (/** @type {any} */ e) => edit({ recolor: swap(changes.recolor, k, e.target.value) }) }),
      k >= found && picked && h("button", { class: "quiet", onClick: () => old(picked.hex, k) }, `It is ${picked.hex}`),
      k >= found && h("button", { class: "quiet", "aria-label": `No paint ${k + 1}`, onClick: () => edit({
        paints: changes.paints.filter((_, j) => j !== k - found), recolor: changes.recolor.filter((_, j) => j !== k) }) }, "✕"))),
    paints.length > 0 && paints.length < MOST_PAINTS && h("button", { class: "quiet", onClick: () => edit({ paints: [...changes.paints, "#ffffff"] }) }, "It has another paint"),
    paints.length > 1 && !isClip() && h("button", { onClick: () => run("paints", words.paints(own, paints.map((one) => one.hex)), "paints") }, "Map where each paint was"),
    h(Written, { kind: "paints" }),
  ];
}

/** @param {{own: Source, line: import("./api.js").Words}} props */
function Compose({ own, line }) {
  const over = facts(store.over);
  const at = (/** @type {Partial<typeof store.place>} */ part) => change({ place: { ...store.place, ...part }, mode: "over" });
  const begin = () => over && at(store.place.x ? {} : { x: over.width / 2, y: over.height / 2 });
  return [
    h("h2", null, "Over another picture"),
    h(FileField, { label: "Over", source: store.over, clear: () => change({ over: null, mode: "result" }) }),
    over && [
      store.mode !== "over" && h("button", { onClick: begin }, "Place it"),
      store.mode === "over" && h("p", { class: "hint" }, "Drag it with the tool Pan."),
      h(Slider, { name: "Place x", value: store.place.x, from: 0, to: over.width, step: 1, words: `${Math.round(store.place.x)} px`, onInput: (/** @type {number} */ x) => at({ x }) }),
      h(Slider, { name: "Place y", value: store.place.y, from: 0, to: over.height, step: 1, words: `${Math.round(store.place.y)} px`, onInput: (/** @type {number} */ y) => at({ y }) }),
      h(Slider, { name: "Scale", value: store.place.scale, from: 0.1, to: 5, step: 0.01, words: `${store.place.scale.toFixed(2)} ×`, onInput: (/** @type {number} */ scale) => at({ scale }) }),
      h("button", { onClick: () => run("edit", words.compose(own, /** @type {Source} */ (store.over), line, store.place, `composed.${store.format}`), "compose") }, "Write the composed picture"),
    ],
  ];
}

/** The files of a job that has ended. @param {{kind: string}} props */
function Written({ kind }) {
  const one = job(kind);
  if (!one || one.state !== "done") return null;
  return h("section", { class: "answer" }, h("p", { role: "status" }, `done: ${one.files.length > 3 ? `${one.files.length} files` : one.files.join(", ")}`), h(Downloads, { number: one.number }));
}

// Measure

export function Measure() {
  const { ruler } = store;
  const set = (/** @type {Partial<typeof ruler>} */ part) => change({ ruler: { ...store.ruler, ...part } });
  const exif = facts(store.picture)?.exposure_seconds;
  const own = layer();
  const clip = isClip();
  return [
    h("h2", null, "How large, how long"),
    h(Field, { name: "Diameter", value: ruler.diameter, hint: "67mm, or 67mm±0.5mm", onChange: (/** @type {string} */ diameter) => set({ diameter }) }),
    h("button", { class: "quiet", "aria-pressed": String(store.tool === "Ruler"), onClick: () => change({ tool: "Ruler" }) }, "Or draw a ruler"),
    h(Field, { name: "Length of the ruler", value: store.lineLength, hint: "1.2m", onChange: (/** @type {string} */ lineLength) => change({ lineLength }) }),
    h(Field, { name: "Exposure time", value: ruler.exposure, hint: exif ? `of the file: ${exif.toPrecision(3)} s` : "1/60, or 4ms±0.1ms", onChange: (/** @type {string} */ exposure) => set({ exposure }) }),
    h("details", null, h("summary", null, "Camera and plane"),
      h(Field, { name: "Time from row to row", value: ruler.lineTime, hint: "15us", onChange: (/** @type {string} */ lineTime) => set({ lineTime }) }),
      h(Field, { name: "Next row lies", value: ruler.readout, hint: "down, up, left, right", onChange: (/** @type {string} */ readout) => set({ readout }) }),
      h(Plane, null),
      h(FileField, { label: "Camera", source: ruler.camera, clear: () => set({ camera: null }) }),
      clip && h(Field, { name: "Gravity", value: ruler.gravity, hint: "9.81, gives the scale", onChange: (/** @type {string} */ gravity) => set({ gravity }) }),
      !clip && h(Check, { name: "Also how far it turned", checked: store.rotation, onChange: (/** @type {boolean} */ rotation) => change({ rotation }) })),
    clip && h(Several, null),
    clip ? h("button", { class: "main", disabled: !store.picture, onClick: () => trackNow() }, "Track")
      : h("button", { class: "main", disabled: !own, onClick: () => own && run("measure",
        ruler.plane.length || ruler.camera ? words.locate(own, measured()) : words.measure(own, measured(), store.rotation), "measure") }, "Measure"),
    !own && !clip && h("p", { class: "hint" }, "Solve the picture first."),
    h(Motion, { found: answer(clip ? "track" : "measure"), number: store.jobs[clip ? "track" : "measure"] }),
  ];
}

/** The true sizes and times, the ruler's line with them. */
function measured() {
  const ends = (store.line ?? []).map((value) => (value - 0.5).toFixed(1));
  const scale = store.line && store.lineLength ? `${ends.join(",")}=${store.lineLength}` : "";
  return { ...store.ruler, scale };
}

function trackNow() {
  const picture = /** @type {Source} */ (store.picture);
  const plate = store.plate === "none" ? null : store.plate;
  run("track", words.track(picture, plate, measured(), { color: store.colors[0] ?? "", frames: store.frames, several: store.several }), "track");
}

/** Four points of a plane: pixel and place. */
function Plane() {
  const { plane } = store.ruler;
  return h("fieldset", null, h("legend", null, "A plane: pixel x,y = place"),
    [0, 1, 2, 3].map((k) => h(Field, { name: `Point ${k + 1}`, value: plane[k] ?? "", hint: "102,300=0,0", onChange: (/** @type {string} */ value) => {
      const next = [0, 1, 2, 3].map((j) => (j === k ? value : plane[j] ?? "")).filter(Boolean);
      change({ ruler: { ...store.ruler, plane: next } });
    } })));
}

/** @param {{found: any, number: number}} props */
function Motion({ found, number }) {
  if (!found) return null;
  const lines = found.in_words ?? [];
  return h("section", { class: "answer" },
    h("p", { role: "status", class: found.mean_speed === undefined ? "" : "speed" }, found.mean_speed === undefined ? lines[0] : speedInWords(found)),
    lines.slice(found.mean_speed === undefined ? 1 : 0).map((/** @type {string} */ line) => h("p", null, line)),
    h(Downloads, { number }));
}

/** @param {any} found */
function speedInWords(found) {
  const { mean_speed: value, mean_speed_std: std, speed_unit: unit } = found;
  return unit === "m/s" ? `${words.withError(3.6 * value, 3.6 * std)} km/h (${words.withError(value, std)} m/s)` : `${words.withError(value, std)} ${unit}`;
}

// Sharp

export function Sharp() {
  const own = layer();
  if (!own) return h("p", { class: "hint" }, "Solve a picture first: then its object can be shown sharp.");
  const rows = sharpRows();
  return [
    h("h2", null, "As it was at moments of the exposure"),
    h(Slider, { name: "Moments", value: store.moments, from: 1, to: 33, step: 2, words: `${store.moments}`, onInput: (/** @type {number} */ moments) => change({ moments }) }),
    h(Check, { name: "It may spin", checked: store.spin, onChange: (/** @type {boolean} */ spin) => change({ spin }) }),
    h("button", { class: "main", onClick: () => run("sharpen", words.sharpen(own, store.picture, store.plate, store), "sharpen") }, "Make it sharp"),
    rows.length > 0 && h(Slider, { name: "Moment", value: Math.min(store.moment, rows.length - 1), from: 0, to: rows.length - 1, step: 1,
      words: `${((store.moment + 0.5) / rows.length).toFixed(2)} of the exposure`, onInput: (/** @type {number} */ moment) => change({ moment, mode: "sharp" }) }),
    h(Written, { kind: "sharpen" }),
  ];
}
