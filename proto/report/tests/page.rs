//! Pages as a whole: well-formed whatever goes in, self-contained, and nothing of the data lost.

#![allow(clippy::unwrap_used, clippy::panic, reason = "the helpers of a test fail by panicking, as the test does")]

use proptest::prelude::*;
use report::{Band, Color, Histogram, KeyFigure, Line, Panel, Plot, Report, Scatter, Table, Verdict};

/// Checks that a page is well-formed XML, and returns its elements' names.
///
/// A small checker of its own: tags nest, attributes are quoted and stand once, text holds no bare `<`
/// or `&` and only the entities that we write.
fn well_formed(page: &str) -> Result<Vec<String>, String> {
    let page = without_scripts(page)?;
    let mut rest = page.strip_prefix("<!DOCTYPE html>").unwrap_or(&page);
    let (mut open, mut names): (Vec<String>, Vec<String>) = (Vec::new(), Vec::new());
    loop {
        let Some(at) = rest.find('<') else {
            check_text(rest)?;
            break;
        };
        check_text(&rest[..at])?;
        let end = at + rest[at..].find('>').ok_or("a tag is not closed")?;
        let tag = &rest[at + 1..end];
        rest = &rest[end + 1..];
        if let Some(name) = tag.strip_prefix('/') {
            let opened = open.pop();
            if opened.as_deref() != Some(name) {
                return Err(format!("</{name}> closes {opened:?}"));
            }
            continue;
        }
        let (tag, alone) = tag.strip_suffix('/').map_or((tag, false), |tag| (tag, true));
        let name = tag.split_ascii_whitespace().next().ok_or("a tag without a name")?;
        check_attributes(&tag[name.len()..])?;
        names.push(name.to_owned());
        if !alone {
            open.push(name.to_owned());
        }
    }
    if open.is_empty() { Ok(names) } else { Err(format!("left open: {open:?}")) }
}

/// The page without what stands in its script elements, which is no markup; nothing in them may end them early.
fn without_scripts(page: &str) -> Result<String, String> {
    let (mut out, mut rest) = (String::new(), page);
    while let Some(at) = rest.find("<script") {
        let begin = at + rest[at..].find('>').ok_or("a script is not closed")? + 1;
        let end = begin + rest[begin..].find("</script>").ok_or("a script does not end")?;
        out.push_str(&rest[..begin]);
        rest = &rest[end..];
    }
    out.push_str(rest);
    Ok(out)
}

fn check_attributes(mut rest: &str) -> Result<(), String> {
    let mut seen = Vec::new();
    while !rest.trim().is_empty() {
        rest = rest.trim_start();
        let (name, after) = rest.split_once("=\"").ok_or_else(|| format!("no value: {rest}"))?;
        let (value, after) = after.split_once('"').ok_or_else(|| format!("no closing quote: {rest}"))?;
        if !name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-') || seen.contains(&name) {
            return Err(format!("attribute {name}"));
        }
        check_text(value)?;
        seen.push(name);
        rest = after;
    }
    Ok(())
}

fn check_text(text: &str) -> Result<(), String> {
    for (at, _) in text.match_indices('&') {
        let known = ["&amp;", "&lt;", "&gt;", "&quot;", "&#39;"];
        if !known.iter().any(|entity| text[at..].starts_with(entity)) {
            return Err(format!("a bare & in {text:?}"));
        }
    }
    if text.chars().any(|c| c.is_control() && !"\t\r\n".contains(c)) {
        return Err(format!("a control character in {text:?}"));
    }
    Ok(())
}

