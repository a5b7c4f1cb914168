// @ts-check
// Whether the station is well: alerts that stay until somebody has seen them, what it says of itself, and what doctor says.

import { element } from "../elements.js";
import { clock, plain } from "../measuring/words.js";

const DOCTOR_AGAIN_MS = 10_000;

export class Health {
  constructor({ alerts, list, doctor, details }) {
    this.box = alerts;
    this.list = list;
    this.doctor = doctor;
    this.details = details;
    this.alerts = new Map(); // key and since: text, whether it lasts
    this.dismissed = new Set();
    details.ontoggle = () => { if (details.open) this.ask(); };
  }

  // ---- alerts

  take({ alerts, status, image, disk }) { // news of a live station
    this.isLive = true;
    for (const each of this.alerts.values()) each.lasts = false;
    for (const { key, since_ns: since, text } of alerts) {
      const id = `${key} ${since}`;
      if (!this.dismissed.has(id)) this.alerts.set(id, { text, since, lasts: true });
    }
    this.drawAlerts();
    this.list.replaceChildren(...rowsOf(status, image?.pose, disk).flatMap(([name, value]) => [element("dt", name), element("dd", value)]));
  }

  drawAlerts() {
    const shown = JSON.stringify([...this.alerts]);
    if (shown === this.shown) return; // nothing moves under a finger
    this.shown = shown;
    this.box.hidden = !this.alerts.size;
    this.box.replaceChildren(...[...this.alerts].map(([id, { text, since, lasts }]) => {
      const when = [since === "0" ? "" : `since ${clock(since)}`, lasts ? "" : "over now"].filter(Boolean).join(", ");
      const row = element("p", `${plain(text)} ${when && `(${when})`} `), seen = element("button", "Seen");
      seen.onclick = () => { this.dismissed.add(id); this.alerts.delete(id); this.drawAlerts(); };
      row.append(seen);
      return row;
    }));
  }

  // ---- doctor

  async ask() { // while somebody looks
    if (!this.doctor.children.length) this.doctor.replaceChildren(element("p", "Reading the telemetry …"));
    const answer = await fetch("doctor.json").catch(() => null), found = answer?.ok ? await answer.json() : null;
    const said = JSON.stringify(found);
    if (said !== this.said) this.doctor.replaceChildren(...(found ? diagnosis(found) : [element("p", "No telemetry, nothing to say.")]));
    this.said = said;
    clearTimeout(this.again);
    if (this.details.open && this.isLive) this.again = setTimeout(() => this.ask(), DOCTOR_AGAIN_MS);
  }
}

function rowsOf(status, pose, disk) {
  const rows = [["Height from", pose?.height_source ? `${pose.height_source}${pose.telemetry_age_s === null ? "" : `, ${pose.telemetry_age_s.toFixed(1)} s old`}` : "not known yet"]];
  if (disk) rows.push(["Disk", `${(disk.free_bytes / 1e9).toFixed(1)} GB free`]);
  if (!status) return rows;
  const { text, counts, health } = status, count = (...names) => names.reduce((sum, name) => sum + (counts[name] ?? 0), 0);
  rows.unshift(["State", text], ["Images", `${count("images")} measured`]);
  rows.push(["Recorder", `${count("recorded_messages")} messages, ${count("recorded_images")} images; lost `
    + `${count("shed_messages", "lost_messages")} and ${count("shed_images", "lost_images")}`]);
  if (!health) return rows;
  const ages = Object.entries(health.ages_s).map(([name, age]) => `${name} ${age.toFixed(1)} s`).join(", ");
  rows.push(["Link", `${health.link.received} frames, ${health.link.lost} lost in the last seconds`], ["Telemetry's age", ages || "none yet"]);
  rows.push(["GPS", health.gps.fix === null ? "not heard" : `fix ${health.gps.fix}, ${health.gps.satellites ?? "?"} satellites`]);
  return rows;
}

function diagnosis({ clock: seconds, problems, notes }) { // what is wrong first, the rest for whoever asks
  const more = folded(`${notes.length} remarks`, notes.map((each) => element("p", plain(each))));
  more.className = "remarks";
  return [
    ...(seconds === null ? [] : [element("p", `Clock: telemetry arrives ${seconds.toFixed(3)} s after its UTC`)]),
    element("h3", problems.length ? `${problems.length} to mend` : "Nothing to mend"),
    ...problems.map((each) => {
      const [what, ...how] = plain(each).split(": ");
      return folded(what, how.length ? [element("p", how.join(": "))] : []);
    }),
    ...(notes.length ? [more] : []),
  ];
}

function folded(title, content) {
  const made = element("details");
  made.append(element("summary", title), ...content);
  return made;
}
