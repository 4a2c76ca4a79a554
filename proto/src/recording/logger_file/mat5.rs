//! MATLAB files of level 5 (`save -v6`, `-v7`): their vectors as columns.
//!
//! After 128 bytes of text, version and byte order come elements of a type, a length and data, padded to 8 bytes (four-byte
//! lengths and data in one word where they fit); `-v7` compresses each variable (zlib). A column is a real numeric or logical
//! vector, a field of a 1×1 structure (`run.p`), or a column of a matrix (`y(:,2)`). (The format is
//! published: MAT-File Format, MathWorks.)
//!
//! Left out: characters, cells, sparse and complex matrices; objects (tables, timetables, timeseries), which MATLAB stores in a
//! form that it does not publish.

use super::numeric_vectors::{MOST_BYTES, MOST_COLUMNS, NumericVectors, Wording};
use super::sheet::Sheet;
use crate::recording::recording_error::RecordingError;

const HEADER: usize = 128;
const COMPRESSED: u32 = 15;
const MATRIX: u32 = 14;
/// Classes of arrays.
const STRUCT: u8 = 2;
const OBJECTS: [u8; 2] = [3, 17];
const NUMERIC: std::ops::RangeInclusive<u8> = 6..=15;

/// Words for MATLAB's files, of this level and of 7.3.
pub(super) const MATLAB: Wording = Wording {
    kind: "a MATLAB file",
    vectors: "MATLAB vectors",
    mend: "write vectors of one length from MATLAB: t = …; u = …; p = …; save('FILE.mat', 't', 'u', 'p', '-v7')",
};

/// Byte order of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Order {
    Little,
    Big,
}

/// Reads the columns of a file.
///
/// # Errors
/// No vectors, or damaged elements: in one line, with the MATLAB line that helps.
pub(crate) fn sheet(file: &str, bytes: &[u8]) -> Result<Sheet<'static>, RecordingError> {
    let order = match bytes.get(126..HEADER) {
        Some(b"IM") => Order::Little,
        Some(b"MI") => Order::Big,
        _ => return Err(MATLAB.broken(file, "its header is damaged")),
    };
    let mut gathered = NumericVectors::default();
    let mut rest = bytes.get(HEADER..).unwrap_or_default();
    while let Some((kind, data, after)) = element(rest, order) {
        match kind {
            COMPRESSED => {
                let inflated = miniz_oxide::inflate::decompress_to_vec_zlib_with_limit(data, MOST_BYTES)
                    .map_err(|_| MATLAB.broken(file, "a compressed variable of it is damaged"))?;
                if let Some((MATRIX, data, _)) = element(&inflated, order) {
                    matrix(&mut gathered, data, order, "");
                }
            }
            MATRIX => matrix(&mut gathered, data, order, ""),
            _ => {}
        }
        rest = after;
    }
    if rest.len() >= 8 {
        gathered.remark(format!("{file}: the file is cut short; variables before the cut were read, the one at the cut and all behind it were not"));
    }
    gathered.into_sheet(file, &MATLAB)
}

/// Takes the columns of an array; what cannot be read is left out.
fn matrix(gathered: &mut NumericVectors, data: &[u8], order: Order, prefix: &str) {
    let Some((_, flags, rest)) = element(data, order) else { return };
    let Some((_, dimensions, rest)) = element(rest, order) else { return };
    let Some((_, name, rest)) = element(rest, order) else { return };
    // The class is the lowest byte of the first word; bit 11 of it says complex.
    let Some(word) = flags.first_chunk::<4>().map(|bytes| number_u32(*bytes, order)) else { return };
    let (class, complex) = (word as u8, word & 0x800 != 0);
    let name = String::from_utf8_lossy(name).trim_end_matches('\0').to_owned();
    let name = if prefix.is_empty() { name } else { prefix.to_owned() };
    if OBJECTS.contains(&class) {
        gathered.leave_out(name);
        return;
    }
    let sizes: Vec<usize> = dimensions
        .as_chunks::<4>()
        .0
        .iter()
        .map(|bytes| usize::try_from(number_u32(*bytes, order)).unwrap_or(usize::MAX))
        .collect();
    if class == STRUCT {
        structure(gathered, rest, order, &name, &sizes);
        return;
    }
    if !NUMERIC.contains(&class) || complex {
        return;
    }
    let (Some((kind, real, _)), [rows, columns]) = (element(rest, order), sizes.as_slice()) else { return };
    let Some(numbers) = numbers(kind, real, order) else { return };
    if rows.checked_mul(*columns) != Some(numbers.len()) || numbers.is_empty() {
        return;
    }
    if *rows == 1 || *columns == 1 {
        gathered.take(name, None, numbers);
    } else if *columns <= MOST_COLUMNS {
        gathered.take_columns(&name, None, numbers.chunks(*rows).map(<[f64]>::to_vec), |at| format!("(:,{})", at + 1));
    }
}

