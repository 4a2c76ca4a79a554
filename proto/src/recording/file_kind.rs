//! What a file is, by its first bytes: what is read, and what is refused with the line that makes it readable.

use super::mat5;
use super::sheet::Sheet;
use super::table::RecordingError;

/// A kind that is not read: its first bytes, what it is, what makes it readable.
struct Refused {
    magic: &'static [u8],
    what: &'static str,
    mend: &'static str,
}

const REFUSED: [Refused; 8] = [
    Refused {
        magic: b"MATLAB 7.3",
        what: "a MATLAB 7.3 file (HDF5), which is not read",
        mend: "save it again in MATLAB: x = load('FILE.mat'); save('FILE_v7.mat', '-struct', 'x', '-v7')",
    },
    Refused {
        magic: b"\x89HDF\r\n\x1a\n",
        what: "an HDF5 file, which is not read",
        mend: "write its columns as CSV, or from MATLAB with save(…, '-v7')",
    },
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
    Refused { magic: b"\x1f\x8b", what: "compressed with gzip", mend: "unpack it with gunzip" },
    Refused { magic: b"\x28\xb5\x2f\xfd", what: "compressed with zstd", mend: "unpack it with unzstd" },
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
const MAT5: &[u8] = b"MATLAB 5.0 MAT-file";

/// The sheet that a file of numbers holds; `None` for text.
///
/// # Errors
/// A kind that is not read, or a MATLAB file without columns.
pub(super) fn sheet(file: &str, bytes: &[u8]) -> Result<Option<Sheet<'static>>, RecordingError> {
    if bytes.starts_with(MAT5) {
        return mat5::sheet(file, bytes).map(Some);
    }
    match REFUSED.iter().find(|kind| bytes.starts_with(kind.magic)) {
        Some(Refused { what, mend, .. }) => {
            Err(RecordingError::Kind { file: file.to_owned(), what: format!("it is {what}"), mend: (*mend).to_owned() })
        }
        None => Ok(None),
    }
}
