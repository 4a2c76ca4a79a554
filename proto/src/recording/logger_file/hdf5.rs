//! HDF5 files, those of MATLAB 7.3 (`save -v7.3`) among them: their arrays of numbers as columns.
//!
//! A column is a dataset of one dimension, a column of a matrix, or a member of records (`run['p']` of h5py); a dataset in
//! groups is named with points (`run.p`), as a field of a MATLAB structure is. Of a matrix the longer side is time. MATLAB
//! stores its matrices column by column and says its class beside each (`MATLAB_class`), by which they are told from others.
//! A unit that stands beside a dataset (`units`) is used as one in a column's name is.
//!
//! Left out: texts, references (cells, arrays of structures), complex and sparse arrays, more than two dimensions, and what
//! MATLAB stores as objects.

use hdf5_pure::{AttrValue, Dataset, Datatype, DatatypeByteOrder, File, Group};

use super::mat5::MATLAB;
use super::numeric_vectors::{MOST_BYTES, MOST_COLUMNS, NumericVectors, Wording};
use super::sheet::Sheet;
use crate::recording::columns::units::Unit;
use crate::recording::recording_error::RecordingError;

/// First bytes of a file of MATLAB 7.3.
pub(crate) const MATLAB_7_3: &[u8] = b"MATLAB 7.3";
/// First bytes of any other HDF5 file.
pub(crate) const HDF5: &[u8] = b"\x89HDF\r\n\x1a\n";

/// Groups within groups that are looked into: a link may lead back to its own group.
const DEEPEST: usize = 6;
/// Objects that are looked at.
const MOST_OBJECTS: usize = 10_000;
/// Memory that all arrays together may take (bytes).
const MOST_IN_ALL: u64 = 1 << 30;

/// Words for the files of other programs.
const OTHER: Wording = Wording {
    kind: "an HDF5 file",
    vectors: "HDF5 datasets",
    mend: "write datasets of one length, one for each column: time_s, u_pos, …",
};

/// Reads the columns of a file.
///
/// # Errors
/// A file that is damaged or cut off, or holds no array of numbers.
pub(crate) fn sheet(file: &str, bytes: &[u8]) -> Result<Sheet<'static>, RecordingError> {
    let wording = if bytes.starts_with(MATLAB_7_3) { MATLAB } else { OTHER };
    let damaged = |error: hdf5_pure::Error| wording.broken(file, &format!("damaged or cut off ({error})"));
    let opened = File::from_bytes(bytes.to_vec()).map_err(damaged)?;
    // Otherwise an array before a cut could still be read, and its unit behind the cut not.
    let whole = opened.superblock().eof_address;
    if whole > bytes.len() as u64 {
        return Err(wording.broken(file, &format!("cut off: {} of {whole} bytes are there", bytes.len())));
    }
    let mut walk = Walk { file, gathered: NumericVectors::default(), left: MOST_OBJECTS, left_bytes: MOST_IN_ALL };
    walk.group(&opened.root(), "", DEEPEST).map_err(damaged)?;
    walk.gathered.into_sheet(file, &wording)
}

/// A walk through a file's groups.
struct Walk<'f> {
    file: &'f str,
    gathered: NumericVectors,
    /// Objects that may still be looked at.
    left: usize,
    /// Memory that arrays may still take (bytes).
    left_bytes: u64,
}

