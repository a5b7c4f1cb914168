// @ts-check
// Values over time, each with its 95 % band; a click or a drag shows the image of that time.

import { converted } from "../measuring/words.js";

const ROW_PX = 84, MOST_LEFT_PX = 190, RIGHT_PX = 12, HEAD_PX = 38, FOOT_PX = 22, TICK_PX = 90, MOST_LIVE = 3000, MOST_DRAWN = 4000;
const BAND = "#56b4e966", BAD = "#d55e00", EVENT = "#cc79a7", OTHER_SOURCES = ["#e69f00", "#009e73", "#cc79a7", "#d55e00"];
/** @type {[string, string, string, string | null, (pose: Pose) => (number | null)[]][]} */
const KNOWN = [ // of the pose: name, unit, and its keys in the series of a recording and in what is seen live
  ["height", "m", "height_m", "height_std_m", (pose) => [pose.height_agl_m, pose.std.height_agl_m]],
  ["tilt", "deg", "tilt_deg", "tilt_std_deg", (pose) => [pose.tilt_deg, pose.std.tilt_deg]],
  ["telemetry's age", "s", "telemetry_age_s", null, (pose) => [pose.telemetry_age_s, null]],
];
const edge = (value, std, sign) => (value === null || std === null ? null : value + sign * 1.96 * std);

export class Plots {
  constructor(canvas) {
    this.canvas = canvas;
    /** @type {(seconds: number) => void} */
    this.onTime = () => {};
    this.isShown = false;
    this.units = /** @type {Units} */ ("m");
    this.now = 0;
    this.rows = []; // { name, unit, seconds, value, low, high, status, source }
    this.events = [];
    const seek = (event) => { if (event.buttons & 1) this.brush(event.offsetX); };
    canvas.onpointerdown = (event) => { canvas.setPointerCapture(event.pointerId); seek(event); };
    canvas.onpointermove = seek;
    new ResizeObserver(() => this.draw()).observe(canvas.parentElement);
  }

  at(seconds) {
    this.now = seconds;
    this.draw();
  }

  take({ probes, poses, events }) { // of a recording
    const { seconds, status, height_source: source } = poses, unknown = seconds.map(() => null);
    const known = KNOWN.map(([name, unit, key, stdKey]) => {
      const value = poses[key], stds = stdKey ? poses[stdKey] : unknown;
      const band = (sign) => value.map((each, at) => edge(each, stds[at], sign));
      return { name, unit, seconds, value, low: band(-1), high: band(1), status, source: name === "height" ? source : null };
    });
    this.rows = [...probes.filter((each) => each.value.some((value) => value !== null)), ...known];
    this.events = events;
    this.draw();
  }

  add(seconds, { measurements, pose }) { // what a live station has measured since
    const put = (name, unit, value, low, high, status, source) => {
      let row = this.rows.find((each) => each.name === name);
      if (!row) this.rows.push(row = { name, unit, seconds: [], value: [], low: [], high: [], status: [], source: source && [] });
      if (row.seconds.at(-1) === seconds) return;
      for (const [key, one] of Object.entries({ seconds, value, low, high, status, source })) {
        row[key]?.push(one);
        if (row[key]?.length > MOST_LIVE) row[key].shift();
      }
    };
    for (const { name, unit, value, ci95, status } of measurements) {
      const isPlotted = value !== null || this.rows.some((row) => row.name === name);
      if (isPlotted) put(name, unit, value, ci95?.[0] ?? null, ci95?.[1] ?? null, status);
    }
    for (const [name, unit, , , of] of KNOWN) {
      const [value, std] = of(pose);
      put(name, unit, value, edge(value, std, -1), edge(value, std, 1), pose.status, name === "height" ? pose.height_source || "" : undefined);
    }
  }

  get span() {
    const ends = this.rows.filter((each) => each.seconds.length).flatMap((each) => [each.seconds[0], each.seconds.at(-1)]);
    const first = Math.min(...ends, this.now), last = Math.max(...ends, this.now);
    return [first, Math.max(last, first + 1)];
  }

