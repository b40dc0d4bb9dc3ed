// What the page knows, and what is done when something is chosen. Everything shown follows from it.

import { ask, look, named, post, send, states } from "./api.js";
import * as words from "./words.js";

/** @typedef {import("./api.js").Source} Source */

const KEPT = `blurmatte ${location.hash}`; // what a reload needs, by session
export const GRADES = ["confirmed", "plausible", "assumed"];

const CHOSEN = {
  tab: "Solve",
  picture: /** @type {Source | null} */ (null),
  plate: /** @type {Source | "none" | null} */ (null),
  burst: /** @type {number[]} */ ([]), // files of which a plate may be made
  region: /** @type {number[] | Source | null} */ (null),
  colors: /** @type {string[]} */ ([]),
  alternative: -1, // the number of the color that was chosen among those that fit
  colorFrom: /** @type {Source | null} */ (null),
  occluder: /** @type {Source | null} */ (null),
  rank: "",
  maxBrightness: "",
  seconds: "",
  opacity: "",
  frames: "",
  layers: "",
  several: false,
  jobs: /** @type {Record<string, number>} */ ({}), // the last job of each kind
  searched: "", // the pictures of the last search for regions
  mode: "picture",
  wipe: 0,
  stops: 0,
  falseColor: false,
  frame: 0,
  tool: "Pan",
  radius: 3, // pixels around a picked one
  strokes: /** @type {number[][][]} */ ([]), // of the painted mask
  brush: 24, // pixels, its width
  line: /** @type {number[] | null} */ (null), // of the ruler
  lineLength: "",
  ruler: { diameter: "", scale: "", exposure: "", lineTime: "", readout: "", plane: /** @type {string[]} */ ([]),
    camera: /** @type {Source | null} */ (null), gravity: "" },
  rotation: false,
  spin: false,
  moments: 9,
  moment: 4,
  changes: { fade: 1, amplify: 1, paints: /** @type {string[]} */ ([]), recolor: /** @type {string[]} */ ([]), expose: 0, gain: [1, 1, 1] },
  over: /** @type {Source | null} */ (null),
  place: { x: 0, y: 0, scale: 1 },
  grow: 0,
  format: "png",
};

export const store = {
  ...structuredClone(CHOSEN),
  server: /** @type {any} */ (null),
  gone: false,
  shaders: true, // whether the browser draws; else the server does, in 8 bits
  error: "",
  sending: /** @type {Map<string, number>} */ (new Map()),
  facts: /** @type {Map<string, any>} */ (new Map()), // what the viewer says of a source
  answers: /** @type {Map<number, any>} */ (new Map()), // what ended jobs answered
  picked: /** @type {any} */ (null),
  under: /** @type {any} */ (null), // values under the cursor
  pointed: /** @type {number | null} */ (null), // the frame of the charts under the cursor
};

const kept = sessionStorage.getItem(KEPT);
if (kept) Object.assign(store, JSON.parse(kept));

let draw = () => {};
let asked = false;

/** @param {() => void} how */
export function onChange(how) {
  draw = how;
}

/** Change what is known, and show it with the next frame of the screen.
 * @param {Partial<typeof store>} [part] */
export function change(part = {}) {
  Object.assign(store, part);
  const chosen = Object.fromEntries(Object.keys(CHOSEN).map((name) => [name, /** @type {any} */ (store)[name]]));
  sessionStorage.setItem(KEPT, JSON.stringify(chosen));
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => {
    asked = false;
    draw();
  });
}

/** Do something that may be refused; the reason is shown, until something else that was asked for is done.
 * @template T @param {() => Promise<T>} what @param {boolean} wasAsked  not by the page itself
 * @returns {Promise<T | null>} */
export async function trying(what, wasAsked = true) {
  try {
    const done = await what();
    if (store.error && wasAsked) change({ error: "" });
    return done;
  } catch (error) {
    change({ error: /** @type {Error} */ (error).message });
    return null;
  }
}

/** Follow the session until the server ends. */
export async function follow() {
  for (let tries = 0; tries < 3;) {
    try {
      await states((state) => {
        tries = 0;
        hear(state);
      });
    } catch (error) {
      if (!store.server) change({ error: /** @type {Error} */ (error).message });
    }
    tries += 1;
    await new Promise((resolve) => setTimeout(resolve, 300 * tries));
  }
  change({ gone: true });
}

