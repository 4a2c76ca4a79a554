//! A line on a terminal that is written over, whatever the terminal's width.
//!
//! A line that wraps cannot be written over: its first half stays. So wrapping is switched off while the line is written, and the
//! terminal itself cuts it at its edge; no width has to be asked for, and none can change in between.

/// Signs that take a live line away.
pub const CLEARED: &str = "\r\x1b[K";

/// The bytes that show a line in place of the live line before it, cut at the terminal's edge.
pub fn written_over(text: &str) -> String {
    format!("{CLEARED}\x1b[?7l{text}\x1b[?7h")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrapping_is_off_for_the_line_alone() {
        let line = written_over("fitting 40 %");
        let (before, after) = line.split_once("fitting 40 %").unwrap();
        assert!(before.starts_with('\r') && before.ends_with("\x1b[?7l"), "{before:?}");
        assert_eq!(after, "\x1b[?7h");
    }
}
