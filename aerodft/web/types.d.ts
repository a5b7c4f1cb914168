// What crosses the connection to the program, and what the parts of the page give each other.

type Pixel = [number, number]; // u, v: (0, 0) is the middle of the top-left pixel
type Units = "m" | "ft";

interface Measurement {
  name?: string;
  kind?: string;
  status: string; // "ok", or why there is no value
  reasons: string[];
  value: number | null; // null of a place
  unit?: string;
  std?: number | null;
  ci95?: [number, number] | null;
  ellipse95?: { semi_major_m: number } | null;
  ground_m?: number[][]; // right and ahead of the camera, up
  enu_m?: number[][];
  pixels?: [number | null, number | null][];
  budget?: { source: string; share: number; std: number }[];
  advice?: string;
  command?: string;
  geojson?: string;
}

interface Mark {
  name: string;
  kind: string;
  points: Pixel[];
  colour: string;
  heights?: Record<string, string>; // as typed
  found: Measurement | null;
  before?: Measurement | null; // before the pose was changed
}

interface Pose {
  status: string;
  reasons: string[];
  height_agl_m: number;
  height_source: string | null;
  tilt_deg: number;
  heading_deg: number;
  telemetry_age_s: number | null;
  level?: { level_m: number; std_m: number; datum: string; source: string } | null;
  std: { height_agl_m: number; tilt_deg: number };
}

interface Reach { // a river in an image
  status: string;
  reasons: string[];
  width_m: { median: number; ci95: [number, number]; transects: number } | null;
}

interface Shape { // see stage/picture.js
  points?: Pixel[];
  rings?: Pixel[][];
  colour: string;
  style?: "mark" | "line" | "arrow" | "dashed" | "thin" | "fill";
  closed?: boolean;
  label?: string;
  tag?: string;
}

interface ToolWords { // see tools.js
  label: string;
  title?: string;
  key?: string;
  help?: string;
}

interface ElementOfId { // those of the page that are more than an HTMLElement
  accept: HTMLInputElement;
  above: HTMLDetailsElement;
  after: HTMLButtonElement;
  before: HTMLButtonElement;
  copied: HTMLTextAreaElement;
  end: HTMLButtonElement;
  evidence: HTMLSelectElement;
  export: HTMLAnchorElement;
  focal: HTMLInputElement;
  grid: HTMLButtonElement;
  heights: HTMLInputElement;
  "heights-std": HTMLInputElement;
  image: HTMLCanvasElement;
  list: HTMLTextAreaElement;
  "list-file": HTMLInputElement;
  loop: HTMLInputElement;
  loupe: HTMLCanvasElement;
  map: HTMLCanvasElement;
  others: HTMLSelectElement;
  parameters: HTMLTableElement;
  plane: HTMLInputElement;
  play: HTMLButtonElement;
  plot: HTMLButtonElement;
  plots: HTMLCanvasElement;
  profile: HTMLCanvasElement;
  river: HTMLButtonElement;
  seek: HTMLInputElement;
  speed: HTMLSelectElement;
  undo: HTMLButtonElement;
  units: HTMLSelectElement;
  use: HTMLButtonElement;
  well: HTMLDetailsElement;
  whole: HTMLButtonElement;
}
