// @ts-check
// What helps to read the image: the horizon, a grid of metres on the ground, and the values of the station's probes.

import { isClosed } from "../measuring/marks.js";
import { gridText, labelText } from "../measuring/words.js";

const HORIZON = "#d55e00", GRID = "#ffffff", PROBE = "#cc79a7";

export class OverlayLayer {
  constructor(link, changed) {
    this.link = link;
    this.changed = changed;
    this.isShown = false;
    this.scene = null; // horizon, grid, footprint: of the image that is shown
    this.seen = null; // pose and measurements of the station's probes
  }

  look(image) {
    this.link.ask("overlay", { image, overlay: true }, (answer) => {
      this.scene = answer.overlay || null;
      this.changed();
    });
  }

  get probes() {
    return this.seen?.measurements || [];
  }

  shapes(units) {
    const probes = this.probes.filter((each) => each.pixels.length).map((each) => ({
      points: each.pixels.filter(([u, v]) => u !== null && v !== null), colour: PROBE, closed: isClosed(each.kind),
      label: labelText(each, units),
    }));
    return this.isShown && this.scene ? [...gridShapes(this.scene, units), ...probes] : probes;
  }
}

export function gridShapes({ grid, horizon }, units) {
  return [
    ...grid.map((line) => ({ points: line.pixels, colour: GRID, style: "thin", tag: gridText(line, units) })),
    ...horizon.map((points) => ({ points, colour: HORIZON, style: "line" })),
  ];
}
