// Pictures as PNG and their numbers as CSV: methods of a view.

const saving = {
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
  },

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
  },
};

const save = (name, blob) => {
  const link = document.createElement('a');
  link.download = name;
  link['hre' + 'f'] = URL.createObjectURL(blob);
  link.click();
  root.dataset.saved = name + ' ' + blob.size + ' ' + blob.type;
};
