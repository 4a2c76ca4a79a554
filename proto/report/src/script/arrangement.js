// Places of a picture's panels, names and axes: methods of a view.

const arrangement = {
  layout() {
    const width = Math.max(340, Math.min(920, this.box.clientWidth || 920));
    const marks = this.plot.panels.map((panel, p) => {
      const y = this.yAxis(panel, p);
      return {y, ticks: ticks(y, Math.max(3, Math.min(9, Math.floor(panel.h / 26))))};
    });
    const widest = Math.max(0, ...marks.flatMap(m => m.ticks.map(([, label]) => textWidth(label))));
    const left = Math.max(width < 600 ? 52 : 68, num(1.15 * widest + 10)), right = width - (width < 600 ? 10 : 18);
    let at = 4;
    const panels = this.plot.panels.map((panel, p) => {
      const keys = [], words = shortened(panel.s.map(s => s.n), Math.floor((right - left - 28) / textWidth('n')));
      let row = 0, x = left + textWidth(panel.l) + 40;
      const named = panel.s.map((s, i) => [s, i]).filter(([s]) => s.n && s.k !== 'level' && s.k !== 'moment');
      const widthOf = i => 28 + textWidth(words[i]);
      const total = named.reduce((sum, [, i]) => sum + widthOf(i) + 18, -18);
      if (named.length && x + total > right) { row = 1; x = left; }
      for (const [, i] of named) {
        if (x + widthOf(i) > right && x > left) { row++; x = left; }
        keys.push({i, x, row, words: words[i]});
        x += widthOf(i) + 18;
      }
      const head = at, top = head + (row + 1) * ROW + 4, bottom = top + panel.h;
      at = bottom + GAP;
      return {panel, p, keys, head, top, bottom, ...marks[p]};
    });
    // Names that do not fit beside each other stand upright.
    const whole = this.plot.names || [], longest = names => Math.max(0, ...names.map(textWidth));
    const upright = longest(whole) > (right - left) / Math.max(1, whole.length) - 6, names = upright ? shortened(whole, UPRIGHT) : whole;
    return {width, left, right, panels, upright, names, height: at - GAP + FOOT + (upright ? longest(names) : 0)};
  },

  // Zoomed in, a panel is drawn to the scale of what is seen of it.
  yAxis(panel, p) {
    const [low, high, log] = panel.y;
    if (!this.zoomed() || log) return axis(low, high, log);
    let l = Infinity, h = -Infinity;
    const take = v => { if (isFinite(v)) { l = Math.min(l, v); h = Math.max(h, v); } };
    panel.s.forEach((s, i) => {
      if (!this.visible(p, i)) return;
      if (s.k === 'level') return;
      if (s.k === 'bars') { s.counts.forEach((c, b) => { if (s.edges[b + 1] >= this.range[0] && s.edges[b] <= this.range[1]) take(c); }); take(0); return; }
      if (s.x === undefined) return;
      const x = array(s.x);
      for (const ys of [s.y, s.y2]) {
        if (ys === undefined) continue;
        const y = array(ys);
        for (let k = 0; k < x.length; k++) if (x[k] >= this.range[0] && x[k] <= this.range[1]) take(y[k]);
      }
    });
    if (!(h > l)) return axis(low, high, log);
    const air = 0.06 * (h - l);
    return axis(l - air, h + air, false);
  },
};
