//! Kinds of files, known by their first bytes: those that are read, and those that are refused with the line that makes them readable.

use super::sheet::Sheet;
use super::{hdf5, mat5};
use crate::recording::csv::CsvError;
use crate::recording::recording_error::RecordingError;

/// A kind that is not read: its first bytes, what it is, what makes it readable.
struct Refused {
    magic: &'static [u8],
    what: &'static str,
    mend: &'static str,
}

const REFUSED: [Refused; 13] = [
    Refused {
        magic: b"version https://git-lfs",
        what: "a pointer of Git LFS, not the file",
        mend: "fetch it with: git lfs pull",
    },
    Refused { magic: b"\x89PNG", what: "a picture", mend: "give the table that it shows" },
    Refused { magic: b"\xff\xd8\xff", what: "a picture", mend: "give the table that it shows" },
    Refused { magic: b"%PDF", what: "a PDF file", mend: "give the table that it shows, as CSV" },
    Refused { magic: b"\xff\xfe\0\0", what: "UTF-32 text, which is not read", mend: "save it as UTF-8" },
    Refused {
        magic: b"PAR1",
        what: "a Parquet file, which is not read",
        mend: "write it as CSV: python3 -c \"import pandas; pandas.read_parquet('FILE').to_csv('FILE.csv', index=False)\"",
    },
    Refused {
        magic: b"PK\x03\x04",
        what: "a workbook or a ZIP archive, which is not read",
        mend: "save the sheet as CSV, or unpack the archive",
    },
    Refused { magic: b"BZh", what: "compressed with bzip2, which is not read", mend: "unpack it with bunzip2" },
    Refused { magic: b"\xfd7zXZ\0", what: "compressed with xz, which is not read", mend: "unpack it with unxz" },
    Refused {
        magic: b"\x04\x22\x4d\x18",
        what: "compressed with lz4, which is not read",
        mend: "unpack it with unlz4",
    },
    Refused { magic: b"7z\xbc\xaf\x27\x1c", what: "a 7-Zip archive, which is not read", mend: "unpack it" },
    Refused {
        magic: b"\xd0\xcf\x11\xe0",
        what: "an old Excel workbook, which is not read",
        mend: "save the sheet as CSV",
    },
    Refused {
        magic: b"TDSm",
        what: "a LabVIEW TDMS file, which is not read",
        mend: "write it as text: python3 -c \"import nptdms; nptdms.TdmsFile('FILE').as_dataframe().to_csv('FILE.csv')\"",
    },
];

/// First bytes of a MATLAB 5 file.
pub(crate) const MAT5: &[u8] = b"MATLAB 5.0 MAT-file";

/// The sheet that a file of numbers holds; `None` for text.
///
/// # Errors
/// A kind that is not read, or a MATLAB or HDF5 file without columns.
pub(crate) fn sheet(file: &str, bytes: &[u8]) -> Result<Option<Sheet<'static>>, RecordingError> {
    if bytes.starts_with(MAT5) {
        return mat5::sheet(file, bytes).map(Some);
    }
    if [hdf5::MATLAB_7_3, hdf5::HDF5].iter().any(|magic| bytes.starts_with(magic)) {
        return hdf5::sheet(file, bytes).map(Some);
    }
    let start = bytes.get(..bytes.len().min(LOOKED_AT)).unwrap_or_default();
    if !start.is_empty() && start.iter().all(|byte| *byte == 0) {
        return Err(RecordingError::Kind {
            file: file.to_owned(),
            what: "it begins with nothing but zero bytes: a binary file, or one whose data never reached the disk"
                .to_owned(),
            mend: "get it again from the logger".to_owned(),
        });
    }
    if is_mat4(bytes) {
        return Err(RecordingError::Kind {
            file: file.to_owned(),
            what: "it is a MATLAB 4 file, which is not read".to_owned(),
            mend: "save it again in MATLAB: x = load('FILE.mat'); save('FILE_v7.mat', '-struct', 'x', '-v7')"
                .to_owned(),
        });
    }
    match REFUSED.iter().find(|kind| bytes.starts_with(kind.magic)) {
        Some(Refused { what, mend, .. }) => {
            Err(RecordingError::Kind { file: file.to_owned(), what: format!("it is {what}"), mend: (*mend).to_owned() })
        }
        None => Ok(None),
    }
}

