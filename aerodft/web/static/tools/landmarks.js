// @ts-check
// What is known of a fixed camera's view: landmarks, lengths, heights, verticals, the horizon; and the pose that follows.

import { element, find } from "../elements.js";
import { handText, plain } from "../measuring/words.js";
import { gridShapes } from "../stage/overlay.js";

const UNKNOWNS = ["position", "height", "tilt", "roll", "heading"], WITHOUT_PLACES = ["height", "tilt", "roll"];
const GOOD = "#009e73", OUTLIER = "#d55e00", RESIDUAL = "#f0e442", DRAFT = "#fff", ENLARGED = 10, PATIENCE_MS = 150;
const EVIDENCE = { // how many points, what is typed, and how well that may be known
  landmark: [1, ["east", "north", "up"], ["± m", "± px"]], length: [2, ["metres"], ["± m", "± px"]],
  height: [2, ["metres"], ["± m", "± px"]], vertical: [2, [], ["± px"]], horizon: [2, [], ["± px"]],
};
const STDS = { "± m": ["std_m", "0", "Standard deviation in metres"], "± px": ["std_px", "1", "Standard deviation in pixels"] };
const HAS_PIXELS = /(^|[,;\t])\s*u\s*[,;\t]/i, IS_OF_OPENDRONEMAP = /^\s*(epsg:|\+proj|\+init|wgs84)/i;
const isNumber = (text) => text !== "" && Number.isFinite(Number(text));
const named = (text) => text.trim().replace(/\s+/g, "-");
const typed = (text) => text.trim().replace(",", ".");

export class Landmarks {
  constructor(view, link, history, changed, used) {
    this.view = view;
    this.link = link;
    this.history = history;
    this.changed = changed;
    this.used = used;
    this.items = []; // { kind, name, points: [pixel], values: as typed, stds: { "± m": as typed } }
    this.draft = []; // points of the one that is being made
    this.waiting = []; // of a list: landmarks that are not clicked yet
    this.crs = "local";
    this.made = 0;
    this.turn = 0; // of the newest question
    this.found = null;
    this.say(handText("Click a landmark in the image, then type where it is."));
    find("take").onclick = () => this.take(find("list").value);
    find("use").hidden = view.is_read_only;
    find("use").onclick = () => this.solve(true);
    this.followTyping(find("plane"), () => {});
    find("focal").onchange = find("accept").onchange = () => this.solve();
    find("evidence").onchange = () => { this.draft = []; this.changed(); };
    find("list-file").onchange = async () => {
      find("list").value = await find("list-file").files[0].text();
      this.take(find("list").value);
    };
  }

  get state() {
    return { items: this.items, draft: this.draft, waiting: this.waiting };
  }

  set state(state) {
    if (JSON.stringify(state) === JSON.stringify(this.state)) return;
    Object.assign(this, state);
    this.list();
    this.solve();
  }

  say(text) {
    clearTimeout(this.busy);
    find("solved").textContent = text;
  }

  // ---- marking

  place(pixel) {
    const kind = find("evidence").value, [count, words] = EVIDENCE[kind];
    this.draft.push(pixel);
    if (this.draft.length < count) return this.changed();
    const next = kind === "landmark" ? this.waiting.shift() : null;
    this.made += 1;
    const item = this.add(kind, next?.name || `${kind}-${this.made}`, this.draft, next?.values || words.map((word) => (word === "up" ? "0" : "")));
    this.draft = [];
    this.list();
    if (!next && words.length) this.inputAfterName(item)?.focus();
    this.solve();
  }

  /** @returns {HTMLInputElement | null} */
  inputAfterName(item) {
    return find("places").querySelector(`[data-item="${this.items.indexOf(item)}"] td:nth-child(2) input`);
  }

  add(kind, name, points, values) {
    const item = { kind, name, points, values, stds: {} };
    this.items.push(item);
    return item;
  }

  moved() {
    this.solve();
  }

  take(text) { // with pixels they are placed at once; without, they are clicked in their order
    find("list").closest("details").open = false; // what is said of it stands above
    if (IS_OF_OPENDRONEMAP.test(text) || HAS_PIXELS.test(text.split("\n")[0])) return this.import(text);
    this.waiting = text.split("\n").map((line) => line.split(/[,;\t]/).map((cell) => cell.trim()))
      .filter((cells) => cells.length >= 3 && cells.slice(1, 3).every(isNumber))
      .map(([name, east, north, up]) => ({ name: named(name), values: [east, north, up || "0"] }));
    const [next] = this.waiting;
    this.say(next ? handText(`Click ${next.name} in the image.`) : "No line has a name, east, north and up.");
  }