/** @param {any} state */
function hear(state) {
  const first = store.server === null;
  change({ server: state });
  for (const job of state.jobs) {
    if (job.state === "done" && !store.answers.has(job.number)) fetchAnswer(job, !first);
  }
  if (first && !store.picture) state.files.forEach(take);
}

/** @param {any} job @param {boolean} isNew  it ended now; else the page was loaded again, and stays as it was */
async function fetchAnswer(job, isNew) {
  store.answers.set(job.number, null);
  const whole = await trying(async () => (await ask(`/api/jobs/${job.number}`)).json(), false);
  if (!whole) return;
  store.answers.set(job.number, whole.answer);
  if (!isNew) change();
  else if (store.jobs.solve === job.number && isClip() && whole.answer?.frames) {
    const first = whole.answer.frames.find((/** @type {any} */ row) => row.layer);
    change({ mode: resulting(), ...(first && !clipRow() ? { frame: first.frame } : {}) });
  } else if (store.jobs.solve === job.number && solution()) {
    change({ alternative: -1, mode: resulting(), changes: structuredClone(CHOSEN.changes) });
    describe(/** @type {Source} */ (layerOf(job.number)));
  } else change();
}

/** The view of a picture that has been solved. */
const resulting = () => (store.shaders ? "result" : "checker");

/** The state of the last job of a kind; null if there is none. @param {string} kind */
export function job(kind) {
  const number = store.jobs[kind];
  return store.server?.jobs.find((/** @type {any} */ one) => one.number === number) ?? null;
}

/** What the last job of a kind answered. @param {string} kind */
export const answer = (kind) => store.answers.get(store.jobs[kind] ?? 0) ?? null;

/** The job that runs, or waits first. */
export function active() {
  const jobs = store.server?.jobs ?? [];
  return jobs.find((/** @type {any} */ one) => one.state === "running")
    ?? jobs.find((/** @type {any} */ one) => one.state === "waiting") ?? null;
}

/** What is known of the last solution of a picture: the report; null if there is none. */
export function solution() {
  const found = answer("solve");
  return found && found.grade && found.stats ? found : null;
}

/** The layer of a job, if it wrote one. @param {number} number @returns {Source | null} */
export function layerOf(number) {
  const one = store.server?.jobs.find((/** @type {any} */ other) => other.number === number);
  return one?.files.includes("layer.exr") ? { job: number, name: "layer.exr" } : null;
}

/** The layer that is shown, of a clip that of this frame. @returns {Source | null} */
export function layer() {
  if (!isClip()) return solution() ? layerOf(store.jobs.solve) : null;
  const name = clipRow()?.layer;
  return name ? { job: store.jobs.solve, name } : null;
}

/** What the last solution of a clip says of this frame. */
export const clipRow = () => answer("solve")?.frames?.find((/** @type {any} */ row) => row.frame === store.frame && row.layer) ?? null;

/** What commands change: the layer, or all layers of a clip. @returns {Source | null} */
export function layers() {
  const done = isClip() && (answer("solve")?.frames ?? []).find((/** @type {any} */ row) => row.layer);
  return isClip() ? done ? { job: store.jobs.solve, name: done.layer.replace(/\d/g, "#") } : null : layer();
}

/** The scene behind the object; of a clip that which was made of it. @returns {Source | "none" | null} */
export function behind() {
  const made = isClip() && job("solve")?.files.includes("plate.exr");
  return made ? { job: store.jobs.solve, name: "plate.exr" } : store.plate;
}

/** Queue a command line. @param {string} kind @param {import("./api.js").Words} line @param {string} title */
export function run(kind, line, title) {
  return trying(async () => {
    const search = kind === "solve" && job("find")?.state === "waiting" ? job("find") : null;
    for (const earlier of [job(kind), search]) {
      if (earlier && ["waiting", "running"].includes(earlier.state)) {
        await ask(`/api/jobs/${earlier.number}`, { method: "DELETE" });
      }
    }
    const made = await post("/api/jobs", { words: line, title });
    change({ jobs: { ...store.jobs, [kind]: made.number } });
    return made;
  });
}

