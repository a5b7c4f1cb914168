// What helps to read the image: the horizon, a grid of metres on the ground, and the values of the station's probes.

import { valueText } from "../measuring/words.js";

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

  shapes(units) {
    const probes = (this.seen?.measurements || []).filter((each) => each.pixels.length).map((each) => ({
      points: each.pixels.filter(([u, v]) => u !== null && v !== null), colour: PROBE, closed: each.kind === "area",
      label: each.status === "ok" && each.value !== null ? `${each.name} ${valueText(each, units)}` : "",
    }));
    if (!this.isShown || !this.scene) return probes;
    const grid = this.scene.grid.map((each) => ({ points: each.pixels, colour: GRID, thin: true, tag: each.label }));
    return [...grid, ...this.scene.horizon.map((points) => ({ points, colour: HORIZON, plain: true })), ...probes];
  }
}
