// The page: what people do with pointer and keys, and what they see of it.

import { Health, clock } from "./tools/health.js";
import { Link } from "./link.js";
import { Landmarks } from "./tools/landmarks.js";
import { Live } from "./time/live.js";
import { GroundMap } from "./tools/map.js";
import { OverlayLayer } from "./stage/overlay.js";
import { Picture } from "./stage/picture.js";
import { Plots } from "./time/plots.js";
import { RiverLayer } from "./tools/river.js";
import { copyText, poseText, quality, reachText, samplingText, valueText } from "./measuring/words.js";

const COLOURS = ["#56b4e9", "#e69f00", "#009e73", "#f0e442", "#cc79a7", "#d55e00"]; // Okabe and Ito
const COUNTS = { width: 2, distance: 2, height: 2, position: 1, landmark: 1, length: 256, area: 256 };
const LEAST = { length: 2, area: 3 };
const HELP = {
  width: "Click two banks.", distance: "Click two points on the ground.", position: "Click a point on the ground.",
  length: "Click along the path; double-click or Enter ends it.", area: "Click around the area; double-click or Enter ends it.",
  height: "Click the base, on the ground, then the top.",
  landmark: "Mark what you know of the view, and type where or how long it is.",
  water: "Draw over what is water.", land: "Draw over what is land.",
};
const KEYS = { w: "width", d: "distance", l: "length", a: "area", h: "height", p: "position", m: "landmark" };
const HIT_PX = 14;
const find = (id) => document.getElementById(id);

const picture = new Picture(find("image"), find("loupe"));
const link = new Link((connected) => {
  tellLink(connected);
  if (connected && view) measureAll();
});
const slow = new Link(() => {}); // what takes longer does not hold up what follows the pointer
const river = new RiverLayer(slow, drawAll);
const overlay = new OverlayLayer(link, drawAll);
const plots = new Plots(find("plots"), (seconds) => seek(nearest(seconds)));
const map = new GroundMap(find("map"));
const health = new Health(find("alerts"), find("health"));
const landmarks = new Landmarks(link, drawAll, () => {
  for (const mark of marks) mark.before = mark.found;
  shown(number, true, null);
});
let view = null, number = 0, kind = "width", selected = null, playing = null, made = 0;
let marks = []; // { name, kind, points, found, colour }
let draft = []; // points of the mark that is being made
let vertical = [], pointer = null, drag = null;
const past = [];

function remember() {
  past.push(JSON.stringify({ marks, draft }));
  if (past.length > 200) past.shift();
}

function undo() {
  if (!past.length) return;
  ({ marks, draft } = JSON.parse(past.pop()));
  selected = null;
  measureAll();
}

// ---- measuring

const probe = (mark) => ({ kind: mark.kind, pixels: mark.points, name: mark.name });

function measureAll() {
  drawAll();
  if (!marks.length) return;
  const asked = marks;
  link.ask("marks", { image: number, probes: asked.map(probe), budget: true }, (answer) => {
    if (answer.error) return tell(answer.error);
    answer.measurements.forEach((each, index) => { asked[index].found = each; });
    drawAll();
  });
}

function measureDraft() {
  const points = pointer && draft.length < COUNTS[kind] ? [...draft, pointer] : draft;
  const few = points.length < (LEAST[kind] || COUNTS[kind]);
  const question = few ? { kind: "position", pixels: points.slice(-1) } : { kind, pixels: points };
  if (!points.length || isStroke() || kind === "landmark") return;
  const asked = { image: number, probes: [question], vertical: kind === "height" && draft.length === 1, sampling: overlay.isShown };
  link.ask("pointer", asked, (answer) => {
    if (answer.error) return tell(answer.error);
    vertical = answer.vertical || [];
    const [found] = answer.measurements, sampling = answer.sampling_m ? `\n${samplingText(answer.sampling_m)}` : "";
    const value = few && found.status === "ok" && draft.length ? "" : valueText(found, units());
    tell(value || sampling ? value + sampling : "", quality(found));
    drawAll();
  });
}

