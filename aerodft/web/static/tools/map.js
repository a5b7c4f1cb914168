// @ts-check
// The view from above, north up, in metres of the station: what the image shows of the ground, the camera's way, the
// river's banks and what is measured; on a grid, and on the tiles of a server where one is configured.

import { isClosed } from "../measuring/marks.js";
import { converted, gridText } from "../measuring/words.js";
import { trace } from "../stage/picture.js";
import { niceStep } from "../time/plots.js";

const FOOTPRINT = "#56b4e944", TRACK = "#999999", CAMERA = "#d55e00", BANKS = "#f0e442", PROBE = "#cc79a7";
const EDGE_PX = 24, TILE_PX = 256, MOST_TILES = 64, DEEPEST = 19, EQUATOR_M = 40075016.68557849;

export class GroundMap {
  constructor(canvas, onTile) {
    this.canvas = canvas;
    this.onTile = onTile;
    this.template = null; // address of a tile, with {z}, {x} and {y}
    this.tiles = new Map(); // address: image
    this.track = []; // [[east, north]]
  }

  draw({ scene, marks, probes, banks, ink, units }) {
    const { canvas } = this, ratio = devicePixelRatio || 1, side = canvas.clientWidth;
    if (!side || !scene?.camera_enu_m) return;
    canvas.width = canvas.height = Math.round(side * ratio);
    const pen = this.pen = canvas.getContext("2d"), measured = marks.filter((mark) => mark.found?.enu_m);
    const seen = probes.filter((probe) => probe.enu_m && probe.status === "ok");
    const all = [scene.camera_enu_m, ...scene.footprint_enu_m, ...measured.flatMap((mark) => mark.found.enu_m)];
    const view = viewOf(all, side), at = ([east, north]) => [view.x(east), view.y(north)];
    pen.scale(ratio, ratio);
    pen.font = "13px system-ui, sans-serif";
    this.drawTiles(scene.geo, view);
    this.drawGrid(view, ink, units);
    this.line(scene.footprint_enu_m.map(at), { fill: FOOTPRINT, stroke: ink, closed: true });
    this.line(this.track.map(at), { stroke: TRACK });
    for (const bank of banks) this.line(bank.map(at), { stroke: BANKS, width: 3, halo: true });
    for (const { enu_m: points, kind } of seen) this.line(points.map(at), { stroke: PROBE, closed: isClosed(kind), width: 3, dots: true });
    for (const { found, colour, kind } of measured) this.line(found.enu_m.map(at), { stroke: colour, closed: isClosed(kind), width: 3, dots: true });
    this.drawCamera(at(scene.camera_enu_m), scene.heading_deg);
    this.drawNames([...seen.map(({ name, enu_m: [point] }) => [name, at(point)]), ...measured.map(({ name, found }) => [name, at(found.enu_m[0])])]);
    pen.fillStyle = ink;
    pen.fillText("N ↑", side - 34, 18);
  }

  /**
   * An arrow in the camera's direction.
   * @param {number[]} place
   * @param {number} headingDeg
   */
  drawCamera([x, y], headingDeg) {
    const turn = (headingDeg * Math.PI) / 180, [cos, sin] = [Math.cos(turn), Math.sin(turn)];
    const arrow = [[-6, 8], [0, -10], [6, 8]].map(([dx, dy]) => [x + dx * cos - dy * sin, y + dx * sin + dy * cos]);
    this.line(arrow, { fill: CAMERA, stroke: "#fff", width: 1, closed: true });
  }

  drawNames(names) { // beside their first points, none on another
    const { pen } = this, taken = [], side = this.canvas.clientWidth;
    pen.strokeStyle = "#000";
    pen.lineWidth = 3;
    for (const [name, [x, y]] of names) {
      const width = pen.measureText(name).width, left = Math.min(x + 8, side - width - 2);
      const base = [-6, 16, -22, 32].map((dy) => y + dy).find((each) => !taken.some(([l, w, b]) => left < l + w && l < left + width && Math.abs(each - b) < 15));
      if (base === undefined) continue;
      taken.push([left, width, base]);
      pen.strokeText(name, left, base);
      pen.fillStyle = "#fff";
      pen.fillText(name, left, base);
    }
  }

