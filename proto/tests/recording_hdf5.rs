//! Files of MATLAB 7.3 and of HDF5, written by libhdf5 (`hdf5/make_files.py`), give the columns that are in them.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod logged;

use logged::{assert_whole, paper, read, refused, with};

const MATLAB: &[u8] = include_bytes!("hdf5/run_v73.mat");
const OTHER: &[u8] = include_bytes!("hdf5/run.h5");

/// Keys by which a rig names the columns of [`OTHER`].
const OTHERS_NAMES: &str = "time = \"log.time\"\ncolumns.u_pos = \"log.record.u_pos\"\ncolumns.u_neg = \"log.record.u_neg\"\n\
                            columns.p_pos_kpa = \"log.p[0,:]\"\ncolumns.p_neg_kpa = \"log.p[1,:]\"";

#[test]
fn vectors_matrices_and_structures_of_matlab_are_read() {
    let rig = with(
        "columns.u_pos = \"u(:,1)\"\ncolumns.u_neg = \"u(:,2)\"\ncolumns.p_pos_kpa = \"run.p_pos_kpa\"\n\
         columns.p_neg_kpa = \"run.p_neg_kpa\"",
    );
    let recording = read(MATLAB, &rig).unwrap();
    assert_whole(&recording, "MATLAB 7.3");
    let notes = recording.notes().join("\n");
    assert!(notes.contains("MATLAB vectors of 60 rows"), "{notes}");
    // A timetable is told; texts, cells, what is empty and what they refer to are no columns.
    assert!(notes.contains("tt left out: tables, timetables"), "{notes}");
    assert!(!recording.names().any(|name| ["note", "cell", "nothing", "gain", "a"].contains(&name)));
    assert_eq!(recording.column("on").unwrap()[4..8], [0.0, 0.0, 1.0, 1.0]);
}

#[test]
fn records_and_channels_by_samples_are_read_with_their_units() {
    let recording = read(OTHER, &with(OTHERS_NAMES)).unwrap();
    assert_whole(&recording, "HDF5");
    let notes = recording.notes().join("\n");
    assert!(notes.contains("HDF5 datasets of 60 rows") && notes.contains("log.setpoints has 5"), "{notes}");
    // What is passed over is told.
    for left_out in
        ["log.half left out: its numbers", "log.huge left out: it is larger", "1.2.3.4.5.6.7 left out: only 6 groups"]
    {
        assert!(notes.contains(left_out), "{left_out}: {notes}");
    }
}

#[test]
fn a_name_that_is_missing_is_told_with_those_that_are_there() {
    let recording = read(OTHER, &paper()).unwrap();
    let said = recording.require(["p_pos_kpa"]).unwrap_err().to_string();
    assert!(said.contains("p_pos_kpa is missing") && said.contains("log.p[0,:]"), "{said}");
}

/// A file cut anywhere, or with any byte changed, is read or refused in one line, and nothing panics.
#[test]
fn damaged_files_are_refused_in_one_line() {
    let rig = with(OTHERS_NAMES);
    for whole in [MATLAB, OTHER] {
        for at in (0..whole.len()).step_by(7) {
            let mut flipped = whole.to_vec();
            flipped[at] ^= 0x55;
            for bytes in [&whole[..at], &flipped] {
                let said = read(bytes, &rig).err().map(|error| error.to_string()).unwrap_or_default();
                assert!(!said.contains('\n'), "{at}: {said}");
            }
        }
        let said = refused(&whole[..whole.len() - 1], &rig);
        assert!(said.contains("cut off: "), "{said}");
    }
}
