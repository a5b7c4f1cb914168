// What is known of a fixed camera's view: landmarks, lengths, heights, verticals, the horizon; and the pose that follows.

import { gridShapes } from "../stage/overlay.js";

const UNKNOWNS = ["position", "height", "tilt", "roll", "heading"], WITHOUT_PLACES = ["height", "tilt", "roll"];
const GOOD = "#009e73", OUTLIER = "#d55e00", RESIDUAL = "#f0e442", DRAFT = "#fff", ENLARGED = 10;
const EVIDENCE = { // how many points, and what is typed
  landmark: [1, ["east", "north", "up"]], length: [2, ["metres"]], height: [2, ["metres"]], vertical: [2, []], horizon: [2, []],
};
const HAS_PIXELS = /(^|[,;\t])\s*u\s*[,;\t]/i, IS_OF_OPENDRONEMAP = /^\s*(epsg:|\+proj|\+init|wgs84)/i;
const find = (id) => document.getElementById(id);
const isNumber = (text) => text !== "" && Number.isFinite(Number(text));
const named = (text) => text.trim().replace(/\s+/g, "-");

export class Landmarks {
  constructor(link, history, changed, used) {
    this.link = link;
    this.history = history;
    this.changed = changed;
    this.used = used;
    this.items = []; // { kind, name, points: [pixel], values: as typed }
    this.draft = []; // points of the one that is being made
    this.waiting = []; // of a list: landmarks that are not clicked yet
    this.crs = "local";
    this.made = 0;
    this.found = null;
    find("take").onclick = () => this.take(find("list").value);
    find("use").onclick = () => this.solve(true);
    find("focal").onchange = () => this.solve();
    find("evidence").onchange = () => { this.draft = []; this.changed(); };
    find("list-file").onchange = async (event) => {
      find("list").value = await event.target.files[0].text();
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

  // ---- marking

  place(pixel) {
    const kind = find("evidence").value, [count, words] = EVIDENCE[kind];
    this.draft.push(pixel);
    if (this.draft.length < count) return this.changed();
    const next = kind === "landmark" && this.waiting.shift();
    const values = next ? next.values : words.map((word) => (word === "up" ? "0" : ""));
    this.made += 1;
    this.items.push({ kind, name: next?.name || `${kind}-${this.made}`, points: this.draft, values });
    this.draft = [];
    this.list();
    if (!next) find("places").lastElementChild.querySelectorAll("input")[1]?.focus();
    this.solve();
  }

  moved() {
    this.solve();
  }

  take(text) { // with pixels they are placed at once; without, they are clicked in their order
    if (IS_OF_OPENDRONEMAP.test(text) || HAS_PIXELS.test(text.split("\n")[0])) return this.import(text);
    this.waiting = text.split("\n").map((line) => line.split(/[,;\t]/).map((cell) => cell.trim()))
      .filter((cells) => cells.length >= 3 && cells.slice(1, 3).every(isNumber))
      .map(([name, east, north, up]) => ({ name: named(name), values: [east, north, up || "0"] }));
    const [next] = this.waiting;
    find("solved").textContent = next ? `Click ${next.name} in the image.` : "No line has a name, east, north and up.";
  }

  import(text) {
    this.link.ask("import", { image: 0, import: text }, (answer) => {
      if (answer.error) { find("solved").textContent = answer.error; return; }
      this.crs = answer.crs;
      this.items.push(...answer.landmarks.map(({ name, pixel, place }) =>
        ({ kind: "landmark", name, points: [pixel], values: place.map(String) })));
      this.list();
      this.solve();
    });
  }

  list() {
    find("places").replaceChildren(...this.items.map((item) => {
      const row = document.createElement("li"), remove = document.createElement("button");
      const cell = (value, word, change) => {
        const label = document.createElement("label"), input = document.createElement("input");
        input.value = value;
        input.oninput = () => { change(input.value); this.solve(); };
        label.append(word, input);
        return label;
      };
      const words = EVIDENCE[item.kind][1].map((word, axis) =>
        cell(item.values[axis], word, (text) => { item.values[axis] = text.trim().replace(",", "."); }));
      remove.textContent = "✕";
      remove.setAttribute("aria-label", `Delete ${item.name}`);
      remove.onclick = () => {
        this.history.keep();
        this.items = this.items.filter((each) => each !== item);
        this.list();
        this.solve();
      };
      row.append(cell(item.name, item.kind, (text) => { item.name = named(text); }), ...words, remove);
      return row;
    }));
  }

  // ---- the pose that follows

  evidence() { // as a file of evidence has it; null where nothing is known yet
    const known = this.items.filter((item) => item.values.every(isNumber)), tables = {};
    for (const { kind, name, points, values } of known) {
      const numbers = values.map(Number), [first, second] = points;
      const place = this.crs === "geo" ? { lat_deg: numbers[0], lon_deg: numbers[1], alt_m: numbers[2] } : { position_m: numbers };
      (tables[kind] ??= []).push({
        landmark: { name, pixel: first, ...place },
        length: { name, pixels: points, length_m: numbers[0] },
        height: { name, base: first, top: second, height_m: numbers[0] },
        vertical: { name, pixels: points },
        horizon: { name, pixels: points },
      }[kind]);
    }
    return known.length ? { crs: this.crs, ...tables } : null;
  }

  solve(use = false) {
    const evidence = this.evidence();
    find("use").disabled = true;
    this.changed();
    if (!evidence) { this.found = null; return; }
    const unknowns = [...(evidence.landmark ? UNKNOWNS : WITHOUT_PLACES), ...(find("focal").checked ? ["focal"] : [])];
    this.link.ask("evidence", { image: 0, evidence, unknowns, use }, (answer) => {
      this.found = answer.calibration || null;
      this.tell(answer.error);
      if (use && this.found) this.used();
      this.changed();
    });
  }

  tell(error) {
    const { found, waiting: [next] } = this;
    find("use").disabled = found?.status !== "ok";
    find("solved").textContent = [found ? this.text() : error, next ? `Next: click ${next.name}.` : ""].filter(Boolean).join(" ");
    find("parameters").hidden = !found;
    find("parameters").replaceChildren(...(found ? Object.entries(found.parameters).map(parameterRow) : []));
  }

  text() {
    const { file, rms_px: rms, residuals, notes } = this.found;
    const left = residuals.filter((each) => each.outlier).map((each) => each.name);
    return [
      file ? `Saved as ${file}, and measured with.` : "",
      rms === null ? "" : `Residuals ${rms.toFixed(2)} px rms: the yellow lines, ${ENLARGED} times as long.`,
      left.length ? `Left out: ${left.join(", ")}.` : "",
      ...notes,
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
    .map(([[u, v], [x, y]]) => ({ points: [[u, v], [u + ENLARGED * (x - u), v + ENLARGED * (y - v)]], colour: RESIDUAL, style: "line" }));
}

function parameterRow([key, { value, std }]) { // its name, value and 95 %
  const row = document.createElement("tr"), [, name, unit] = /^(.*)_(deg|m|px)$/.exec(key) || [key, key, ""];
  const digits = std > 0 ? Math.min(Math.max(1 - Math.floor(Math.log10(1.96 * std)), 0), 6) : 3, sign = unit === "deg" ? "°" : ` ${unit}`;
  const texts = [name.replaceAll("_", " "), `${value.toFixed(digits)}${sign}`, std === null ? "" : `± ${(1.96 * std).toFixed(digits)}${sign}`];
  row.replaceChildren(...texts.map((text) => Object.assign(document.createElement("td"), { textContent: text })));
  return row;
}
