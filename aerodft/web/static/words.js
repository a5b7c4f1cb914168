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

export function reachText(river, units) {
  if (!river.width_m) return refusalText(river);
  const { median, ci95, transects } = river.width_m;
  const value = valueText({ status: "ok", value: median, ci95, unit: "m" }, units);
  return `${value}, the median of ${transects} transects. ${river.reasons.join("; ")}`;
}

function number(value, interval) {
  const digits = interval > 0 ? Math.min(Math.max(1 - Math.floor(Math.log10(interval)), 0), 6) : 3;
  return value.toFixed(digits);
}

export function copyText(form, measurement, units) {
  if (form === "json") return JSON.stringify(measurement, null, 2);
  if (form === "command") return measurement.command;
  if (form === "probe") {
    const pixels = measurement.pixels.map(([u, v]) => `[${u}, ${v}]`).join(", ");
    return `[[probes]]\nname = "${measurement.name}"\nkind = "${measurement.kind}"\npixels = [${pixels}]\n`;
  }
  return `${measurement.name}: ${valueText(measurement, units)}`;
}
