// The viewer: the picture in linear light, what lies over it, and tools to point at it.

import { look } from "./api.js";
import { Painter, changeOf, lightOf } from "./painter.js";
import { answer, behind, change, clipRow, drop, facts, isClip, job, layer, solution, store, trying } from "./store.js";
import { Component, createRef, h } from "./vendor/preact.js";

/** @typedef {import("./tiles.js").Part} Part */

export const VIEWS = /** @type {[string, string][]} */ ([
  ["picture", "Picture"], ["plate", "Plate"], ["alpha", "Alpha"], ["color", "Color"], ["error", "Error of alpha"],
  ["flags", "Flags"], ["checker", "Layer over a checkerboard"], ["over", "Layer over another picture"], ["result", "Result"], ["sharp", "Sharp over the plate"], ["reference", "The sharp picture of its color"],
]);
const FLAGS = [["known", "#4a9d5b"], ["not explained", "#e63c3c"], ["saturated", "#f3e63c"], ["shadow", "#5959d9"], ["occluded", "#bb43cc"], ["other", "#f39e26"]];
const SAME = { fade: 1, light: [1, 0, 0, 0, 1, 0, 0, 0, 1] };
const DATA = ["alpha", "error", "flags"]; // no light: exposure does not change them
const AS_IT_IS = "plate as it is"; // what the report says of a plate that was not changed
const ZOOM_STEP = 1.25;
const MOST_ZOOM = 32;

const DRAWN = ["picture", "plate", "checker", "error"]; // views that the server draws, too

/** Views that there is something to show in. */
export const views = () => VIEWS.filter(([mode]) => (store.shaders || DRAWN.includes(mode)) && (
  mode === "picture" || (mode === "plate" ? scene() || (behind() && behind() !== "none")
    : mode === "over" ? layer() && store.over : mode === "sharp" ? sharpLayer()
    : mode === "reference" ? store.colorFrom
    : ["error", "flags"].includes(mode) ? facts(layer())?.kind === "solution" : layer())));

export class Viewer extends Component {
  constructor(/** @type {any} */ props) {
    super(props);
    this.canvas = createRef();
    this.overlay = createRef();
    this.view = { x: 0, y: 0, zoom: 0 }; // zoom: screen pixels for one of the picture
    this.shown = "";
    this.pointer = /** @type {any} */ (null);
    this.painter = /** @type {Painter | null} */ (null);
    this.previews = false;
    this.fitted = true; // a picture that is shown whole stays so when the window changes
    this.reading = false;
    this.previewed = "";
  }

  componentDidMount() {
    this.props.held.current = this; // buttons outside fit and zoom it
    try {
      this.painter = new Painter(this.canvas.current, () => this.paint());
    } catch {
      this.previews = true;
      change({ shaders: false });
    }
    this.watch = new ResizeObserver(() => (this.fitted ? this.fit() : this.paint()));
    this.watch.observe(this.canvas.current.parentElement);
    this.componentDidUpdate();
  }

  componentDidUpdate() {
    const found = this.ground();
    const key = found ? `${found.width}x${found.height}` : "";
    if (found && key !== this.shown) {
      this.shown = key;
      this.fit();
    }
    this.paint();
  }

  /** Size of what is shown; null before it is known. */
  ground() {
    return facts(store.mode === "over" ? store.over : store.mode === "reference" ? store.colorFrom : store.picture);
  }

  fit() {
    const found = this.ground();
    const box = this.canvas.current?.parentElement?.getBoundingClientRect();
    if (!found || !box || !box.width) return;
    const zoom = Math.min(box.width / found.width, box.height / found.height, 8);
    this.view = { zoom, x: (found.width - box.width / zoom) / 2, y: (found.height - box.height / zoom) / 2 };
    this.fitted = true;
    this.paint();
  }

  /** Show a box with some room around it. @param {number[]} box */
  show([x0, y0, x1, y1]) {
    const seen = this.canvas.current.parentElement.getBoundingClientRect();
    this.fitted = false;
    const zoom = Math.min(seen.width / (1.6 * (x1 - x0)), seen.height / (1.6 * (y1 - y0)), MOST_ZOOM);
    this.view = { zoom, x: (x0 + x1 - seen.width / zoom) / 2, y: (y0 + y1 - seen.height / zoom) / 2 };
    this.paint();
  }

