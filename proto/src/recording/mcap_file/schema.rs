//! The messages of a recording: which fields a tick has, and the schema that says so to others.
//!
//! One list names every field with its number and its place in [`TickRecord`]; the encoder, the
//! decoder and the schema (a serialized `FileDescriptorSet`) all come from it, so they cannot
//! disagree. Numbers are never used twice: a field that goes leaves its number behind.
//!
//! The messages, as a `.proto` file would say it:
//!
//! ```text
//! package pneumatic;
//! message Tick  { uint32 session = 1; uint32 tick = 2; … }   // the list below
//! message Frame { bytes data = 1; uint32 length = 2; }
//! package foxglove;
//! message Log   { google.protobuf.Timestamp timestamp = 1; Level level = 2; string message = 3; string name = 4; }
//! ```

use super::protobuf::{DecodeError, FieldType, FieldValue, Raw, for_each_field, put_bytes, put_uint};
use super::tick::{Arrival, TickRecord};
use super::tick_table::{self, Cells};

/// Full name of the tick message.
pub(crate) const TICK: &str = "pneumatic.Tick";
/// Full name of the message around a raw frame.
pub(crate) const FRAME: &str = "pneumatic.Frame";
/// Full name of the event message: Foxglove's own, so that its log panel shows events.
pub(crate) const LOG: &str = "foxglove.Log";

macro_rules! tick_fields {
    ($($number:literal $name:ident = $($path:ident).+;)*) => {
        /// Appends a tick as a `pneumatic.Tick`; the raw frames go into messages of their own.
        pub(crate) fn encode_tick(tick: &TickRecord, out: &mut Vec<u8>) {
            $( tick.$($path).+.put($number, out); )*
        }

        /// Reads a `pneumatic.Tick`; fields that this program does not know are passed over.
        pub(crate) fn decode_tick(bytes: &[u8]) -> Result<TickRecord, DecodeError> {
            let mut tick = TickRecord::default();
            for_each_field(bytes, |number, raw| {
                let taken = match number {
                    $( $number => tick.$($path).+.take(raw), )*
                    _ => Some(()),
                };
                taken.ok_or(DecodeError::Value(number))
            })?;
            Ok(tick)
        }

        /// Names of the columns of a tick as a table.
        pub(crate) fn column_names() -> Vec<String> {
            let tick = TickRecord::default();
            let mut names = Vec::new();
            $( names.extend(tick_table::names_of(stringify!($name), &tick.$($path).+)); )*
            names
        }

        /// Appends a tick's cells, in the order of [`column_names`].
        pub(crate) fn cells(tick: &TickRecord, out: &mut Vec<String>) {
            $( tick.$($path).+.cells(out); )*
        }

        fn tick_descriptors() -> Vec<Vec<u8>> {
            let tick = TickRecord::default();
            vec![ $( descriptor_of(stringify!($name), $number, &tick.$($path).+), )* ]
        }
    };
}

tick_fields! {
    1 session = session;
    2 tick = tick;
    3 receive_ns = receive_ns;
    4 arrival = arrival;
    5 volts = volts;
    6 echo_pos = echo_pos;
    7 echo_neg = echo_neg;
    8 crio_state = crio_state;
    9 crio_trip = crio_trip;
    10 p_pos_kpa = p_pos_kpa;
    11 p_neg_kpa = p_neg_kpa;
    12 ref_pos_kpa = ref_pos_kpa;
    13 ref_neg_kpa = ref_neg_kpa;
    14 predicted_pos_kpa = predicted_pos_kpa;
    15 predicted_neg_kpa = predicted_neg_kpa;
    16 law_pos_feed_forward = law_pos.feed_forward;
    17 law_pos_proportional = law_pos.proportional;
    18 law_pos_integral = law_pos.integral;
    19 law_pos_u_raw = law_pos.u_raw;
    20 law_neg_feed_forward = law_neg.feed_forward;
    21 law_neg_proportional = law_neg.proportional;
    22 law_neg_integral = law_neg.integral;
    23 law_neg_u_raw = law_neg.u_raw;
    24 u_pos = u_pos;
    25 u_neg = u_neg;
    26 pump_on = pump_on;
    27 mode = mode;
    28 state = state;
    29 fault = fault;
    30 arrival_lateness_ns = arrival_lateness_ns;
    31 receive_check_ns = receive_check_ns;
    32 predict_ns = predict_ns;
    33 law_ns = law_ns;
    34 send_ns = send_ns;
    35 compute_ns = compute_ns;
    36 deadline_missed = deadline_missed;
    37 records_dropped = records_dropped;
    38 law_pos_backlash = law_pos.backlash;
    39 law_pos_correction = law_pos.correction;
    40 law_neg_backlash = law_neg.backlash;
    41 law_neg_correction = law_neg.correction;
    42 findings = findings;
    43 inputs = inputs;
    44 observation_hash = observation_hash;
    45 policy_output = policy_output;
    46 policy_stage = policy_stage;
    47 authority = authority;
    48 swap_id = swap_id;
    49 command_before_filter = command_before_filter;
    50 filter_active = filter_active;
    51 experiment = experiment;
    52 exploration_pos = exploration_pos;
    53 exploration_neg = exploration_neg;
    54 exploration_plan = exploration_plan;
}

