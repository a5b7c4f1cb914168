// @ts-check
// What people measure: marks in the image, the one that is being made, and their numbers.

import { MEASURES } from "../tools.js";
import { endsOf, heightsOf, labelText, quality, samplingText, valueText } from "./words.js";

/** @type {Record<string, { help: string, least: number, most: number, closed: boolean }>} */
export const KINDS = {};

/**
 * Learn all that the program measures; returns the names of kinds without a button.
 * @param {Record<string, { least: number, most: number, closed: boolean }>} known
 */
export function learnKinds(known) {
  for (const [name, { least, most, closed }] of Object.entries(known)) {
    const help = most > least ? `Click ${least} to ${most} points; a double-click ends it.` : `Click ${least} ${least > 1 ? "points" : "point"}.`;
    KINDS[name] = { help: MEASURES[name]?.help ?? help, least, most, closed };
  }
  return Object.keys(known).filter((name) => !MEASURES[name]);
}

export const isClosed = (name) => Boolean(KINDS[name]?.closed);

export const COLOURS = ["#56b4e9", "#e69f00", "#009e73", "#f0e442", "#cc79a7", "#d55e00"]; // Okabe and Ito
const DRAFT = "#fff", VERTICAL = "#f0e442";

export class Marks {
  constructor(link, changed) {
    this.link = link;
    this.changed = changed;
    this.items = []; // { name, kind, points, heights: as typed, colour, found: its measurement, before: what it was }
    this.draft = []; // points of the mark that is being made
    this.vertical = []; // the line that stands on the base of a height
    this.kind = "width";
    this.image = 0;
    this.measured = null; // number of the image that the numbers are of
    this.selected = null;
    this.made = 0;
  }

  get state() {
    return { items: this.items.map((mark) => ({ ...mark, found: null, before: null })), draft: this.draft };
  }

  set state({ items, draft }) {
    Object.assign(this, { items, draft, vertical: [] });
    this.measure();
  }

  get current() {
    return this.items.find((mark) => mark === this.selected) || this.items.at(-1);
  }

  get canEnd() {
    const { least, most } = KINDS[this.kind];
    return most > least && this.draft.length >= least;
  }

  choose(kind) {
    Object.assign(this, { kind, draft: [], vertical: [] });
  }

  // ---- making and changing

  place(pixel) {
    const last = this.draft.at(-1);
    if (last && last[0] === pixel[0] && last[1] === pixel[1]) return; // the second click of a double-click
    this.draft.push(pixel);
    if (this.draft.length === KINDS[this.kind].most) this.end();
  }

  end() {
    if (this.draft.length < KINDS[this.kind].least) return;
    this.made += 1;
    const mark = { kind: this.kind, points: this.draft, colour: COLOURS[(this.made - 1) % COLOURS.length], found: null };
    mark.name = this.freeName();
    this.items.push(mark);
    Object.assign(this, { selected: mark, draft: [], vertical: [] });
    this.measure();
  }

  freeName() {
    const isTaken = (name) => this.items.some((mark) => mark.name === name);
    let number = 1;
    while (isTaken(`${this.kind}-${number}`)) number += 1;
    return `${this.kind}-${number}`;
  }

  moved() {
    this.measure();
  }

  rename(mark, wanted) { // where the name can be one
    const name = wanted.trim().replace(/\s+/g, "-");
    if (name && !this.items.some((each) => each !== mark && each.name === name)) mark.name = name;
    this.measure();
  }

  remove(mark) {
    this.items = this.items.filter((each) => each !== mark);
    this.changed();
  }

  // ---- numbers

  measure(image = this.image) {
    this.image = image;
    this.changed();
    if (!this.items.length) return;
    const asked = this.items, probes = asked.map(probeOf);
    this.link.ask("marks", { image, probes, budget: true }, (answer) => {
      asked.forEach((mark, index) => { mark.found = answer.measurements?.[index] || refusal(answer.error); });
      this.measured = image;
      this.changed();
    });
  }

  follow(pointer, hasSampling, units, say) { // what would be measured if the next point were where the pointer is
    const { least, most } = KINDS[this.kind], points = this.draft.length < most ? [...this.draft, pointer] : this.draft;
    const isWhole = points.length >= least;
    const probe = isWhole ? { kind: this.kind, pixels: points } : { kind: "position", pixels: [pointer] };
    const vertical = this.kind === "height" && this.draft.length === 1;
    const question = { image: this.image, probes: [probe], vertical, sampling: hasSampling };
    this.link.ask("pointer", question, (answer) => {
      if (answer.error) return say(answer.error, "refused");
      const [found] = answer.measurements, isWorthSaying = isWhole || found.status !== "ok" || !this.draft.length;
      const lines = [isWorthSaying ? valueText(found, units) : "", samplingText(answer.sampling_m, units)];
      this.vertical = answer.vertical || [];
      say(lines.filter(Boolean).join("\n"), quality(found));
    });
  }

  shapes(pointer, units) {
    const open = pointer && this.draft.length ? [...this.draft, pointer] : this.draft;
    return [
      ...this.items.map((mark) => ({
        points: mark.points, colour: mark.colour, closed: isClosed(mark.kind),
        label: mark.found ? labelText({ ...mark.found, name: mark.name }, units) : "",
      })),
      { points: open, colour: DRAFT, closed: isClosed(this.kind) && open.length > 2 },
      { points: this.vertical, colour: VERTICAL, style: "dashed" },
    ];
  }
}

export const probeOf = (mark) => ({ kind: mark.kind, pixels: endsOf(mark), name: mark.name, ...heightsOf(mark) });

const refusal = (text) => ({ status: "", reasons: [text], value: null, pixels: [] });