/// Takes the fields of a 1×1 structure.
fn structure(gathered: &mut NumericVectors, rest: &[u8], order: Order, name: &str, sizes: &[usize]) {
    if sizes.iter().any(|size| *size != 1) {
        return;
    }
    let Some((_, length, rest)) = element(rest, order) else { return };
    let Some((_, names, mut rest)) = element(rest, order) else { return };
    let Some(length) = length.first_chunk::<4>().map(|bytes| number_u32(*bytes, order) as usize) else { return };
    if length == 0 {
        return;
    }
    for field in names.chunks(length) {
        let end = field.iter().position(|byte| *byte == 0).unwrap_or(field.len());
        let field = String::from_utf8_lossy(field.get(..end).unwrap_or_default()).into_owned();
        let Some((kind, data, after)) = element(rest, order) else { return };
        if kind == MATRIX {
            matrix(gathered, data, order, &format!("{name}.{field}"));
        }
        rest = after;
    }
}

/// Type and data of the element that bytes begin with, and what follows it; `None` where none is whole.
fn element(bytes: &[u8], order: Order) -> Option<(u32, &[u8], &[u8])> {
    let word = number_u32(*bytes.first_chunk::<4>()?, order);
    // A small element: length in the upper half of the first word, data in the second word.
    if word >> 16 != 0 {
        let data = bytes.get(4..8)?.get(..(word >> 16) as usize)?;
        return Some((word & 0xffff, data, bytes.get(8..)?));
    }
    let length = number_u32(*bytes.get(4..8)?.first_chunk::<4>()?, order) as usize;
    let data = bytes.get(8..)?.get(..length)?;
    // Compressed elements are not padded.
    let padded = if word == COMPRESSED { length } else { length.next_multiple_of(8) };
    Some((word, data, bytes.get(8 + padded..).unwrap_or_default()))
}

fn number_u32(bytes: [u8; 4], order: Order) -> u32 {
    match order {
        Order::Little => u32::from_le_bytes(bytes),
        Order::Big => u32::from_be_bytes(bytes),
    }
}

