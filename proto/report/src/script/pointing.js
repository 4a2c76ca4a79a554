// Values under the pointer, a finger or the keyboard's line, and zoom by them: methods of a view.

const pointing = {
  // The point of a series that stands for a place of the x axis: the nearest one, of a series that holds its values the
  // last one. -1 where nothing is drawn: before the series, behind it, and in a gap.
  nearest(s, at) {
    const x = array(s.x), y = array(s.y), sound = k => k >= 0 && k < x.length && isFinite(y[k]) && isFinite(x[k]);
    let best = -1, gap = Infinity;
    for (let k = 0; k < x.length; k++) {
      const d = Math.abs(x[k] - at);
      if (d < gap && sound(k)) { gap = d; best = k; }
    }
    if (best < 0) return best;
    if (this.plot.names) return Math.round(x[best]) === Math.round(at) ? best : -1;
    const other = x[best] < at ? best + 1 : best - 1, between = s.k !== 'dots' && sound(other) && (x[other] - at) * (x[best] - at) <= 0;
    if (s.step && between && x[best] > at) best = other;
    const g = this.geometry, X = this.x();
    return between || Math.abs(X.place(x[best]) - X.place(at)) * (g.right - g.left) <= REACH ? best : -1;
  },

  // What stands under a place of the x axis, for each panel and series.
  under(at) {
    const g = this.geometry;
    return g.panels.map(({panel, p, y}) => {
      const span = y.high - y.low, rows = [];
      panel.s.forEach((s, i) => {
        if (!this.visible(p, i) || s.k === 'level' || s.k === 'moment') return;
        if (s.k === 'span') { if (s.n && at >= s.from && at <= s.to) rows.push({s, text: ''}); return; }
        if (s.k === 'bars') {
          const b = s.counts.findIndex((_, k) => at >= s.edges[k] && at < s.edges[k + 1]);
          if (b >= 0) rows.push({s, text: `${s.counts[b]} from ${+s.edges[b].toPrecision(3)} to ${+s.edges[b + 1].toPrecision(3)}`});
          return;
        }
        const x = array(s.x), best = this.nearest(s, at);
        if (best < 0 || !(x[best] >= this.range[0] && x[best] <= this.range[1])) return;
        const v = array(s.y)[best];
        rows.push({s, v, x: s.step ? at : x[best], text: s.y2 === undefined ? value(v, span) : `${value(v, span)} \u2026 ${value(array(s.y2)[best], span)}`});
      });
      return {panel, rows};
    });
  },

  point(event) {
    const box = this.svg.getBoundingClientRect(), g = this.geometry;
    const x = (event.clientX - box.left) * g.width / box.width, y = (event.clientY - box.top) * g.width / box.width;
    // Not above the first panel: what would stand there hides the names that are being clicked.
    const inside = x >= g.left && x <= g.right && y >= g.panels[0].top && y <= g.panels[g.panels.length - 1].bottom + 4;
    return {x, y, inside, share: Math.max(0, Math.min(1, (x - g.left) / (g.right - g.left)))};
  },

  hover(event) {
    const at = this.point(event), g = this.geometry, X = this.x();
    if (!at.inside) return this.leave();
    const v = X.back(at.share), found = this.under(v), px = w => g.left + (g.right - g.left) * X.place(w);
    const snapped = found.flatMap(f => f.rows).find(r => r.x !== undefined && !r.s.step);
    const shown = this.plot.names ? (this.plot.names[Math.round(v) - 1] || '') : `${value(snapped ? snapped.x : v, X.high - X.low)}`;
    let html = `<b>${esc(this.plot.names ? shown : this.plot.xl + ': ' + shown)}</b>`, marks = `<path d="M${num(at.x)} ${g.panels[0].top}V${g.panels[g.panels.length - 1].bottom}" stroke="#57606a" stroke-width="1"/>`;
    const narrow = g.width < 600;
    found.forEach(({panel, rows}, k) => {
      const q = g.panels[k];
      if (narrow && !(at.y >= q.head && at.y <= q.bottom + GAP)) return;
      if (rows.length) html += `<i>${esc(panel.l)}</i>`;
      for (const r of rows) {
        html += `<span><u style="background:${isDark() && data.dark[r.s.c] || r.s.c}"></u>${esc(r.s.n || '')} <em>${esc(r.text)}</em></span>`;
        if (r.v !== undefined && isFinite(r.v)) {
          const place = q.y.place(r.v);
          if (place >= 0 && place <= 1) marks += `<circle cx="${num(px(r.x))}" cy="${num(q.bottom - (q.bottom - q.top) * place)}" r="3.5" fill="${r.s.c}" stroke="#ffffff"/>`;
        }
      }
    });
    if (this.drag !== undefined && this.drag !== null && !this.drag.pan) {
      const from = g.left + (g.right - g.left) * this.drag.share;
      marks += `<rect x="${num(Math.min(from, at.x))}" y="${g.panels[0].top}" width="${num(Math.abs(at.x - from))}" height="${num(g.panels[g.panels.length - 1].bottom - g.panels[0].top)}" fill="#0072b2" fill-opacity="0.15"/>`;
    }
    this.over.innerHTML = marks;
    this.tip.innerHTML = html;
    this.tip.hidden = false;
    const figure = this.figure.getBoundingClientRect(), wide = this.tip.offsetWidth;
    let left = event.clientX - figure.left + 14;
    if (left + wide > figure.width) left = event.clientX - figure.left - wide - 14;
    this.tip.style.left = Math.max(0, left) + 'px';
    this.tip.style.top = Math.max(0, event.clientY - figure.top + 14) + 'px';
  },

  leave() { this.over.innerHTML = ''; this.tip.hidden = true; },

  events() {
    const box = this.box;
    const fingers = new Map();
    box.addEventListener('pointerdown', e => {
      if (e.button !== 0 || e.target.closest('.key')) return;
      const at = this.point(e);
      if (!at.inside) return;
      const touch = e.pointerType === 'touch';
      this.drag = {share: at.share, pan: e.shiftKey || touch, x: e.clientX, range: [...this.range]};
      // What is touched is drawn anew while the finger moves; the box around it stays.
      box.setPointerCapture(e.pointerId);
      if (touch) fingers.set(e.pointerId, {share: at.share, at: axis(...this.plot.x).place(this.x().back(at.share))});
      else e.preventDefault();
      this.hover(e);
    });
    box.addEventListener('pointermove', e => {
      const d = this.drag, finger = fingers.get(e.pointerId);
      if (finger) finger.share = this.point(e).share;
      if (fingers.size === 2) return this.pinch(...fingers.values());
      if (d && d.pan && this.zoomed()) {
        const a = axis(d.range[0], d.range[1], this.plot.x[2]), wide = this.svg.getBoundingClientRect().width;
        const g = this.geometry, by = (d.x - e.clientX) / (wide * (g.right - g.left) / g.width);
        const low = a.back(by), high = a.back(1 + by);
        if (low >= this.plot.x[0] && high <= this.plot.x[1]) this.show(low, high);
      }
      this.hover(e);
    });
    const end = e => {
      const d = this.drag;
      this.drag = null;
      fingers.delete(e.pointerId);
      if (!d || d.pan || e.type === 'pointercancel') return;
      const at = this.point(e);
      if (Math.abs(e.clientX - d.x) < 5) return;
      const X = this.x(), [a, b] = [Math.min(d.share, at.share), Math.max(d.share, at.share)];
      this.leave();
      this.show(X.back(a), X.back(b));
    };
    box.addEventListener('pointerup', end);
    box.addEventListener('pointercancel', end);
    // The values under a finger stay when it is lifted, until it touches elsewhere.
    box.addEventListener('pointerleave', e => { if (!this.drag && e.pointerType !== 'touch') this.leave(); });
    addEventListener('pointerdown', e => { if (!box.contains(e.target)) this.leave(); });
    box.addEventListener('blur', () => this.leave());
    box.addEventListener('keydown', e => this.key(e));
    box.addEventListener('dblclick', () => this.show(this.plot.x[0], this.plot.x[1]));
    box.addEventListener('wheel', e => {
      if (!e.ctrlKey && !e.metaKey) return;
      e.preventDefault();
      this.scale(e.deltaY > 0 ? 1.25 : 0.8, this.point(e).share);
    }, {passive: false});
  },

  // Two fingers keep the places of the axis that they touched.
  pinch(one, other) {
    if (Math.abs(other.share - one.share) < 0.02) return;
    const whole = axis(...this.plot.x), wide = (other.at - one.at) / (other.share - one.share), low = one.at - one.share * wide;
    this.leave();
    if (wide > 0) this.show(whole.back(low), whole.back(low + wide));
  },

  // With the keyboard: arrows move the line whose values are shown, with Shift by more; + and - zoom around it.
  key(e) {
    if (e.target !== this.box || e.ctrlKey || e.metaKey || e.altKey) return;
    const by = {ArrowLeft: -0.01, ArrowRight: 0.01}[e.key], zoom = {'+': 0.5, '-': 2}[e.key], at = this.cursor === undefined ? 0.5 : this.cursor;
    if (by !== undefined) this.cursor = Math.max(0, Math.min(1, at + by * (e.shiftKey ? 10 : 1)));
    else if (zoom !== undefined) this.scale(zoom, at);
    else if (e.key === 'Escape') return this.leave();
    else return;
    e.preventDefault();
    const g = this.geometry, box = this.svg.getBoundingClientRect(), unit = box.width / g.width;
    this.hover({clientX: box.left + unit * (g.left + (g.right - g.left) * (this.cursor === undefined ? 0.5 : this.cursor)), clientY: box.top + unit * (g.panels[0].top + 1)});
  },
};
