// @ts-check
// The river in the image: its water, banks and transects, and the strokes that say what is water and what is land.

import { lengthText, reachText } from "../measuring/words.js";

const BANKS = "#f0e442", ACROSS = "#ffffff", WATER = "#0072b2", LAND = "#d55e00", FOUND = "#56b4e955", BAND = "#56b4e966";
const MOST_POINTS = 256, STEP_PX = 3, LEFT_PX = 64, FOOT_PX = 22;
const NOTHING = { banks: {}, water: [], transects: [], banks_enu_m: [], width_m: null };

export class RiverLayer {
  constructor(link, changed) {
    this.link = link;
    this.changed = changed;
    this.isShown = false;
    this.image = 0;
    this.side = "water"; // what is drawn
    this.items = []; // strokes are drawn anew, not dragged
    this.forget();
  }

  get state() {
    return { strokes: this.strokes, hinted: this.hinted };
  }

  set state({ strokes, hinted }) {
    const hasChanged = JSON.stringify(strokes) !== JSON.stringify(this.strokes);
    Object.assign(this, { strokes, hinted });
    if (hasChanged) this.look();
  }

  forget() {
    this.strokes = { water: [], land: [] };
    this.hinted = null; // number of the image that the strokes are of
    this.found = null;
  }

  look(image = this.image) {
    this.image = image;
    if (!this.isShown) return;
    const river = { ...this.strokes, ...(this.hinted === null ? {} : { image: this.hinted }) };
    this.link.ask("river", { image, river }, (answer) => {
      this.found = { ...NOTHING, ...(answer.river || { status: "error", reasons: [answer.error] }) };
      this.changed();
    });
  }

  // ---- strokes

  begin(pixel) {
    if (this.hinted !== this.image) this.forget();
    this.hinted = this.image;
    this.strokes[this.side].push([pixel]);
    this.changed();
  }

  go(pixel) {
    const stroke = this.strokes[this.side].at(-1), last = stroke.at(-1);
    if (stroke.length < MOST_POINTS && Math.hypot(pixel[0] - last[0], pixel[1] - last[1]) > STEP_PX) stroke.push(pixel);
    this.changed();
  }

  end() {
    this.look();
  }

  // ---- what is seen of it

  get transects() {
    return (this.found?.transects || []).filter((each) => each.width_m !== null);
  }

  shapes() {
    if (!this.isShown) return [];
    const strokes = this.image === this.hinted ? Object.entries(this.strokes).flatMap(([side, lines]) =>
      lines.map((points) => ({ points, colour: side === "water" ? WATER : LAND, style: points.length > 1 ? "line" : "mark" }))) : [];
    const { water, banks } = this.found || NOTHING;
    return [
      { rings: water, colour: FOUND, style: "fill" },
      ...this.transects.map((each) => ({ points: [each.left, each.right], colour: ACROSS, style: "thin" })),
      ...Object.values(banks).map((points) => ({ points, colour: BANKS, style: "line" })),
      ...strokes,
    ];
  }

  get reasons() {
    return this.found?.width_m ? this.found.reasons : [];
  }

  text(units) {
    if (!this.found) return "Looking for banks …";
    const isCarried = this.hinted !== null && this.hinted !== this.image;
    return reachText(this.found, units) + (isCarried ? ` With the strokes of image ${this.hinted + 1}, carried to this one.` : "");
  }

  drawProfile(canvas, ink, units) {
    const ratio = devicePixelRatio || 1, rows = this.transects;
    canvas.hidden = rows.length < 2; // before its size is asked for: hidden it has none
    const { clientWidth: wide, clientHeight: tall } = canvas;
    if (canvas.hidden || !wide) return;
    canvas.width = Math.round(wide * ratio);
    canvas.height = Math.round(tall * ratio);
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    const high = Math.max(...rows.map((each) => each.ci95[1])), low = Math.min(...rows.map((each) => each.ci95[0]));
    const first = rows[0].station_m, last = rows.at(-1).station_m;
    const x = (each) => LEFT_PX + ((each.station_m - first) / (last - first)) * (wide - LEFT_PX - 8);
    const y = (width) => 8 + ((high - width) / (high - low || 1)) * (tall - FOOT_PX - 16);
    pen.fillStyle = BAND;
    pen.beginPath();
    rows.forEach((each) => pen.lineTo(x(each), y(each.ci95[1])));
    [...rows].reverse().forEach((each) => pen.lineTo(x(each), y(each.ci95[0])));
    pen.fill();
    pen.strokeStyle = pen.fillStyle = ink;
    pen.lineWidth = 2;
    pen.beginPath();
    rows.forEach((each) => pen.lineTo(x(each), y(each.width_m)));
    pen.stroke();
    pen.font = "13px system-ui, sans-serif";
    pen.fillText(lengthText(high, units, high - low), 0, 18);
    pen.fillText(lengthText(low, units, high - low), 0, tall - FOOT_PX - 6);
    pen.fillText(`95 % band; ${lengthText(last - first, units, last - first)} along the river`, LEFT_PX, tall - 5);
  }
}
