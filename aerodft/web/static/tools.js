// @ts-check
// What can be taken in hand or pressed: its label, its title, its key, and what to do with it. The buttons are made from this.

/** @type {Record<string, ToolWords>} How many points a measure takes, and whether they are closed, is the program's to say. */
export const MEASURES = {
  width: { label: "Width", title: "Width: two banks", key: "w", help: "Click two banks." },
  distance: { label: "Distance", title: "Distance: two points", key: "d", help: "Click two points on the ground." },
  length: { label: "Path", title: "Path: double-click or Enter ends it", key: "l", help: "Click along the path; a double-click ends it." },
  area: { label: "Area", title: "Area: double-click or Enter ends it", key: "a", help: "Click around the area; a double-click ends it." },
  height: { label: "Height", title: "Height: base, then top", key: "h", help: "Click the base, on the ground, then the top." },
  position: { label: "Point", title: "Point", key: "p", help: "Click a point on the ground." },
};

/** @type {Record<string, ToolWords>} */
export const DRAWN = {
  landmark: {
    label: "Camera's pose", title: "Find the camera's pose from landmarks", key: "m",
    help: "Mark what you know of the view, and type where or how long it is.",
  },
  water: { label: "water", help: "Draw over what is water." },
  land: { label: "land", help: "Draw over what is land." },
};

/** @type {Record<string, ToolWords>} By the id of their button. */
export const PRESSED = {
  grid: { label: "Grid", title: "Grid, horizon and sampling distance", key: "g" },
  river: { label: "River", title: "River: water, banks and widths", key: "r" },
  plot: { label: "Over time", title: "Values over time", key: "t" },
  whole: { label: "Whole image", title: "Show the whole image", key: "0" },
  before: { label: "◀", title: "Image before", key: "," },
  play: { label: "▶", title: "Play", key: " " },
  after: { label: "▶▏", title: "Image after", key: "." },
};

const KEY_NAMES = { " ": "space" };

/**
 * Title of a button: what it does, and its key in brackets.
 * @param {ToolWords} words
 */
export function titleText({ title = "", key }) {
  return [title, key ? `(${KEY_NAMES[key] || key.toUpperCase()})` : ""].filter(Boolean).join(" ");
}
