// @ts-check
// The list of what is measured, and of the selected one where its uncertainty comes from, and how it is taken along.

import { element, fillList, find, targetOf } from "../elements.js";
import { COLOURS, probeOf } from "./marks.js";
import { copyText, plain, quality, QUALITY_WORDS, stdText, valueText } from "./words.js";

const LEAST_SHARE = 0.01, HEIGHTS = { heights: "elevation_m", "heights-std": "elevation_std_m" };
const inputOf = (id) => /** @type {HTMLInputElement} */ (find(id));

export class Panel {
  constructor(marks, history, link) {
    this.marks = marks;
    this.history = history;
    this.link = link;
    this.rows = new Map(); // mark: its row, made once, so that nothing moves under a finger
    find("copies").onclick = (event) => this.copy(targetOf(event).dataset.copy);
    find("saving").onclick = (event) => this.save(targetOf(event).dataset.save);
    for (const [id, key] of Object.entries(HEIGHTS)) inputOf(id).onchange = () => this.raise(key, inputOf(id).value);
  }

  draw(units, probes) {
    const { items, current } = this.marks;
    this.units = units;
    for (const mark of this.rows.keys()) if (!items.includes(mark)) this.rows.delete(mark);
    for (const mark of items) if (!this.rows.has(mark)) this.rows.set(mark, this.row(mark));
    const rows = items.map((mark) => this.rows.get(mark).row), list = find("measurements");
    if (rows.length !== list.children.length || rows.some((row, at) => row !== list.children[at])) list.replaceChildren(...rows);
    for (const mark of items) this.fill(mark, mark === current);
    this.detail(current);
    find("copies").ariaBusy = String(this.marks.measured !== this.marks.image); // numbers of the image before
    this.showProbes(probes);
  }

  showProbes(probes) { // of the station, as it published them
    const box = find("probes");
    box.hidden = !probes.length;
    fillList(box.querySelector("ul"), probes.map((probe) => `${probe.name}: ${valueText(probe, this.units)}`));
  }

  row(mark) {
    const row = element("li"), rename = () => { this.history.keep(); this.marks.rename(mark, name.value); name.blur(); };
    const name = element("input", "", { maxLength: 64, ariaLabel: "Name", onchange: rename });
    const value = element("button", "", { className: "value", onclick: () => { this.marks.selected = mark; this.marks.changed(); } });
    const remove = element("button", "✕", { onclick: () => { this.history.keep(); this.marks.remove(mark); } });
    row.style.borderColor = mark.colour;
    row.append(name, value, remove);
    return { row, name, value, remove };
  }

  fill(mark, isCurrent) {
    const { row, name, value, remove } = this.rows.get(mark), { found, before } = mark;
    row.setAttribute("aria-current", String(isCurrent));
    if (document.activeElement !== name) name.value = mark.name;
    remove.ariaLabel = `Delete ${mark.name}`;
    const was = before?.value && before.value !== found?.value ? ` (before: ${valueText(before, this.units)})` : "";
    const text = found ? valueText(found, this.units) + was : "…";
    if (value.dataset.text === text) return;
    value.dataset.text = text;
    value.className = `value ${found ? quality(found) : ""}`;
    value.title = found ? QUALITY_WORDS[quality(found)] : "";
    const end = text.search(/ \[|: /), [head, rest] = end < 0 ? [text, ""] : [text.slice(0, end), text.slice(end)];
    value.replaceChildren(element("b", head), element("span", rest));
  }

  raise(key, text) { // the selected mark's points
    this.history.keep();
    this.marks.current.heights = { ...this.marks.current.heights, [key]: text };
    this.marks.measure();
  }

  detail(mark) {
    const found = mark?.found;
    find("details").hidden = !found;
    if (!found) return;
    for (const [id, key] of Object.entries(HEIGHTS)) if (document.activeElement !== inputOf(id)) inputOf(id).value = mark.heights?.[key] || "";
    const parts = (found.budget || []).map((part, at) => ({ ...part, colour: COLOURS[at % COLOURS.length] }));
    find("budget").replaceChildren(...parts.map(({ share, colour }) => {
      const bar = element("span");
      Object.assign(bar.style, { flex: String(share), background: colour });
      return bar;
    }));
    find("shares").replaceChildren(...parts.filter(({ share }) => share >= LEAST_SHARE).map(({ source, share, std, colour }) => {
      const line = element("span"), swatch = element("i");
      swatch.style.background = colour;
      line.append(swatch, `${source} ${(100 * share).toFixed(0)} % (${stdText(std, found.unit, this.units)})`);
      return line;
    }));
    find("advice").textContent = found.advice || "";
    fillList(find("reasons"), found.reasons.map(plain));
  }

  async copy(form) {
    const mark = this.marks.current, box = find("copied");
    if (!form || !mark?.found) return;
    box.hidden = false;
    box.value = copyText(form, mark, this.units);
    box.select();
    await navigator.clipboard?.writeText(box.value).catch(() => {}); // the text stands there, selected, all the same
  }

  save(how) {
    const mark = this.marks.current;
    if (!how || !mark) return;
    this.link.ask("save", { image: this.marks.image, save: probeOf(mark), tracked: how === "tracked" }, (answer) => {
      find("saved").textContent = answer.error ? plain(answer.error) : `In ${answer.file}: measured from the station's next start on.`;
    });
  }
}
