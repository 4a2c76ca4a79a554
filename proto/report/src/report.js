'use strict';
(() => {
  const data = JSON.parse(document.getElementById('plot-data').textContent);
  const root = document.documentElement;
  const FONT = 13, ROW = 20, GAP = 16, FOOT = 48, DOT = 4.4, UPRIGHT = 28, REACH = 12;
  const esc = text => text.replace(/[&<>"']/g, c => '&#' + c.charCodeAt(0) + ';');
  const minus = text => text.replace('-', '\u2212');
  const textWidth = text => [...text].length * FONT * 0.56;
  const num = x => Math.round(x * 10) / 10;

  // Names with at most so many letters each: the middle of a longer one is left out, and names that differ stay different.
  const shortened = (names, most) => {
    const cut = n => { const c = [...n]; return c.length <= most ? n : c.slice(0, most >> 1).join('') + '\u2026' + c.slice(c.length - (most - 1 >> 1)).join(''); };
    const longest = Math.max(0, ...names.map(n => [...n].length)), wanted = new Set(names).size;
    for (most = Math.max(3, most); most < longest && new Set(names.map(cut)).size < wanted;) most += 8;
    return names.map(cut);
  };

  // Arrays are single-precision numbers, little-endian, in base 64; a gap is a number that is none.
  const decoded = [];
  const array = index => {
    if (!decoded[index]) {
      const text = atob(data.arrays[index]);
      const bytes = Uint8Array.from(text, c => c.charCodeAt(0));
      decoded[index] = new Float32Array(bytes.buffer);
    }
    return decoded[index];
  };

  // A number with as many digits as the span of its axis makes meaningful.
  const value = (v, span) => {
    if (!isFinite(v)) return '\u2013';
    if (v !== 0 && (Math.abs(v) >= 1e6 || Math.abs(v) < 1e-5)) return minus(v.toExponential(3));
    const digits = Math.min(6, Math.max(0, 3 - Math.floor(Math.log10(Math.max(span, 1e-9)))));
    return minus(v.toFixed(digits));
  };

  const axis = (low, high, log) => ({
    low, high, log,
    place: v => log ? Math.log(v / low) / Math.log(high / low) : (v - low) / (high - low),
    back: s => log ? low * Math.pow(high / low, s) : low + s * (high - low),
  });

  const ticks = (a, most) => {
    const found = [];
    if (a.log) {
      const decades = Math.log10(a.high / a.low);
      if (decades > 0.7) {
        const digits = decades < 2 ? [1, 2, 5] : [1], every = Math.max(1, Math.ceil(decades / 10));
        for (let e = Math.floor(Math.log10(a.low)); e <= Math.ceil(Math.log10(a.high)); e += every)
          for (const d of digits) {
            const v = d * Math.pow(10, e);
            if (v >= a.low && v <= a.high) found.push([v, v >= 1e-3 && v < 1e5 ? String(+v.toPrecision(6)) : minus(v.toExponential())]);
          }
        return found;
      }
    }
    const span = a.high - a.low;
    let e = Math.floor(Math.log10(span / Math.max(2, most)));
    for (;; e++)
      for (const d of [1, 2, 5]) {
        const step = d * Math.pow(10, e), first = Math.ceil(a.low / step - 1e-9), last = Math.floor(a.high / step + 1e-9);
        if (last - first + 1 > most) continue;
        for (let k = first; k <= last; k++) {
          const v = k * step;
          found.push([v, Math.abs(v) >= 1e6 || e < -6 ? minus(v.toExponential()) : minus(v.toFixed(Math.max(0, -e)))]);
        }
        return found;
      }
  };

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
    }

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
    }

    draw(force) {
      const g = this.geometry = force || this.layout();
      const X = this.x(), px = v => g.left + (g.right - g.left) * Math.max(-8, Math.min(9, X.place(v)));
      let out = '';
      g.panels.forEach((q, index) => { out += this.panel(q, g, X, px, index + 1 === g.panels.length); });
      out += `<text x="${num((g.left + g.right) / 2)}" y="${num(g.height - 9)}" text-anchor="middle" font-weight="600">${esc(this.plot.xl)}</text>`;
      out += '<g class="over" pointer-events="none"></g>';
      this.box.innerHTML = `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${g.width} ${num(g.height)}" width="${g.width}" height="${num(g.height)}" role="img" aria-label="${esc(this.title)}" font-family="system-ui,-apple-system,'Segoe UI',Roboto,'Liberation Sans',Arial,sans-serif" font-size="${FONT}" fill="#1f2328">${out}</svg>`;
      this.svg = this.box.firstChild;
      this.over = this.svg.querySelector('.over');
      this.whole.disabled = !this.zoomed();
      this.figure.dataset.from = this.range[0];
      this.figure.dataset.to = this.range[1];
      this.svg.querySelectorAll('.key').forEach(key => {
        const toggle = () => {
          const id = key.dataset.key;
          this.hidden.has(id) ? this.hidden.delete(id) : this.hidden.add(id);
          this.draw();
          const again = this.svg.querySelector(`[data-key="${id}"]`);
          if (again) again.focus();
        };
        key.addEventListener('click', toggle);
        key.addEventListener('keydown', e => { if (e.key === 'Enter' || e.key === ' ') { e.preventDefault(); toggle(); } });
      });
    }

    panel(q, g, X, px, last) {
      const {panel, p, top, bottom, y} = q, id = this.still.dataset.plot + '-live-' + p;
      const py = v => bottom - (bottom - top) * Math.max(-8, Math.min(9, y.place(v)));
      let out = `<text x="${g.left}" y="${num(q.head + ROW - 6)}" font-weight="600">${esc(panel.l)}</text>`;
      for (const {i, x, row, words} of q.keys) {
        const s = panel.s[i], at = q.head + ROW * (row + 1) - 6, on = this.visible(p, i);
        let mark;
        if (s.k === 'line') mark = `<path d="M${num(x)} ${num(at - 4.4)}h22" stroke="${s.c}" stroke-width="${Math.max(2, s.w)}"${s.dash ? ' stroke-dasharray="6 4"' : ''} fill="none"/>`;
        else if (s.k === 'dots') mark = `<circle cx="${num(x + 11)}" cy="${num(at - 4.4)}" r="3" fill="${s.c}"/>`;
        else mark = `<rect x="${num(x)}" y="${num(at - 9.8)}" width="22" height="11" fill="${s.c}" fill-opacity="${s.k === 'bars' ? 0.85 : 0.22}" stroke="${s.c}" stroke-opacity="0.6"/>`;
        out += `<g class="key" data-key="${p}:${i}" role="button" tabindex="0" aria-pressed="${on}" opacity="${on ? 1 : 0.35}"><rect x="${num(x - 4)}" y="${num(at - 15)}" width="${num(36 + textWidth(words))}" height="20" fill="#ffffff" fill-opacity="0"/>${mark}<text x="${num(x + 28)}" y="${num(at)}">${esc(words)}</text><title>${esc(s.n)}</title></g>`;
      }
      let grid = '';
      for (const [v, label] of q.ticks) {
        grid += `M${g.left} ${num(py(v))}H${g.right}`;
        out += `<text x="${g.left - 8}" y="${num(py(v) + FONT * 0.35)}" text-anchor="end">${label}</text>`;
      }
      const named = this.plot.names && g.names, most = named ? 99 : Math.max(3, Math.round((g.right - g.left) / 66));
      const xs = named ? named.map((n, k) => [k + 1, n]).filter(([v]) => v >= X.low && v <= X.high) : ticks(X, most);
      xs.forEach(([v, label]) => {
        grid += `M${num(px(v))} ${top}V${bottom}`;
        if (!last) return;
        const at = num(px(v));
        if (named && g.upright) out += `<text transform="translate(${num(at + FONT * 0.35)} ${num(bottom + 8)}) rotate(-90)" text-anchor="end">${esc(label)}</text>`;
        // A long number at the end of the axis would be cut off by the picture's edge.
        else out += `<text x="${named ? at : Math.min(at, num(g.width - 0.6 * textWidth(label) - 1))}" y="${num(bottom + FONT + 5)}" text-anchor="middle">${named ? esc(label) : label}</text>`;
      });
      out += `<path d="${grid}" fill="none" stroke="#d8dee4" stroke-width="1"/>`;
      out += `<clipPath id='${id}'><rect x="${g.left - 2.2}" y="${top - 2.2}" width="${num(g.right - g.left + 4.4)}" height="${panel.h + 4.4}"/></clipPath><g clip-path="url(#${id})">`;
      const layer = s => s.k === 'span' || s.k === 'band' || s.k === 'bars' ? 0 : s.k === 'line' || s.k === 'dots' ? 1 : 2;
      for (let l = 0; l < 3; l++)
        panel.s.forEach((s, i) => { if (layer(s) === l && this.visible(p, i)) out += this.series(s, X, px, py, g, top, bottom); });
      out += `</g><path d="M${g.left} ${top}V${bottom}H${g.right}" fill="none" stroke="#57606a" stroke-width="1"/>`;
      if (panel.words) out += `<text x="${num((g.left + g.right) / 2)}" y="${num((top + bottom) / 2)}" text-anchor="middle" fill="#57606a">${esc(panel.words)}</text>`;
      const taken = [];
      panel.s.forEach(s => { out += this.label(s, px, py, g, top, bottom, taken); });
      return out;
    }

    // Names of moments that would stand on one another go one below the other.
    label(s, px, py, g, top, bottom, taken) {
      if (!s.n || (s.k !== 'level' && s.k !== 'moment')) return '';
      let x, y, anchor;
      if (s.k === 'level') {
        const at = py(s.at);
        [x, y, anchor] = [g.right - 6, at - FONT - 4 < top ? at + FONT + 1 : at - 5, 'end'];
      } else {
        const at = px(s.at), fits = at + 6 + textWidth(s.n) < g.right;
        const wide = textWidth(s.n), from = fits ? at + 6 : at - 6 - wide;
        const above = taken.filter(([begin, end]) => from < end + 6 && from + wide > begin - 6).length;
        taken.push([from, from + wide]);
        [x, y, anchor] = [fits ? at + 6 : at - 6, top + FONT + 3 + above * (FONT + 3), fits ? 'start' : 'end'];
      }
      if (!(x >= g.left && x <= g.right && y >= top && y <= bottom + FONT)) return '';
      return `<text x="${num(x)}" y="${num(y)}" text-anchor="${anchor}" fill="${s.c}" stroke="#ffffff" stroke-width="3" paint-order="stroke">${esc(s.n)}</text>`;
    }

    series(s, X, px, py, g, top, bottom) {
      if (s.k === 'level') return `<path d="M${g.left} ${num(py(s.at))}H${g.right}" stroke="${s.c}" stroke-width="1.3" stroke-dasharray="2 3"/>`;
      if (s.k === 'moment') return `<path d="M${num(px(s.at))} ${top}V${bottom}" stroke="${s.c}" stroke-width="1.3" stroke-dasharray="2 3"/>`;
      if (s.k === 'span') return `<rect x="${num(px(s.from))}" y="${top}" width="${num(Math.max(1, px(s.to) - px(s.from)))}" height="${num(bottom - top)}" fill="${s.c}" fill-opacity="0.12"/>`;
      if (s.k === 'bars') {
        let d = '';
        s.counts.forEach((c, b) => { if (c > 0) d += `M${num(px(s.edges[b]))} ${bottom}V${num(py(c))}H${num(px(s.edges[b + 1]))}V${bottom}Z`; });
        return `<path d="${d}" fill="${s.c}" fill-opacity="0.85" stroke="#ffffff" stroke-width="0.6"/>`;
      }
      const x = array(s.x), y = array(s.y);
      if (s.k === 'dots') {
        let d = '';
        for (let k = 0; k < x.length; k++) if (x[k] >= X.low && x[k] <= X.high && isFinite(y[k])) d += `M${num(px(x[k]))} ${num(py(y[k]))}h0`;
        return `<path d="${d}" fill="none" stroke="${s.c}" stroke-opacity="0.65" stroke-width="${DOT}" stroke-linecap="round"/>`;
      }
      const [from, to] = this.within(x);
      if (s.k === 'band') {
        const high = array(s.y2);
        let d = '', start = -1;
        for (let k = from; k <= to; k++) {
          const sound = k < to && isFinite(y[k]) && isFinite(high[k]);
          if (sound && start < 0) start = k;
          if (!sound && start >= 0) {
            d += 'M';
            for (let j = start; j < k; j++) d += `${num(px(x[j]))} ${num(py(high[j]))} `;
            for (let j = k - 1; j >= start; j--) d += `${num(px(x[j]))} ${num(py(y[j]))} `;
            d += 'Z';
            start = -1;
          }
        }
        return `<path d="${d}" fill="${s.c}" fill-opacity="0.22"/>`;
      }
      let d = '', lone = '', pen = false;
      const sound = k => k >= 0 && k < x.length && isFinite(y[k]) && isFinite(x[k]);
      for (let k = from; k < to; k++) {
        if (!sound(k)) { pen = false; continue; }
        const a = num(px(x[k])), b = num(py(y[k]));
        d += !pen ? `M${a} ${b}h0` : s.step ? `H${a}V${b}` : `L${a} ${b}`;
        pen = true;
        // A point without a neighbour is a dot: as thin as the line nobody would see it.
        if (!sound(k - 1) && !sound(k + 1)) lone += `M${a} ${b}h0`;
      }
      if (lone) lone = `<path d="${lone}" fill="none" stroke="${s.c}" stroke-width="${Math.max(s.w, DOT)}" stroke-linecap="round"/>`;
      return lone + `<path d="${d}" fill="none" stroke="${s.c}" stroke-width="${s.w}" stroke-linejoin="round" stroke-linecap="round"${s.dash ? ' stroke-dasharray="6 4"' : ''}/>`;
    }

    // Points of the visible range and one beyond each end; everything where x does not rise.
    within(x) {
      for (let k = 1; k < x.length; k++) if (x[k] < x[k - 1]) return [0, x.length];
      let from = 0, to = x.length;
      while (from + 1 < to && x[from + 1] < this.range[0]) from++;
      while (to - 1 > from && x[to - 2] > this.range[1]) to--;
      return [from, to];
    }

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
    }

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
    }

    point(event) {
      const box = this.svg.getBoundingClientRect(), g = this.geometry;
      const x = (event.clientX - box.left) * g.width / box.width, y = (event.clientY - box.top) * g.width / box.width;
      // Not above the first panel: what would stand there hides the names that are being clicked.
      const inside = x >= g.left && x <= g.right && y >= g.panels[0].top && y <= g.panels[g.panels.length - 1].bottom + 4;
      return {x, y, inside, share: Math.max(0, Math.min(1, (x - g.left) / (g.right - g.left)))};
    }

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
    }

    leave() { this.over.innerHTML = ''; this.tip.hidden = true; }

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
    }

    // Two fingers keep the places of the axis that they touched.
    pinch(one, other) {
      if (Math.abs(other.share - one.share) < 0.02) return;
      const whole = axis(...this.plot.x), wide = (other.at - one.at) / (other.share - one.share), low = one.at - one.share * wide;
      this.leave();
      if (wide > 0) this.show(whole.back(low), whole.back(low + wide));
    }

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
    }

    // The visible series over the visible range: a row for every x that any of them has, several where one has several
    // values at it. Of an axis of names it is a row for each name.
    csv() {
      const columns = [], rows = new Map(), names = this.plot.names, cell = text => /[",\n]/.test(text) ? '"' + text.replace(/"/g, '""') + '"' : text;
      const put = (name, xs, ys) => {
        const column = columns.push(name) - 1, taken = new Map();
        xs.forEach((x, k) => {
          // A number that is none is a gap, which has no row.
          if (!isFinite(ys[k]) || !(x >= this.range[0] && x <= this.range[1])) return;
          x = names ? Math.round(x) : +x.toPrecision(7);
          const nth = names ? 0 : taken.get(x) || 0;
          taken.set(x, nth + 1);
          if (!rows.has(x)) rows.set(x, []);
          const at = rows.get(x);
          (at[nth] = at[nth] || [])[column] = String(+ys[k].toPrecision(7));
        });
      };
      this.plot.panels.forEach((panel, p) => panel.s.forEach((s, i) => {
        if (!this.visible(p, i)) return;
        const name = s.n ? panel.l + ': ' + s.n : panel.l;
        if (s.k === 'bars') put(name, s.edges.slice(0, -1), s.counts);
        else if (s.y2 !== undefined) { put(name + ' low', array(s.x), array(s.y)); put(name + ' high', array(s.x), array(s.y2)); }
        else if (s.x !== undefined) put(name, array(s.x), array(s.y));
      }));
      const lines = [[this.plot.xl, ...columns].map(cell).join(',')];
      for (const x of [...rows.keys()].sort((a, b) => a - b)) {
        const label = names ? cell(names[x - 1] || String(x)) : String(x);
        for (const row of rows.get(x)) lines.push([label, ...columns.map((_, c) => row[c] === undefined ? '' : row[c])].join(','));
      }
      return lines.join('\n') + '\n';
    }

    png() {
      const g = this.geometry, dark = isDark(), copy = this.svg.cloneNode(true);
      copy.querySelector('.over').remove();
      let text = new XMLSerializer().serializeToString(copy);
      if (dark) text = text.replace(/#[0-9a-f]{6}/g, hex => data.dark[hex] || hex);
      const picture = new Image(), factor = 2;
      picture.onload = () => {
        const canvas = document.createElement('canvas');
        canvas.width = g.width * factor;
        canvas.height = g.height * factor;
        const c = canvas.getContext('2d');
        c.fillStyle = dark ? data.dark['#ffffff'] : '#ffffff';
        c.fillRect(0, 0, canvas.width, canvas.height);
        c.drawImage(picture, 0, 0, canvas.width, canvas.height);
        canvas.toBlob(blob => save(this.name() + '.png', blob), 'image/png');
      };
      picture['sr' + 'c'] = 'data:image/svg+xml;charset=utf-8,' + encodeURIComponent(text);
    }
  }

  const save = (name, blob) => {
    const link = document.createElement('a');
    link.download = name;
    link['hre' + 'f'] = URL.createObjectURL(blob);
    link.click();
    root.dataset.saved = name + ' ' + blob.size + ' ' + blob.type;
  };

  const isDark = () => root.dataset.theme ? root.dataset.theme === 'dark' : matchMedia('(prefers-color-scheme: dark)').matches;
  const remembered = theme => { try { if (theme === undefined) return localStorage.getItem('report-theme'); localStorage.setItem('report-theme', theme); } catch { return null; } };
  const theme = document.createElement('button');
  theme.type = 'button';
  theme.className = 'theme';
  const named = () => { theme.textContent = isDark() ? 'light' : 'dark'; theme.setAttribute('aria-label', 'show the page ' + theme.textContent); };
  theme.addEventListener('click', () => { root.dataset.theme = isDark() ? 'light' : 'dark'; remembered(root.dataset.theme); named(); });
  const kept = remembered();
  if (kept === 'dark' || kept === 'light') root.dataset.theme = kept;
  named();
  document.querySelector('header').prepend(theme);

  const views = [];
  document.querySelectorAll('figure > svg[data-plot]').forEach(svg => views.push(new View(svg.parentElement, svg)));
  let before = innerWidth;
  addEventListener('resize', () => { if (innerWidth !== before) { before = innerWidth; views.forEach(view => view.draw()); } });
  root.dataset.ready = views.length;
})();
