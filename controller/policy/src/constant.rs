//! Constants of a graph: initialisers and `Constant` nodes, decoded and proven finite.
//!
//! ONNX keeps a tensor's numbers either as little-endian `raw_data` or in a typed list. Types that no
//! weight has (strings, booleans, float16) are remembered by name only and refused where they are used.

use tract_onnx::pb::{TensorProto, tensor_proto::DataLocation, tensor_proto::DataType};

use crate::error::Fault;
use crate::wording::shown;

/// A constant tensor in row-major order.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Constant {
    pub(crate) dims: Vec<usize>,
    pub(crate) data: Data,
}

/// The numbers of a [`Constant`].
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Data {
    F32(Vec<f32>),
    F64(Vec<f64>),
    I64(Vec<i64>),
    /// A type that no operator of a policy takes.
    Other(&'static str),
}

impl Constant {
    /// Decodes one tensor.
    ///
    /// # Errors
    /// [`Fault::ExternalWeights`], [`Fault::WeightSize`], [`Fault::WeightNotFinite`].
    pub(crate) fn decode(proto: &TensorProto) -> Result<Self, Fault> {
        let tensor = || shown(&proto.name);
        let external = proto.data_location == Some(DataLocation::External as i32);
        if external || !proto.external_data.is_empty() {
            return Err(Fault::ExternalWeights { tensor: tensor() });
        }
        let data = decode_data(proto);
        let (whole, bytes_each) = match &data {
            Data::F32(v) => (v.len(), 4),
            Data::F64(v) => (v.len(), 8),
            Data::I64(v) => (v.len(), 8),
            Data::Other(_) => return Ok(Self { dims: Vec::new(), data }),
        };
        // Raw data may hold a part of a number behind the whole ones.
        let bytes = (whole * bytes_each).max(proto.raw_data.len());
        let dims: Option<Vec<usize>> = proto.dims.iter().map(|&d| usize::try_from(d).ok()).collect();
        let size = |dims: &[usize]| dims.iter().try_fold(1usize, |n, &d| n.checked_mul(d));
        match dims {
            Some(dims) if size(&dims) == Some(whole) && bytes == whole * bytes_each => {
                let constant = Self { dims, data };
                constant.check_finite(&proto.name)?;
                Ok(constant)
            }
            _ => {
                let dims = proto.dims.iter().copied().take(8).collect();
                Err(Fault::WeightSize { tensor: tensor(), dims, bytes })
            }
        }
    }

    /// A scalar or list made by an attribute of a `Constant` node.
    pub(crate) fn from_attribute(dims: Vec<usize>, data: Data, name: &str) -> Result<Self, Fault> {
        let constant = Self { dims, data };
        constant.check_finite(name)?;
        Ok(constant)
    }

    fn check_finite(&self, name: &str) -> Result<(), Fault> {
        let place = match &self.data {
            Data::F32(v) => first_not_finite(v.iter().map(|&x| f64::from(x))),
            Data::F64(v) => first_not_finite(v.iter().copied()),
            Data::I64(_) | Data::Other(_) => None,
        };
        match place {
            Some((index, value)) => Err(Fault::WeightNotFinite { tensor: shown(name), index, value }),
            None => Ok(()),
        }
    }

    /// The numbers as float32.
    ///
    /// # Errors
    /// [`Fault::WeightType`] for any other type.
    pub(crate) fn f32s(&self, name: &str) -> Result<&[f32], Fault> {
        match &self.data {
            Data::F32(v) => Ok(v),
            other => Err(Fault::WeightType { tensor: shown(name), found: other.type_name() }),
        }
    }

    /// This constant cast to float32, as `Cast` with `to = FLOAT` does (round to nearest even).
    pub(crate) fn cast_f32(&self, name: &str) -> Result<Self, Fault> {
        let values: Vec<f32> = match &self.data {
            Data::F32(v) => v.clone(),
            Data::F64(v) => v.iter().map(|&x| x as f32).collect(),
            Data::I64(v) => v.iter().map(|&x| x as f32).collect(),
            Data::Other(found) => {
                return Err(Fault::WeightType { tensor: shown(name), found });
            }
        };
        let cast = Self { dims: self.dims.clone(), data: Data::F32(values) };
        cast.check_finite(name)?;
        Ok(cast)
    }

    /// An operation on two float32 constants of one shape, or of which one is a single number; `None` for other shapes.
    ///
    /// # Errors
    /// [`Fault::WeightType`] for any other type, [`Fault::WeightNotFinite`] where the result is none that a policy may hold.
    pub(crate) fn combined(
        &self,
        names: [&str; 2],
        other: &Self,
        operation: impl Fn(f32, f32) -> f32,
    ) -> Result<Option<Self>, Fault> {
        let (left, right) = (self.f32s(names[0])?, other.f32s(names[1])?);
        let (dims, values): (_, Vec<f32>) = match (left, right) {
            (&[one], _) if self.dims.len() <= other.dims.len() => {
                (&other.dims, right.iter().map(|&b| operation(one, b)).collect())
            }
            (_, &[one]) if other.dims.len() <= self.dims.len() => {
                (&self.dims, left.iter().map(|&a| operation(a, one)).collect())
            }
            _ if self.dims == other.dims => {
                (&self.dims, left.iter().zip(right).map(|(&a, &b)| operation(a, b)).collect())
            }
            _ => return Ok(None),
        };
        let combined = Self { dims: dims.clone(), data: Data::F32(values) };
        combined.check_finite(names[0])?;
        Ok(Some(combined))
    }

    /// The square roots of a float32 constant.
    ///
    /// # Errors
    /// As [`Constant::combined`].
    pub(crate) fn rooted(&self, name: &str) -> Result<Self, Fault> {
        let values = self.f32s(name)?.iter().map(|x| x.sqrt()).collect();
        let rooted = Self { dims: self.dims.clone(), data: Data::F32(values) };
        rooted.check_finite(name)?;
        Ok(rooted)
    }

    /// The transpose of a float32 matrix; `None` if it is none.
    pub(crate) fn transposed(&self) -> Option<Self> {
        let (Data::F32(values), &[rows, columns]) = (&self.data, self.dims.as_slice()) else {
            return None;
        };
        Some(Self { dims: vec![columns, rows], data: Data::F32(transposed(values, rows, columns)) })
    }

    /// Numbers held, for limits on memory.
    pub(crate) fn len(&self) -> usize {
        match &self.data {
            Data::F32(v) => v.len(),
            Data::F64(v) => v.len(),
            Data::I64(v) => v.len(),
            Data::Other(_) => 0,
        }
    }
}

impl Data {
    fn type_name(&self) -> &'static str {
        match self {
            Self::F32(_) => "float32",
            Self::F64(_) => "float64",
            Self::I64(_) => "int64",
            Self::Other(name) => name,
        }
    }
}

