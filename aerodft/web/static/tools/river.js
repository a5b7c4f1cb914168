// The river in the image: banks and transects, and the strokes that say what is water and what is land.

const BANKS = "#f0e442", ACROSS = "#56b4e9", WATER = "#0072b2", LAND = "#d55e00";

export class RiverLayer {
  constructor(link, changed) {
    this.link = link;
    this.changed = changed;
    this.isShown = false;
    this.forget();
  }

  forget() {
    this.strokes = { water: [], land: [] };
    this.hinted = null; // number of the image that the strokes are of
    this.found = null;
  }

  look(image) {
    if (!this.isShown) return;
    const river = { ...this.strokes, ...(this.hinted === null ? {} : { image: this.hinted }) };
    this.link.ask("river", { image, river }, (answer) => {
      this.found = answer.river || { status: "error", reasons: [answer.error], banks: {}, transects: [], width_m: null };
      this.changed();
    });
  }

  begin(side, image, pixel) {
    if (this.hinted !== image) this.forget();
    this.hinted = image;
    this.strokes[side].push([pixel]);
  }

  go(side, pixel) {
    const stroke = this.strokes[side].at(-1), last = stroke.at(-1);
    if (stroke.length < 256 && Math.hypot(pixel[0] - last[0], pixel[1] - last[1]) > 3) stroke.push(pixel);
  }

  shapes(image) {
    if (!this.isShown) return [];
    const found = this.found ? [
      ...this.found.transects.filter((each) => each.width_m !== null).map((each) => ({ points: [each.left, each.right], colour: ACROSS, plain: true })),
      ...Object.values(this.found.banks).map((line) => ({ points: line, colour: BANKS, plain: true })),
    ] : [];
    const strokes = image === this.hinted ? Object.entries(this.strokes).flatMap(([side, lines]) =>
      lines.map((points) => ({ points, colour: side === "water" ? WATER : LAND, plain: points.length > 1 }))) : [];
    return [...found, ...strokes];
  }

  drawProfile(canvas, ink) {
    const pen = canvas.getContext("2d"), rows = (this.found?.transects || []).filter((each) => each.width_m !== null);
    pen.clearRect(0, 0, canvas.width, canvas.height);
    if (rows.length < 2) return;
    const high = Math.max(...rows.map((each) => each.ci95[1])), low = Math.min(...rows.map((each) => each.ci95[0]));
    const first = rows[0].station_m, last = rows.at(-1).station_m;
    const x = (each) => 40 + ((each.station_m - first) / (last - first)) * (canvas.width - 48);
    const y = (width) => 12 + ((high - width) / (high - low || 1)) * (canvas.height - 36);
    pen.fillStyle = "#56b4e966";
    pen.beginPath();
    rows.forEach((each) => pen.lineTo(x(each), y(each.ci95[1])));
    [...rows].reverse().forEach((each) => pen.lineTo(x(each), y(each.ci95[0])));
    pen.fill();
    pen.strokeStyle = pen.fillStyle = ink;
    pen.beginPath();
    rows.forEach((each) => pen.lineTo(x(each), y(each.width_m)));
    pen.stroke();
    pen.font = "12px system-ui, sans-serif";
    pen.fillText(`${high.toFixed(1)} m`, 0, 16);
    pen.fillText(`${low.toFixed(1)} m`, 0, canvas.height - 24);
    pen.fillText(`${(last - first).toFixed(0)} m along the river`, 40, canvas.height - 4);
  }
}