  import(text) {
    this.link.ask("import", { image: 0, import: text }, (answer) => {
      if (answer.error) return this.say(plain(answer.error));
      this.crs = answer.crs;
      for (const { name, pixel, place } of answer.landmarks) this.add("landmark", name, [pixel], place.map(String));
      this.list();
      this.solve();
    });
  }

  // ---- the table of what is typed: of each kind its own, so that its columns are named once

  list() {
    find("places").replaceChildren(...Object.keys(EVIDENCE).map((kind) => this.table(kind)).filter((table) => table.tBodies[0].rows.length));
  }

  table(kind) {
    const [, words, stds] = EVIDENCE[kind], table = element("table");
    const columns = kind === "landmark" && this.crs === "geo" ? ["latitude", "longitude", "height"] : words;
    const heads = [kind, ...columns, ...stds, ""].map((text) => element("th", text, { scope: "col" }));
    table.createTHead().insertRow().append(...heads);
    const body = table.createTBody();
    this.items.forEach((item, at) => { if (item.kind === kind) this.row(body.insertRow(), item, at, columns, stds); });
    return table;
  }

  row(row, item, at, columns, stds) {
    const remove = element("button", "✕", { ariaLabel: `Delete ${item.name}`, onclick: () => this.remove(item) });
    row.dataset.item = String(at);
    row.insertCell().append(this.input(item.name, `Name of ${item.name}`, (text) => { item.name = named(text); }));
    columns.forEach((word, axis) => row.insertCell().append(
      this.input(item.values[axis], `${word} of ${item.name}`, (text) => { item.values[axis] = typed(text); })));
    for (const word of stds) {
      const [, assumed, label] = STDS[word];
      const input = this.input(item.stds[word] || "", `${label} of ${item.name}`, (text) => { item.stds[word] = typed(text); });
      row.insertCell().append(Object.assign(input, { placeholder: assumed, title: `${label}; ${assumed} if nothing is typed` }));
    }
    row.insertCell().append(remove);
  }

  input(value, label, change) {
    const input = element("input", "", { value, ariaLabel: label });
    this.followTyping(input, change);
    return input;
  }

  followTyping(input, change) { // solved once it is left or Enter is pressed: half a number is none
    input.oninput = () => {
      change(input.value);
      this.isTyping = find("use").disabled = find("export").hidden = true;
      this.say("Enter or Tab takes what you type.");
    };
    input.onkeydown = ({ key }) => { if (key === "Enter") find("image").focus(); }; // for the next mark
    input.onchange = input.onblur = () => { if (this.isTyping) this.solve(); };
  }

  remove(item) {
    this.history.keep();
    this.items = this.items.filter((each) => each !== item);
    this.list();
    this.solve();
  }

  // ---- the pose that follows

  isKnown({ values, stds }) {
    return values.every(isNumber) && Object.values(stds).every((text) => text === "" || isNumber(text));
  }

  /** @returns {any} As a file of evidence has it; null where nothing is known yet. */
  evidence() {
    const known = this.items.filter((item) => this.isKnown(item)), tables = {};
    for (const { kind, name, points, values, stds } of known) {
      const numbers = values.map(Number), [first, second] = points;
      const place = this.crs === "geo" ? { lat_deg: numbers[0], lon_deg: numbers[1], alt_m: numbers[2] } : { position_m: numbers };
      const spread = Object.fromEntries(Object.entries(stds).filter(([, text]) => text).map(([word, text]) => [STDS[word][0], Number(text)]));
      (tables[kind] ??= []).push({
        name, ...spread, ...{
          landmark: { pixel: first, ...place },
          length: { pixels: points, length_m: numbers[0] },
          height: { base: first, top: second, height_m: numbers[0] },
          vertical: { pixels: points },
          horizon: { pixels: points },
        }[kind],
      });
    }
    const plane = typed(find("plane").value), ground = isNumber(plane) ? { elevation_m: Number(plane) } : {};
    return known.length ? { crs: this.crs, ...ground, ...tables } : null;
  }

