// Measurements as words: the numbers are those that the program sent, with two digits of their interval.

const FEET = { m: ["ft", 1 / 0.3048], m2: ["ft²", 1 / 0.3048 ** 2] }, SIGNS = { m2: "m²", deg: "°" };

export function valueText(measurement, units) {
  if (measurement.status !== "ok") return refusalText(measurement);
  if (measurement.value === null) {
    const [x, y] = measurement.ground_m[0], ellipse = measurement.ellipse95;
    const spread = ellipse ? ` ± ${number(ellipse.semi_major_m, ellipse.semi_major_m)} m (95 %)` : "";
    return `right ${number(x, ellipse?.semi_major_m)} m, ahead ${number(y, ellipse?.semi_major_m)} m${spread}`;
  }
  const [unit, factor] = (units === "ft" && FEET[measurement.unit]) || [SIGNS[measurement.unit] || measurement.unit, 1];
  const [low, high] = (measurement.ci95 || [measurement.value, measurement.value]).map((each) => each * factor);
  return `${number(measurement.value * factor, high - low)} ${unit} [${number(low, high - low)} … ${number(high, high - low)}] 95 %`;
}

export function refusalText(measurement) {
  return `${measurement.status.toUpperCase()}: ${measurement.reasons.join("; ")}`;
}

export function quality(measurement) {
  if (measurement.status !== "ok") return "refused";
  if (!measurement.value || !measurement.std) return "good";
  const share = measurement.std / Math.abs(measurement.value);
  return share < 0.02 ? "good" : share < 0.1 ? "fair" : "poor";
}

export function poseText(pose) {
  if (!pose) return "The camera's pose is not known yet: place landmarks.";
  if (pose.status !== "ok") return `${pose.status.toUpperCase()}: ${pose.reasons.join("; ")}`;
  const std = (name) => pose.std[name].toPrecision(2), source = pose.height_source ? ` (${pose.height_source})` : "";
  const age = pose.telemetry_age_s === null ? "" : `, telemetry ${pose.telemetry_age_s.toFixed(2)} s old`;
  return `Height ${pose.height_agl_m.toFixed(2)} ± ${std("height_agl_m")} m${source}, tilt ${pose.tilt_deg.toFixed(2)} ± ${std("tilt_deg")}°,`
    + ` heading ${pose.heading_deg.toFixed(1)}°${age} (± is one standard deviation)`;
}

export function samplingText([across, down]) {
  const metres = (value) => (value < 0.1 ? `${(100 * value).toPrecision(2)} cm` : `${value.toPrecision(2)} m`);
  return `a pixel is ${metres(across)} wide, ${metres(down)} deep`;
}

export function reachText(river, units) {
  if (!river.width_m) return refusalText(river);
  const { median, ci95, transects } = river.width_m;
  const value = valueText({ status: "ok", value: median, ci95, unit: "m" }, units);
  return `${value}, the median of ${transects} transects. ${river.reasons.join("; ")}`;
}

function number(value, interval) {
  const digits = interval > 0 ? Math.min(Math.max(1 - Math.floor(Math.log10(interval)), 0), 6) : 3;
  return (Math.round(value * 10 ** digits) / 10 ** digits || 0).toFixed(digits); // no -0
}

export function copyText(form, measurement, units) {
  if (form === "json") return JSON.stringify(measurement, null, 2);
  if (form === "command") return measurement.command;
  if (form === "geojson") return measurement.geojson || "Nobody knows where on the map this is: the pose has no place.";
  if (form === "probe") {
    const pixels = measurement.pixels.map(([u, v]) => `[${u}, ${v}]`).join(", ");
    return `[[probe]]\nname = "${measurement.name}"\nkind = "${measurement.kind}"\npixels = [${pixels}]\n`;
  }
  return `${measurement.name}: ${valueText(measurement, units)}`;
}
