// The view from above, in metres of the station: what the image shows of the ground, the camera's way, and what is measured.

const FOOTPRINT = "#56b4e955", TRACK = "#999999", CAMERA = "#d55e00", EDGE_PX = 24;

export class GroundMap {
  constructor(canvas) {
    this.canvas = canvas;
    this.track = []; // [[east, north]]
  }

  draw(scene, marks, ink) {
    const { canvas } = this, ratio = devicePixelRatio || 1, side = canvas.clientWidth;
    if (!side || !scene?.camera_enu_m) return;
    canvas.width = Math.round(side * ratio);
    canvas.height = Math.round(side * ratio);
    const pen = canvas.getContext("2d"), measured = marks.filter((each) => each.found?.enu_m);
    const all = [scene.camera_enu_m, ...scene.footprint_enu_m, ...measured.flatMap((each) => each.found.enu_m)];
    const [west, east] = extent(all, 0), [south, north] = extent(all, 1), wide = Math.max(east - west, north - south, 1);
    const scale = (side - 2 * EDGE_PX) / wide, at = ([x, y]) => [EDGE_PX + (x - (west + east - wide) / 2) * scale, side - EDGE_PX - (y - (south + north - wide) / 2) * scale];
    pen.scale(ratio, ratio);
    pen.font = "13px system-ui, sans-serif";
    this.drawGrid(pen, at, [west, east, south, north, wide], side, ink);
    line(pen, scene.footprint_enu_m.map(at), { fill: FOOTPRINT, stroke: ink, closed: true });
    line(pen, this.track.map(at), { stroke: TRACK });
    for (const { found, colour, kind } of measured) line(pen, found.enu_m.map(at), { stroke: colour, closed: kind === "area", width: 3, dots: true });
    const [x, y] = at(scene.camera_enu_m), turn = (scene.heading_deg * Math.PI) / 180;
    line(pen, [[-6, 8], [0, -10], [6, 8]].map(([dx, dy]) => [x + dx * Math.cos(turn) - dy * Math.sin(turn), y + dx * Math.sin(turn) + dy * Math.cos(turn)]), { fill: CAMERA, closed: true });
    pen.fillStyle = ink;
    pen.fillText("N ↑", side - 34, 18);
  }

  drawGrid(pen, at, [west, east, south, north, wide], side, ink) {
    const power = 10 ** Math.floor(Math.log10(wide / 4)), step = [1, 2, 5, 10].map((each) => each * power).find((each) => each >= wide / 6);
    pen.strokeStyle = `${ink}`;
    pen.globalAlpha = 0.25;
    pen.lineWidth = 1;
    pen.beginPath();
    for (let k = Math.ceil((west - wide) / step); k * step < east + wide; k += 1) { const [x] = at([k * step, 0]); pen.moveTo(x, 0); pen.lineTo(x, side); }
    for (let k = Math.ceil((south - wide) / step); k * step < north + wide; k += 1) { const [, y] = at([0, k * step]); pen.moveTo(0, y); pen.lineTo(side, y); }
    pen.stroke();
    pen.globalAlpha = 1;
    pen.fillStyle = ink;
    pen.fillText(`a square is ${step} m`, 6, side - 6);
  }
}

function extent(points, axis) {
  const values = points.map((each) => each[axis]);
  return [Math.min(...values), Math.max(...values)];
}

function line(pen, points, { fill, stroke, closed, width = 1.5, dots }) {
  if (!points.length) return;
  pen.beginPath();
  points.forEach(([x, y]) => pen.lineTo(x, y));
  if (closed) pen.closePath();
  if (fill) { pen.fillStyle = fill; pen.fill(); }
  if (stroke) { pen.strokeStyle = stroke; pen.lineWidth = width; pen.stroke(); }
  if (dots) for (const [x, y] of points) { pen.fillStyle = stroke; pen.beginPath(); pen.arc(x, y, 4, 0, 7); pen.fill(); }
}