  solve(use = false) {
    const evidence = this.evidence();
    find("use").disabled = find("export").hidden = true;
    this.isTyping = false;
    this.changed();
    if (!evidence) { this.found = null; return this.tell(); }
    clearTimeout(this.busy);
    this.busy = setTimeout(() => this.say("Solving …"), PATIENCE_MS);
    const unknowns = [...(evidence.landmark ? UNKNOWNS : WITHOUT_PLACES), ...(find("focal").checked ? ["focal"] : [])];
    const question = { image: 0, evidence, unknowns, accept: find("accept").checked, use };
    this.turn += 1;
    const { turn } = this;
    this.link.ask(use ? "use" : "evidence", question, (answer) => {
      if (this.isTyping || turn !== this.turn) return; // it is of what stood there before
      this.found = answer.calibration || null;
      this.tell(answer.error);
      if (use && this.found) this.used();
      this.changed();
    });
  }

  tell(error = "") {
    const { found, waiting: [next] } = this, isGood = found?.status === "ok", open = this.items.filter((item) => !this.isKnown(item));
    find("use").disabled = find("export").hidden = !isGood;
    URL.revokeObjectURL(find("export").href);
    if (isGood) find("export").href = URL.createObjectURL(new Blob([found.file_text], { type: "application/toml" }));
    this.say([
      found ? this.text() : plain(error),
      open.length ? `Numbers are missing of ${open.map((each) => each.name).join(", ")}.` : "",
      next ? handText(`Next: click ${next.name}.`) : "",
    ].filter(Boolean).join(" ") || handText("Click what you know of the view."));
    find("parameters").hidden = !isGood;
    find("parameters").replaceChildren(...(isGood ? Object.entries(found.parameters).map(parameterRow) : []));
  }

  text() {
    const { file, status, reasons, rms_px: rms, residuals, notes } = this.found;
    if (status !== "ok") return `Not found yet: ${reasons.map(plain).join("; ")}.`;
    const left = residuals.filter((each) => each.outlier).map((each) => each.name);
    return [
      file ? `Saved as ${file}, and measured with.` : "",
      file && this.view.is_live ? `The station does from its next start on, if calibration = "${file.split(/[\\/]/).at(-1)}" stands under [pose] in its file.` : "",
      rms === null ? "" : `Residuals ${rms.toFixed(2)} px rms: the yellow arrows, ${ENLARGED} times as long.`,
      left.length ? `Left out: ${left.join(", ")}.` : "",
      ...notes.map((each) => `${each[0].toUpperCase()}${plain(each.slice(1))}.`),
    ].filter(Boolean).join(" ");
  }

  shapes(units) {
    const { residuals = [], marks = [], overlay } = this.found || {};
    const residualOf = new Map(residuals.map((each) => [each.name, each]));
    return [
      ...(overlay ? gridShapes(overlay, units) : []),
      ...this.items.map(({ name, points }) => {
        const { px, outlier } = residualOf.get(name) || {};
        return { points, colour: outlier ? OUTLIER : GOOD, label: typeof px === "number" ? `${name} ${px.toFixed(2)} px` : name };
      }),
      ...marks.flatMap(residualShapes),
      { points: this.draft, colour: DRAFT },
    ];
  }
}

function residualShapes({ seen_px: seen, expected_px: expected }) { // from what was clicked towards where it should be
  return seen.map((pixel, at) => [pixel, expected[at]]).filter(([pixel, there]) => pixel && there)
    .map(([[u, v], [x, y]]) => ({ points: [[u, v], [u + ENLARGED * (x - u), v + ENLARGED * (y - v)]], colour: RESIDUAL, style: "arrow" }));
}

function parameterRow([key, { value, std }]) { // its name, value and 95 %
  const row = element("tr"), [, name, unit] = /^(.*)_(deg|m|px)$/.exec(key) || [key, key, ""];
  const digits = std > 0 ? Math.min(Math.max(1 - Math.floor(Math.log10(1.96 * std)), 0), 6) : 3, sign = unit === "deg" ? "°" : ` ${unit}`;
  const texts = [name.replace("_agl", "").replaceAll("_", " "), `${value.toFixed(digits)}${sign}`, std === null ? "" : `± ${(1.96 * std).toFixed(digits)}${sign}`];
  row.replaceChildren(...texts.map((text) => element("td", text)));
  return row;
}