/// `values[row * columns + column]` as `[column * rows + row]`.
pub(crate) fn transposed(values: &[f32], rows: usize, columns: usize) -> Vec<f32> {
    let mut out = Vec::with_capacity(values.len());
    for column in 0..columns {
        out.extend(values.iter().skip(column).step_by(columns).take(rows));
    }
    out
}

/// A plain name for an ONNX element type.
pub(crate) fn type_name(data_type: i32) -> &'static str {
    match DataType::try_from(data_type) {
        Ok(DataType::Float) => "float32",
        Ok(DataType::Double) => "float64",
        Ok(DataType::Float16) => "float16",
        Ok(DataType::Bfloat16) => "bfloat16",
        Ok(DataType::Int64) => "int64",
        Ok(DataType::Int32) => "int32",
        Ok(DataType::Int8) => "int8",
        Ok(DataType::Uint8) => "uint8",
        Ok(DataType::Bool) => "bool",
        Ok(DataType::String) => "a string",
        Ok(DataType::Undefined) => "without a type",
        Ok(_) | Err(_) => "of another type",
    }
}

fn decode_data(proto: &TensorProto) -> Data {
    let raw = &proto.raw_data;
    match DataType::try_from(proto.data_type) {
        Ok(DataType::Float) if raw.is_empty() => Data::F32(proto.float_data.clone()),
        Ok(DataType::Float) => Data::F32(little_endian(raw, f32::from_le_bytes)),
        Ok(DataType::Double) if raw.is_empty() => Data::F64(proto.double_data.clone()),
        Ok(DataType::Double) => Data::F64(little_endian(raw, f64::from_le_bytes)),
        Ok(DataType::Int64) if raw.is_empty() => Data::I64(proto.int64_data.clone()),
        Ok(DataType::Int64) => Data::I64(little_endian(raw, i64::from_le_bytes)),
        _ => Data::Other(type_name(proto.data_type)),
    }
}

/// The whole numbers of `raw`; a part behind them, [`Constant::decode`] finds by the length.
fn little_endian<T, const BYTES: usize>(raw: &[u8], number: fn([u8; BYTES]) -> T) -> Vec<T> {
    raw.as_chunks::<BYTES>().0.iter().map(|&bytes| number(bytes)).collect()
}

fn first_not_finite(values: impl Iterator<Item = f64>) -> Option<(usize, f64)> {
    values.enumerate().find(|(_, v)| !v.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn float(dims: &[i64], raw: &[u8]) -> TensorProto {
        TensorProto {
            dims: dims.to_vec(),
            data_type: DataType::Float as i32,
            raw_data: raw.to_vec(),
            name: "w".into(),
            ..TensorProto::default()
        }
    }

    #[test]
    fn raw_data_is_little_endian() {
        // 1.5 is 0x3fc00000, -2.0 is 0xc0000000.
        let raw = [0, 0, 0xc0, 0x3f, 0, 0, 0, 0xc0];
        let constant = Constant::decode(&float(&[2, 1], &raw)).unwrap();
        assert_eq!(constant.f32s("w").unwrap(), [1.5, -2.0]);
        assert_eq!(constant.transposed().unwrap().dims, [1, 2]);
    }

    #[test]
    fn shape_and_data_must_agree() {
        for dims in [&[3][..], &[-1], &[i64::MAX, i64::MAX]] {
            let refused = Constant::decode(&float(dims, &[0; 8]));
            assert!(matches!(refused, Err(Fault::WeightSize { bytes: 8, .. })), "{dims:?}");
        }
        for dims in [1, 2] {
            let refused = Constant::decode(&float(&[dims], &[0; 7]));
            assert!(matches!(refused, Err(Fault::WeightSize { bytes: 7, .. })), "{dims}");
        }
    }

    #[test]
    fn transpose_moves_rows_to_columns() {
        assert_eq!(transposed(&[1., 2., 3., 4., 5., 6.], 2, 3), [1., 4., 2., 5., 3., 6.]);
    }
}