/// The numbers of a data element; `None` for a type of another kind.
fn numbers(kind: u32, data: &[u8], order: Order) -> Option<Vec<f64>> {
    macro_rules! of {
        ($($kind:literal => $rust:ty),*) => {
            match kind {
                $($kind => Some(
                    data.as_chunks::<{ size_of::<$rust>() }>()
                        .0
                        .iter()
                        .map(|bytes| match order {
                            Order::Little => <$rust>::from_le_bytes(*bytes) as f64,
                            Order::Big => <$rust>::from_be_bytes(*bytes) as f64,
                        })
                        .collect(),
                ),)*
                _ => None,
            }
        };
    }
    of!(1 => i8, 2 => u8, 3 => i16, 4 => u16, 5 => i32, 6 => u32, 7 => f32, 9 => f64, 12 => i64, 13 => u64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::logger_file::sheet::{Cells, SheetColumn};

    fn padded(kind: u32, data: &[u8]) -> Vec<u8> {
        let mut bytes = [kind.to_le_bytes(), (data.len() as u32).to_le_bytes()].concat();
        bytes.extend_from_slice(data);
        bytes.resize(bytes.len().next_multiple_of(8), 0);
        bytes
    }

    fn array(class: u8, sizes: [u32; 2], name: &str, body: &[u8]) -> Vec<u8> {
        let flags = [u32::from(class).to_le_bytes(), [0; 4]].concat();
        let sizes = sizes.map(u32::to_le_bytes).concat();
        padded(MATRIX, &[padded(6, &flags), padded(5, &sizes), padded(1, name.as_bytes()), body.to_vec()].concat())
    }

    fn doubles(name: &str, sizes: [u32; 2], numbers: &[f64]) -> Vec<u8> {
        let data: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        array(6, sizes, name, &padded(9, &data))
    }

    fn whole(elements: &[Vec<u8>]) -> Vec<u8> {
        let mut bytes = b"MATLAB 5.0 MAT-file, Platform: GLNXA64".to_vec();
        bytes.resize(124, b' ');
        bytes.extend_from_slice(&[0, 1, b'I', b'M']);
        bytes.extend(elements.concat());
        bytes
    }

    fn columns(bytes: &[u8]) -> Vec<(String, Vec<f64>)> {
        let of = |column: SheetColumn<'_>| match column.cells {
            Cells::Numbers(numbers) => (column.name, numbers),
            Cells::Text(_) => (column.name, Vec::new()),
        };
        sheet("x.mat", bytes).unwrap().columns.into_iter().map(of).collect()
    }

    #[test]
    fn vectors_fields_and_columns_of_matrices_are_read() {
        // A small element holds up to four bytes of data in its own eight: three numbers of one byte.
        let small = [[2, 0, 3, 0].to_vec(), vec![1, 0, 1, 0]].concat();
        let length = padded(5, &8_u32.to_le_bytes());
        let fields = padded(1, b"p\0\0\0\0\0\0\0note\0\0\0\0");
        let text = array(4, [1, 2], "", &padded(16, b"ab"));
        let body = [length, fields, doubles("", [1, 3], &[7.0, 8.0, 9.0]), text].concat();
        let zipped = miniz_oxide::deflate::compress_to_vec_zlib(&doubles("t", [3, 1], &[0.0, 0.02, 0.04]), 6);
        let bytes = whole(&[
            [COMPRESSED.to_le_bytes(), (zipped.len() as u32).to_le_bytes()].concat(),
            zipped,
            array(9, [3, 1], "on", &small),
            doubles("y", [3, 2], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]),
            array(STRUCT, [1, 1], "run", &body),
            doubles("gain", [1, 1], &[3.0]),
        ]);
        let expected = [
            ("t", vec![0.0, 0.02, 0.04]),
            ("on", vec![1.0, 0.0, 1.0]),
            ("y(:,1)", vec![1.0, 2.0, 3.0]),
            ("y(:,2)", vec![4.0, 5.0, 6.0]),
            ("run.p", vec![7.0, 8.0, 9.0]),
        ];
        assert_eq!(columns(&bytes), expected.map(|(name, numbers)| (name.to_owned(), numbers)));
        // Whatever is cut or flipped, nothing panics.
        for end in 0..bytes.len() {
            let _ = sheet("x.mat", &bytes[..end]);
            let mut flipped = bytes.clone();
            flipped[end] ^= 0x55;
            let _ = sheet("x.mat", &flipped);
        }
    }

    #[test]
    fn what_was_left_out_stands_beside_what_is_missed() {
        let rig = model::rig::Rig::builtin("dual_pressure").unwrap();
        let numbers: Vec<f64> = (0..30).map(|k| 0.02 * f64::from(k)).collect();
        let vectors = |times: usize| {
            let others = ["u_pos", "u_neg", "p_pos_kpa"].map(|name| doubles(name, [30, 1], &numbers));
            whole(&[vec![doubles("time_s", [times as u32, 1], &numbers[..times])], others.to_vec()].concat())
        };
        let read = |bytes: &[u8]| crate::recording::Recording::parse_for("x.mat", bytes, &rig);
        let said = read(&vectors(29)).unwrap_err().to_string();
        assert!(said.contains("time_s is missing") && said.contains("time_s has 29"), "{said}");
        let bytes = [vectors(30), doubles("p_neg_kpa", [30, 1], &numbers)].concat();
        let cut = read(&bytes[..bytes.len() - 40]).unwrap();
        let said = cut.require(["p_neg_kpa"]).unwrap_err().to_string();
        assert!(said.contains("p_neg_kpa is missing") && said.contains("cut short"), "{said}");
    }

    #[test]
    fn what_has_no_vector_says_so() {
        let said = sheet("x.mat", &whole(&[array(17, [1, 1], "tt", &[])])).unwrap_err().to_string();
        assert!(said.contains("objects: tt") && said.contains("save('FILE.mat'"), "{said}");
    }
}
