// Controls: labelled fields of all kinds.

import { drop, store } from "./store.js";
import { Component, h } from "./vendor/preact.js";

/** @typedef {import("./api.js").Source} Source */

/** A slider with its name and its value in words.
 * @param {{name: string, value: number, from: number, to: number, step: number, words: string,
 *   onInput: (value: number) => void}} props */
export function Slider({ name, value, from, to, step, words, onInput }) {
  return h("label", { class: "slider" }, h("span", null, name),
    h("input", {
      type: "range", min: from, max: to, step, value, "aria-label": name, "aria-valuetext": words,
      onInput: (/** @type {any} */ e) => onInput(Number(e.target.value)),
    }), h("span", { class: "words" }, words));
}

/** A number that may be typed; what is begun stays while the page is drawn anew. */
export class NumberField extends Component {
  constructor(/** @type {any} */ props) {
    super(props);
    this.typed = /** @type {string | null} */ (null);
  }

  /** @param {any} props  name: string, value: number | string, onChange: (value: number) => void */
  render({ name, value, onChange }) {
    return h("label", { class: "number" }, `${name} `, h("input", {
      type: "number", step: "any", value: this.typed ?? value, "aria-label": name,
      onInput: (/** @type {any} */ e) => { this.typed = e.target.value; },
      onChange: (/** @type {any} */ e) => {
        this.typed = null;
        if (e.target.value !== "") onChange(Number(e.target.value));
      },
    }));
  }
}

/** @param {Source | "none" | null} source */
function nameOf(source) {
  if (!source) return "none yet";
  if (source === "none") return "guessed";
  if ("job" in source) return source.name;
  return store.server?.files.find((/** @type {any} */ one) => one.number === source.file)?.name ?? "";
}

/** A field for a file, by dialog or by dropping. @param {{label: string, source: any, clear?: () => void}} props */
export function FileField({ label, source, clear }) {
  const id = `file-${label.replaceAll(" ", "-")}`;
  return h("div", { class: "file" },
    h("label", { for: id }, label),
    h("input", {
      id, type: "file",
      onChange: (/** @type {any} */ e) => { drop([...e.target.files], label); e.target.value = ""; },
      onDrop: (/** @type {DragEvent} */ e) => {
        e.preventDefault();
        e.stopPropagation();
        drop(e.dataTransfer?.files ?? [], label);
      },
    }),
    h("span", { class: "name" }, nameOf(source)),
    clear && source && h("button", { class: "quiet", "aria-label": `No ${label.toLowerCase()}`, onClick: clear }, "✕"));
}

/** A text that a command reads. @param {{name: string, value: string, hint: string, onChange: (value: string) => void}} props */
export function Field({ name, value, hint, onChange: changed }) {
  return h("label", { class: "field" }, h("span", null, name), h("input", {
    type: "text", value, placeholder: hint, "aria-label": name,
    onInput: (/** @type {any} */ e) => changed(e.target.value.trim()),
  }));
}

/** @param {{name: string, checked: boolean, onChange: (value: boolean) => void}} props */
export const Check = ({ name, checked, onChange: changed }) => h("label", { class: "check" }, h("input", {
  type: "checkbox", checked, onChange: (/** @type {any} */ e) => changed(e.target.checked) }), ` ${name}`);
