//! Numbers that a page in a browser gives back: under the pointer, to the keyboard, in a saved table; and names and labels
//! that stay within their picture.
//!
//! Skipped with a line where there is no Chromium.

#![allow(clippy::unwrap_used, reason = "the helpers of a test fail by panicking, as the test does")]

mod in_browser;

use in_browser::{chromium, seen};
use report::{Color, Line, Panel, Plot, Report, Scatter};

/// Acts of the reader, and what the page answers: lines of `key=value`. Of a saved file it is the text.
const HAND: &str = r#"<script>
const texts = [];
// The text of a blob is read beside the page's own time; what it is made of is there at once.
window.Blob = class extends Blob { constructor(parts, options) { super(parts, options); texts.push(parts.join('')); } };
URL.createObjectURL = () => 'about:blank';
HTMLAnchorElement.prototype.click = () => {};
// A finger of a script is no pointer that could be captured.
Element.prototype.setPointerCapture = () => {};
addEventListener('load', () => setTimeout(() => {
  const out = {}, figures = [...document.querySelectorAll('figure')];
  const svg = f => f.querySelector('.live svg'), tip = f => f.querySelector('.tip').hidden ? 'none' : f.querySelector('.tip').innerText.replace(/\n/g, '|');
  // The axes' ends as they are drawn: the frame's own path.
  const frame = f => { const p = [...svg(f).querySelectorAll('path')].find(p => /^M[\d.]+ [\d.]+V[\d.]+H[\d.]+$/.test(p.getAttribute('d'))).getAttribute('d').match(/[\d.]+/g).map(Number); return [p[0], p[3], p[1]]; };
  const point = (f, type, share, id, kind) => {
    const s = svg(f), box = s.getBoundingClientRect(), unit = box.width / s.viewBox.baseVal.width, [left, right, top] = frame(f);
    s.dispatchEvent(new PointerEvent(type, {bubbles: true, clientX: box.left + unit * (left + share * (right - left)), clientY: box.top + unit * (top + 5), pointerId: id, button: 0, pointerType: kind}));
  };
  const at = (f, share) => { point(f, 'pointermove', share, 1, 'mouse'); return tip(f); };
  const press = (f, what) => f.querySelector(`[data-act="${what}"]`).click();
  out.within = at(figures[0], 0.1); out.gap = at(figures[0], 0.35); out.behind = at(figures[0], 0.8);
  for (const [k, f] of figures.entries()) { press(f, 'save as CSV'); out['csv' + k] = texts.pop().replace(/\n/g, '|'); }
  const key = k => figures[0].querySelector('.live').dispatchEvent(new KeyboardEvent('keydown', {key: k, bubbles: true}));
  key('Escape'); out.escaped = tip(figures[0]);
  key('ArrowLeft'); out.keyed = tip(figures[0]);
  // Two fingers at a quarter and at a half of 0 to 10 go to the ends: 2.5 to 5 is what stays between them.
  for (const [share, id] of [[0.25, 5], [0.5, 6]]) point(figures[0], 'pointerdown', share, id, 'touch');
  for (const [share, id] of [[0, 5], [1, 6]]) point(figures[0], 'pointermove', share, id, 'touch');
  for (const id of [5, 6]) point(figures[0], 'pointerup', 1, id, 'touch');
  out.pinched = [figures[0].dataset.from, figures[0].dataset.to].map(v => Number(v).toFixed(3)).join('..');
  const wrong = [];
  document.querySelectorAll('.live svg').forEach(s => {
    const box = s.getBoundingClientRect();
    s.querySelectorAll('text').forEach(t => { const r = t.getBoundingClientRect(); if (r.left < box.left - 1 || r.right > box.right + 1 || r.bottom > box.bottom + 1) wrong.push(t.textContent); });
  });
  out.outside = wrong.join(';');
  out.keys = [...figures[1].querySelectorAll('.key text')].map(t => t.textContent).join(';');
  out.titles = [...figures[1].querySelectorAll('.key title')].map(t => t.textContent).join(';');
  out.tall = figures[2].querySelector('.live svg').viewBox.baseVal.height;
  out.words = [...figures[3].querySelectorAll('.live svg text')].some(t => t.textContent === 'no values');
  out.dots = [...figures[0].querySelectorAll('.live g[clip-path] path')].filter(p => p.getAttribute('stroke-width') === '4.4').length;
  const written = document.createElement('pre');
  written.id = 'seen';
  written.textContent = Object.entries(out).map(([key, value]) => key + '=' + value).join('\n');
  document.body.append(written);
}, 100));
</script>"#;