  /** @param {number} factor @param {number} [px] @param {number} [py]  a place that stays, on the screen */
  zoomBy(factor, px, py) {
    const box = this.canvas.current.getBoundingClientRect();
    this.fitted = false;
    const at = [px ?? box.width / 2, py ?? box.height / 2];
    const zoom = Math.min(Math.max(this.view.zoom * factor, 0.01), MOST_ZOOM);
    this.view = {
      zoom,
      x: this.view.x + at[0] / this.view.zoom - at[0] / zoom,
      y: this.view.y + at[1] / this.view.zoom - at[1] / zoom,
    };
    this.paint();
  }

  /** @param {number} dx @param {number} dy  screen pixels */
  panBy(dx, dy) {
    this.fitted = false;
    this.view = { ...this.view, x: this.view.x - dx / this.view.zoom, y: this.view.y - dy / this.view.zoom };
    this.paint();
  }

  /** Draw what the store says, in the next frame of the screen. */
  paint() {
    if (this.asked) return;
    this.asked = requestAnimationFrame(() => {
      this.asked = 0;
      this.paintNow();
    });
  }

  paintNow() {
    const canvas = this.canvas.current;
    const ground = this.ground();
    if (!canvas || !ground || !this.view.zoom) return;
    const begun = performance.now();
    const box = canvas.parentElement.getBoundingClientRect();
    const dense = window.devicePixelRatio || 1;
    const size = [Math.round(box.width * dense), Math.round(box.height * dense)];
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    const grid = this.view.zoom * dense; // whole pixels of the screen: at 1:1 a pixel is a pixel
    const [x, y] = [this.view.x, this.view.y].map((at) => Math.round(at * grid) / grid);
    this.overlay.current?.setAttribute("transform", `scale(${this.view.zoom}) translate(${-x} ${-y})`);
    if (this.previews) this.placePreview();
    if (!this.painter) return;
    const view = { x, y, zoom: grid };
    const strips = [];
    const before = ["picture", "reference"].includes(store.mode) ? 0 : store.wipe;
    if (before > 0) strips.push({ from: 0, to: before, items: this.items("picture"), data: false });
    if (before < 1) strips.push({ from: before, to: 1, items: this.items(store.mode), data: DATA.includes(store.mode) });
    const light = { stops: store.stops, falseColor: store.falseColor };
    const done = this.painter.draw(strips.map((one) => ({ ...one, ...light })), view, peak());
    canvas.dataset.complete = String(done);
    canvas.dataset.script = (performance.now() - begun).toFixed(1);
  }

  /** What a mode draws. @param {string} mode @returns {import("./painter.js").Item[]} */
  items(mode) {
    const found = this.ground();
    if (!found || !store.picture) return [];
    const part = (/** @type {any} */ source, /** @type {string} */ name, frame = 0) =>
      (source && source !== "none" ? { source, part: name, frame } : null);
    const parts = {
      picture: store.mode === "reference" ? part(store.colorFrom, "picture") : part(store.picture, "picture", store.frame),
      plate: scene() ?? part(behind(), "picture"),
      layer: part(layer(), "layer"),
      error: facts(layer())?.kind === "solution" ? part(layer(), "error") : null,
    };
    const size = [found.width, found.height];
    const item = { size, parts, change: currentChange(), scale: 1, at: [0, 0], over: false };
    if (mode === "reference") return [{ ...item, mode: "picture" }];
    if (mode === "sharp") {
      return [{ ...item, mode: "picture", parts: { picture: parts.plate } }, { ...item, mode: "layer", parts: { layer: part(sharpLayer(), "layer") }, change: SAME, over: true }];
    }
    if (mode !== "over") return [{ ...item, mode }];
    const ground = facts(store.over);
    if (!ground) return [];
    const below = { ...item, mode: "picture", size: [ground.width, ground.height], parts: { picture: part(store.over, "picture") } };
    const at = placed();
    return [below, { ...item, mode: "layer", scale: store.place.scale, at, over: true }];
  }

