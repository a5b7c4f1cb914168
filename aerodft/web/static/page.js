// @ts-check
// The page: an image to look at and to click, what was measured in it, and what is known of the camera, put together.

import { element, fillList, find, targetOf, toolButtons } from "./elements.js";
import { Link } from "./link.js";
import { History } from "./measuring/history.js";
import { KINDS, Marks, learnKinds } from "./measuring/marks.js";
import { Panel } from "./measuring/panel.js";
import { handText, plain, poseText } from "./measuring/words.js";
import { OverlayLayer } from "./stage/overlay.js";
import { Picture } from "./stage/picture.js";
import { Pointer } from "./stage/pointer.js";
import { Plots } from "./time/plots.js";
import { Timeline } from "./time/timeline.js";
import { Health } from "./tools/health.js";
import { Landmarks } from "./tools/landmarks.js";
import { GroundMap } from "./tools/map.js";
import { RiverLayer } from "./tools/river.js";
import { DRAWN, MEASURES, PRESSED, titleText } from "./tools.js";

const units = () => /** @type {Units} */ (find("units").value);
const view = await (await fetch("view.json")).json();
let image = 0; // number of the image that is shown

// ---- the parts

const link = new Link((isConnected) => {
  tellLink(isConnected);
  if (isConnected) marks.measure();
});
const slowLink = new Link(() => {}); // what takes longer does not hold up what follows the pointer
const picture = new Picture(find("image"), find("loupe"));
const overlay = new OverlayLayer(link, draw);
const marks = new Marks(link, draw);
const river = new RiverLayer(slowLink, draw);
const history = new History(draw);
const landmarks = new Landmarks(view, slowLink, history, draw, () => {
  for (const mark of marks.items) mark.before = mark.found;
  show(image, { hasPicture: false });
});
history.parts = [marks, river, landmarks];
const panel = new Panel(marks, history, link);
const pointer = new Pointer(picture, history, follow, (item) => { marks.selected = item; draw(); });
const map = new GroundMap(find("map"), draw);
const plots = new Plots(find("plots"));
const health = new Health({ alerts: find("alerts"), list: find("health"), doctor: find("doctor"), details: find("well") });
const timeline = new Timeline(view, plots, { show, onNews: (news) => health.take(news), onLink: tellLink });

// ---- the tool in hand

const PARTS = { landmark: landmarks, water: river, land: river };
const others = learnKinds(view.kinds);
let kind = "width";

const buttonOf = (name) => toolButtons().find((each) => each.dataset.kind === name);

function choose(wanted) {
  const isOther = others.includes(wanted);
  if ((isOther ? find("others") : buttonOf(wanted)).disabled) return;
  find("others").value = isOther ? wanted : "";
  kind = wanted;
  const tool = PARTS[kind] ?? marks;
  pointer.tool = tool;
  if (tool === marks) marks.choose(kind);
  if (tool === river) river.side = kind;
  if (tool === landmarks) timeline.pause(); // what is marked is of one image
  for (const button of toolButtons()) button.setAttribute("aria-pressed", String(button.dataset.kind === kind));
  find("help").textContent = handText((DRAWN[kind] ?? KINDS[kind]).help);
  draw();
}

function follow() { // what is at the pointer, in words beside it
  draw();
  if (!pointer.at || pointer.tool !== marks || pointer.drag?.does === "point") return tell("");
  marks.follow(pointer.at, overlay.isShown, units(), (text, how) => { tell(text, how); draw(); });
}

function tell(text, how = "refused") {
  const box = find("pointer");
  box.hidden = !text || !pointer.at;
  box.textContent = text;
  box.className = how;
  if (box.hidden) return;
  const [x, y] = picture.screenAt(pointer.at), room = find("stage");
  box.style.left = `${Math.max(0, Math.min(x + 16, room.clientWidth - box.offsetWidth - 8))}px`;
  box.style.top = `${Math.max(0, Math.min(y + 16, room.clientHeight - box.offsetHeight - 8))}px`;
}

// ---- drawing, once for all that has changed

let isDue = false;

function draw() {
  if (isDue) return;
  isDue = true;
  requestAnimationFrame(() => {
    isDue = false;
    drawNow();
  });
}

function drawNow() {
  const isCalibrating = pointer.tool === landmarks, hasPose = !view.can_calibrate || overlay.seen?.pose, ink = getComputedStyle(document.body).color;
  picture.shapes = [
    ...overlay.shapes(units()), ...river.shapes(), ...(isCalibrating ? landmarks.shapes(units()) : []), ...marks.shapes(pointer.at, units()),
  ];
  picture.draw();
  panel.draw(units(), overlay.probes);
  find("undo").disabled = !history.past.length;
  find("end").hidden = !marks.canEnd;
  for (const each of toolButtons()) if (KINDS[each.dataset.kind]) each.disabled = !hasPose;
  find("others").disabled = !hasPose;
  find("river").disabled = find("grid").disabled = !hasPose;
  find("landmarks").hidden = !isCalibrating;
  find("reach").hidden = !river.isShown;
  find("reach-width").textContent = river.text(units());
  fillList(find("reach-reasons"), river.reasons.map(plain));
  find("pose").textContent = overlay.seen ? poseText(overlay.seen.pose, units()) : "";
  if (river.isShown) river.drawProfile(find("profile"), ink, units());
  if (!find("above").open) return;
  const banks = river.isShown && river.found ? river.found.banks_enu_m : [];
  map.draw({ scene: overlay.scene, marks: marks.items, probes: overlay.probes, banks, ink, units: units() });
}

// ---- what is shown

let loading = 0;

/**
 * Show an image with what is known of it, unless another was wanted meanwhile.
 * @param {number} wanted
 * @param {{ hasPicture: boolean, seen?: object }} what
 */