impl FieldValue for Arrival {
    // A number and not an enum: PlotJuggler shows enums as text and cannot plot them.
    const TYPE: FieldType = FieldType::Uint32;
    fn put(&self, number: u32, out: &mut Vec<u8>) {
        self.code().put(number, out);
    }
    fn take(&mut self, raw: Raw<'_>) -> Option<()> {
        let mut code = 0_u8;
        code.take(raw)?;
        *self = Self::from_code(code)?;
        Some(())
    }
}

/// Appends a raw frame as a `pneumatic.Frame`.
pub(crate) fn encode_frame(frame: &[u8], out: &mut Vec<u8>) {
    put_bytes(1, frame, out);
    // The length is there so that the topic has something to plot: when frames came, and how long.
    put_uint(2, frame.len() as u64, out);
}

/// The bytes of a `pneumatic.Frame`.
pub(crate) fn decode_frame(bytes: &[u8]) -> Result<&[u8], DecodeError> {
    let mut data: &[u8] = &[];
    for_each_field(bytes, |number, raw| {
        match (number, raw) {
            (1, Raw::Bytes(found)) => data = found,
            (1, _) => return Err(DecodeError::Value(1)),
            _ => {}
        }
        Ok(())
    })?;
    Ok(data)
}

/// A `foxglove.Log`, as read and written.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Log {
    pub(crate) unix_ns: u64,
    pub(crate) level: u64,
    pub(crate) message: String,
    pub(crate) name: String,
}

impl Log {
    pub(crate) fn encode(&self, out: &mut Vec<u8>) {
        let mut timestamp = Vec::with_capacity(16);
        put_uint(1, self.unix_ns / 1_000_000_000, &mut timestamp);
        put_uint(2, self.unix_ns % 1_000_000_000, &mut timestamp);
        put_bytes(1, &timestamp, out);
        put_uint(2, self.level, out);
        put_bytes(3, self.message.as_bytes(), out);
        put_bytes(4, self.name.as_bytes(), out);
    }

    pub(crate) fn decode(bytes: &[u8]) -> Result<Self, DecodeError> {
        let mut log = Self::default();
        for_each_field(bytes, |number, raw| {
            match (number, raw) {
                (1, Raw::Bytes(timestamp)) => log.unix_ns = decode_timestamp(timestamp)?,
                (2, Raw::Varint(level)) => log.level = level,
                (3, Raw::Bytes(text)) => log.message = String::from_utf8_lossy(text).into_owned(),
                (4, Raw::Bytes(text)) => log.name = String::from_utf8_lossy(text).into_owned(),
                (1..=4, _) => return Err(DecodeError::Value(number)),
                _ => {}
            }
            Ok(())
        })?;
        Ok(log)
    }
}

fn decode_timestamp(bytes: &[u8]) -> Result<u64, DecodeError> {
    let mut unix_ns = 0_u64;
    for_each_field(bytes, |number, raw| {
        match (number, raw) {
            (1, Raw::Varint(seconds)) => {
                unix_ns = unix_ns.saturating_add(seconds.saturating_mul(1_000_000_000));
            }
            (2, Raw::Varint(ns)) => unix_ns = unix_ns.saturating_add(ns),
            _ => {}
        }
        Ok(())
    })?;
    Ok(unix_ns)
}

/// The schema of `pneumatic.Tick` and `pneumatic.Frame`: a serialized `FileDescriptorSet`.
pub(crate) fn pneumatic_schema() -> Vec<u8> {
    let frame = [field("data", 1, FieldType::Bytes, false, None), field("length", 2, FieldType::Uint32, false, None)];
    let messages = [message("Tick", &tick_descriptors()), message("Frame", &frame)];
    file_set(&[file("pneumatic/recording.proto", "pneumatic", &[], &messages, &[])])
}

