//! Words from files in messages: short, quoted where they are foreign, and on one line.

/// The start of a name from a file, short enough for a one-line message.
pub(crate) fn shown(name: &str) -> String {
    const LONGEST: usize = 60;
    match name.char_indices().nth(LONGEST) {
        Some((at, _)) => format!("{}...", &name[..at]),
        None => name.to_owned(),
    }
}

/// A foreign error's text on one line of bounded length.
pub(crate) fn one_line(text: &str) -> String {
    const LONGEST: usize = 300;
    let mut line = String::new();
    for word in text.split_whitespace() {
        if line.len() + word.len() > LONGEST {
            line.push_str(" ...");
            break;
        }
        if !line.is_empty() {
            line.push(' ');
        }
        line.push_str(word);
    }
    line.retain(|c| !c.is_control());
    line
}

/// Names in brackets, the first six of them.
pub(crate) fn listed(names: &[String]) -> String {
    if names.is_empty() {
        return String::new();
    }
    let quoted: Vec<String> = names.iter().take(6).map(|n| format!("{n:?}")).collect();
    let more = if names.len() > 6 { ", ..." } else { "" };
    format!(" ({}{more})", quoted.join(", "))
}

/// Numbers, parted by commas.
pub(crate) fn versions(known: &[u32]) -> String {
    let list: Vec<String> = known.iter().map(|v| format!("{v:?}")).collect();
    list.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_comes_from_a_file_stays_short_and_on_one_line() {
        assert_eq!(shown(&"é".repeat(100)).chars().count(), 63);
        assert_eq!(one_line("a\n b\u{7}c\t d"), "a bc d");
    }
}