const isStroke = () => kind === "water" || kind === "land";

function finish() {
  if (isStroke()) return;
  if (draft.length < (LEAST[kind] || COUNTS[kind])) return;
  const mark = { name: `${kind}-${++made}`, kind, points: draft, found: null, colour: COLOURS[(made - 1) % COLOURS.length] };
  marks.push(mark);
  selected = mark.name;
  draft = [];
  vertical = [];
  measureAll();
}

// ---- showing

const units = () => find("units").value;

function tell(text, how = "refused") {
  const box = find("pointer");
  box.hidden = !text || !pointer;
  box.textContent = text;
  box.className = how;
  if (box.hidden) return;
  const [x, y] = picture.screenAt(pointer), room = find("stage");
  box.style.left = `${Math.max(0, Math.min(x + 16, room.clientWidth - box.offsetWidth - 8))}px`;
  box.style.top = `${Math.max(0, Math.min(y + 16, room.clientHeight - box.offsetHeight - 8))}px`;
}

function drawAll() {
  const shapes = marks.map((mark) => ({
    points: mark.points, colour: mark.colour, closed: mark.kind === "area",
    label: mark.found ? `${mark.name} ${valueText(mark.found, units())}` : "",
  }));
  const open = pointer && draft.length ? [...draft, pointer] : draft;
  shapes.push({ points: open, colour: "#fff", closed: kind === "area" && open.length > 2 });
  if (vertical.length) shapes.push({ points: vertical, colour: "#f0e442", dashed: true });
  picture.shapes = [...overlay.shapes(units()), ...river.shapes(number), ...(kind === "landmark" ? landmarks.shapes() : []), ...shapes];
  find("landmarks").hidden = kind !== "landmark";
  picture.draw();
  listMarks();
  find("reach").hidden = !river.isShown;
  find("reach-width").textContent = river.found ? reachText(river.found, units()) : "looking for banks";
  const ink = getComputedStyle(document.body).color;
  river.drawProfile(find("profile"), ink);
  if (find("above").open) map.draw(overlay.scene, marks, ink);
}

function showGrid() {
  overlay.isShown = !overlay.isShown;
  find("grid").setAttribute("aria-pressed", String(overlay.isShown));
  drawAll();
}

async function showPlots() {
  plots.isShown = !plots.isShown;
  find("plot").setAttribute("aria-pressed", String(plots.isShown));
  find("over-time").hidden = !plots.isShown;
  plots.draw();
}

function showRiver() {
  river.isShown = !river.isShown;
  find("river").setAttribute("aria-pressed", String(river.isShown));
  for (const button of document.querySelectorAll("[data-kind=water], [data-kind=land]")) button.hidden = !river.isShown;
  if (!river.isShown && isStroke()) choose("width");
  river.look(number);
  drawAll();
}

function listMarks() {
  const list = find("measurements");
  if (list.contains(document.activeElement) && document.activeElement.tagName === "INPUT") return;
  list.replaceChildren(...marks.map((mark) => {
    const row = document.createElement("li"), name = document.createElement("input");
    const value = document.createElement("button"), remove = document.createElement("button");
    row.style.borderColor = mark.colour;
    row.setAttribute("aria-current", String(mark.name === selected));
    name.value = mark.name;
    name.maxLength = 64;
    name.setAttribute("aria-label", "Name");
    name.onchange = () => rename(mark, name.value);
    value.className = "value";
    value.textContent = mark.found ? valueText(mark.found, units()) + beforeText(mark) : "…";
    value.onclick = () => { selected = mark.name; drawAll(); };
    remove.textContent = "✕";
    remove.setAttribute("aria-label", `Delete ${mark.name}`);
    remove.onclick = () => { remember(); marks = marks.filter((each) => each !== mark); drawAll(); };
    row.append(name, value, remove);
    return row;
  }));
  showDetails(marks.find((each) => each.name === selected)?.found);
}

const beforeText = ({ found, before }) => (before?.value && before.value !== found.value ? ` (before: ${valueText(before, units())})` : "");

