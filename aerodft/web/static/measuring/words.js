// @ts-check
// Measurements as words: the numbers are those that the program sent, with two digits of their interval.

const FOOT_M = 0.3048, SIGNS = { m2: "m²", deg: "°" };

// ---- numbers with their unit

/**
 * @param {number} value
 * @param {string} unit
 * @param {Units} units
 * @returns {[number, string]}
 */
export function converted(value, unit, units) { // value and sign of the unit that people chose
  if (units === "ft" && unit === "m") return [value / FOOT_M, "ft"];
  if (units === "ft" && unit === "m2") return [value / FOOT_M ** 2, "ft²"];
  return [value, SIGNS[unit] || unit];
}

function rounded(value, interval) { // with two digits of its interval
  const digits = interval > 0 ? Math.min(Math.max(1 - Math.floor(Math.log10(interval)), 0), 6) : 3;
  return value.toFixed(digits).replace(/^-(0(\.0*)?)$/, "$1");
}

/**
 * @param {number} metres
 * @param {Units} units
 * @param {number} interval Of which two digits are shown.
 */
export function lengthText(metres, units, interval = Math.abs(metres) || 1) {
  const [value, sign] = converted(metres, "m", units);
  return `${rounded(value, converted(interval, "m", units)[0])} ${sign}`;
}

/**
 * @param {number} std
 * @param {string} unit
 * @param {Units} units
 */
export function stdText(std, unit, units) {
  const [value, sign] = converted(std, unit, units);
  return `${Number(value.toPrecision(2))} ${sign}`;
}

// ---- measurements

/**
 * @param {Measurement} measurement
 * @param {Units} units
 */
export function valueText(measurement, units) {
  if (measurement.status !== "ok") return refusalText(measurement);
  if (measurement.value === null) return placeText(measurement, units);
  const [value, sign] = converted(measurement.value, measurement.unit, units);
  const [low, high] = (measurement.ci95 || [measurement.value, measurement.value])
    .map((each) => converted(each, measurement.unit, units)[0]);
  const text = (each) => rounded(each, high - low);
  return `${text(value)} ${sign} [${text(low)} … ${text(high)}] 95 %`;
}

/**
 * @param {Measurement} measurement
 * @param {Units} units
 */
function placeText({ ground_m: [[x, y]], ellipse95: ellipse }, units) {
  const spread = ellipse?.semi_major_m, text = (metres) => lengthText(metres, units, spread);
  const side = x < 0 ? `left ${text(-x)}` : `right ${text(x)}`;
  return `${side}, ahead ${text(y)}${spread ? ` ± ${text(spread)} (95 %)` : ""}`;
}

/**
 * @param {{ status: string, reasons: string[] }} refused
 */
export function refusalText({ status, reasons }) {
  return [status.toUpperCase(), reasons.map(plain).join("; ")].filter(Boolean).join(": ");
}

/**
 * @param {Measurement} measurement
 * @param {Units} units
 */
export function labelText(measurement, units) { // short enough to stand in the image
  if (measurement.status !== "ok") return `${measurement.name} ${measurement.status.toUpperCase()}`;
  return measurement.value === null ? measurement.name : `${measurement.name} ${valueText(measurement, units).replace("] 95 %", "]")}`;
}

/**
 * @param {Measurement} measurement
 */
export function quality({ status, value, std, ellipse95, ground_m: ground }) {
  if (status !== "ok") return "refused";
  const share = value === null ? (ellipse95?.semi_major_m ?? 0) / 1.96 / Math.hypot(...ground[0]) : std / Math.abs(value);
  return share >= 0.1 ? "poor" : share >= 0.02 ? "fair" : "good";
}

export const QUALITY_WORDS = { good: "Its std is below 2 %", fair: "Its std is 2 to 10 %", poor: "Its std is above 10 %", refused: "No number" };

/**
 * @param {Reach} river
 * @param {Units} units
 */
export function reachText(river, units) {
  if (!river.width_m) return refusalText(river);
  const { median, ci95, transects } = river.width_m;
  return `${valueText({ status: "ok", reasons: [], value: median, ci95, unit: "m" }, units)}, the median of ${transects} transects.`;
}

// ---- what is known of an image

/**
 * @param {Pose | null} pose
 * @param {Units} units
 */
export function poseText(pose, units) {
  if (!pose) return "The camera's pose is not known yet: mark what you know of the view, or open it with --height and --tilt if they are known.";
  if (pose.status !== "ok") return refusalText(pose);
  const degrees = (value, std) => `${value.toFixed(2)} ± ${std.toPrecision(2)}°`;
  const height = lengthText(pose.height_agl_m, units, pose.std.height_agl_m), std = lengthText(pose.std.height_agl_m, units);
  const level = pose.level ? `, water level ${lengthText(pose.level.level_m, units, pose.level.std_m)} ± ${stdText(pose.level.std_m, "m", units)} (${pose.level.datum}, ${pose.level.source})` : "";
  const age = pose.telemetry_age_s === null ? "" : `, telemetry ${pose.telemetry_age_s.toFixed(2)} s old`;
  return `Height ${height} ± ${std}${pose.height_source ? ` (${pose.height_source})` : ""},`
    + ` tilt ${degrees(pose.tilt_deg, pose.std.tilt_deg)}, heading ${((Math.round(10 * pose.heading_deg) / 10) % 360).toFixed(1)}°${level}${age}; ± is one standard deviation.`;
}

