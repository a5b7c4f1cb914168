// @ts-check
// The newest image of a station that measures. While one is drawn the next is waited for, and no more pile up.

const AGAIN_MS = 1000;

export class Live {
  constructor(onNews, onState) {
    this.onNews = onNews;
    this.onState = onState;
    this.after = "";
  }

  async follow() {
    let drawn = null;
    for (;;) {
      try {
        const answer = await fetch(`news.json?after=${this.after}`);
        if (!answer.ok) throw new Error(await answer.text());
        const news = await answer.json();
        await drawn;
        drawn = this.onNews(news);
        this.after = String(news.image?.number ?? -1);
        this.onState(true);
      } catch {
        drawn = null;
        this.onState(false);
        await new Promise((resolve) => { setTimeout(resolve, AGAIN_MS); });
      }
    }
  }
}