function rename(mark, wanted) {
  const name = wanted.trim().replace(/\s+/g, "-");
  document.activeElement?.blur();
  if (name && !marks.some((each) => each !== mark && each.name === name)) {
    remember();
    if (selected === mark.name) selected = name;
    mark.name = name;
  }
  measureAll();
}

function showDetails(found) {
  find("details").hidden = !found;
  if (!found) return;
  find("budget").replaceChildren(...(found.budget || []).map((part, index) => {
    const bar = document.createElement("span");
    bar.style.flex = String(part.share);
    bar.style.background = COLOURS[index % COLOURS.length];
    bar.textContent = part.source;
    bar.title = `${part.source}: ${(100 * part.share).toFixed(0)} %, std ${part.std.toPrecision(3)} ${found.unit}`;
    return bar;
  }));
  find("advice").textContent = found.advice || "";
  find("reasons").textContent = found.reasons.join("; ");
}

// ---- pointer and keys

function hit(x, y) {
  for (const mark of [...(kind === "landmark" ? landmarks.items : []), ...[...marks].reverse()]) {
    const index = mark.points.findIndex((point) => {
      const [px, py] = picture.screenAt(point);
      return Math.hypot(px - x, py - y) < HIT_PX;
    });
    if (index >= 0) return { mark, index };
  }
  return null;
}

const canvas = find("image"), fingers = new Map();

canvas.onpointerdown = (event) => {
  canvas.setPointerCapture(event.pointerId);
  fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
  if (isStroke() && fingers.size === 1 && event.button === 0) {
    river.begin(kind, number, picture.pixelAt(event.offsetX, event.offsetY));
    drag = { stroke: kind };
    return drawAll();
  }
  const found = fingers.size === 1 && event.button === 0 ? hit(event.offsetX, event.offsetY) : null;
  drag = { x: event.offsetX, y: event.offsetY, start: [event.offsetX, event.offsetY], point: found, far: fingers.size > 1 };
};

canvas.onpointermove = (event) => {
  const { offsetX: x, offsetY: y } = event;
  if (fingers.size === 2 && fingers.has(event.pointerId)) {
    const [other] = [...fingers].filter(([id]) => id !== event.pointerId).map(([, at]) => at), old = fingers.get(event.pointerId);
    picture.zoom(Math.hypot(x - other[0], y - other[1]) / Math.max(Math.hypot(old[0] - other[0], old[1] - other[1]), 1), (x + other[0]) / 2, (y + other[1]) / 2);
    fingers.set(event.pointerId, [x, y]);
    return;
  }
  pointer = picture.pixelAt(x, y);
  picture.drawLoupe(pointer);
  if (!drag) return measureDraft();
  if (drag.stroke) { river.go(drag.stroke, pointer); return drawAll(); }
  if (Math.hypot(x - drag.start[0], y - drag.start[1]) > 4 && !drag.far) {
    drag.far = true;
    if (drag.point) remember();
  }
  if (drag.far && drag.point) {
    drag.point.mark.points[drag.point.index] = pointer;
    if (kind === "landmark") landmarks.solve(false);
    measureAll();
  } else if (drag.far) picture.move(x - drag.x, y - drag.y);
  [drag.x, drag.y] = [x, y];
};

canvas.onpointerup = (event) => {
  fingers.delete(event.pointerId);
  const done = drag;
  drag = null;
  if (done?.stroke) return river.look(number);
  if (!done || done.far || event.button !== 0) return;
  if (done.point) { selected = done.point.mark.name; return drawAll(); }
  place(picture.pixelAt(event.offsetX, event.offsetY));
};

canvas.onpointercancel = (event) => { fingers.delete(event.pointerId); drag = null; };
canvas.onpointerleave = () => { pointer = null; picture.drawLoupe(null); tell(""); drawAll(); };
canvas.ondblclick = finish;
canvas.onwheel = (event) => {
  event.preventDefault();
  picture.zoom(Math.exp(-event.deltaY / 400), event.offsetX, event.offsetY);
};

