// @ts-check
// The image on a canvas, zoomed and moved. Pixel (0, 0) is the middle of the top-left pixel, as everywhere in aerodft.
//
// A shape is { points: [[u, v]], colour, style, closed, label, tag }. Its style is "mark" (a line and its points, as people
// click them), "line", "arrow", "dashed", "thin" (a line of the grid, with its tag) or "fill" (of rings, what is within two is left out).

const POINT_PX = 7, HEAD_PX = 7, LOUPE_ZOOM = 8, LABEL_PX = 22, LABEL_TOPS = [-34, 12, -58, 36, -82, 60], EDGE_PX = 40, NARROW_PX = 500;
const HALO = "#000", CIRCLE = 2 * Math.PI;

export class Picture {
  constructor(canvas, loupe) {
    this.canvas = canvas;
    this.loupe = loupe;
    this.pen = canvas.getContext("2d");
    this.bitmap = null;
    this.scale = 1;
    this.left = 0;
    this.top = 0;
    /** @type {Shape[]} */
    this.shapes = [];
    new ResizeObserver(() => this.resized()).observe(canvas);
  }

  show(bitmap) {
    const isFirst = !this.bitmap || this.bitmap.width !== bitmap.width || this.bitmap.height !== bitmap.height;
    this.bitmap?.close?.();
    this.bitmap = bitmap;
    this.canvas.parentElement.style.aspectRatio = `${bitmap.width} / ${bitmap.height}`;
    if (isFirst) this.fit();
    this.draw();
  }

  blank(width, height) { // a station whose images have no picture is measured in all the same
    const canvas = new OffscreenCanvas(width, height);
    canvas.getContext("2d").fillRect(0, 0, width, height);
    this.show(canvas);
  }

  // ---- where it is on the screen

  resized() {
    const ratio = devicePixelRatio || 1;
    this.canvas.width = Math.max(1, Math.round(this.canvas.clientWidth * ratio));
    this.canvas.height = Math.max(1, Math.round(this.canvas.clientHeight * ratio));
    if (this.bitmap && !this.isMoved) this.fit();
    this.draw();
  }

  fit() {
    const { width, height } = this.bitmap, { clientWidth, clientHeight } = this.canvas;
    this.scale = Math.min(clientWidth / width, clientHeight / height) || 1;
    this.left = (clientWidth - width * this.scale) / 2;
    this.top = (clientHeight - height * this.scale) / 2;
    this.isMoved = false;
    this.draw();
  }

  zoom(factor, x, y) {
    const scale = Math.min(Math.max(this.scale * factor, 0.02), 64);
    this.left = x - ((x - this.left) * scale) / this.scale;
    this.top = y - ((y - this.top) * scale) / this.scale;
    this.scale = scale;
    this.isMoved = true;
    this.draw();
  }

  move(dx, dy) {
    this.left += dx;
    this.top += dy;
    this.isMoved = true;
    this.draw();
  }

  reveal(pixel) { // a pixel that keys went to
    const [x, y] = this.screenAt(pixel), { clientWidth, clientHeight } = this.canvas;
    const dx = within(x, EDGE_PX, clientWidth - EDGE_PX) - x, dy = within(y, EDGE_PX, clientHeight - EDGE_PX) - y;
    if (dx || dy) this.move(dx, dy);
  }

  pixelAt(x, y) { // hundredths are finer than anybody clicks, and read the same in every program
    const round = (value) => Math.round(value * 100) / 100;
    return [round((x - this.left) / this.scale - 0.5), round((y - this.top) / this.scale - 0.5)];
  }

  screenAt([u, v]) {
    return [(u + 0.5) * this.scale + this.left, (v + 0.5) * this.scale + this.top];
  }

  // ---- drawing