  get left() { // of the lines: before them stand their titles
    return Math.min(MOST_LEFT_PX, 0.3 * this.canvas.clientWidth);
  }

  brush(x) {
    const [first, last] = this.span, width = this.canvas.clientWidth - this.left - RIGHT_PX;
    this.onTime(first + Math.min(Math.max((x - this.left) / width, 0), 1) * (last - first));
  }

  // ---- drawing

  draw(units = this.units) {
    this.units = units;
    if (!this.isShown) return;
    const { canvas } = this, ratio = devicePixelRatio || 1, height = HEAD_PX + this.rows.length * ROW_PX + FOOT_PX, [first, last] = this.span;
    canvas.style.height = `${height}px`;
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    canvas.height = Math.round(height * ratio);
    const pen = this.pen = canvas.getContext("2d"), { left } = this, width = canvas.clientWidth - left - RIGHT_PX;
    const style = getComputedStyle(document.body);
    this.ink = style.color;
    this.colours = [style.getPropertyValue("--accent"), ...OTHER_SOURCES];
    this.x = (seconds) => left + ((seconds - first) / (last - first)) * width;
    pen.scale(ratio, ratio);
    pen.font = "13px system-ui, sans-serif";
    this.drawTime(first, last, width, height - FOOT_PX - HEAD_PX);
    this.rows.forEach((row, number) => this.drawRow(row, HEAD_PX + number * ROW_PX));
    this.drawEvents(height - FOOT_PX);
    pen.fillStyle = this.ink;
    pen.fillRect(this.x(this.now) - 0.75, HEAD_PX, 1.5, height - FOOT_PX - HEAD_PX);
    const near = this.events.find((each) => Math.abs(each.seconds - this.now) < (last - first) / 60);
    pen.fillText(near ? `${near.kind}: ${near.text}` : "95 % bands; orange marks below a line: no answer", 6, height - 6, canvas.clientWidth - 12);
  }

  drawTime(first, last, width, tall) { // seconds, or minutes and seconds, above thin lines
    const { pen } = this, least = ((last - first) * TICK_PX) / width, step = least > 20 ? 60 * niceStep(least / 60) : niceStep(least), digits = decimals(step);
    const text = (seconds) => (last < 120 ? `${seconds.toFixed(digits)} s` : `${Math.floor(seconds / 60)}:${String(Math.round(seconds % 60)).padStart(2, "0")}`);
    for (let at = Math.ceil(first / step) * step; at <= last; at += step) {
      this.rule(this.x(at), 18, 1, tall + HEAD_PX - 18);
      const label = text(at), wide = pen.measureText(label).width;
      pen.fillText(label, Math.min(this.x(at) - wide / 2, this.canvas.clientWidth - wide), 13);
    }
  }

  drawEvents(bottom) { // each with what it says, as far as there is room before the next one
    const { pen } = this, lefts = this.events.map((each) => this.x(each.seconds));
    this.events.forEach(({ kind, text }, at) => {
      const room = (lefts[at + 1] ?? this.canvas.clientWidth) - lefts[at] - 8;
      pen.fillStyle = EVENT;
      pen.fillRect(lefts[at] - 1, 18, 2, bottom - 18);
      pen.fillStyle = this.ink;
      pen.fillText(shortened(pen, `${kind}: ${text}`, room), lefts[at] + 4, 31);
    });
  }

  rule(left, top, width, height) { // a thin line
    this.pen.globalAlpha = 0.15;
    this.pen.fillStyle = this.ink;
    this.pen.fillRect(left, top, width, height);
    this.pen.globalAlpha = 1;
  }