/** @param {number} number */
export const cancel = (number) => trying(() => ask(`/api/jobs/${number}`, { method: "DELETE" }));
/** @param {number} number */
export const resume = (number) => trying(() => {
  store.answers.delete(number);
  return post(`/api/jobs/${number}/resume`);
});

/** Ask what a source is, once. @param {Source} source */
export async function describe(source) {
  const key = named(source);
  if (store.facts.has(key)) return store.facts.get(key);
  store.facts.set(key, null);
  const found = await trying(async () => (await look("describe", source)).json(), false);
  store.facts.set(key, found); // null if it was refused: asked again, it would be refused with each drawing
  change();
  return found;
}

/** What is known of a source; asked for if nothing is. @param {Source | "none" | null} source */
export function facts(source) {
  if (!source || source === "none") return null;
  const key = named(source);
  if (!store.facts.has(key)) describe(source);
  return store.facts.get(key) ?? null;
}

export const isClip = () => facts(store.picture)?.kind === "clip";

/** @param {Iterable<File>} files @param {string} [slot] */
export async function drop(files, slot) {
  for (const file of files) {
    store.sending.set(file.name, 0);
    const held = await trying(() => send(file, (done) => {
      store.sending.set(file.name, done);
      change();
    }));
    store.sending.delete(file.name);
    if (held) take(held, slot);
    change();
  }
}

/** Give a file its part: the first is the picture, the second the plate; a third makes a burst.
 * @param {any} held @param {string | unknown} [slot] */
function take(held, slot) {
  const source = { file: held.number };
  if (slot === "Plate") choosePlate(source);
  else if (slot === "Picture or clip" || !store.picture) choosePicture(source);
  else if (slot === "Over") change({ over: source });
  else if (slot === "Occluder") change({ occluder: source });
  else if (slot === "Region") change({ region: source });
  else if (slot === "Sharp picture") change({ colorFrom: source, mode: "reference", tool: "Pick color" });
  else if (slot === "Camera") change({ ruler: { ...store.ruler, camera: source } });
  else if (!store.plate && held.kind === "picture" && !store.burst.length) choosePlate(source);
  else {
    const before = [store.picture, store.plate].flatMap((one) => (one && one !== "none" && "file" in one ? [one.file] : []));
    change({ burst: [...new Set([...store.burst, ...before, held.number])] });
  }
}

/** @param {Source} picture */
export async function choosePicture(picture) {
  change({ picture, region: null, jobs: {}, mode: "picture", frame: 0, wipe: 0, colors: [], line: null });
  await describe(picture);
  findStreaks();
}

/** @param {Source | "none" | null} plate */
export function choosePlate(plate) {
  change({ plate, jobs: {}, region: null });
  if (plate && plate !== "none") describe(plate);
  findStreaks();
}

/** The picture is the plate, and the plate the picture. */
export function exchange() {
  const { picture, plate } = store;
  if (!plate || plate === "none") return;
  change({ picture: plate, plate: picture, region: null, jobs: {}, mode: "picture" });
  findStreaks();
}

/** Outline what moved, as soon as there are a picture and its plate. */
function findStreaks() {
  const { picture, plate } = store;
  const pair = JSON.stringify([picture, plate]);
  if (!picture || !plate || !facts(picture) || isClip() || store.jobs.solve || pair === store.searched) return;
  change({ searched: pair });
  run("find", words.find(picture, plate), "regions");
}

/** A plate of all pictures that were dropped. */
export async function makePlate() {
  const made = await run("plate", words.plate(store.burst.map((file) => ({ file }))), "plate");
  if (made) change({ plate: { job: made.number, name: "plate.exr" }, burst: [] });
}

/** @param {Partial<typeof CHOSEN.changes>} part */
export const edit = (part) => change({ changes: { ...store.changes, ...part }, mode: store.mode === "checker" || store.mode === "over" ? store.mode : "result" });

/** An example of the package, rendered on the spot. */
export async function example() {
  await run("render", ["render", "easy", "-o", { out: "" }], "example");
}

/** Take the pictures of the example when it is there. */
export function takeExample() {
  const made = job("render");
  if (made?.state !== "done" || store.picture) return;
  const of = (/** @type {string} */ name) => ({ job: made.number, name });
  change({ picture: of("image.png"), plate: of("plate.png"), jobs: {} });
  describe(of("image.png")).then(findStreaks);
}