/// Tells whether bytes begin as a MATLAB 4 file: type, rows, columns, imaginary part, length of the name, and the name with its zero.
fn is_mat4(bytes: &[u8]) -> bool {
    const LONGEST_NAME: u32 = 64;
    let words = bytes.as_chunks::<4>().0;
    let [of_type, _rows, _columns, imaginary, length] = words.get(..5).unwrap_or_default() else { return false };
    [u32::from_le_bytes, u32::from_be_bytes].into_iter().any(|number: fn([u8; 4]) -> u32| {
        let length = number(*length);
        let name = bytes.get(20..20 + length.min(LONGEST_NAME) as usize).unwrap_or_default();
        let is_name = name.split_last().is_some_and(|(end, name)| {
            *end == 0 && name.first().is_some_and(u8::is_ascii_alphabetic) && name.iter().all(u8::is_ascii_graphic)
        });
        number(*of_type) < 5_000 && number(*imaginary) < 2 && length <= LONGEST_NAME && is_name
    })
}

/// Characters from which a binary file is told from text.
const LOOKED_AT: usize = 4096;
/// One control character in so many: no text has that.
const BINARY: usize = 50;

/// Tells bytes that are no text by one in fifty of their first characters, which is none that can be printed. Zeros at the end, which some
/// loggers leave in a file of a fixed size, do not count, and a block of them, which a disk that lost power leaves, counts once.
fn is_binary(text: &str) -> bool {
    let start = text.trim_end_matches('\0').chars().take(LOOKED_AT);
    let (mut all, mut odd, mut before) = (0, 0, ' ');
    for letter in start {
        all += 1;
        let goes_on = (before, letter) == ('\0', '\0');
        odd += usize::from(letter.is_ascii_control() && !letter.is_ascii_whitespace() && !goes_on);
        before = letter;
    }
    odd * BINARY > all
}

fn binary(file: &str) -> RecordingError {
    RecordingError::Kind {
        file: file.to_owned(),
        what: "it is a binary file of a kind that is not read".to_owned(),
        mend: "write its columns as CSV: a line of names, then a row per sample".to_owned(),
    }
}

/// The error of bytes that are no text: of a binary file where they look like one, and otherwise that of the byte.
pub(crate) fn no_text(file: &str, bytes: &[u8], error: CsvError) -> RecordingError {
    let start: String = bytes.iter().take(LOOKED_AT).map(|byte| char::from(*byte)).collect();
    if is_binary(&start) { binary(file) } else { error.into() }
}

/// Refuses texts that are no tables, and bytes that are no text.
///
/// # Errors
/// HTML, XML, JSON and binary files, with what makes them readable.
pub(crate) fn check_text(file: &str, text: &str) -> Result<(), RecordingError> {
    let text = text.trim_start();
    if is_binary(text) {
        return Err(binary(file));
    }
    let after = |open: char| text.strip_prefix(open).and_then(|rest| rest.trim_start().chars().next());
    let (what, mend) = if after('<').is_some_and(|c| c.is_ascii_alphabetic() || matches!(c, '!' | '?')) {
        ("it is HTML or XML, which is not read", "save the table in it as CSV")
    } else if after('{') == Some('"') || after('[').is_some_and(|c| matches!(c, '{' | '[' | '"' | '-' | '0'..='9')) {
        ("it is JSON, which is not read", json_mend(text))
    } else {
        return Ok(());
    };
    Err(RecordingError::Kind { file: file.to_owned(), what: what.to_owned(), mend: mend.to_owned() })
}

/// The error of a log of lines.
pub(crate) fn log(file: &str) -> RecordingError {
    RecordingError::Kind {
        file: file.to_owned(),
        what: "each of its lines says `name=number` among other words, as logs of programs and line protocols do, which is not read"
            .to_owned(),
        mend: "write it as CSV: a line of names with the time among them, then a row for each line with what stands behind the `=`"
            .to_owned(),
    }
}

/// The command that makes a table of JSON: of an object in each line, or of one value.
fn json_mend(text: &str) -> &'static str {
    let lines: Vec<&str> = text.lines().map(str::trim).filter(|line| !line.is_empty()).take(2).collect();
    let is_object = |line: &&str| line.starts_with('{') && line.ends_with('}');
    // One line alone may be an object of whole columns.
    if lines.len() == 2 && lines.iter().all(is_object) {
        "write it as CSV: python3 -c \"import pandas; pandas.read_json('FILE', lines=True, convert_dates=False).to_csv('FILE.csv', index=False)\""
    } else {
        "write it as CSV: python3 -c \"import pandas; pandas.read_json('FILE', convert_dates=False).to_csv('FILE.csv', index=False)\""
    }
}