  drawRow(row, top) {
    const { pen, x } = this, [factor, unit] = converted(1, row.unit, this.units), bottom = top + ROW_PX - 10, room = ROW_PX - 22, [low, high] = range(row);
    const y = (value) => bottom - Math.min(Math.max((value - low) / (high - low || 1), -0.05), 1.05) * room;
    this.drawAxis((value) => y(value / factor), factor * low, factor * high);
    this.drawTitle(row, top, factor, unit, factor * (high - low));
    for (const part of parts(row)) {
      pen.fillStyle = BAND;
      pen.beginPath();
      for (const at of part) if (row.high[at] !== null) pen.lineTo(x(row.seconds[at]), y(row.high[at]));
      for (const at of [...part].reverse()) if (row.low[at] !== null) pen.lineTo(x(row.seconds[at]), y(row.low[at]));
      pen.fill();
      pen.strokeStyle = row.source ? this.colourOf(row, row.source[part[0]]) : this.colours[0];
      pen.lineWidth = 1.5;
      pen.beginPath();
      for (const at of part) pen.lineTo(x(row.seconds[at]), y(row.value[at]));
      if (part.length === 1) pen.arc(x(row.seconds[part[0]]), y(row.value[part[0]]), 1.5, 0, 2 * Math.PI);
      pen.stroke();
    }
    pen.fillStyle = BAD;
    row.status.forEach((status, at) => { if (status !== "ok") pen.fillRect(x(row.seconds[at]) - 1, bottom + 3, 2, 4); });
  }

  drawAxis(y, low, high) { // two to four values, each with its line
    if (!(high > low)) return;
    const { pen, left } = this, step = niceStep((high - low) / 3);
    for (let at = Math.ceil(low / step) * step; at <= high; at += step) {
      this.rule(left, y(at), this.canvas.clientWidth - left - RIGHT_PX, 1);
      const label = at.toFixed(decimals(step));
      pen.fillText(label, left - 5 - pen.measureText(label).width, y(at) + 4);
    }
  }

  drawTitle({ name, seconds, value, status, source }, top, factor, unit, extent) {
    const { pen } = this, digits = Math.max(0, Math.min(5, 2 - Math.floor(Math.log10(extent || 1))));
    const at = lastBefore(seconds, this.now), isNear = at >= 0 && this.now - seconds[at] < 2, room = this.left - 60;
    pen.fillStyle = this.ink;
    pen.fillText(`${name}, ${unit}`, 6, top + 22, room);
    if (isNear) pen.fillText(value[at] === null ? status[at].toUpperCase() : `now ${(factor * value[at]).toFixed(digits)}`, 6, top + 42, room);
    let left = 6;
    for (const each of new Set((source || []).filter(Boolean))) {
      pen.fillStyle = this.colourOf({ source }, each);
      pen.fillRect(left, top + 53, 9, 9);
      pen.fillStyle = this.ink;
      pen.fillText(each, left + 12, top + 62);
      left += pen.measureText(each).width + 20;
    }
  }

  colourOf({ source }, one) {
    return this.colours[[...new Set(source)].indexOf(one) % this.colours.length];
  }
}

function range({ low, high, value }) { // of all but the strangest hundredth
  const numbers = [...low, ...high, ...value].filter((each) => each !== null).sort((a, b) => a - b);
  const share = (part) => numbers[Math.min(Math.floor(part * numbers.length), numbers.length - 1)] ?? NaN;
  return [share(0.01), share(0.99)];
}

function parts({ seconds, value, source }) { // rows to be joined: a gap in the values is one in the line
  const every = Math.ceil(seconds.length / MOST_DRAWN), found = [];
  let before = null;
  for (let at = 0; at < seconds.length; at += every) {
    if (value[at] === null) { before = null; continue; }
    if (before !== null && (!source || source[before] === source[at])) found.at(-1).push(at);
    else found.push([at]);
    before = at;
  }
  return found;
}

function shortened(pen, text, room) {
  let length = text.length;
  while (length && pen.measureText(text.slice(0, length)).width > room) length -= 1;
  return length < text.length && length > 1 ? `${text.slice(0, length - 1)}…` : text.slice(0, length);
}

export function niceStep(least) { // 1, 2 or 5 times a power of ten
  const power = 10 ** Math.floor(Math.log10(least));
  return power * [1, 2, 5, 10].find((each) => each * power >= least);
}

const decimals = (step) => Math.max(0, -Math.floor(Math.log10(step) + 1e-9));

function lastBefore(seconds, now) {
  let low = 0, high = seconds.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (seconds[middle] <= now + 1e-6) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}