const LONG: [&str; 2] = [
    "a folder named by somebody who tells the whole experiment, morning/flight.mcap",
    "a folder named by somebody who tells the whole experiment, evening/flight.mcap",
];

fn page() -> String {
    let nan = f64::NAN;
    let table = Plot::new("gaps", "time (s)").x_range(0.0, 10.0).panel(
        Panel::new("y")
            // A hole between 2 and 5, a point of its own at 5, and nothing behind that.
            .line(Line::new("holed", &[0.0, 1.0, 2.0, 3.0, 5.0], &[1.0, 2.0, 3.0, nan, 7.0]))
            .line(Line::new("held", &[0.0, 10.0], &[4.0, 6.0]).stepped())
            .scatter(Scatter::new("twice", &[1.0, 1.0, 9.0], &[8.0, 9.0, 7.5])),
    );
    let mut panel = Panel::new("small").y_range(0.0011, 0.0013);
    for name in LONG {
        panel = panel.line(Line::new(name, &[0.0, 100_000.0], &[0.0011, 0.0013]));
    }
    let names = Panel::new("RMSE")
        .at_names(&[("positive", &[0.5, nan, 0.25], Color::Blue), ("negative", &[1.5, 2.5, 3.5], Color::Vermilion)]);
    Report::new("values")
        .plot(table)
        .plot(Plot::new("long", "steps").panel(panel))
        .plot(Plot::new("names", "run").x_names(["fallback", LONG[0], LONG[1]]).panel(names))
        .plot(Plot::new("nothing", "x").panel(Panel::new("y").log_y().line(Line::new(
            "zero",
            &[0.0, 1.0],
            &[0.0, 0.0],
        ))))
        .to_html()
}

#[test]
fn a_page_gives_back_what_it_was_given() {
    let Some(browser) = chromium() else { return };
    let seen = seen(browser, &page(), HAND, "values", 500);
    let at = |key: &str| seen.get(key).map_or("", String::as_str);
    println!("{seen:?}");
    // A tenth of 0 to 10: the curve's own point, and the value that the step holds.
    assert_eq!(at("within"), "time (s): 1.00|y|holed 2.000|held 4.000|twice 8.000");
    assert_eq!(at("gap"), "time (s): 3.50|y|held 4.000", "a curve has no value in its gap");
    assert_eq!(at("behind"), "time (s): 8.00|y|held 4.000", "nor behind its end; a step holds its value");
    // The points around a gap are there, and both points at one x.
    assert_eq!(at("csv0"), "time (s),y: holed,y: held,y: twice|0,1,4,|1,2,,8|1,,,9|2,3,,|5,7,,|9,,,7.5|10,,6,|");
    let [morning, evening] = LONG.map(|name| format!("\"{name}\""));
    assert_eq!(
        at("csv2"),
        format!("run,RMSE: positive,RMSE: negative|fallback,0.5,1.5|{morning},,2.5|{evening},0.25,3.5|"),
        "a row for each name, and its own values in it"
    );
    assert_eq!((at("escaped"), at("keyed")), ("none", "time (s): 5.00|y|holed 7.000|held 4.000"));
    assert_eq!(at("pinched"), "2.500..5.000");
    assert_eq!(at("outside"), "", "texts outside of their picture");
    let keys: Vec<&str> = at("keys").split(';').collect();
    assert!(keys.len() == 2 && keys[0] != keys[1] && keys.iter().all(|key| key.contains('…')), "{keys:?}");
    assert_eq!(at("titles"), LONG.join(";"), "the whole name under the pointer");
    // The panel's 190, its texts, and names of half their 78 letters, each of 7.3 pixels.
    assert!(at("tall").parse::<f64>().unwrap() < 560.0, "{}", at("tall"));
    assert_eq!((at("words"), at("dots")), ("true", "2"), "an empty panel says so; lone points and dots can be seen");
}
