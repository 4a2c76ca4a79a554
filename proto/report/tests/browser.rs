//! A page in a real browser: what is under the pointer, zoom, series switched off, both colours, what is saved.
//!
//! Chromium loads the page without a window, a script at its end does what a reader's hand would, and writes what it saw
//! into the page, which Chromium then prints. Skipped with a line where there is no Chromium.

#![allow(clippy::unwrap_used, reason = "the helpers of a test fail by panicking, as the test does")]

mod in_browser;

use in_browser::{chromium, seen};
use report::{Color, Histogram, Line, Panel, Plot, Report};

/// Acts of the reader, and his view after them: lines of `key=value`.
const HAND: &str = r#"<script>
addEventListener('load', () => setTimeout(() => {
  const out = {}, root = document.documentElement, figure = document.querySelector('figure');
  const svg = () => figure.querySelector('.live svg'), press = what => figure.querySelector(`[data-act="${what}"]`).click();
  const curves = () => svg().querySelectorAll('g[clip-path]')[0].querySelectorAll('path').length;
  const range = () => figure.dataset.from + '..' + figure.dataset.to;
  const box = svg().getBoundingClientRect();
  const point = (type, x, y) => svg().dispatchEvent(new PointerEvent(type, {bubbles: true, clientX: box.left + x, clientY: box.top + y, pointerId: 1, button: 0, pointerType: 'mouse'}));
  const unit = box.width / svg().viewBox.baseVal.width, g = svg().viewBox.baseVal.width < 600 ? [52, svg().viewBox.baseVal.width - 10] : [68, 902], left = g[0] * unit, right = g[1] * unit;
  out.plots = root.dataset.ready;
  out.start = range();
  point('pointermove', left + (right - left) * 0.25, 60);
  out.tip = figure.querySelector('.tip').innerText.replace(/\n/g, '|');
  press('zoom in'); out.zoomed = range();
  press('later'); out.later = range();
  out.other = document.querySelectorAll('figure')[1].dataset.from;
  press('whole range'); out.whole = range();
  out.curves = curves();
  svg().querySelector('.key').dispatchEvent(new MouseEvent('click', {bubbles: true}));
  out.without = curves();
  press('save as CSV'); out.csv = root.dataset.saved;
  out.before = getComputedStyle(root).backgroundColor;
  document.querySelector('.theme').click();
  out.after = getComputedStyle(root).backgroundColor;
  out.sideways = root.scrollWidth > innerWidth;
  press('save as PNG');
  // The picture is made beside the page's own time.
  let looks = 0;
  const look = setInterval(() => {
    if (!root.dataset.saved.includes('png') && ++looks < 150) return;
    clearInterval(look);
    out.png = root.dataset.saved;
    const seen = document.createElement('pre');
    seen.id = 'seen';
    seen.textContent = Object.entries(out).map(([key, value]) => key + '=' + value).join('\n');
    document.body.append(seen);
  }, 100);
}, 100));
</script>"#;

fn page() -> String {
    let time_s: Vec<f64> = (0..=1_000).map(|k| f64::from(k) / 50.0).collect();
    let ramp: Vec<f64> = time_s.iter().map(|t| 80.0 + t).collect();
    let half: Vec<f64> = time_s.iter().map(|t| -0.5 * t).collect();
    let plot = |title: &str| {
        Plot::new(title, "time (s)").panel(
            Panel::new("pressure (kPa)")
                .line(Line::new("ramp, <full>", &time_s, &ramp).color(Color::Blue))
                .line(Line::new("half", &time_s, &half)),
        )
    };
    Report::new("A page & more")
        .plot(plot("first"))
        .plot(plot("second"))
        .plot(
            Plot::new("names", "controller").x_names(["fallback", "policy"]).panel(Panel::new("RMSE").line(Line::new(
                "positive",
                &[1.0, 2.0],
                &[0.2, 0.1],
            ))),
        )
        .plot(
            Plot::new("bars", "ms")
                .log_x()
                .panel(Panel::new("ticks").log_y().bars("", Histogram::logarithmic(&[1.0, 2.0, 40.0], 9))),
        )
        .to_html()
}

#[test]
fn a_reader_can_work_with_a_page() {
    let Some(browser) = chromium() else { return };
    let seen = seen(browser, &page(), HAND, "wide", 1_400);
    let at = |key: &str| seen.get(key).map_or("", String::as_str);
    println!("{seen:?}");
    assert_eq!((at("plots"), at("start")), ("4", "0..20"));
    // A quarter of 20 s: 80 + 5 and −0.5 · 5, by the formulas and not by what was drawn.
    assert!(at("tip").starts_with("time (s): 5.0"), "{}", at("tip"));
    for words in ["pressure (kPa)", "ramp, &lt;full&gt; 85.0", "half −2.5"] {
        assert!(at("tip").contains(words), "{words} is not in {}", at("tip"));
    }
    assert_eq!((at("zoomed"), at("later"), at("whole")), ("5..15", "7.5..17.5", "0..20"));
    assert_eq!(at("other"), "7.5", "plots over one axis move together");
    assert_eq!((at("curves"), at("without")), ("2", "1"));
    // 1,001 rows, one series left of two: more than its bytes at their shortest, and none of the other's.
    assert!(at("csv").starts_with("a-page-more-first.csv ") && at("csv").ends_with(" text/csv"), "{}", at("csv"));
    assert!(at("png").starts_with("a-page-more-first.png ") && at("png").ends_with(" image/png"), "{}", at("png"));
    assert_ne!(at("before"), at("after"), "dark and light");
}

#[test]
fn a_narrow_window_needs_no_sideways_scrolling() {
    let Some(browser) = chromium() else { return };
    // Chromium's own windows are no narrower than 500 pixels; the plot of 340 and more is drawn for what there is.
    let seen = seen(browser, &page(), HAND, "narrow", 500);
    assert_eq!(seen.get("sideways").map(String::as_str), Some("false"), "{seen:?}");
}

/// Without scripts, in a mail or on paper, the pictures are there: the page holds one for every plot.
#[test]
fn pictures_do_not_need_the_script() {
    let page = page();
    let before_scripts = page.split("<script").next().unwrap();
    assert_eq!(before_scripts.matches("<svg ").count(), 4);
    for name in ["fallback", "policy"] {
        assert!(before_scripts.contains(&format!(">{name}</text>")), "{name}");
    }
}