  /** Without shaders: pictures of 8 bits that the server draws. */
  placePreview() {
    const image = this.canvas.current.parentElement.querySelector("img");
    const ground = this.ground();
    if (!image || !ground) return;
    const { x, y, zoom } = this.view;
    Object.assign(image.style, { left: `${-x * zoom}px`, top: `${-y * zoom}px`, width: `${ground.width * zoom}px` });
    const part = ["alpha", "color", "checker", "over"].includes(store.mode) ? "layer" : store.mode === "error" ? "error" : "picture";
    const source = part === "picture" ? (store.mode === "plate" ? behind() : store.picture) : layer();
    const key = JSON.stringify([source, part, store.frame, store.stops]);
    if (!source || source === "none" || this.previewed === key) return;
    this.previewed = key;
    trying(async () => {
      const values = { part, frame: part === "picture" ? store.frame : 0, side: 2048, stops: store.stops };
      const blob = await (await look("preview", source, values)).blob();
      if (image.src) URL.revokeObjectURL(image.src);
      image.src = URL.createObjectURL(blob);
    });
  }

  /** A place on the picture, in its pixels. @param {PointerEvent | WheelEvent} event */
  at(event) {
    const box = this.canvas.current.getBoundingClientRect();
    return [this.view.x + (event.clientX - box.left) / this.view.zoom, this.view.y + (event.clientY - box.top) / this.view.zoom];
  }

  /** @param {PointerEvent} event */
  onDown(event) {
    if (event.button !== 0 || !this.ground()) return;
    /** @type {Element} */ (event.currentTarget).setPointerCapture(event.pointerId);
    this.pointer = { from: this.at(event), last: [event.clientX, event.clientY], tool: event.shiftKey ? "Pan" : store.tool };
    if (this.pointer.tool === "Pick color" && store.colorFrom && store.mode !== "reference") change({ mode: "reference" });
    else if (this.pointer.tool === "Pick color") pickAt(...whole(this.pointer.from));
    if (this.pointer.tool === "Mask") change({ strokes: [...store.strokes, [this.pointer.from]] });
    event.preventDefault();
    this.canvas.current.parentElement.focus();
  }

  /** @param {PointerEvent} event */
  onMove(event) {
    const here = this.at(event);
    this.readAt(here);
    const pointer = this.pointer;
    if (!pointer) return;
    if (pointer.tool === "Pan" && store.mode === "over") {
      const moved = [event.clientX - pointer.last[0], event.clientY - pointer.last[1]].map((one) => one / this.view.zoom);
      change({ place: { ...store.place, x: store.place.x + moved[0], y: store.place.y + moved[1] } });
    } else if (pointer.tool === "Pan") this.panBy(event.clientX - pointer.last[0], event.clientY - pointer.last[1]);
    else if (pointer.tool === "Box") change({ region: this.inside([...pointer.from, ...here]) });
    else if (pointer.tool === "Mask") change({ strokes: [...store.strokes.slice(0, -1), [...store.strokes[store.strokes.length - 1], here]] });
    else if (pointer.tool === "Ruler") change({ line: [...pointer.from, ...here] });
    pointer.moved ||= Math.hypot(here[0] - pointer.from[0], here[1] - pointer.from[1]) * this.view.zoom > 3;
    pointer.last = [event.clientX, event.clientY];
  }

  onUp() {
    const pointer = this.pointer;
    this.pointer = null;
    const box = store.region;
    if (pointer && this.isClick(pointer)) this.choose(pointer.from);
    if (pointer?.tool === "Box" && Array.isArray(box) && (box[2] - box[0] < 2 || box[3] - box[1] < 2)) change({ region: null });
  }

  /** Whether the pointer stayed where it went down. @param {any} pointer */
  isClick(pointer) {
    return !pointer.moved && ["Pan", "Box"].includes(pointer.tool);
  }

  /** Choose the region at a place, the smallest of those there. @param {number[]} place */
  choose([x, y]) {
    const there = (answer("find")?.regions ?? []).filter((/** @type {number[]} */ [x0, y0, x1, y1]) => x >= x0 && x < x1 && y >= y0 && y < y1);
    const area = (/** @type {number[]} */ one) => (one[2] - one[0]) * (one[3] - one[1]);
    if (there.length && !solution()) change({ region: there.sort((/** @type {number[]} */ a, /** @type {number[]} */ b) => area(a) - area(b))[0] });
  }

