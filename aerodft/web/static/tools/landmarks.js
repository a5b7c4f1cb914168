// What is known of a fixed camera's view: landmarks, lengths, heights, verticals, the horizon; and the pose that follows.

const UNKNOWNS = ["position", "height", "tilt", "roll", "heading"], WITHOUT_PLACES = ["height", "tilt", "roll"];
const GOOD = "#009e73", OUTLIER = "#d55e00", RESIDUAL = "#f0e442", ENLARGED = 10;
export const EVIDENCE = { // how many points, and what is typed
  landmark: [1, ["east", "north", "up"]], length: [2, ["metres"]], height: [2, ["metres"]], vertical: [2, []], horizon: [2, []],
};
const find = (id) => document.getElementById(id);
const isNumber = (text) => text !== "" && Number.isFinite(Number(text));

export class Landmarks {
  constructor(link, changed, used) {
    this.link = link;
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
    find("focal").onchange = () => this.solve(false);
    find("evidence").onchange = () => { this.draft = []; this.changed(); };
    find("list-file").onchange = async (event) => { find("list").value = await event.target.files[0].text(); this.take(find("list").value); };
  }

  get kind() {
    return find("evidence").value;
  }

  add(pixel) {
    const [points, words] = EVIDENCE[this.kind];
    this.draft.push(pixel);
    if (this.draft.length < points) return this.changed();
    const next = this.kind === "landmark" && this.waiting.shift();
    const values = next ? next.values : words.map((word) => (word === "up" ? "0" : ""));
    this.items.push({ kind: this.kind, name: next?.name || `${this.kind}-${++this.made}`, points: this.draft, values });
    this.draft = [];
    this.list();
    this.solve(false);
  }

  take(text) { // with pixels they are placed at once; without, they are clicked in their order
    if (/^\s*(epsg:|\+proj|\+init|wgs84)/i.test(text) || /(^|[,;\t])\s*u\s*[,;\t]/i.test(text.split("\n")[0])) {
      this.link.ask("import", { image: 0, import: text }, (answer) => {
        if (answer.error) { find("solved").textContent = answer.error; return; }
        this.crs = answer.crs;
        this.items.push(...answer.landmarks.map(({ name, pixel, place }) => ({ kind: "landmark", name, points: [pixel], values: place.map(String) })));
        this.list();
        this.solve(false);
      });
      return;
    }
    this.waiting = text.split("\n").map((line) => line.split(/[,;\t]/).map((cell) => cell.trim()))
      .filter((cells) => cells.length >= 3 && cells.slice(1, 3).every(isNumber))
      .map(([name, east, north, up]) => ({ name: name.replace(/\s+/g, "-"), values: [east, north, up || "0"] }));
    const [next] = this.waiting;
    find("solved").textContent = next ? `Click ${next.name} in the image.` : "No line has a name, east, north and up.";
  }

  list() {
    find("places").replaceChildren(...this.items.map((item, index) => {
      const row = document.createElement("li"), remove = document.createElement("button");
      const cell = (value, label, change) => {
        const input = document.createElement("input");
        input.value = value;
        input.setAttribute("aria-label", label);
        input.placeholder = label;
        input.oninput = () => { change(input.value.trim()); this.solve(false); };
        return input;
      };
      remove.textContent = "✕";
      remove.setAttribute("aria-label", `Delete ${item.name}`);
      remove.onclick = () => { this.items.splice(index, 1); this.list(); this.solve(false); };
      const words = EVIDENCE[item.kind][1].map((word, axis) => cell(item.values[axis], word, (text) => { item.values[axis] = text; }));
      row.append(cell(item.name, "name", (text) => { item.name = text.replace(/\s+/g, "-"); }), ...words, remove);
      return row;
    }));
  }

  document() { // as a file of evidence has it
    const known = this.items.filter((item) => item.values.every(isNumber)), tables = {};
    for (const { kind, name, points, values } of known) {
      const numbers = values.map(Number), [first, second] = points, isGeo = this.crs === "geo";
      (tables[kind] ??= []).push({
        landmark: { name, pixel: first, ...(isGeo ? { lat_deg: numbers[0], lon_deg: numbers[1], alt_m: numbers[2] } : { position_m: numbers }) },
        length: { name, pixels: points, length_m: numbers[0] },
        height: { name, base: first, top: second, height_m: numbers[0] },
        vertical: { name, pixels: points },
        horizon: { name, pixels: points },
      }[kind]);
    }
    return known.length ? { crs: this.crs, ...tables } : null;
  }

  solve(use) {
    const evidence = this.document();
    this.found = null;
    find("use").disabled = true;
    this.changed();
    if (!evidence) return;
    const unknowns = [...(evidence.landmark ? UNKNOWNS : WITHOUT_PLACES), ...(find("focal").checked ? ["focal"] : [])];
    this.link.ask("evidence", { image: 0, evidence, unknowns, use }, (answer) => {
      this.found = answer.calibration || null;
      find("use").disabled = !this.found || this.found.status !== "ok";
      const next = this.waiting[0] ? ` Next: click ${this.waiting[0].name}.` : "";
      find("solved").textContent = (this.found ? this.text() : answer.error) + next;
      if (use && this.found) this.used();
      this.changed();
    });
  }

  text() {
    const { parameters, residuals, rms_px: rms, notes, file } = this.found;
    const values = Object.entries(parameters).map(([name, { value, std }]) => `${name} ${value.toFixed(3)} ± ${std === null ? "?" : (1.96 * std).toPrecision(2)}`);
    const left = residuals.filter((each) => each.outlier).map((each) => each.name);
    return [file ? `Saved as ${file}, and measured with.` : "", `95 %: ${values.join(", ")}.`, rms === null ? "" : `Residuals ${rms.toFixed(2)} px rms, drawn ${ENLARGED} times as long.`,
      left.length ? `Left out: ${left.join(", ")}.` : "", ...notes].filter(Boolean).join(" ");
  }

  shapes() {
    const residuals = new Map((this.found?.residuals || []).map((each) => [each.name, each]));
    const marks = this.items.map((item) => {
      const residual = residuals.get(item.name);
      return { points: item.points, colour: residual?.outlier ? OUTLIER : GOOD,
        label: typeof residual?.px === "number" ? `${item.name} ${residual.px.toFixed(2)} px` : item.name };
    });
    const arrows = (this.found?.marks || []).flatMap(({ seen_px: seen, expected_px: expected }) => seen.map((pixel, at) => [pixel, expected[at]]))
      .filter(([pixel, expected]) => pixel && expected)
      .map(([[u, v], [x, y]]) => ({ points: [[u, v], [u + ENLARGED * (x - u), v + ENLARGED * (y - v)]], colour: RESIDUAL, plain: true }));
    return [...marks, ...arrows, ...(this.draft.length ? [{ points: this.draft, colour: "#fff" }] : [])];
  }
}
