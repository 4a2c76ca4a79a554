// A picture as SVG, drawn anew for what is seen of it: methods of a view.

const drawing = {
  draw() {
    const g = this.geometry = this.layout();
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
  },

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
  },

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
  },

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
  },

  // Points of the visible range and one beyond each end; everything where x does not rise.
  within(x) {
    for (let k = 1; k < x.length; k++) if (x[k] < x[k - 1]) return [0, x.length];
    let from = 0, to = x.length;
    while (from + 1 < to && x[from + 1] < this.range[0]) from++;
    while (to - 1 > from && x[to - 2] > this.range[1]) to--;
    return [from, to];
  },
};
