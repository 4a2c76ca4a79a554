//! Text to HTML and SVG: escaping, and numbers as people write them.

/// Escapes text for element content and for attributes in double quotes.
///
/// Characters that XML forbids (control characters but tab and line ends) become U+FFFD, so that the
/// result is well-formed whatever came in.
pub(crate) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for character in text.chars() {
        match character {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\t' | '\n' | '\r' => out.push(character),
            '\0'..='\u{1f}' | '\u{7f}'..='\u{9f}' | '\u{fffe}' | '\u{ffff}' => out.push('\u{fffd}'),
            _ => out.push(character),
        }
    }
    out
}

/// A coordinate with one decimal and no needless zero: fine enough for the eye, short in the file.
pub(crate) fn coordinate(value: f64) -> String {
    let tenths = (value * 10.0).round();
    if tenths % 10.0 == 0.0 { format!("{:.0}", tenths / 10.0 + 0.0) } else { format!("{:.1}", tenths / 10.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_becomes_text() {
        assert_eq!(
            escape("<script>alert(\"a\" & 'b')</script>"),
            "&lt;script&gt;alert(&quot;a&quot; &amp; &#39;b&#39;)&lt;/script&gt;"
        );
        assert_eq!(escape("Δp ≤ 5 kPa\tx\0\u{1b}[1m"), "Δp ≤ 5 kPa\tx\u{fffd}\u{fffd}[1m");
    }

    #[test]
    fn coordinates_are_short() {
        let written = [0.0, -0.01, 12.0, 12.34, 12.36, -3.95].map(coordinate);
        assert_eq!(written, ["0", "0", "12", "12.3", "12.4", "-4"].map(str::to_owned));
    }
}
