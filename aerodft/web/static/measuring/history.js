// @ts-check
// What people did, step by step, so that they can take it back. A part has a state that can be read and set.

const MOST_STEPS = 200;

export class History {
  constructor(onChange) {
    this.onChange = onChange;
    this.parts = [];
    this.past = [];
  }

  keep() {
    const now = JSON.stringify(this.parts.map((part) => part.state));
    if (now === this.past.at(-1)) return;
    this.past.push(now);
    if (this.past.length > MOST_STEPS) this.past.shift();
    this.onChange();
  }

  undo() {
    if (!this.past.length) return;
    const states = JSON.parse(this.past.pop());
    this.parts.forEach((part, index) => { part.state = states[index]; });
    this.onChange();
  }
}
