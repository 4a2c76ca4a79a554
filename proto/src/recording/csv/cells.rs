//! The bytes of a text file to rows of cells, with the line on which each row begins.
//!
//! Rows end with LF or CRLF. Cells are separated by commas, or by what the grammar says; blanks around them do not count. A
//! cell in double quotes may hold separators, line ends and, doubled, quotes. Lines with nothing but blanks are skipped, and
//! still counted: an error must name the line that an editor shows. Loggers' lines of comment are skipped where the grammar
//! has them; the last of them is kept, since some loggers name the columns in it.

use std::borrow::Cow;

use model::rig::Separator;

use crate::recording::columns::units::Unit;

/// A break of the grammar.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Broken {
    /// Line of the broken cell, from 1.
    pub(crate) line: u64,
    /// Column of it, from 1.
    pub(crate) position: usize,
    /// True when the file ends within quotes, false when something follows a closing quote.
    pub(crate) open: bool,
}

/// Signs that tell cells apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Grammar {
    /// Character between cells; a blank stands for a run of blanks and tabs.
    pub(crate) separator: Separator,
    /// Lines that are no rows.
    pub(crate) comments: Comments,
}

/// Which lines are comment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Comments {
    /// None.
    No,
    /// Those that begin with `#`, `%` or `//`.
    Marked,
}

impl Grammar {
    /// Commas, no comments.
    pub(crate) const CSV: Self = Self { separator: Separator::Comma, comments: Comments::No };

    fn separates(self, byte: u8) -> bool {
        match self.separator {
            Separator::Comma => byte == b',',
            Separator::Semicolon => byte == b';',
            Separator::Tab => byte == b'\t',
            Separator::Bar => byte == b'|',
            Separator::Blank => matches!(byte, b' ' | b'\t'),
        }
    }
}

/// Walks through the rows of a file.
#[derive(Debug)]
pub(crate) struct Rows<'a> {
    rest: &'a [u8],
    line: u64,
    grammar: Grammar,
    comment: Option<(u64, &'a [u8])>,
    /// Cells of the row before.
    before: usize,
}