  draw() {
    const { pen, canvas, bitmap } = this, ratio = devicePixelRatio || 1;
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, canvas.width, canvas.height);
    if (!bitmap) return;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.imageSmoothingEnabled = this.scale < 3;
    pen.drawImage(bitmap, this.left, this.top, bitmap.width * this.scale, bitmap.height * this.scale);
    const onScreen = (points) => points.map((point) => this.screenAt(point));
    const drawn = this.shapes.map((shape) => ({ ...shape, at: onScreen(shape.points || []), rings: (shape.rings || []).map(onScreen) }))
      .filter(({ at, rings }) => at.length || rings.length);
    for (const shape of drawn) this.drawShape(shape);
    const marked = drawn.filter(({ style = "mark" }) => style === "mark").flatMap(({ at }) => at.map(pointBox)), taken = [];
    for (const { at, label, colour } of [...drawn].reverse()) if (label) this.drawLabel(at, label, colour, marked, taken);
    for (const { at, tag, colour } of drawn) if (tag) this.drawTag(at[0], tag, colour, taken);
  }

  /** @param {Shape & { at: Pixel[], rings: Pixel[][] }} shape With its points and rings on the screen. */
  drawShape({ at, rings, colour, style = "mark", closed }) {
    if (style === "fill") this.fill(rings, colour);
    else if (style === "thin") this.stroke(at, colour, { width: 1, alpha: 0.6, closed });
    else {
      const dash = style === "dashed" ? [6, 6] : [];
      for (const [paint, width] of [[HALO, 5], [colour, 2.5]]) {
        this.stroke(at, paint, { width, dash, closed });
        if (style === "mark") for (const point of at) this.drawPoint(point);
        if (style === "arrow") this.drawHead(at);
      }
    }
  }

  fill(rings, colour) {
    const { pen } = this, path = new Path2D();
    for (const [[x0, y0], ...rest] of rings) {
      path.moveTo(x0, y0);
      for (const [x, y] of rest) path.lineTo(x, y);
      path.closePath();
    }
    pen.fillStyle = colour;
    pen.fill(path, "evenodd");
  }

  stroke(at, colour, { width, dash = [], alpha = 1, closed = false }) {
    const { pen } = this;
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.globalAlpha = alpha;
    pen.setLineDash(dash);
    trace(pen, at, closed);
    pen.stroke();
    pen.setLineDash([]);
    pen.globalAlpha = 1;
  }

  drawPoint([x, y]) {
    const { pen } = this;
    pen.beginPath();
    pen.arc(x, y, POINT_PX, 0, CIRCLE);
    pen.moveTo(x - 2, y);
    pen.lineTo(x + 2, y);
    pen.moveTo(x, y - 2);
    pen.lineTo(x, y + 2);
    pen.stroke();
  }

  /** @param {Pixel[]} at Both ends of an arrow; its head is drawn where the arrow is longer. */
  drawHead([[x0, y0], [x, y]]) {
    const { pen } = this, long = Math.hypot(x - x0, y - y0), [dx, dy] = [(x - x0) / long, (y - y0) / long].map((each) => each * HEAD_PX);
    if (long < HEAD_PX) return;
    trace(pen, [[x - dx - dy / 2, y - dy + dx / 2], [x, y], [x - dx + dy / 2, y - dy - dx / 2]]);
    pen.stroke();
  }

  drawLabel(at, label, colour, marked, taken) { // above or below the middle of its shape, on no other text, and on no point if it can
    const { pen, canvas } = this, [x, y] = mean(at), text = canvas.clientWidth < NARROW_PX ? label.split(" [")[0] : label;
    pen.font = "bold 15px system-ui, sans-serif";
    const width = pen.measureText(text).width + 15, left = within(x - width / 2, 2, canvas.clientWidth - width - 2);
    const boxes = LABEL_TOPS.map((dy) => ({ left, width, height: LABEL_PX, top: within(y + dy, 2, canvas.clientHeight - LABEL_PX - 2) }));
    const free = boxes.filter((each) => !hides(each, taken)), box = free.find((each) => !hides(each, marked)) || free[0];
    if (!box) return; // its value stands in the list
    taken.push(box);
    pen.fillStyle = "#000c";
    pen.fillRect(left, box.top, width, LABEL_PX);
    pen.fillStyle = colour;
    pen.fillRect(left, box.top, 4, LABEL_PX);
    pen.fillStyle = "#fff";
    pen.fillText(text, left + 9, box.top + 16);
  }

  drawTag([x, y], text, colour, taken) { // where there is room
    const { pen, canvas } = this;
    pen.font = "12px system-ui, sans-serif";
    const width = pen.measureText(text).width, left = within(x + 4, 2, canvas.clientWidth - width - 2);
    const base = within(y - 4, 12, canvas.clientHeight - 4), box = { left, width, top: base - 12, height: 16 };
    if (hides(box, taken)) return;
    taken.push(box);
    for (const [paint, shift] of [[HALO, 1], [colour, 0]]) {
      pen.fillStyle = paint;
      pen.fillText(text, left + shift, base + shift);
    }
  }

  drawLoupe(pixel) {
    const { loupe, bitmap } = this;
    loupe.hidden = !pixel || !bitmap;
    if (loupe.hidden) return;
    const pen = loupe.getContext("2d"), half = loupe.width / 2, [u, v] = pixel, [x, y] = this.screenAt(pixel);
    const isCovered = x > this.canvas.clientWidth / 2 && y < 1.5 * loupe.height;
    loupe.classList.toggle("left", isCovered); // a finger or pointer would cover it
    pen.imageSmoothingEnabled = false;
    pen.fillStyle = "#000";
    pen.fillRect(0, 0, loupe.width, loupe.height);
    pen.drawImage(bitmap, half - (u + 0.5) * LOUPE_ZOOM, half - (v + 0.5) * LOUPE_ZOOM,
      bitmap.width * LOUPE_ZOOM, bitmap.height * LOUPE_ZOOM);
    for (const [paint, width] of [[HALO, 3], ["#fff", 1]]) {
      pen.strokeStyle = paint;
      pen.lineWidth = width;
      pen.beginPath();
      for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
        pen.moveTo(half + 4 * dx, half + 4 * dy);
        pen.lineTo(half + 24 * dx, half + 24 * dy);
      }
      pen.stroke();
    }
  }
}

export function trace(pen, at, closed) {
  pen.beginPath();
  for (const [x, y] of at) pen.lineTo(x, y);
  if (closed) pen.closePath();
}

const pointBox = ([x, y]) => ({ left: x - POINT_PX - 2, top: y - POINT_PX - 2, width: 2 * POINT_PX + 4, height: 2 * POINT_PX + 4 });

const hides = (box, others) => others.some((each) => box.left < each.left + each.width && each.left < box.left + box.width
  && box.top < each.top + each.height && each.top < box.top + box.height);

const within = (value, low, high) => Math.max(low, Math.min(value, high));

function mean(points) {
  const sum = (axis) => points.reduce((total, point) => total + point[axis], 0);
  return [sum(0) / points.length, sum(1) / points.length];
}
