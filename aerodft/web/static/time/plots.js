// Values over time, each with its 95 % band; a click or a drag shows the image of that time.

const ROW_PX = 84, LEFT_PX = 150, RIGHT_PX = 12, FOOT_PX = 20, MOST_LIVE = 3000;
const BAND = "#56b4e966", LINE = "#0072b2", BAD = "#d55e00", EVENT = "#cc79a7";

export class Plots {
  constructor(canvas, onTime) {
    this.canvas = canvas;
    this.onTime = onTime;
    this.isShown = false;
    this.now = 0;
    this.clear();
    const seek = (event) => { if (event.buttons & 1) this.brush(event.offsetX); };
    canvas.onpointerdown = (event) => { canvas.setPointerCapture(event.pointerId); seek(event); };
    canvas.onpointermove = seek;
    new ResizeObserver(() => this.draw()).observe(canvas.parentElement);
  }

  clear() {
    this.rows = []; // { name, unit, seconds, value, low, high, status }
    this.events = [];
  }

  take({ probes, poses, events }) {
    const band = (values, stds, sign) => values.map((value, at) => (value === null || stds[at] === null ? null : value + sign * 1.96 * stds[at]));
    const known = (name, unit, values, stds) => ({
      name, unit, seconds: poses.seconds, value: values, low: band(values, stds, -1), high: band(values, stds, 1), status: poses.status,
    });
    this.rows = probes.filter((each) => each.value.some((value) => value !== null));
    this.rows.push(known("height", "m", poses.height_m, poses.height_std_m), known("tilt", "deg", poses.tilt_deg, poses.tilt_std_deg));
    this.events = events;
    this.draw();
  }

  add(seconds, seen) { // what a live station has measured since
    const put = (name, unit, value, low, high, status) => {
      let row = this.rows.find((each) => each.name === name);
      if (!row) this.rows.push(row = { name, unit, seconds: [], value: [], low: [], high: [], status: [] });
      if (row.seconds.at(-1) === seconds) return;
      for (const [key, one] of Object.entries({ seconds, value, low, high, status })) {
        row[key].push(one);
        if (row[key].length > MOST_LIVE) row[key].shift();
      }
    };
    for (const each of seen.measurements) if (each.value !== null || this.rows.some((row) => row.name === each.name)) put(each.name, each.unit, each.value, each.ci95?.[0] ?? null, each.ci95?.[1] ?? null, each.status);
    for (const [name, key, unit] of [["height", "height_agl_m", "m"], ["tilt", "tilt_deg", "deg"]]) {
      const value = seen.pose[key], std = seen.pose.std[key];
      put(name, unit, value, value === null ? null : value - 1.96 * std, value === null ? null : value + 1.96 * std, seen.pose.status);
    }
    this.draw();
  }

  get span() {
    const ends = this.rows.filter((each) => each.seconds.length).flatMap((each) => [each.seconds[0], each.seconds.at(-1)]);
    const first = Math.min(...ends, this.now), last = Math.max(...ends, this.now);
    return [first, Math.max(last, first + 1)];
  }

  brush(x) {
    const [first, last] = this.span, width = this.canvas.clientWidth - LEFT_PX - RIGHT_PX;
    this.onTime(first + Math.min(Math.max((x - LEFT_PX) / width, 0), 1) * (last - first));
  }

  draw() {
    if (!this.isShown) return;
    const { canvas } = this, ratio = devicePixelRatio || 1, height = this.rows.length * ROW_PX + FOOT_PX;
    canvas.style.height = `${height}px`;
    canvas.width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    canvas.height = Math.round(height * ratio);
    const pen = canvas.getContext("2d"), ink = getComputedStyle(document.body).color, [first, last] = this.span;
    const width = canvas.clientWidth - LEFT_PX - RIGHT_PX, x = (seconds) => LEFT_PX + ((seconds - first) / (last - first)) * width;
    pen.scale(ratio, ratio);
    pen.font = "13px system-ui, sans-serif";
    this.rows.forEach((row, number) => this.drawRow(pen, row, number * ROW_PX, x, ink));
    for (const event of this.events) {
      pen.fillStyle = EVENT;
      pen.fillRect(x(event.seconds) - 1, 0, 2, height - FOOT_PX);
    }
    pen.fillStyle = ink;
    pen.fillText(`${first.toFixed(1)} s`, LEFT_PX, height - 5);
    pen.fillText(`${last.toFixed(1)} s`, LEFT_PX + width - 48, height - 5);
    const near = this.events.filter((each) => Math.abs(each.seconds - this.now) < (last - first) / 60)[0];
    pen.fillText(near ? `${near.kind}: ${near.text}`.slice(0, 90) : "95 % bands; orange: no answer; purple: events", LEFT_PX + 80, height - 5);
    pen.fillRect(x(this.now) - 0.75, 0, 1.5, height - FOOT_PX);
  }

  drawRow(pen, row, top, x, ink) {
    const numbers = [...row.low, ...row.high, ...row.value].filter((each) => each !== null).sort((a, b) => a - b);
    const share = (part) => numbers[Math.min(Math.floor(part * numbers.length), numbers.length - 1)];
    const low = share(0.01), high = share(0.99), room = ROW_PX - 22, bottom = top + ROW_PX - 10;
    const y = (value) => bottom - Math.min(Math.max((value - low) / (high - low || 1), -0.05), 1.05) * room;
    const known = row.seconds.map((_, at) => at).filter((at) => row.value[at] !== null);
    pen.fillStyle = ink;
    pen.fillText(row.name.slice(0, 18), 6, top + 24);
    if (numbers.length) {
      const digits = Math.max(0, Math.min(4, 1 - Math.floor(Math.log10(high - low || 1))));
      pen.fillText(`${low.toFixed(digits)} … ${high.toFixed(digits)} ${row.unit}`, 6, top + 44);
    }
    for (let from = 0; from < known.length;) { // a gap in the values is one in the band
      let to = from;
      while (to + 1 < known.length && known[to + 1] === known[to] + 1) to += 1;
      const part = known.slice(from, to + 1);
      pen.fillStyle = BAND;
      pen.beginPath();
      for (const at of part) if (row.high[at] !== null) pen.lineTo(x(row.seconds[at]), y(row.high[at]));
      for (const at of [...part].reverse()) if (row.low[at] !== null) pen.lineTo(x(row.seconds[at]), y(row.low[at]));
      pen.fill();
      pen.strokeStyle = LINE;
      pen.lineWidth = 1.5;
      pen.beginPath();
      for (const at of part) pen.lineTo(x(row.seconds[at]), y(row.value[at]));
      if (part.length === 1) pen.arc(x(row.seconds[part[0]]), y(row.value[part[0]]), 1.5, 0, 7);
      pen.stroke();
      from = to + 1;
    }
    pen.fillStyle = BAD;
    row.status.forEach((status, at) => { if (status !== "ok") pen.fillRect(x(row.seconds[at]) - 1, bottom + 3, 2, 4); });
  }
}
