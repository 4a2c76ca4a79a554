// A plot of the page that can be worked with.

class View {
  constructor(figure, svg) {
    this.figure = figure;
    this.still = svg;
    this.plot = data.plots[svg.dataset.plot];
    this.title = this.plot.t;
    this.range = [this.plot.x[0], this.plot.x[1]];
    this.hidden = new Set();
    this.box = document.createElement('div');
    this.box.className = 'live';
    this.box.tabIndex = 0;
    this.box.setAttribute('role', 'group');
    this.box.setAttribute('aria-label', this.title + ': arrow keys show values');
    svg.before(this.box);
    svg.classList.add('still');
    this.tip = document.createElement('div');
    this.tip.className = 'tip';
    this.tip.hidden = true;
    figure.append(this.tip);
    this.tools();
    this.events();
    this.draw();
  }

  zoomed() { return this.range[0] !== this.plot.x[0] || this.range[1] !== this.plot.x[1]; }
  x() { return axis(this.range[0], this.range[1], this.plot.x[2]); }

  tools() {
    const bar = document.createElement('div');
    bar.className = 'tools';
    const add = (text, label, act) => {
      const button = document.createElement('button');
      button.type = 'button';
      button.textContent = text;
      button.title = label;
      button.setAttribute('aria-label', label + ': ' + this.title);
      button.dataset.act = label;
      button.addEventListener('click', act);
      bar.append(button);
      return button;
    };
    add('+', 'zoom in', () => this.scale(0.5, 0.5));
    add('\u2212', 'zoom out', () => this.scale(2, 0.5));
    add('\u25c0', 'earlier', () => this.shift(-0.25));
    add('\u25b6', 'later', () => this.shift(0.25));
    this.whole = add('all', 'whole range', () => this.show(this.plot.x[0], this.plot.x[1]));
    add('PNG', 'save as PNG', () => this.png());
    add('CSV', 'save as CSV', () => save(this.name() + '.csv', new Blob([this.csv()], {type: 'text/csv'})));
    this.box.before(bar);
  }

  name() { return (document.title + ' ' + this.title).replace(/[^A-Za-z0-9]+/g, '-').replace(/^-+|-+$/g, '').toLowerCase(); }

  // All plots over the same axis move together.
  show(low, high) {
    const [l, h, log] = this.plot.x;
    if (!(high > low) || !isFinite(low) || !isFinite(high)) return;
    const place = axis(l, h, log).place, least = 1e-5;
    if (place(high) - place(low) < least) return;
    low = Math.max(l, low);
    high = Math.min(h, high);
    for (const view of views)
      if (view === this || (view.plot.xl === this.plot.xl && view.plot.x.join() === this.plot.x.join())) {
        view.range = [low, high];
        view.draw();
      }
  }

  scale(by, at) {
    const a = this.x(), low = a.back(at - at * by), high = a.back(at + (1 - at) * by);
    this.show(low, high);
  }

  shift(by) {
    const whole = axis(...this.plot.x), a = this.x();
    const from = whole.place(a.low), to = whole.place(a.high), step = by * (to - from);
    const moved = Math.max(-from, Math.min(1 - to, step));
    this.show(whole.back(from + moved), whole.back(to + moved));
  }

  visible(p, s) { return !this.hidden.has(p + ':' + s); }
}

Object.assign(View.prototype, arrangement, drawing, pointing, saving);