function place(pixel) {
  if (kind === "landmark") return landmarks.add(pixel);
  const last = draft.at(-1);
  if (last && last[0] === pixel[0] && last[1] === pixel[1]) return; // the second click of a double-click
  remember();
  draft.push(pixel);
  if (draft.length === COUNTS[kind]) finish();
  else measureDraft();
}

function choose(wanted) {
  kind = wanted;
  draft = [];
  vertical = [];
  for (const button of find("tools").children) if (button.dataset.kind) button.setAttribute("aria-pressed", String(button.dataset.kind === kind));
  find("help").textContent = `${HELP[kind]} Esc starts anew, Ctrl+Z takes back, 0 shows the whole image.`;
  drawAll();
}

function movePointer(event) {
  const step = event.shiftKey ? 10 : 1, [x, y] = picture.screenAt(pointer || picture.pixelAt(canvas.clientWidth / 2, canvas.clientHeight / 2));
  const by = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[event.key];
  pointer = picture.pixelAt(x + by[0], y + by[1]);
  picture.drawLoupe(pointer);
  measureDraft();
  drawAll();
}

document.onkeydown = (event) => {
  if (event.target.tagName === "INPUT" && event.target.type !== "range") return;
  if ((event.ctrlKey || event.metaKey) && event.key === "z") undo();
  else if (event.ctrlKey || event.metaKey || event.altKey) return;
  else if (KEYS[event.key]) choose(KEYS[event.key]);
  else if (event.key === "r") showRiver();
  else if (event.key === "g") showGrid();
  else if (event.key === "t" && !find("plot").hidden) showPlots();
  else if (event.key === "Escape") choose(kind);
  else if (event.key.startsWith("Arrow") && event.target === canvas) movePointer(event);
  else if (event.key === "Enter" && event.target === canvas) { if (LEAST[kind] && event.ctrlKey) finish(); else if (pointer) place(pointer); }
  else if (event.key === "Enter" && event.target === document.body) finish();
  else if (event.key === "+" || event.key === "-") picture.zoom(event.key === "+" ? 1.25 : 0.8, canvas.clientWidth / 2, canvas.clientHeight / 2);
  else if (event.key === "0") picture.fit();
  else if (event.key === ",") seek(target - 1);
  else if (event.key === ".") seek(target + 1);
  else if (event.key === " " && event.target.tagName !== "BUTTON") play();
  else return;
  event.preventDefault();
};

find("tools").onclick = (event) => event.target.dataset.kind && choose(event.target.dataset.kind);
find("river").onclick = showRiver;
find("grid").onclick = showGrid;
find("plot").onclick = showPlots;
find("above").ontoggle = drawAll;
find("saving").onclick = (event) => {
  const mark = marks.find((each) => each.name === selected), how = event.target.dataset.save;
  if (!how || !mark) return;
  link.ask("save", { image: number, save: probe(mark), tracked: how === "tracked" }, (answer) => {
    find("saved").textContent = answer.error || `In ${answer.file}: measured from the station's next start on.`;
  });
};
find("forget").onclick = () => { river.forget(); river.look(number); drawAll(); };
find("units").onchange = drawAll;
find("copies").onclick = async (event) => {
  const found = marks.find((each) => each.name === selected)?.found;
  if (!event.target.dataset.copy || !found) return;
  const text = copyText(event.target.dataset.copy, found, units()), box = find("copied");
  box.hidden = false;
  box.value = text;
  box.select();
  await navigator.clipboard?.writeText(text).catch(() => {}); // the text stands there, selected, all the same
};

// ---- time

let loading = 0;

function tellLink(connected) {
  find("link").textContent = connected ? "connected" : "connection lost, trying again";
  find("link").classList.toggle("lost", !connected);
}

const nearest = (seconds) => view.images.reduce((best, each, at) => (Math.abs(each.seconds - seconds) < Math.abs(view.images[best].seconds - seconds) ? at : best), 0);