impl<'a> Rows<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self::with(bytes, Grammar::CSV)
    }

    pub(crate) fn with(bytes: &'a [u8], grammar: Grammar) -> Self {
        Self { rest: bytes, line: 1, grammar, comment: None, before: 0 }
    }

    /// The last line of comment that was skipped, without its mark, and where it stands.
    pub(crate) fn last_comment(&self) -> Option<(u64, &'a [u8])> {
        self.comment
    }

    /// Puts the next row's cells into `cells` and returns its line; `None` at the end.
    pub(crate) fn next_row(&mut self, cells: &mut Vec<Cow<'a, [u8]>>) -> Result<Option<u64>, Broken> {
        self.before = cells.len();
        cells.clear();
        self.skip_blank_lines();
        if self.rest.is_empty() {
            return Ok(None);
        }
        let row_line = self.line;
        loop {
            self.skip_blanks();
            let cell = match self.rest.strip_prefix(b"\"") {
                Some(rest) => {
                    self.rest = rest;
                    self.quoted(cells.len() + 1)?
                }
                None => Cow::Borrowed(self.plain()),
            };
            cells.push(cell);
            match self.rest.split_first() {
                Some((byte, rest)) if self.grammar.separates(*byte) => {
                    self.rest = rest;
                    if self.grammar.separator == Separator::Blank {
                        self.skip_blanks();
                        if self.ends_here() {
                            self.skip_line();
                            return Ok(Some(row_line));
                        }
                    }
                }
                Some((_, rest)) => {
                    // Nothing but a separator or a line end stops a cell.
                    self.rest = rest;
                    self.line += 1;
                    return Ok(Some(row_line));
                }
                None => return Ok(Some(row_line)),
            }
        }
    }

    fn skip_blank_lines(&mut self) {
        while !self.rest.is_empty() {
            let end = self.rest.iter().position(|byte| *byte == b'\n').map_or(self.rest.len(), |end| end + 1);
            let (line, rest) = self.rest.split_at(end);
            if !line.iter().all(u8::is_ascii_whitespace) {
                match self.comment_in(line) {
                    Some(comment) => self.comment = Some((self.line, comment)),
                    None => return,
                }
            }
            self.rest = rest;
            self.line += 1;
        }
    }

    /// The text of a line that is a comment.
    fn comment_in(&self, line: &'a [u8]) -> Option<&'a [u8]> {
        let trimmed = line.trim_ascii();
        let marked = |mark: &[u8]| trimmed.strip_prefix(mark).map(<[u8]>::trim_ascii);
        match self.grammar.comments {
            Comments::No => None,
            Comments::Marked if self.is_units(line) => None,
            Comments::Marked => marked(b"#").or_else(|| marked(b"%")).or_else(|| marked(b"//")),
        }
    }

    /// Tells whether a line that a per cent may begin is a row of units: as many cells as the row before, blank or a unit each.
    fn is_units(&self, line: &[u8]) -> bool {
        if !line.trim_ascii_start().starts_with(b"%") {
            return false;
        }
        let line = line.strip_suffix(b"\n").unwrap_or(line);
        let cells = line.split(|byte| self.grammar.separates(*byte)).map(|cell| cell.trim_ascii());
        let cells: Vec<&[u8]> =
            cells.filter(|cell| self.grammar.separator != Separator::Blank || !cell.is_empty()).collect();
        let is_unit = |cell: &&[u8]| {
            cell.is_empty() || std::str::from_utf8(cell).is_ok_and(|cell| Unit::parse(cell.trim_matches('"')).is_some())
        };
        cells.len() > 1 && cells.len() == self.before && cells.iter().all(is_unit)
    }

    fn ends_here(&self) -> bool {
        matches!(self.rest, [] | [b'\n', ..] | [b'\r', b'\n', ..] | [b'\r'])
    }

    fn skip_line(&mut self) {
        let end = self.rest.iter().position(|byte| *byte == b'\n');
        self.rest = end.map_or(&[], |end| self.rest.split_at(end + 1).1);
        self.line += 1;
    }

    fn skip_blanks(&mut self) {
        let tabs = self.grammar.separator != Separator::Tab;
        let blanks = self.rest.iter().take_while(|byte| **byte == b' ' || (tabs && **byte == b'\t')).count();
        self.rest = self.rest.split_at(blanks).1;
    }

    /// Up to the next separator or line end.
    fn plain(&mut self) -> &'a [u8] {
        let grammar = self.grammar;
        let stop = |byte: &u8| *byte == b'\n' || grammar.separates(*byte);
        let end = self.rest.iter().position(stop).unwrap_or(self.rest.len());
        let (cell, rest) = self.rest.split_at(end);
        self.rest = rest;
        cell.trim_ascii_end()
    }

    /// From behind the opening quote to behind the closing one and the blanks after it.
    fn quoted(&mut self, position: usize) -> Result<Cow<'a, [u8]>, Broken> {
        let opened = self.line;
        let mut cell: Cow<'a, [u8]> = Cow::Borrowed(&[]);
        loop {
            let Some(end) = self.rest.iter().position(|byte| *byte == b'"') else {
                return Err(Broken { line: opened, position, open: true });
            };
            let (part, rest) = self.rest.split_at(end);
            self.line += part.iter().filter(|byte| **byte == b'\n').count() as u64;
            if cell.is_empty() {
                cell = Cow::Borrowed(part);
            } else {
                cell.to_mut().extend_from_slice(part);
            }
            match rest.strip_prefix(b"\"\"") {
                Some(rest) => {
                    cell.to_mut().push(b'"');
                    self.rest = rest;
                }
                None => {
                    self.rest = rest.split_at(1).1;
                    break;
                }
            }
        }
        if self.grammar.separator != Separator::Blank {
            self.skip_blanks();
        }
        match self.rest {
            [] | [b'\n', ..] => {}
            [byte, ..] if self.grammar.separates(*byte) => {}
            [b'\r', rest @ ..] if matches!(rest, [] | [b'\n', ..]) => self.rest = rest,
            _ => return Err(Broken { line: self.line, position, open: false }),
        }
        Ok(cell)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn all(text: &str) -> Result<Vec<(u64, Vec<String>)>, Broken> {
        let mut rows = Rows::new(text.as_bytes());
        let (mut cells, mut found) = (Vec::new(), Vec::new());
        while let Some(line) = rows.next_row(&mut cells)? {
            let texts = cells.iter().map(|cell| String::from_utf8(cell.to_vec()).unwrap());
            found.push((line, texts.collect()));
        }
        Ok(found)
    }

    fn row(line: u64, cells: &[&str]) -> (u64, Vec<String>) {
        (line, cells.iter().map(|cell| (*cell).to_owned()).collect())
    }

    #[test]
    fn rows_cells_and_lines_are_told_apart() {
        assert_eq!(all("a,b\n1,2").unwrap(), [row(1, &["a", "b"]), row(2, &["1", "2"])]);
        assert_eq!(all("\r\n a ,\tb \r\n \n,\n").unwrap(), [row(2, &["a", "b"]), row(4, &["", ""])]);
        assert_eq!(all("\"\",x\n").unwrap(), [row(1, &["", "x"])]);
        assert_eq!(all("\"a, \"\"b\"\"\nc\" ,d\r\ne,f").unwrap(), [row(1, &["a, \"b\"\nc", "d"]), row(3, &["e", "f"])]);
        assert_eq!(all(" \n\t\n").unwrap(), []);
        assert_eq!(all("\"\"\"\"").unwrap(), [row(1, &["\""])]);
    }

    #[test]
    fn other_separators_and_comments_are_told_apart() {
        let read = |text: &str, separator| {
            let mut rows = Rows::with(text.as_bytes(), Grammar { separator, comments: Comments::Marked });
            let (mut cells, mut found) = (Vec::new(), Vec::new());
            while let Some(line) = rows.next_row(&mut cells).unwrap() {
                found.push((line, cells.iter().map(|cell| String::from_utf8(cell.to_vec()).unwrap()).collect()));
            }
            let comment = rows.last_comment().map(|(line, text)| (line, String::from_utf8(text.to_vec()).unwrap()));
            (found, comment)
        };
        let (rows, comment) = read("# rig 3\n% t;p\n1,5;\"a;b\"\n", Separator::Semicolon);
        assert_eq!(rows, [row(3, &["1,5", "a;b"])]);
        assert_eq!(comment, Some((2, "t;p".to_owned())));
        assert_eq!(
            read("a\t\tb\r\n\t\t\n1\t2\t\n", Separator::Tab).0,
            [row(1, &["a", "", "b"]), row(3, &["1", "2", ""])]
        );
        let (rows, _) = read("  t   p \r\n\n 1.5\t -2\n3 4", Separator::Blank);
        assert_eq!(rows, [row(1, &["t", "p"]), row(3, &["1.5", "-2"]), row(4, &["3", "4"])]);
    }

    #[test]
    fn broken_quotes_are_placed() {
        assert_eq!(all("a\nb,\"c\nd"), Err(Broken { line: 2, position: 2, open: true }));
        assert_eq!(all("\"a\"b\n"), Err(Broken { line: 1, position: 1, open: false }));
        assert_eq!(all("\"a\n\"b\n"), Err(Broken { line: 2, position: 1, open: false }));
    }

    proptest! {
        #[test]
        fn it_agrees_with_the_csv_crate_on_clean_files(
            cells in proptest::collection::vec(proptest::collection::vec("[a-z0-9\",\n.]{1,6}", 3), 1..8),
        ) {
            let mut writer = csv::WriterBuilder::new().from_writer(Vec::new());
            for row in &cells {
                writer.write_record(row).unwrap();
            }
            let text = String::from_utf8(writer.into_inner().unwrap()).unwrap();
            let found: Vec<Vec<String>> = all(&text).unwrap().into_iter().map(|(_, row)| row).collect();
            prop_assert_eq!(found, cells);
        }

        #[test]
        fn no_text_makes_it_panic(text in "[a\", \r\n]{0,40}") {
            let _ = all(&text);
        }
    }
}
