// Data of the page, and numbers and words as its pictures show them.

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
