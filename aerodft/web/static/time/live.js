// The newest image of a station that measures. There is one question at a time, so that nothing piles up.

const AGAIN_MS = 1000;

export class Live {
  constructor(onNews, onState) {
    this.onNews = onNews;
    this.onState = onState;
    this.after = "";
  }

  async follow() {
    for (;;) {
      try {
        const answer = await fetch(`news.json?after=${this.after}`);
        if (!answer.ok) throw new Error(await answer.text());
        const news = await answer.json();
        this.after = String(news.image?.number ?? -1);
        this.onState(true);
        await this.onNews(news);
      } catch {
        this.onState(false);
        await new Promise((resolve) => { setTimeout(resolve, AGAIN_MS); });
      }
    }
  }
}