/// The schema of `foxglove.Log`, with the timestamp that it needs.
pub(crate) fn log_schema() -> Vec<u8> {
    const TIMESTAMP_FILE: &str = "google/protobuf/timestamp.proto";
    let timestamp = message(
        "Timestamp",
        &[field("seconds", 1, FieldType::Int64, false, None), field("nanos", 2, FieldType::Int32, false, None)],
    );
    let log = message(
        "Log",
        &[
            field("timestamp", 1, FieldType::Message, false, Some(".google.protobuf.Timestamp")),
            field("level", 2, FieldType::Enum, false, Some(".foxglove.LogLevel")),
            field("message", 3, FieldType::String, false, None),
            field("name", 4, FieldType::String, false, None),
        ],
    );
    let level = enumeration("LogLevel", &["UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"]);
    file_set(&[
        file(TIMESTAMP_FILE, "google.protobuf", &[], &[timestamp], &[]),
        file("foxglove/Log.proto", "foxglove", &[TIMESTAMP_FILE], &[log], &[level]),
    ])
}

fn descriptor_of<T: FieldValue>(name: &str, number: u32, _: &T) -> Vec<u8> {
    field(name, number, T::TYPE, T::REPEATED, None)
}

/// `FieldDescriptorProto`: name 1, number 3, label 4, type 5, `type_name` 6, `json_name` 10.
fn field(name: &str, number: u32, kind: FieldType, repeated: bool, of: Option<&str>) -> Vec<u8> {
    const OPTIONAL: u64 = 1;
    const REPEATED: u64 = 3;
    let mut out = Vec::new();
    put_bytes(1, name.as_bytes(), &mut out);
    put_uint(3, number.into(), &mut out);
    put_uint(4, if repeated { REPEATED } else { OPTIONAL }, &mut out);
    put_uint(5, kind as u64, &mut out);
    if let Some(of) = of {
        put_bytes(6, of.as_bytes(), &mut out);
    }
    // Readers that go by JSON names must show the same names as the others.
    put_bytes(10, name.as_bytes(), &mut out);
    out
}

/// `DescriptorProto`: name 1, field 2.
fn message(name: &str, fields: &[Vec<u8>]) -> Vec<u8> {
    let mut out = Vec::new();
    put_bytes(1, name.as_bytes(), &mut out);
    for field in fields {
        put_bytes(2, field, &mut out);
    }
    out
}

/// `EnumDescriptorProto`: name 1, value 2 (`EnumValueDescriptorProto`: name 1, number 2).
fn enumeration(name: &str, values: &[&str]) -> Vec<u8> {
    let mut out = Vec::new();
    put_bytes(1, name.as_bytes(), &mut out);
    for (number, value) in (0_u64..).zip(values) {
        let mut entry = Vec::new();
        put_bytes(1, value.as_bytes(), &mut entry);
        put_uint(2, number, &mut entry);
        put_bytes(2, &entry, &mut out);
    }
    out
}

/// `FileDescriptorProto`: name 1, package 2, dependency 3, `message_type` 4, `enum_type` 5, syntax 12.
fn file(name: &str, package: &str, needs: &[&str], messages: &[Vec<u8>], enums: &[Vec<u8>]) -> Vec<u8> {
    let mut out = Vec::new();
    put_bytes(1, name.as_bytes(), &mut out);
    put_bytes(2, package.as_bytes(), &mut out);
    for need in needs {
        put_bytes(3, need.as_bytes(), &mut out);
    }
    for message in messages {
        put_bytes(4, message, &mut out);
    }
    for entry in enums {
        put_bytes(5, entry, &mut out);
    }
    put_bytes(12, b"proto3", &mut out);
    out
}

/// `FileDescriptorSet`: file 1.
fn file_set(files: &[Vec<u8>]) -> Vec<u8> {
    let mut out = Vec::new();
    for file in files {
        put_bytes(1, file, &mut out);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn every_field_has_a_number_and_a_name_of_its_own() {
        let (mut names, mut numbers) = (HashSet::new(), HashSet::new());
        for descriptor in tick_descriptors() {
            for_each_field(&descriptor, |key, raw| {
                match (key, raw) {
                    (1, Raw::Bytes(name)) => assert!(names.insert(name.to_vec())),
                    (3, Raw::Varint(number)) => assert!(numbers.insert(number)),
                    _ => {}
                }
                Ok(())
            })
            .unwrap();
        }
        assert_eq!(names.len(), numbers.len());
        // 19000 … 19999 belong to Protocol Buffers itself; keys above 15 cost a second byte.
        assert!(numbers.iter().all(|number| (1..19_000).contains(number)));
    }

    #[test]
    fn fields_of_a_later_version_are_passed_over() {
        let mut bytes = Vec::new();
        encode_tick(&TickRecord { tick: 7, ..TickRecord::default() }, &mut bytes);
        1.5_f64.put(9_000, &mut bytes);
        put_bytes(9_001, b"later", &mut bytes);
        assert_eq!(decode_tick(&bytes).unwrap().tick, 7);
    }

    #[test]
    fn an_unknown_arrival_class_is_refused() {
        let mut bytes = Vec::new();
        put_uint(4, 9, &mut bytes);
        assert_eq!(decode_tick(&bytes).unwrap_err(), DecodeError::Value(4));
    }
}
