// Landmarks of a fixed camera: where they are seen, where they are, and the pose that follows.

const UNKNOWNS = ["position", "height", "tilt", "roll", "heading"], GOOD = "#009e73", OUTLIER = "#d55e00";
const find = (id) => document.getElementById(id);

export class Landmarks {
  constructor(link, changed, used) {
    this.link = link;
    this.changed = changed;
    this.used = used;
    this.items = []; // { name, points: [pixel], place: [east, north, up] as typed }
    this.waiting = []; // of a list: those that are not clicked yet
    this.made = 0;
    this.found = null;
    find("take").onclick = () => this.take(find("list").value);
    find("use").onclick = () => this.solve(true);
    find("focal").onchange = () => this.solve(false);
  }

  add(pixel) {
    const next = this.waiting.shift() || { name: `landmark-${++this.made}`, place: ["", "", "0"] };
    this.items.push({ ...next, points: [pixel] });
    this.list();
    this.solve(false);
  }

  take(text) {
    this.waiting = text.split("\n").map((line) => line.split(/[,;\t]/).map((cell) => cell.trim()))
      .filter((cells) => cells.length >= 3 && cells.slice(1, 3).every((cell) => cell !== "" && Number.isFinite(Number(cell))))
      .map(([name, east, north, up]) => ({ name: name.replace(/\s+/g, "-"), place: [east, north, up || "0"] }));
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
      row.append(cell(item.name, "name", (text) => { item.name = text.replace(/\s+/g, "-"); }),
        ...["east", "north", "up"].map((label, axis) => cell(item.place[axis], label, (text) => { item.place[axis] = text; })), remove);
      return row;
    }));
  }

  solve(use) {
    const known = this.items.filter((item) => item.place.every((text) => text !== "" && Number.isFinite(Number(text))));
    this.found = null;
    find("use").disabled = true;
    this.changed();
    if (!known.length) return;
    const landmarks = known.map((item) => ({ name: item.name, pixel: item.points[0], place_m: item.place.map(Number) }));
    const unknowns = find("focal").checked ? [...UNKNOWNS, "focal"] : UNKNOWNS;
    this.link.ask("landmarks", { image: 0, landmarks, unknowns, use }, (answer) => {
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
    const values = Object.entries(parameters).map(([name, { value, std }]) => `${name} ${value.toFixed(3)} ± ${(1.96 * std).toPrecision(2)}`);
    const left = residuals.filter((each) => each.outlier).map((each) => each.name);
    return [file ? `Saved as ${file}, and measured with.` : "", `95 %: ${values.join(", ")}.`, `Residuals ${rms.toFixed(2)} px rms.`,
      left.length ? `Left out: ${left.join(", ")}.` : "", ...notes].filter(Boolean).join(" ");
  }

  shapes() {
    const residuals = new Map((this.found?.residuals || []).map((each) => [each.name, each]));
    return this.items.map((item) => {
      const residual = residuals.get(item.name);
      return { points: item.points, colour: residual?.outlier ? OUTLIER : GOOD,
        label: residual ? `${item.name} ${residual.px.toFixed(2)} px` : item.name };
    });
  }
}
