// Requests to the server of this page, with the key that only its address holds.

const key = location.hash.slice(1);

/** A source of pixels: a file that was given, or a result of a job.
 * @typedef {{file: number} | {job: number, name: string}} Source */

/** The words of a command line behind `blurmatte`.
 * @typedef {(string | Source | {out: string})[]} Words */

/** Ask the server; an Error holds the sentence that it refused with.
 * @param {string} path
 * @param {{method?: string, body?: BodyInit, signal?: AbortSignal}} [how]
 * @returns {Promise<Response>} */
export async function ask(path, how = {}) {
  const response = await fetch(path, { ...how, headers: { Authorization: `Bearer ${key}` } });
  if (response.ok) return response;
  let why = `the server answered ${response.status}`;
  try {
    why = (await response.json()).error ?? why;
  } catch { /* no JSON */ }
  throw new Error(why);
}

/** @param {string} path
 * @param {object} [body] */
export async function post(path, body) {
  return (await ask(path, { method: "POST", body: JSON.stringify(body ?? {}) })).json();
}

/** The states of the session, as they come; ends when the server does.
 * @param {(state: any) => void} hear */
export async function states(hear) {
  const response = await ask("/api/states");
  if (!response.body) return;
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let begun = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    const lines = (begun + value).split("\n");
    begun = lines.pop() ?? "";
    if (lines.length) hear(JSON.parse(lines[lines.length - 1]));
  }
}

/** Copy a file to the server; `progress` gets the fraction that is done.
 * @param {File} file
 * @param {(done: number) => void} progress
 * @returns {Promise<any>} */
export function send(file, progress) {
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("PUT", `/api/files?name=${encodeURIComponent(file.name)}`);
    request.setRequestHeader("Authorization", `Bearer ${key}`);
    request.upload.onprogress = (event) => progress(event.loaded / Math.max(event.total, 1));
    request.onerror = () => reject(new Error(`${file.name}: the server cannot be reached`));
    request.onload = () => {
      const answer = JSON.parse(request.responseText || "{}");
      if (request.status === 200) resolve(answer);
      else reject(new Error(answer.error ?? `the server answered ${request.status}`));
    };
    request.send(file);
  });
}

/** @param {Source} source */
export function named(source) {
  return "file" in source ? `file=${source.file}`
    : `job=${source.job}&name=${encodeURIComponent(source.name)}`;
}

/** What the viewer says of a source.
 * @param {string} question
 * @param {Source} source
 * @param {Record<string, string | number>} [values]
 * @param {AbortSignal} [signal] */
export function look(question, source, values = {}, signal) {
  const given = Object.entries(values).map(([name, value]) => `&${name}=${encodeURIComponent(value)}`);
  return ask(`/api/look/${question}?${named(source)}${given.join("")}`, { signal });
}

/** Save a file of the server on this machine, under a name.
 * @param {string} path
 * @param {string} name */
export async function download(path, name) {
  const url = URL.createObjectURL(await (await ask(path)).blob());
  const link = document.createElement("a");
  link.href = url;
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 60000);
}