fn page_of(text: &str, x: &[f64], y: &[f64]) -> String {
    Report::new(text)
        .subtitle(text)
        .summary([KeyFigure::new(text, text).note(text).verdict(Verdict::Bad)])
        .heading(text)
        .text(text)
        .list([text, "b"])
        .table(Table::new([text, "b"]).row([text]).caption(text))
        .plot(
            Plot::new(text, text)
                .caption(text)
                .panel(
                    Panel::new(text)
                        .line(Line::new(text, x, y))
                        .line(Line::new("steps", x, y).stepped().dashed())
                        .band(Band::new(text, x, y, y))
                        .scatter(Scatter::new(text, y, x))
                        .level(text, 3.0, Color::Red)
                        .moment(text, 2.0, Color::Grey)
                        .span(text, 1.0, 2.0, Color::Ochre),
                )
                .panel(Panel::new(text).log_y().bars(text, Histogram::linear(y, 7)).include(1e3)),
        )
        .plot(Plot::new(text, text).log_x().panel(Panel::new("").log_y().line(Line::new(text, x, y))))
        .verbatim(text, text)
        .to_html()
}

#[test]
fn the_checker_itself_sees_what_is_wrong() {
    for wrong in ["<a>", "<a></b>", "<a b=c></a>", "<a b=\"1\" b=\"2\"/>", "<a>&</a>", "<a", "</a>", "<a>\u{1}</a>"] {
        assert!(well_formed(wrong).is_err(), "{wrong}");
    }
    assert_eq!(well_formed("<a b=\"1\">x &amp; y<c/></a>").unwrap(), ["a", "c"]);
}

proptest! {
    // Pages of 30 kB each; 200 of them take about a second.
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn any_text_and_any_numbers_give_a_well_formed_page_without_wild_coordinates(
        text in "\\PC*|[<>&\"'\\x00-\\x1f]{0,12}",
        points in proptest::collection::vec(any::<(u64, u64)>(), 0..40),
        tame: bool,
    ) {
        let number = |bits: u64| if tame { (bits % 2_000) as f64 / 7.0 - 100.0 } else { f64::from_bits(bits) };
        let (x, y): (Vec<f64>, Vec<f64>) = points.into_iter().map(|(x, y)| (number(x), number(y))).unzip();
        let page = page_of(&text, &x, &y);
        let elements = well_formed(&page).map_err(TestCaseError::fail)?;
        for element in &elements {
            prop_assert!(!["link", "img", "iframe", "foreignObject"].contains(&element.as_str()));
        }
        // Numbers that are not finite must never reach a path; names may hold such words.
        for path in page.split(" d=\"").skip(1) {
            let path = path.split('"').next().unwrap_or_default();
            prop_assert!(!path.contains("NaN") && !path.contains("inf"), "{path}");
        }
    }
}

#[test]
fn a_page_needs_nothing_from_outside() {
    let page = page_of("plain", &[0.0, 1.0, 2.0], &[1.0, 2.0, 3.0]);
    let outside: Vec<_> = page.match_indices("http").map(|(at, _)| &page[at..(at + 30).min(page.len())]).collect();
    // The name of the SVG namespace is a name and never fetched.
    assert!(outside.iter().all(|found| found.starts_with("http://www.w3.org/2000/svg")), "{outside:?}");
    for word in ["<script src", "javascript:", "@import", "url(http", "src="] {
        assert!(!page.contains(word), "{word}");
    }
}