async function show(wanted, { hasPicture, seen }) {
  loading += 1;
  const turn = loading, isNew = wanted !== image || !picture.bitmap;
  find("loading").textContent = "Loading the image …";
  const [answer, known] = await Promise.all([
    hasPicture ? fetch(`images/${wanted}.jpg`) : null,
    seen || fetch(`images/${wanted}.json`).then((found) => (found.ok ? found.json() : null)),
  ]);
  const bitmap = answer?.ok ? await createImageBitmap(await answer.blob()) : null;
  if (turn !== loading) return;
  if (answer && !answer.ok) find("link").textContent = plain(await answer.text());
  image = wanted;
  overlay.seen = known;
  if (bitmap) picture.show(bitmap);
  else if (isNew) picture.blank(view.width_px, view.height_px);
  find("loading").hidden = true;
  marks.measure(image);
  lookAround();
  river.look(image);
  follow();
}

function lookAround() { // at the ground, for whoever looks at the grid or the map
  if (overlay.isShown || find("above").open) overlay.look(image);
  draw();
}

function toggle(id, part) {
  part.isShown = !part.isShown;
  find(id).setAttribute("aria-pressed", String(part.isShown));
}

function showGrid() {
  toggle("grid", overlay);
  lookAround();
}

function showPlots() {
  toggle("plot", plots);
  find("over-time").hidden = !plots.isShown;
  plots.draw();
}

function showRiver() {
  toggle("river", river);
  if (!river.isShown && pointer.tool === river) choose("width");
  river.look(image);
  draw();
}

function tellLink(isConnected) {
  find("link").textContent = isConnected ? "connected" : "connection lost, trying again";
  find("link").classList.toggle("lost", !isConnected);
}

// ---- buttons and keys

function undo() {
  history.undo();
  follow();
}

function end() {
  marks.end();
  follow();
}

const middle = () => [picture.canvas.clientWidth / 2, picture.canvas.clientHeight / 2];
const PRESS = {
  grid: showGrid, river: showRiver, plot: showPlots, whole: () => picture.fit(),
  before: () => timeline.step(-1), play: () => timeline.play(), after: () => timeline.step(1),
};
const KEYS = {
  Escape: () => choose(kind),
  "+": () => picture.zoom(1.25, ...(pointer.at ? picture.screenAt(pointer.at) : middle())),
  "-": () => picture.zoom(0.8, ...(pointer.at ? picture.screenAt(pointer.at) : middle())),
  Delete: () => { if (marks.current) { history.keep(); marks.remove(marks.current); } },
};

function dress(button, words) {
  button.textContent = words.label;
  button.title = titleText(words);
  if (!/[a-z]/i.test(words.label)) button.ariaLabel = words.title; // a sign says nothing aloud
}

for (const name of Object.keys(MEASURES)) {
  const button = element("button", "", { ariaPressed: "false" });
  button.dataset.kind = name;
  find("others").before(button, " ");
}
for (const [name, words] of Object.entries({ ...MEASURES, ...DRAWN })) {
  dress(buttonOf(name), words);
  if (words.key) KEYS[words.key] = () => choose(name);
}
for (const [id, words] of Object.entries(PRESSED)) {
  const button = /** @type {HTMLButtonElement} */ (find(id));
  dress(button, words);
  button.onclick = PRESS[id];
  KEYS[words.key] = () => { if (!button.hidden && !button.disabled) PRESS[id](); };
}

document.onkeydown = (event) => {
  const { key } = event, target = targetOf(event), isCommand = event.ctrlKey || event.metaKey, isAtImage = target === picture.canvas;
  if ((target.tagName === "INPUT" && target.type !== "range") || (target.tagName === "TEXTAREA" && !target.readOnly)) return;
  if (isCommand && key === "z") undo();
  else if (key === "Enter" && isCommand) end();
  else if (isCommand || event.altKey) return;
  else if (isAtImage && pointer.key(event)) draw();
  else if (key === " " && (target.tagName === "BUTTON" || target.tagName === "SUMMARY")) return;
  else if (KEYS[key]) KEYS[key]();
  else return;
  event.preventDefault();
};

document.onclick = (event) => { if (targetOf(event).dataset.kind) choose(targetOf(event).dataset.kind); };
picture.canvas.ondblclick = end;
find("others").append(...others.map((name) => new Option(name)));
find("others").onchange = () => choose(find("others").value);
find("undo").onclick = undo;
find("end").onclick = end;
find("above").ontoggle = lookAround;
find("units").onchange = () => { plots.draw(units()); follow(); };
find("forget").onclick = () => { history.keep(); river.forget(); river.look(); draw(); };

// ---- the beginning

for (const each of document.querySelectorAll("[data-hand]")) each.textContent = handText(each.textContent);
document.title = `${view.title} - aerodft`;
find("title").textContent = view.title;
find("saving").hidden = !view.can_save;
find("well").hidden = !view.is_live && !view.is_recording;
buttonOf("landmark").hidden = !view.can_calibrate;
map.template = view.tiles;
choose("width");
if (view.is_live) timeline.follow();
else await timeline.seek(view.is_recording ? Math.floor(view.images.length / 2) : 0); // a flight is in the air by then
if (view.can_calibrate && !view.is_live && !overlay.seen?.pose) choose("landmark");
if (view.is_recording) {
  fetch("series.json").then(async (answer) => {
    if (!answer.ok) return;
    const series = await answer.json(), { east_m: east, north_m: north } = series.poses;
    map.track = east.map((each, at) => [each, north[at]]).filter(([each]) => each !== null);
    plots.take(series);
    draw();
  });
}
document.body.dataset.ready = "true";
