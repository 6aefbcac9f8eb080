// What the reader looks at, kept in the address's hash so that a link shows the same.

const FLAGS = { planned: false, heightmap: false, xray: false, walls: true, sizes: true };

export class State {
  constructor(steps) {
    this.steps = steps;
    this.listeners = [];
    this.hidden = new Set();
    this.values = { step: steps, select: null, ...FLAGS };
    this.read();
  }

  get step() { return this.values.step; }

  /** Index of the item that is highlighted: the selected one, else the one placed last; -1 for none. */
  get focus() { return this.values.select ?? this.values.step - 1; }

  flag(name) { return this.values[name]; }

  read() {
    const given = new URLSearchParams(location.hash.slice(1));
    const number = (key, low, fallback) => {
      const value = Number.parseInt(given.get(key), 10);
      return Number.isNaN(value) ? fallback : Math.min(this.steps, Math.max(low, value));
    };
    this.values.step = number('step', 0, this.values.step);
    const select = this.steps ? number('select', 1, null) : null;
    this.values.select = select === null ? null : select - 1;
    for (const key of Object.keys(FLAGS)) if (given.has(key)) this.values[key] = given.get(key) !== '0';
    this.view = given.get('view') ?? 'iso';
  }

  write() {
    const words = [`step=${this.values.step}`];
    if (this.values.select !== null) words.push(`select=${this.values.select + 1}`);
    for (const [key, usual] of Object.entries(FLAGS)) {
      if (this.values[key] !== usual) words.push(`${key}=${this.values[key] ? 1 : 0}`);
    }
    try {
      history.replaceState(null, '', `#${words.join('&')}`);
    } catch {
      // A page inside a frame may not touch its address; it works without.
    }
  }

  set(changes) {
    const before = { ...this.values };
    Object.assign(this.values, changes);
    this.values.step = Math.min(this.steps, Math.max(0, this.values.step));
    // A selection that is not placed yet cannot be shown, and a step of the reader's own ends the selection.
    if ('step' in changes && !('select' in changes)) this.values.select = null;
    this.write();
    this.tell(before);
  }

  toggle(name) { this.set({ [name]: !this.values[name] }); }

  select(index) {
    if (this.values.select === index) this.set({ select: null });
    else this.set({ select: index, step: Math.max(this.values.step, index + 1) });
  }

  toggleHidden(index) {
    if (!this.hidden.delete(index)) this.hidden.add(index);
    this.tell({ ...this.values });
  }

  onChange(listener) { this.listeners.push(listener); }

  tell(before) { for (const listener of this.listeners) listener(this, before); }
}