async function shown(wanted, hasPicture, seen) { // false where a newer image was asked for meanwhile
  const turn = ++loading;
  const [picked, known] = await Promise.all([
    hasPicture ? fetch(`images/${wanted}.jpg`) : null, seen || fetch(`images/${wanted}.json`).then((answer) => (answer.ok ? answer.json() : null)),
  ]);
  if (turn !== loading) return false;
  if (picked && !picked.ok) { find("link").textContent = await picked.text(); return false; }
  const bitmap = picked && await createImageBitmap(await picked.blob());
  if (turn !== loading) return false;
  number = wanted;
  overlay.seen = known;
  find("pose").textContent = known ? poseText(known.pose) : "";
  if (bitmap) picture.show(bitmap);
  else picture.blank(view.width_px, view.height_px);
  measureAll();
  overlay.look(number);
  river.look(number);
  return true;
}

let target = 0; // the image that is on its way, or shown

async function seek(wanted) {
  if (view.is_live) return;
  target = Math.min(Math.max(wanted, 0), view.images.length - 1);
  const { stamp_ns: stamp, seconds } = view.images[target];
  find("seek").value = String(target);
  const day = stamp === "0" ? "" : `  ${new Date(Number(BigInt(stamp) / 1000000n)).toISOString()}`;
  find("when").textContent = `image ${target + 1} of ${view.images.length}, ${seconds.toFixed(3)} s${day}`;
  plots.now = seconds;
  plots.draw();
  await shown(target, true, null);
}

async function takeNews(news) {
  health.take(news);
  if (!news.image) { find("when").textContent = "no image yet"; return; }
  const { number: newest, stamp_ns: stamp, has_picture: hasPicture } = news.image, seconds = Number(BigInt(stamp) / 1000000n) / 1000;
  liveStart ??= seconds;
  plots.now = seconds - liveStart;
  plots.add(plots.now, news.image);
  find("when").textContent = playing ? `image ${newest}, ${clock(stamp)}` : `stopped at image ${number}; the station goes on (${clock(stamp)})`;
  if (playing && newest !== number) await shown(newest, hasPicture, news.image);
}

let liveStart = null;

function play() {
  find("play").textContent = playing ? "▶" : "❚❚";
  find("play").setAttribute("aria-label", playing ? "Play" : "Pause");
  if (view.is_live) { playing = playing ? null : "live"; return; }
  if (playing) { clearTimeout(playing); playing = null; return; }
  const step = async () => {
    const here = view.images[number].seconds, began = performance.now(), isLast = number + 1 >= view.images.length;
    if (isLast && !find("loop").checked) return play();
    await seek(isLast ? 0 : number + 1);
    const pace = Number(find("speed").value), due = (Math.max(view.images[number].seconds - here, 0.02) * 1000) / pace;
    if (playing) playing = setTimeout(step, Math.max(due - (performance.now() - began), 0));
  };
  playing = setTimeout(step, 0);
}

find("before").onclick = () => seek(target - 1);
find("after").onclick = () => seek(target + 1);
find("play").onclick = play;
find("seek").oninput = () => seek(Number(find("seek").value));

view = await (await fetch("view.json")).json();
document.title = `${view.title} - aerodft`;
find("title").textContent = view.title;
find("saving").hidden = !view.can_save;
find("time").hidden = view.images.length < 2 && !view.is_live;
find("plot").hidden = !view.is_live && !view.is_recording;
find("well").hidden = !view.is_live;
for (const id of ["before", "after", "seek", "looping", "pace"]) find(id).hidden = view.is_live;
find("seek").max = String(view.images.length - 1);
if (view.is_live) {
  play();
  new Live(takeNews, tellLink).follow();
} else {
  await seek(0);
  if (view.is_recording) {
    fetch("series.json").then(async (answer) => {
      if (!answer.ok) return;
      const series = await answer.json();
      map.track = series.poses.east_m.map((east, at) => [east, series.poses.north_m[at]]).filter(([east]) => east !== null);
      plots.take(series);
    });
  }
}
document.body.dataset.ready = "true";
