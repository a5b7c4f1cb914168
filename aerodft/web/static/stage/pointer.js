// @ts-check
// Pointer, fingers and keys on the image: set points, drag them, draw strokes, move and zoom.
//
// The tool in hand has items whose points can be dragged, and takes pixels: place(pixel), moved(), or as strokes
// begin(pixel), go(pixel) and end().

const HIT_PX = 14, FINGER_PX = 26, STILL_PX = 4, HOLD_MS = 350;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

export class Pointer {
  constructor(picture, history, onMoved, onSelected) {
    this.picture = picture;
    this.history = history;
    this.onMoved = onMoved; // where it is has changed
    this.onSelected = onSelected;
    this.tool = null;
    this.at = null; // the pixel that it is at
    this.drag = null; // what is done with the finger that is down
    this.held = null; // a point that keys have picked up
    this.fingers = new Map();
    const { canvas } = picture;
    canvas.onpointerdown = (event) => this.down(event);
    canvas.onpointermove = (event) => this.move(event);
    canvas.onpointerup = (event) => this.up(event);
    canvas.onpointercancel = (event) => { this.fingers.delete(event.pointerId); this.letGo(); };
    canvas.onpointerleave = () => { if (!this.drag) this.go(null); };
    canvas.onwheel = (event) => {
      event.preventDefault();
      picture.zoom(Math.exp(-event.deltaY / 400), event.offsetX, event.offsetY);
    };
  }

  go(pixel) {
    this.at = pixel;
    this.picture.drawLoupe(pixel);
    this.onMoved();
  }

  hit(x, y, reach = HIT_PX) {
    for (const item of [...this.tool.items].reverse()) {
      const index = item.points.findIndex((point) => {
        const [px, py] = this.picture.screenAt(point);
        return Math.hypot(px - x, py - y) < reach;
      });
      if (index >= 0) return { item, index };
    }
    return null;
  }

  put({ item, index }, pixel) {
    item.points[index] = pixel;
    this.tool.moved(item);
  }

  letGo() {
    clearTimeout(this.drag?.hold);
    this.drag = null;
  }

  // ---- mouse and fingers

  down(event) {
    const { offsetX: x, offsetY: y } = event, isFinger = event.pointerType === "touch";
    this.picture.canvas.setPointerCapture(event.pointerId);
    this.fingers.set(event.pointerId, [x, y]);
    this.letGo();
    const isAlone = this.fingers.size === 1 && event.button === 0;
    if (isAlone && this.tool.begin) {
      this.history.keep();
      this.tool.begin(this.picture.pixelAt(x, y));
      this.drag = { does: "stroke" };
      return;
    }
    const point = isAlone ? this.hit(x, y, isFinger ? FINGER_PX : HIT_PX) : null;
    this.drag = { does: isAlone ? "click" : "move", point, x, y, start: [x, y] };
    if (isFinger && isAlone && !point) this.drag.hold = setTimeout(() => this.pick(x, y), HOLD_MS);
  }

  pick(x, y) { // a finger that was held still sees through the loupe, and sets the point where it is lifted
    this.drag.does = "pick";
    this.go(this.picture.pixelAt(x, y));
  }

  move(event) {
    const { offsetX: x, offsetY: y } = event, { drag } = this;
    if (this.fingers.size === 2 && this.fingers.has(event.pointerId)) return this.pinch(event.pointerId, x, y);
    if (drag?.does === "click" && Math.hypot(x - drag.start[0], y - drag.start[1]) > STILL_PX) {
      clearTimeout(drag.hold);
      drag.does = drag.point ? "point" : "move";
      if (drag.point) this.history.keep();
    }
    this.go(this.picture.pixelAt(x, y));
    if (!drag) return;
    if (drag.does === "stroke") this.tool.go(this.at);
    else if (drag.does === "point") this.put(drag.point, this.at);
    else if (drag.does === "move") this.picture.move(x - drag.x, y - drag.y);
    [drag.x, drag.y] = [x, y];
  }

  pinch(id, x, y) {
    const old = this.fingers.get(id), other = [...this.fingers].find(([each]) => each !== id)[1];
    const far = ([fx, fy]) => Math.max(Math.hypot(fx - other[0], fy - other[1]), 1);
    this.picture.zoom(far([x, y]) / far(old), (x + other[0]) / 2, (y + other[1]) / 2);
    this.picture.move((x - old[0]) / 2, (y - old[1]) / 2);
    this.fingers.set(id, [x, y]);
  }

  up(event) {
    const { drag } = this, pixel = this.picture.pixelAt(event.offsetX, event.offsetY);
    this.fingers.delete(event.pointerId);
    this.letGo();
    if (drag?.does === "stroke") this.tool.end();
    else if (drag?.does === "click" && drag.point) this.onSelected(drag.point.item);
    else if (event.button === 0 && (drag?.does === "click" || drag?.does === "pick")) this.place(pixel);
    if (event.pointerType === "touch") this.go(null);
  }

  place(pixel) {
    this.history.keep();
    this.tool.place(pixel);
    this.onMoved();
  }

  // ---- keys

  key(event) { // whether it was one of the pointer's
    if (ARROWS[event.key]) this.step(ARROWS[event.key], event.shiftKey ? 10 : 1);
    else if (event.key === "Enter" && !event.ctrlKey && this.at) this.take();
    else return false;
    return true;
  }

  step([dx, dy], pixels) {
    const { picture } = this, { clientWidth, clientHeight } = picture.canvas;
    const [x, y] = picture.screenAt(this.at || picture.pixelAt(clientWidth / 2, clientHeight / 2));
    const pixel = picture.pixelAt(x + dx * pixels, y + dy * pixels);
    picture.reveal(pixel);
    this.go(pixel);
    if (this.held) this.put(this.held, pixel);
  }

  take() { // Enter picks a point up, puts it down, or sets a new one
    if (this.held) { this.held = null; return; }
    this.held = this.tool.begin ? null : this.hit(...this.picture.screenAt(this.at));
    if (this.held) { this.history.keep(); this.onSelected(this.held.item); } else if (this.tool.place) this.place(this.at);
  }
}