/**
 * @param {[number, number] | null} sampling Metres that a pixel is wide and deep.
 * @param {Units} units
 */
export function samplingText(sampling, units) {
  if (!sampling) return "";
  const [across, down] = sampling.map((metres) => (metres < 0.1 && units === "m"
    ? `${(100 * metres).toPrecision(2)} cm` : lengthText(metres, units)));
  return `a pixel is ${across} wide, ${down} deep`;
}

/**
 * @param {{ at_m: number, axis: string }} line
 * @param {Units} units
 */
export function gridText({ at_m: at, axis }, units) {
  const [ahead, behind] = axis === "right" ? ["right", "left"] : ["ahead", "behind"];
  const [value, sign] = converted(Math.abs(at), "m", units);
  return at === 0 ? `0 ${sign}` : `${Number(value.toPrecision(3))} ${sign} ${at > 0 ? ahead : behind}`;
}

/**
 * @param {string} stampNs
 */
export const clock = (stampNs) => `${new Date(Number(BigInt(stampNs) / 1000000n)).toISOString().slice(11, 19)} UTC`;

/**
 * @param {string} stampNs
 */
export const day = (stampNs) => new Date(Number(BigInt(stampNs) / 1000000n)).toISOString().replace("T", " ").replace("Z", " UTC");

// ---- the program's sentences in the page's words: they name parameters and keys that nobody sees here

/** @type {[RegExp, any][]} A text, or a function that makes one. */
const PAGE_WORDS = [
  [/what you know of the camera under \[camera\]/g, "a height, a length, a vertical or the horizon"],
  [/take it with stds scaled up by `accept_misfit`/g, "take it with wider intervals, below"],
  [/ \(hidden_m_per_m\)/g, ""],
  [/elevation_m in the file states another/g, "what is typed below states another"],
  [/add focal to `unknowns`/g, "find the focal length too, below"],
  [/`calibrate_lens`/g, "aerodft calibrate-lens"],
  [/`request_messages`/g, "aerodft doctor --request-messages"],
  [/`([a-z_]+)`/g, (_, name) => name.replace(/_(m|px|deg|s|ns|hz)$/, "").replaceAll("_", " ")],
];

/**
 * @param {string} sentence
 */
export const plain = (sentence) => PAGE_WORDS.reduce((text, [from, to]) => text.replace(from, to), sentence);

/**
 * @param {string} text
 */
export const handText = (text) => (matchMedia("(pointer: coarse)").matches // fingers tap
  ? text.replaceAll("click", "tap").replaceAll("Click", "Tap") : text);

// ---- what is typed

const typedWords = (text = "") => text.split(/[\s;]+/).filter(Boolean).map((word) => word.replace(/,$/, ""));
const isPointName = (word = "") => word.startsWith("@"); // of a surveyed point, which has the height

/**
 * Pixels of a mark; "u,v@NAME" where a surveyed point's name is typed for a height.
 * @param {Mark} mark
 * @returns {(Pixel | string)[]}
 */
export const endsOf = ({ points, heights = {} }) => {
  const words = typedWords(heights.elevation_m);
  return points.map(([u, v], at) => (isPointName(words[at]) ? `${u},${v}${words[at]}` : [u, v]));
};

/**
 * @param {{ heights?: Record<string, string> }} mark
 * @returns {Record<string, number | number[]>}
 */
export function heightsOf({ heights = {} }) { // one number, or one for each point without a name; null for what is no number
  const numbers = (text) => typedWords(text).filter((word) => !isPointName(word)).map((word) => Number(word.replace(",", ".")));
  return Object.fromEntries(Object.entries(heights).map(([key, text]) => [key, numbers(text)])
    .filter(([, several]) => several.length).map(([key, several]) => [key, several.length > 1 ? several : several[0]]));
}

// ---- what is taken along

/**
 * @param {string} form
 * @param {Mark} mark
 * @param {Units} units
 */
export function copyText(form, mark, units) {
  const { name, kind, found } = mark;
  if (form === "json") {
    const { budget, advice, command, geojson, ...measurement } = found;
    return JSON.stringify(measurement, null, 2);
  }
  if (form === "command") return found.command;
  if (form === "geojson") return found.geojson || "Nobody knows where on the map this is: the pose has no place.";
  if (form === "text") return `${name}: ${valueText(found, units)}`;
  const pixels = endsOf(mark).map((end) => (typeof end === "string" ? JSON.stringify(end) : `[${end.join(", ")}]`)).join(", ");
  const heights = Object.entries(heightsOf(mark)).map(([key, value]) => `${key} = ${JSON.stringify(value)}\n`).join("");
  return `[[probe]]\nname = "${name}"\nkind = "${kind}"\npixels = [${pixels}]\n${heights}`;
}
