//! Files of loggers, LabVIEW, MATLAB and HDF5, each to a [`sheet`] of named columns.

pub(crate) mod file_kind;
pub(crate) mod hdf5;
pub(crate) mod labview;
pub(crate) mod labview_channels;
pub(crate) mod labview_segments;
pub(crate) mod labview_units;
pub(crate) mod logger_text;
pub(crate) mod long_format;
pub(crate) mod mat5;
pub(crate) mod numeric_vectors;
pub(crate) mod own_clocks;
pub(crate) mod remarks;
pub(crate) mod row_names;
pub(crate) mod second_clock;
pub(crate) mod second_header;
pub(crate) mod serial_monitor;
pub(crate) mod sheet;
pub(crate) mod table_head;
pub(crate) mod text_encoding;