  /** @param {number[]} corners */
  inside([x0, y0, x1, y1]) {
    const found = this.ground();
    const clip = (/** @type {number} */ value, /** @type {number} */ most) => Math.round(Math.min(Math.max(value, 0), most));
    return [clip(Math.min(x0, x1), found.width), clip(Math.min(y0, y1), found.height),
      clip(Math.max(x0, x1), found.width), clip(Math.max(y0, y1), found.height)];
  }

  /** Values under the cursor, one request at a time. @param {number[]} place */
  async readAt(place) {
    const found = this.ground();
    const [x, y] = place.map(Math.floor);
    if (!found || this.reading || x < 0 || y < 0 || x >= found.width || y >= found.height) return;
    this.reading = true;
    try {
      const values = { frame: store.frame, x, y, radius: 0 };
      const source = { over: store.over, reference: store.colorFrom }[store.mode] ?? store.picture;
      const seen = await (await look("pixels", /** @type {any} */ (source), values)).json();
      const own = layer();
      const more = own && !["over", "reference"].includes(store.mode) ? await (await look("pixels", own, { ...values, frame: 0 })).json() : {};
      change({ under: { ...seen, alpha: more.alpha, alpha_std: more.alpha_std, flags: more.flags } });
    } catch { /* outside, or the next one comes */ }
    this.reading = false;
  }

  /** @param {KeyboardEvent} event */
  onKey(event) {
    const far = event.shiftKey ? 200 : 40;
    const moves = /** @type {Record<string, () => void>} */ ({
      ArrowLeft: () => this.panBy(far, 0), ArrowRight: () => this.panBy(-far, 0),
      ArrowUp: () => this.panBy(0, far), ArrowDown: () => this.panBy(0, -far),
      "+": () => this.zoomBy(ZOOM_STEP), "=": () => this.zoomBy(ZOOM_STEP), "-": () => this.zoomBy(1 / ZOOM_STEP),
      0: () => this.fit(), 1: () => this.zoomBy(1 / this.view.zoom),
    });
    if (event.target !== event.currentTarget || event.ctrlKey || event.metaKey || !moves[event.key]) return;
    moves[event.key]();
    event.preventDefault();
  }

  /** @param {any} props */
  render({ children }) {
    return h("div", {
      class: `viewer tool-${store.tool.toLowerCase().replace(" ", "-")}`, tabIndex: 0, role: "application",
      "aria-label": "Picture: arrows move, plus and minus zoom, 0 fits, 1 shows its own pixels",
      onPointerDown: (/** @type {any} */ e) => this.onDown(e), onPointerMove: (/** @type {any} */ e) => this.onMove(e),
      onPointerUp: () => this.onUp(), onPointerLeave: () => change({ under: null }),
      onKeyDown: (/** @type {any} */ e) => this.onKey(e),
      onWheel: (/** @type {WheelEvent} */ e) => {
        const box = this.canvas.current.getBoundingClientRect();
        this.zoomBy(Math.exp(-e.deltaY / 500), e.clientX - box.left, e.clientY - box.top);
        e.preventDefault();
      },
    },
    h("canvas", { ref: this.canvas, "aria-hidden": "true" }),
    this.previews && h("img", { class: "preview", alt: "" }),
    h("svg", { class: "overlay", "aria-hidden": "true" }, h("g", { ref: this.overlay }, children)),
    h(Legend, null));
  }
}

/** The scene behind the object of a solved picture, if it is no file as it is: matched to the picture, or guessed.
 * @returns {Part | null} */
function scene() {
  const own = layer();
  const { picture, plate } = store;
  if (!own || !picture || isClip()) return null;
  if (plate === "none") return { source: picture, part: "guessed", frame: 0, basis: own };
  const changed = solution()?.stats.match && solution().stats.match.in_words !== AS_IT_IS;
  return plate && changed ? { source: picture, part: "matched", frame: 0, basis: plate } : null;
}