  drawGrid({ x, y, west, east, south, north, side }, ink, units) {
    const { pen } = this, [factor] = converted(1, "m", units), step = niceStep((factor * (east - west)) / 7) / factor;
    pen.strokeStyle = ink;
    pen.globalAlpha = 0.25;
    pen.lineWidth = 1;
    pen.beginPath();
    for (let k = Math.ceil(west / step); k * step < east; k += 1) { pen.moveTo(x(k * step), 0); pen.lineTo(x(k * step), side); }
    for (let k = Math.ceil(south / step); k * step < north; k += 1) { pen.moveTo(0, y(k * step)); pen.lineTo(side, y(k * step)); }
    pen.stroke();
    pen.globalAlpha = 1;
    pen.fillStyle = ink;
    pen.fillText(`a square is ${gridText({ at_m: step, axis: "" }, units).replace(" ahead", "")}`, 6, side - 6);
  }

  drawTiles(geo, { x, y, west, east, south, north, scale }) { // Web Mercator, straightened to metres around the camera
    if (!this.template || !geo) return;
    const { lat_deg: lat, lon_deg: lon, east_m: east0, north_m: north0, metres_per_deg: [perLon, perLat] } = geo;
    const lonAt = (metres) => lon + (metres - east0) / perLon, latAt = (metres) => lat + (metres - north0) / perLat;
    const finest = Math.log2((EQUATOR_M * Math.cos((lat * Math.PI) / 180) * scale) / TILE_PX);
    for (let zoom = Math.min(Math.max(Math.round(finest), 0), DEEPEST); zoom >= 0; zoom -= 1) {
      const [left, right] = [lonAt(west), lonAt(east)].map((each) => Math.floor(column(each, zoom)));
      const [top, bottom] = [latAt(north), latAt(south)].map((each) => Math.floor(row(each, zoom)));
      if ((right - left + 1) * (bottom - top + 1) > MOST_TILES) continue;
      const px = (col) => x(east0 + (lonOf(col, zoom) - lon) * perLon), py = (line) => y(north0 + (latOf(line, zoom) - lat) * perLat);
      for (let col = left; col <= right; col += 1) {
        for (let line = top; line <= bottom; line += 1) {
          const tile = this.tile(zoom, col, line);
          if (tile.naturalWidth) this.pen.drawImage(tile, px(col), py(line), px(col + 1) - px(col), py(line + 1) - py(line));
        }
      }
      return;
    }
  }

  tile(zoom, col, line) {
    const address = this.template.replace("{z}", zoom).replace("{x}", col).replace("{y}", line);
    if (!this.tiles.has(address)) {
      const image = new Image();
      image.referrerPolicy = "origin"; // some servers want to know who asks
      image.onload = this.onTile;
      image.src = address;
      this.tiles.set(address, image);
    }
    return this.tiles.get(address);
  }

  /**
   * @param {number[][]} points
   * @param {{ fill?: string, stroke: string, closed?: boolean, width?: number, dots?: boolean, halo?: boolean }} look
   */
  line(points, { fill, stroke, closed, width = 1.5, dots, halo }) {
    const { pen } = this;
    if (!points.length) return;
    trace(pen, points, closed);
    if (fill) { pen.fillStyle = fill; pen.fill(); }
    for (const [paint, wide] of [...(halo ? [["#000", width + 2]] : []), [stroke, width]]) { pen.strokeStyle = paint; pen.lineWidth = wide; pen.stroke(); }
    pen.fillStyle = stroke;
    for (const [x, y] of dots ? points : []) { pen.beginPath(); pen.arc(x, y, 4, 0, 2 * Math.PI); pen.fill(); }
  }
}

function viewOf(points, side) { // a square that holds all points, with how metres become pixels
  const [[west, east], [south, north]] = [0, 1].map((axis) => {
    const values = points.map((each) => each[axis]);
    return [Math.min(...values), Math.max(...values)];
  });
  const wide = Math.max(east - west, north - south, 1), scale = (side - 2 * EDGE_PX) / wide, half = side / 2 / scale;
  const [middleEast, middleNorth] = [(west + east) / 2, (south + north) / 2];
  return {
    side, scale, west: middleEast - half, east: middleEast + half, south: middleNorth - half, north: middleNorth + half,
    x: (metres) => side / 2 + (metres - middleEast) * scale, y: (metres) => side / 2 - (metres - middleNorth) * scale,
  };
}

const column = (lonDeg, zoom) => ((lonDeg + 180) / 360) * 2 ** zoom;
const row = (latDeg, zoom) => (0.5 - Math.asinh(Math.tan((latDeg * Math.PI) / 180)) / (2 * Math.PI)) * 2 ** zoom;
const lonOf = (col, zoom) => (col / 2 ** zoom) * 360 - 180;
const latOf = (line, zoom) => (Math.atan(Math.sinh(Math.PI * (1 - (2 * line) / 2 ** zoom))) * 180) / Math.PI;
