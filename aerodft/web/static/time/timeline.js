// @ts-check
// Which image is shown, and when: seek, step and play a recording; follow a live station, or stop while it goes on.

import { find } from "../elements.js";
import { clock, day } from "../measuring/words.js";
import { Live } from "./live.js";

export class Timeline {
  constructor(view, plots, { show, onNews, onLink }) {
    this.view = view;
    this.plots = plots;
    this.show = show;
    this.onNews = onNews;
    this.onLink = onLink;
    this.target = 0; // the image that is on its way, or shown
    this.playing = null; // a timer, or true of a live station
    this.startSeconds = null; // of a live station: when its first news came
    const { images, is_live: isLive, is_recording: isRecording } = view;
    find("time").hidden = images.length < 2 && !isLive;
    find("plot").hidden = !isLive && !isRecording;
    for (const id of ["before", "after", "seek", "looping", "pace"]) find(id).hidden = isLive;
    find("seek").max = String(images.length - 1);
    find("seek").oninput = () => this.seek(Number(find("seek").value));
    plots.onTime = (seconds) => this.seek(this.nearest(seconds));
  }

  // ---- a recording

  step(by) {
    return this.seek(this.target + by);
  }

  async seek(wanted) {
    if (this.view.is_live) return;
    const { images } = this.view;
    this.target = Math.min(Math.max(wanted, 0), images.length - 1);
    const { stamp_ns: stamp, seconds } = images[this.target];
    find("seek").value = String(this.target);
    const isDated = stamp !== "0";
    find("when").textContent = `image ${this.target + 1} of ${images.length}, ${seconds.toFixed(3)} s${isDated ? `, ${clock(stamp)}` : ""}`;
    find("when").title = isDated ? day(stamp) : "";
    this.plots.at(seconds);
    await this.show(this.target, { hasPicture: true });
  }

  nearest(seconds) { // number of the image at that time
    const { images } = this.view;
    let low = 0, high = images.length - 1;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (images[middle].seconds < seconds) low = middle + 1;
      else high = middle;
    }
    return low > 0 && seconds - images[low - 1].seconds < images[low].seconds - seconds ? low - 1 : low;
  }

  play() {
    find("play").textContent = this.playing ? "▶" : "❚❚";
    find("play").setAttribute("aria-label", this.playing ? "Play" : "Pause");
    if (!this.view.is_live) clearTimeout(this.playing);
    this.playing = this.playing ? null : this.view.is_live || setTimeout(() => this.advance(), 0);
  }

  pause() {
    if (this.playing) this.play();
  }

  async advance() { // to the next image, and then to the one that is due
    const { images } = this.view, began = performance.now(), from = this.target;
    if (from + 1 >= images.length && !find("loop").checked) return this.play();
    const next = from + 1 < images.length ? from + 1 : 0, pace = Number(find("speed").value);
    const spent = () => ((performance.now() - began) / 1000) * pace;
    await this.seek(next);
    if (!this.playing) return;
    const due = images[next].seconds - images[from].seconds;
    let skipped = next; // what is shown too late anyhow
    while (skipped + 1 < images.length && images[skipped + 1].seconds - images[from].seconds < spent()) skipped += 1;
    this.target = skipped;
    this.playing = setTimeout(() => this.advance(), Math.max(((due - spent()) * 1000) / pace, 0));
  }

  // ---- a live station

  follow() {
    this.play();
    new Live((news) => this.take(news), this.onLink).follow();
  }

  async take(news) {
    this.onNews(news);
    const { image } = news;
    if (!image) { find("when").textContent = find("loading").textContent = "Waiting for the station's first image …"; return; }
    const seconds = Number(BigInt(image.stamp_ns) / 1000000n) / 1000;
    this.startSeconds ??= seconds;
    this.plots.add(seconds - this.startSeconds, image);
    this.plots.at(seconds - this.startSeconds);
    if (this.playing && image.number !== this.target) {
      this.target = image.number;
      await this.show(image.number, { hasPicture: image.has_picture, seen: image });
    }
    find("when").textContent = this.playing ? `image ${image.number}, ${clock(image.stamp_ns)}`
      : `stopped at image ${this.target}; the station goes on (${clock(image.stamp_ns)})`;
  }
}