impl Walk<'_> {
    /// Takes note of an object that is passed over.
    fn leave_out(&mut self, name: &str, why: impl std::fmt::Display) {
        self.gathered.remark(format!("{}: {name} left out: {why}", self.file));
    }

    /// Counts an object; false where no more are looked at.
    fn is_within_count(&mut self) -> bool {
        if self.left == 1 {
            self.gathered.remark(format!("{}: only the first {MOST_OBJECTS} objects of it were looked at", self.file));
        }
        self.left = self.left.saturating_sub(1);
        self.left > 0
    }

    fn group(&mut self, group: &Group, prefix: &str, deeper: usize) -> Result<(), hdf5_pure::Error> {
        for (name, dataset) in group.iter_datasets()? {
            if !self.is_within_count() {
                return Ok(());
            }
            let name = format!("{prefix}{name}");
            // One array that cannot be read is no reason to read none, here and below.
            if let Err(error) = self.dataset(&dataset, &name) {
                self.leave_out(&name, error);
            }
        }
        for (name, inner) in group.iter_groups()? {
            // Where MATLAB keeps what its cells and objects refer to.
            if name.starts_with('#') {
                continue;
            }
            if !self.is_within_count() {
                return Ok(());
            }
            let name = format!("{prefix}{name}");
            if deeper == 0 {
                self.leave_out(&name, format!("only {DEEPEST} groups within each other are looked into"));
                continue;
            }
            let within = match inner.attrs() {
                Ok(attributes) if matlab_class(&attributes).is_some_and(|class| class != "struct") => {
                    self.gathered.leave_out(name);
                    continue;
                }
                Ok(_) => self.group(&inner, &format!("{name}."), deeper - 1),
                Err(error) => Err(error),
            };
            if let Err(error) = within {
                self.leave_out(&name, error);
            }
        }
        Ok(())
    }

    fn dataset(&mut self, dataset: &Dataset, name: &str) -> Result<(), hdf5_pure::Error> {
        let attributes = dataset.attrs()?;
        let class = matlab_class(&attributes);
        if attributes.contains_key("MATLAB_object_decode") {
            self.gathered.leave_out(name.to_owned());
            return Ok(());
        }
        if attributes.contains_key("MATLAB_empty") || class.is_some_and(|class| matches!(class, "char" | "cell")) {
            return Ok(());
        }
        let shape = dataset.shape()?;
        let Some(shape) = Shape::of(&shape, class) else { return Ok(()) };
        let record = dataset.datatype()?;
        let members: Vec<(String, u64, &Datatype)> = match &record {
            // The parts of a complex number, as MATLAB and h5py write them.
            Datatype::Compound { members, .. } if members.iter().any(|m| matches!(&*m.name, "imag" | "i")) => {
                return Ok(());
            }
            Datatype::Compound { members, .. } => {
                members.iter().map(|of| (format!("{name}.{}", of.name), of.byte_offset, &of.datatype)).collect()
            }
            plain => vec![(name.to_owned(), 0, plain)],
        };
        let members: Vec<_> =
            members.into_iter().filter_map(|(name, at, of)| Some((name, at, Number::of(of)?))).collect();
        let size = dataset.element_size()?;
        if members.is_empty() {
            return Ok(());
        }
        // As they are read each number takes eight bytes, whatever it takes in the file.
        let takes = shape.bytes(size.max(8 * members.len() as u64)).filter(|bytes| *bytes <= MOST_BYTES as u64);
        let Some(left_bytes) = takes.and_then(|takes| self.left_bytes.checked_sub(takes)) else {
            self.leave_out(name, "it is larger than 128 MiB, or all arrays together than 1 GiB");
            return Ok(());
        };
        self.left_bytes = left_bytes;
        let bytes = dataset.read_raw()?;
        let unit = ["units", "unit"].into_iter().find_map(|key| attributes.get(key).and_then(text));
        let unit = unit.filter(|unit| Unit::parse(unit).is_some());
        for (name, at, number) in members {
            let numbers: Option<Vec<f64>> = (usize::try_from(size).ok())
                .filter(|size| *size > 0)
                .and_then(|size| bytes.chunks_exact(size).map(|record| number.read(record, at)).collect());
            match numbers {
                Some(numbers) => shape.columns(&mut self.gathered, name, unit, numbers),
                None => self.leave_out(&name, "its numbers are of a kind that is not read"),
            }
        }
        Ok(())
    }
}

/// Sides of an array, as its numbers lie one behind the other.
enum Shape {
    /// One column.
    Vector { length: u64 },
    /// Columns of so many rows, each whole behind the other, and what a column is called behind the array's name.
    ColumnByColumn { rows: u64, columns: u64, place: fn(usize) -> String },
    /// Rows of so many numbers.
    RowByRow { rows: u64, columns: u64 },
}

impl Shape {
    /// Sides of an array of these dimensions; `None` where it is no set of columns.
    fn of(shape: &[u64], class: Option<&str>) -> Option<Self> {
        const MOST: u64 = MOST_COLUMNS as u64;
        match *shape {
            [length] | [1, length] | [length, 1] => Some(Shape::Vector { length }),
            // MATLAB's rows are the last dimension here.
            [columns, rows] if class.is_some() => {
                let place: fn(usize) -> String = |at| format!("(:,{})", at + 1);
                (columns <= MOST).then_some(Shape::ColumnByColumn { rows, columns, place })
            }
            [columns, rows] if columns < rows => {
                let place: fn(usize) -> String = |at| format!("[{at},:]");
                (columns <= MOST).then_some(Shape::ColumnByColumn { rows, columns, place })
            }
            [rows, columns] => (columns <= MOST).then_some(Shape::RowByRow { rows, columns }),
            _ => None,
        }
    }