#[test]
fn parts_refer_only_to_parts_of_their_own_plot() {
    let panel = || Panel::new("y").line(Line::new("a", &[0.0, 1.0], &[0.0, 1.0]));
    let plot = || Plot::new("p", "x").panel(panel()).panel(panel());
    let page = Report::new("two plots").plot(plot()).plot(plot()).to_html();
    let ids: Vec<&str> = page.split("<clipPath id=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
    let distinct: std::collections::HashSet<_> = ids.iter().collect();
    assert_eq!((ids.len(), distinct.len()), (4, 4));
    for id in ids {
        assert_eq!(page.matches(&format!("url(#{id})")).count(), 1, "{id}");
    }
}

/// All points of a path in tenths of a pixel: an independent reading of what is drawn.
fn points_of(path: &str) -> Vec<(i64, i64)> {
    let mut points: Vec<(i64, i64)> = Vec::new();
    let mut commands: Vec<(char, String)> = Vec::new();
    for character in path.chars() {
        if "Mlhv".contains(character) {
            commands.push((character, String::new()));
        } else {
            commands.last_mut().unwrap().1.push(character);
        }
    }
    for (command, text) in commands {
        let spaced = text.replace('-', " -");
        let numbers: Vec<i64> = spaced.split_ascii_whitespace().map(|n| n.parse().unwrap()).collect();
        let (x, y) = points.last().copied().unwrap_or_default();
        points.push(match (command, numbers.as_slice()) {
            ('M', [to_x, to_y]) => (*to_x, *to_y),
            ('l', [dx, dy]) => (x + dx, y + dy),
            ('h', [dx]) => (x + dx, y),
            ('v', [dy]) => (x, y + dy),
            other => panic!("{other:?}"),
        });
    }
    points
}

fn line_points(svg: &str, name: &str) -> Vec<(i64, i64)> {
    let title = svg.find(&format!("<title>{name}</title>")).unwrap();
    let start = svg[..title].rfind(" d=\"").unwrap() + 4;
    points_of(svg[start..].split('"').next().unwrap())
}

#[test]
fn a_peak_of_one_point_among_many_is_drawn_where_it_is() {
    // 300 s at 50 Hz, one tick of 50 among ones.
    let x: Vec<f64> = (0..15_001).map(|k| f64::from(k) / 50.0).collect();
    let y: Vec<f64> = (0..15_001).map(|k| if k == 7_503 { 50.0 } else { f64::from(k % 2) }).collect();
    let panel = Panel::new("y").y_range(0.0, 100.0).height(200.0).line(Line::new("spike", &x, &y));
    let svg = Plot::new("p", "x").panel(panel).to_svg("p");
    let points = line_points(&svg, "spike");
    let top = points.iter().min_by_key(|(_, y)| *y).unwrap();
    let low = points.iter().map(|(_, y)| *y).max().unwrap();
    // 50 of 100 on 200 pixels is 100 pixels above 0; a tenth for rounding.
    assert!((low - top.1 - 1_000).abs() <= 1, "{top:?} {low}");
    // 150.06 s of 300 s on axes from 68 to 902 pixels.
    let expected = 680.0 + 8_340.0 * 150.06 / 300.0;
    assert!((top.0 as f64 - expected).abs() <= 1.0, "{top:?} {expected}");
    assert!(svg.len() < 40_000, "{} bytes", svg.len());
}

#[test]
fn a_nan_breaks_a_line_and_a_single_point_is_a_dot() {
    let x = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0];
    let y = [1.0, 2.0, f64::NAN, 3.0, f64::INFINITY, 5.0];
    let svg = Plot::new("p", "x").panel(Panel::new("y").line(Line::new("holes", &x, &y))).to_svg("p");
    let title = svg.find("<title>holes").unwrap();
    let start = svg[..title].rfind(" d=\"").unwrap() + 4;
    let path = svg[start..].split('"').next().unwrap();
    assert_eq!(path.matches('M').count(), 3, "{path}");
    assert_eq!(path.matches("h0").count(), 2, "{path}");
}

#[test]
fn a_stepped_line_holds_each_value_until_the_next() {
    let line = Line::new("steps", &[0.0, 1.0, 2.0], &[0.0, 1.0, 0.0]).stepped();
    let svg = Plot::new("p", "x").panel(Panel::new("y").line(line)).to_svg("p");
    let points = line_points(&svg, "steps");
    assert_eq!(points.len(), 5);
    for pair in points.windows(2) {
        assert!(pair[0].0 == pair[1].0 || pair[0].1 == pair[1].1, "{pair:?} is not level or upright");
    }
    assert_eq!(points[0].1, points[1].1);
}

#[test]
fn empty_plots_and_reports_are_no_trouble() {
    for plot in [Plot::new("", ""), Plot::new("", "").panel(Panel::new("")), Plot::new("", "").log_x()] {
        well_formed(&plot.to_svg("p")).unwrap();
    }
    well_formed(&Report::new("").to_html()).unwrap();
    let nothing = Histogram::logarithmic(&[], 10);
    well_formed(&Plot::new("", "").log_x().panel(Panel::new("").log_y().bars("none", nothing)).to_svg("p")).unwrap();
}
