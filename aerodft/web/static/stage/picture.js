// The image on a canvas, zoomed and moved. Pixel (0, 0) is the middle of the top-left pixel, as everywhere in aerodft.

const POINT_PX = 7, LOUPE_ZOOM = 8;

export class Picture {
  constructor(canvas, loupe) {
    this.canvas = canvas;
    this.loupe = loupe;
    this.pen = canvas.getContext("2d");
    this.bitmap = null;
    this.scale = 1;
    this.left = 0;
    this.top = 0;
    this.shapes = []; // { points: [[u, v]], colour, closed, label, dashed, plain: without its points, thin: a line of the grid, with its tag }
    new ResizeObserver(() => this.resized()).observe(canvas);
  }

  show(bitmap) {
    const first = !this.bitmap || this.bitmap.width !== bitmap.width || this.bitmap.height !== bitmap.height;
    this.bitmap = bitmap;
    if (first) this.fit();
    this.draw();
  }

  resized() {
    const ratio = devicePixelRatio || 1;
    this.canvas.width = Math.max(1, Math.round(this.canvas.clientWidth * ratio));
    this.canvas.height = Math.max(1, Math.round(this.canvas.clientHeight * ratio));
    if (this.bitmap && !this.moved) this.fit();
    this.draw();
  }

  fit() {
    const { width, height } = this.bitmap, { clientWidth, clientHeight } = this.canvas;
    this.scale = Math.min(clientWidth / width, clientHeight / height) || 1;
    this.left = (clientWidth - width * this.scale) / 2;
    this.top = (clientHeight - height * this.scale) / 2;
    this.moved = false;
    this.draw();
  }

  zoom(factor, x, y) {
    const scale = Math.min(Math.max(this.scale * factor, 0.02), 64);
    this.left = x - ((x - this.left) * scale) / this.scale;
    this.top = y - ((y - this.top) * scale) / this.scale;
    this.scale = scale;
    this.moved = true;
    this.draw();
  }

  move(dx, dy) {
    this.left += dx;
    this.top += dy;
    this.moved = true;
    this.draw();
  }

  pixelAt(x, y) { // hundredths are finer than anybody clicks, and read the same in every program
    const round = (value) => Math.round(value * 100) / 100;
    return [round((x - this.left) / this.scale - 0.5), round((y - this.top) / this.scale - 0.5)];
  }

  screenAt([u, v]) {
    return [(u + 0.5) * this.scale + this.left, (v + 0.5) * this.scale + this.top];
  }

  draw() {
    const { pen, canvas, bitmap } = this, ratio = devicePixelRatio || 1;
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, canvas.width, canvas.height);
    if (!bitmap) return;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.imageSmoothingEnabled = this.scale < 3;
    pen.drawImage(bitmap, this.left, this.top, bitmap.width * this.scale, bitmap.height * this.scale);
    for (const shape of this.shapes) this.drawShape(shape);
  }

  drawShape({ points, colour, closed, label, dashed, plain, thin, tag }) {
    const { pen } = this, at = points.map((point) => this.screenAt(point));
    if (!at.length) return;
    if (thin) return this.drawThin(at, colour, tag);
    for (const [paint, width] of [["#000", 5], [colour, 2.5]]) {
      pen.strokeStyle = paint;
      pen.lineWidth = width;
      pen.setLineDash(dashed ? [6, 6] : []);
      pen.beginPath();
      at.forEach(([x, y], index) => (index ? pen.lineTo(x, y) : pen.moveTo(x, y)));
      if (closed) pen.closePath();
      pen.stroke();
      pen.setLineDash([]);
      for (const [x, y] of dashed || plain ? [] : at) {
        pen.beginPath();
        pen.arc(x, y, POINT_PX, 0, 2 * Math.PI);
        pen.moveTo(x - 2, y); pen.lineTo(x + 2, y); pen.moveTo(x, y - 2); pen.lineTo(x, y + 2);
        pen.stroke();
      }
    }
    if (!label) return;
    const x = at.reduce((sum, each) => sum + each[0], 0) / at.length, y = at.reduce((sum, each) => sum + each[1], 0) / at.length;
    pen.font = "bold 15px system-ui, sans-serif";
    const width = pen.measureText(label).width;
    pen.fillStyle = "#000c";
    pen.fillRect(x - width / 2 - 6, y - 34, width + 12, 22);
    pen.fillStyle = "#fff";
    pen.fillText(label, x - width / 2, y - 18);
  }

  drawThin(at, colour, tag) {
    const { pen } = this, [x, y] = at[Math.floor(at.length / 2)];
    pen.strokeStyle = colour;
    pen.lineWidth = 1;
    pen.globalAlpha = 0.6;
    pen.beginPath();
    for (const point of at) pen.lineTo(...point);
    pen.stroke();
    pen.globalAlpha = 1;
    pen.font = "12px system-ui, sans-serif";
    for (const [paint, shift] of [["#000", 1], [colour, 0]]) {
      pen.fillStyle = paint;
      pen.fillText(tag, x + 3 + shift, y - 3 + shift);
    }
  }

  blank(width, height) { // a station whose images have no picture is measured in all the same
    const canvas = new OffscreenCanvas(width, height);
    canvas.getContext("2d").fillRect(0, 0, width, height);
    this.show(canvas);
  }

  drawLoupe(pixel) {
    const { loupe, bitmap } = this;
    loupe.hidden = !pixel || !bitmap;
    if (loupe.hidden) return;
    const pen = loupe.getContext("2d"), half = loupe.width / 2, [u, v] = pixel;
    pen.imageSmoothingEnabled = false;
    pen.fillStyle = "#000";
    pen.fillRect(0, 0, loupe.width, loupe.height);
    pen.drawImage(bitmap, half - (u + 0.5) * LOUPE_ZOOM, half - (v + 0.5) * LOUPE_ZOOM, bitmap.width * LOUPE_ZOOM, bitmap.height * LOUPE_ZOOM);
    for (const [paint, width] of [["#000", 3], ["#fff", 1]]) {
      pen.strokeStyle = paint;
      pen.lineWidth = width;
      pen.beginPath();
      pen.moveTo(half, half - 24); pen.lineTo(half, half - 4); pen.moveTo(half, half + 4); pen.lineTo(half, half + 24);
      pen.moveTo(half - 24, half); pen.lineTo(half - 4, half); pen.moveTo(half + 4, half); pen.lineTo(half + 24, half);
      pen.stroke();
    }
  }
}