    /// Memory of all elements of this size (bytes); `None` where that is beyond counting.
    fn bytes(&self, size: u64) -> Option<u64> {
        let elements = match *self {
            Shape::Vector { length } => Some(length),
            Shape::ColumnByColumn { rows, columns, .. } | Shape::RowByRow { rows, columns } => {
                rows.checked_mul(columns)
            }
        };
        elements.and_then(|elements| elements.checked_mul(size))
    }

    fn columns(&self, gathered: &mut NumericVectors, name: String, unit: Option<&str>, numbers: Vec<f64>) {
        match *self {
            Shape::Vector { .. } => gathered.take(name, unit.map(str::to_owned), numbers),
            Shape::ColumnByColumn { rows, place, .. } => {
                let columns = numbers.chunks((rows as usize).max(1)).map(<[f64]>::to_vec);
                gathered.take_columns(&name, unit, columns, place);
            }
            Shape::RowByRow { columns, .. } => {
                let columns = (columns as usize).max(1);
                let of = (0..columns).map(|at| numbers.iter().skip(at).step_by(columns).copied().collect());
                gathered.take_columns(&name, unit, of, |at| format!("[:,{at}]"));
            }
        }
    }
}

/// A kind of number as it lies in a record.
#[derive(Clone, Copy)]
struct Number {
    kind: Kind,
    size: u32,
    order: DatatypeByteOrder,
}

#[derive(Clone, Copy)]
enum Kind {
    Float,
    Signed,
    Unsigned,
}

impl Number {
    /// Kind of number of a type; `None` for what is none.
    fn of(datatype: &Datatype) -> Option<Self> {
        match *datatype {
            Datatype::FloatingPoint { size, byte_order: order, .. } => Some(Number { kind: Kind::Float, size, order }),
            Datatype::FixedPoint { size, byte_order: order, layout } => {
                Some(Number { kind: if layout.signed { Kind::Signed } else { Kind::Unsigned }, size, order })
            }
            // h5py writes what is true or false as an enumeration of 0 and 1.
            Datatype::Enumeration { ref base_type, .. } => Number::of(base_type),
            _ => None,
        }
    }

    /// The number at a place of a record; `None` where the record is shorter, or a kind is not known.
    fn read(self, record: &[u8], at: u64) -> Option<f64> {
        let at = usize::try_from(at).ok()?;
        let size = usize::try_from(self.size).ok()?;
        let mut bytes = [0_u8; 8];
        let number = bytes.get_mut(..size)?;
        number.copy_from_slice(record.get(at..at.checked_add(size)?)?);
        match self.order {
            DatatypeByteOrder::LittleEndian => {}
            DatatypeByteOrder::BigEndian => number.reverse(),
            DatatypeByteOrder::Vax => return None,
        }
        macro_rules! number {
            ($rust:ty) => {
                bytes.first_chunk().map(|bytes| <$rust>::from_le_bytes(*bytes) as f64)
            };
        }
        match (self.kind, size) {
            (Kind::Float, 4) => number!(f32),
            (Kind::Float, 8) => number!(f64),
            (Kind::Signed, 1) => number!(i8),
            (Kind::Signed, 2) => number!(i16),
            (Kind::Signed, 4) => number!(i32),
            (Kind::Signed, 8) => number!(i64),
            (Kind::Unsigned, 1) => number!(u8),
            (Kind::Unsigned, 2) => number!(u16),
            (Kind::Unsigned, 4) => number!(u32),
            (Kind::Unsigned, 8) => number!(u64),
            _ => None,
        }
    }
}

type Attributes = std::collections::HashMap<String, AttrValue>;

/// Class that MATLAB states of an array or a structure.
fn matlab_class(attributes: &Attributes) -> Option<&str> {
    attributes.get("MATLAB_class").and_then(text)
}

/// Text of an attribute.
fn text(value: &AttrValue) -> Option<&str> {
    let text = match value {
        AttrValue::String(text) | AttrValue::AsciiString(text) | AttrValue::VarLenString(text) => text,
        AttrValue::StringSized { value, .. } | AttrValue::AsciiStringSized { value, .. } => value,
        _ => return None,
    };
    Some(text.trim_matches(['\0', ' ']))
}
