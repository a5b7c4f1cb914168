// @ts-check
// The connection to the program that measures. Of several questions of one topic only the newest is asked.

const MOST_BYTES = 64_000; // the program hears no longer message

export class Link {
  constructor(onState) {
    this.onState = onState;
    this.waiting = new Map(); // topic: question that is not asked yet
    this.asked = null;
    this.number = 0;
    this.open();
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    this.socket = new WebSocket(`${scheme}//${location.host}/measure`);
    this.socket.onopen = () => { this.onState(true); this.next(); };
    this.socket.onmessage = (event) => {
      const answer = JSON.parse(event.data), asked = this.asked;
      this.asked = null;
      this.next();
      if (asked && answer.id === asked.id) asked.done(answer);
    };
    this.socket.onclose = () => {
      this.onState(false);
      if (this.asked && !this.waiting.has(this.asked.topic)) this.waiting.set(this.asked.topic, this.asked);
      this.asked = null;
      setTimeout(() => this.open(), 1000);
    };
  }

  ask(topic, question, done) {
    const size = new TextEncoder().encode(JSON.stringify(question)).length;
    if (size > MOST_BYTES) return done({ error: `That is too much at once: ${Math.ceil(size / 1000)} kB, at most ${MOST_BYTES / 1000}.` });
    this.waiting.delete(topic);
    this.waiting.set(topic, { topic, question, done });
    this.next();
  }

  next() {
    if (this.asked || this.socket.readyState !== WebSocket.OPEN || !this.waiting.size) return;
    const [topic, asked] = this.waiting.entries().next().value;
    this.waiting.delete(topic);
    this.asked = { ...asked, id: ++this.number };
    this.socket.send(JSON.stringify({ ...asked.question, id: this.asked.id }));
  }
}
