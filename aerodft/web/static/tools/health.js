// Whether the station is well: alerts that stay until somebody has seen them, and what it says of itself.

export class Health {
  constructor(alerts, list) {
    this.box = alerts;
    this.list = list;
    this.alerts = new Map(); // key and since: text, whether it lasts
    this.dismissed = new Set();
  }

  take({ alerts, status }) {
    for (const each of this.alerts.values()) each.lasts = false;
    for (const { key, since_ns: since, text } of alerts) {
      const id = `${key} ${since}`;
      if (!this.dismissed.has(id)) this.alerts.set(id, { text, since, lasts: true });
    }
    this.drawAlerts();
    if (status) this.drawStatus(status);
  }

  drawAlerts() {
    const shown = [...this.alerts].map(([id, { text, since, lasts }]) => `${id}|${lasts}|${text}|${since}`).join();
    if (shown === this.shown) return;
    this.shown = shown;
    this.box.hidden = !this.alerts.size;
    this.box.replaceChildren(...[...this.alerts].map(([id, { text, since, lasts }]) => {
      const row = document.createElement("p"), seen = document.createElement("button");
      const when = since === "0" ? "" : ` (since ${clock(since)}${lasts ? "" : ", over now"})`;
      row.textContent = `${text}${when} `;
      seen.textContent = "Seen";
      seen.onclick = () => { this.dismissed.add(id); this.alerts.delete(id); this.drawAlerts(); };
      row.append(seen);
      return row;
    }));
  }

  drawStatus({ text, counts, health }) {
    const rows = [["State", text], ["Images", `${counts.images ?? 0} measured`]];
    if (health) {
      const ages = Object.entries(health.ages_s).map(([name, age]) => `${name} ${age.toFixed(1)} s`).join(", ");
      rows.push(["Link", `${health.link.received} frames, ${health.link.lost} lost in the last seconds`], ["Telemetry's age", ages || "none yet"]);
      rows.push(["GPS", health.gps.fix === null ? "not heard" : `fix ${health.gps.fix}, ${health.gps.satellites ?? "?"} satellites`]);
    }
    const lost = (counts.shed_messages ?? 0) + (counts.lost_messages ?? 0), gone = (counts.shed_images ?? 0) + (counts.lost_images ?? 0);
    rows.push(["Recorder", `${counts.recorded_messages ?? 0} messages, ${counts.recorded_images ?? 0} images; lost ${lost} and ${gone}`]);
    this.list.replaceChildren(...rows.flatMap(([name, value]) => {
      const term = document.createElement("dt"), said = document.createElement("dd");
      term.textContent = name;
      said.textContent = value;
      return [term, said];
    }));
  }
}

export function clock(stampNs) {
  return `${new Date(Number(BigInt(stampNs) / 1000000n)).toISOString().slice(11, 19)} UTC`;
}