/** The highest alpha, which is shown white. */
const peak = () => Math.min(Math.max(facts(layer())?.layer?.peak ?? 1, 0.01), 1);

/** What colors mean in views that show no light. */
function Legend() {
  if (store.mode === "error") return h("p", { class: "legend" }, "0 ", h("span", { class: "heat" }), " 0.1, standard deviation of alpha");
  if (store.mode === "alpha") return h("p", { class: "legend" }, `white is alpha ${peak().toFixed(2)}`);
  if (store.mode !== "flags") return null;
  return h("p", { class: "legend" }, FLAGS.map(([name, color]) => [h("span", { class: "swatch", style: { background: color } }), ` ${name} `]));
}

/** The sharp layer of the chosen moment. @returns {import("./api.js").Source | null} */
function sharpLayer() {
  const made = job("sharpen");
  const rows = sharpRows();
  return rows.length ? { job: made.number, name: rows[Math.min(store.moment, rows.length - 1)] } : null;
}

/** The names of all sharp layers, in the order of their moments. @returns {string[]} */
export const sharpRows = () => (job("sharpen")?.files ?? []).filter((/** @type {string} */ name) => /^sharp\.\d+\.exr$/.test(name));

/** Where the layer begins in the picture that it is put over. */
function placed() {
  const { place } = store;
  const box = facts(layer())?.layer?.box ?? [0, 0, 0, 0];
  return [0, 1].map((axis) => (axis ? place.y : place.x) + 0.5 - place.scale * (box[axis] + box[axis + 2]) / 2);
}

/** The change that the sliders ask for. */
function currentChange() {
  const own = facts(layer())?.layer;
  if (!own) return SAME;
  const { changes } = store;
  const paints = paintsOf();
  const colors = paints.map((paint, k) => (changes.recolor[k] ? lightOf(changes.recolor[k]) : paint.light));
  const recolored = changes.recolor.some(Boolean);
  return changeOf(changes, paints.map((one) => one.light), recolored ? colors : [], own.brightest);
}

/** The paints of the object: its mean color, or those of a model of two; and those that were added.
 * @returns {{hex: string, light: number[]}[]} */
export function paintsOf() {
  const model = solution()?.model;
  const own = facts(layer())?.layer;
  if (!own) return [];
  const found = model?.rank === 2 ? model.hex : [model?.color ?? model?.hex?.[0] ?? clipRow()?.color ?? "#808080"];
  const all = [...found, ...store.changes.paints].map((/** @type {string} */ hex) => ({ hex, light: lightOf(hex) }));
  return all.length > 1 ? all : [{ ...all[0], light: own.color }]; // the command takes its mean
}

/** The pixel at a place. @param {number[]} place @returns {[number, number]} */
const whole = ([x, y]) => [Math.floor(x), Math.floor(y)];

/** Make the region, or the occluder, of what was painted: white where it was. @param {"Region" | "Occluder"} slot */
export function useMask(slot) {
  const found = facts(store.picture);
  if (!found || !store.strokes.length) return;
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [found.width, found.height];
  const pen = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  pen.fillRect(0, 0, found.width, found.height);
  Object.assign(pen, { strokeStyle: "#fff", lineWidth: store.brush, lineCap: "round", lineJoin: "round" });
  for (const stroke of store.strokes) {
    pen.beginPath();
    pen.moveTo(stroke[0][0], stroke[0][1]);
    for (const [x, y] of stroke.length > 1 ? stroke : [...stroke, ...stroke]) pen.lineTo(x, y);
    pen.stroke();
  }
  canvas.toBlob((blob) => {
    if (blob) drop([new File([blob], `${slot.toLowerCase()}.png`)], slot).then(() => change({ strokes: [] }));
  });
}

/** Take the mean color around a pixel of the picture that is shown. @param {number} x @param {number} y */
export function pickAt(x, y) {
  const source = store.colorFrom ?? store.picture;
  if (!source) return;
  trying(async () => {
    const values = { frame: store.colorFrom ? 0 : store.frame, x, y, radius: store.radius };
    change({ picked: await (await look("pixels", source, values)).json() });
  });
}
