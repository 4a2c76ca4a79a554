//! LabVIEW measurement files: columns of times, segments, and units of the channels.

#![allow(clippy::unwrap_used, reason = "the helpers of a test fail by panicking, as the test does")]

mod logged;

use logged::{ROWS, assert_whole, cells, paper, read, refused, seconds, table};

#[test]
fn labview_files_are_read() {
    let head = |columns: &str, decimal: &str| {
        format!(
            "LabVIEW Measurement\t\r\nWriter_Version\t2\r\nSeparator\tTab\r\nDecimal_Separator\t{decimal}\r\nX_Columns\t{columns}\r\n\
             Time\t01:59:59,98\r\n***End_of_Header***\t\r\n\t\r\nChannels\t4\t\t\t\t\r\nSamples\t60\t60\t60\t60\t\r\n\
             Y_Unit_Label\tV\tV\tkPa\tkPa\t\r\nX0\t0\t0\t0\t0\t\r\nDelta_X\t0{decimal}02\t0{decimal}02\t0{decimal}02\t0{decimal}02\t\r\n\
             ***End_of_Header***\t\t\t\t\t\r\nX_Value\tu_pos\tu_neg\tp_pos_kpa\tp_neg_kpa\tComment\r\n"
        )
    };
    let one = table(&head("One", ","), |k| seconds(k).replace('.', ","), "\t", ",", "\r");
    let recording = read(one, &paper()).unwrap();
    assert_whole(&recording, "one column of times");
    let notes = recording.notes().join("\n");
    for word in ["LabVIEW", "decimal commas", "u_pos as it stands, a share of 1 (V is said)", "p_pos_kpa in kPa"] {
        assert!(notes.contains(word), "{word}: {notes}");
    }
    let none = table(&head("No", "."), |_| String::new(), "\t", ".", "\t\r");
    assert_whole(&read(none, &paper()).unwrap(), "no column of times");
}

/// A LabVIEW file whose commands are written at 10 Hz and whose pressures at 50 Hz, each channel with times of its own.
#[test]
fn labview_channels_with_rates_of_their_own_are_brought_together() {
    let command = |k: usize| if (k / 10).is_multiple_of(2) { "0.5" } else { "0.7" };
    let mut text =
        "LabVIEW Measurement\t\nSeparator\tTab\nMulti_Headings\tYes\nX_Columns\tMulti\n***End_of_Header***\t\n\t\n\
                    Channels\t4\nY_Unit_Label\tVolts\t\tVolts\t\tkPa\t\tkPa\n***End_of_Header***\t\n\
                    X_Value\tu_pos\tX_Value\tu_neg\tX_Value\tp_pos_kpa\tX_Value\tp_neg_kpa\tComment\n"
            .to_owned();
    for k in 0..ROWS {
        // The fifth sample of a command is that of the twentieth row.
        let slow = if 5 * k < ROWS { format!("{:.2}\t{}", 0.1 * k as f64, command(5 * k)) } else { "\t".to_owned() };
        let (time_s, [.., p_pos, p_neg]) = (0.02 * k as f64, cells(k));
        text += &format!("{slow}\t{slow}\t{time_s:.2}\t{p_pos}\t{time_s:.2}\t{p_neg}\n");
    }
    let of = read(&text, &paper()).unwrap();
    assert_eq!((of.rows(), of.measured()), (ROWS, None), "{:?}", of.notes());
    for (at, name) in [(2, "p_pos_kpa"), (3, "p_neg_kpa")] {
        let expected: Vec<f64> = (0..ROWS).map(|k| cells(k)[at].parse().unwrap()).collect();
        assert_eq!(of.column(name).unwrap(), expected, "{name}");
    }
    for name in ["u_pos", "u_neg"] {
        let expected: Vec<f64> = (0..ROWS).map(|k| command(k).parse().unwrap()).collect();
        assert_eq!(of.column(name).unwrap(), expected, "{name}");
    }
    assert!(of.notes().join("\n").contains("4 columns of times, 2 of them slower"), "{:?}", of.notes());
}

/// A LabVIEW file of two segments that began at these clocks, with times of their own or with a first time and a step alone; the rows of
/// the second are those of a file that goes on.
fn segments(columns: &str, clocks: [&str; 2]) -> String {
    let mut text = format!("LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\t{columns}\n***End_of_Header***\t\n\t\n");
    for (segment, clock) in clocks.into_iter().enumerate() {
        let (date, time) = clock.split_once(' ').unwrap();
        text += &format!(
            "Channels\t4\nDate\t{date}\nTime\t{time}\nY_Unit_Label\t-\t-\tkPa\tkPa\nX0\t0.0\nDelta_X\t0.02\n\
             ***End_of_Header***\t\nX_Value\tu_pos\tu_neg\tp_pos_kpa\tp_neg_kpa\tComment\n"
        );
        for k in 0..ROWS {
            let time = if columns == "One" { format!("{:.2}", 0.02 * k as f64) } else { String::new() };
            text += &format!("{time}\t{}\n", cells(segment * ROWS + k).join("\t"));
        }
    }
    text
}

/// Heads say when a program began to write, which may well be an hour later to the second: an hour between them is an hour.
#[test]
fn labview_segments_an_hour_apart_are_an_hour_apart() {
    for columns in ["One", "No"] {
        for (clock, apart_s) in [("11:00:00.0", 3600.0), ("10:59:59.3", 3599.3), ("11:00:07.0", 3607.0)] {
            let of =
                read(segments(columns, ["2026/03/04 10:00:00.0", &format!("2026/03/04 {clock}")]), &paper()).unwrap();
            assert_eq!((of.rows(), of.segments().len()), (2 * ROWS, 2), "{columns} {clock}: {:?}", of.notes());
            // The second segment may stand up to 1 ms beside its clock, on the grid of the rows.
            let found = of.time_s()[ROWS] - of.time_s()[0];
            assert!((found - apart_s).abs() < 2e-3, "{columns} {clock}: {found}");
            assert_eq!(of.column("p_pos_kpa").unwrap()[ROWS], cells(ROWS)[2].parse::<f64>().unwrap());
        }
        // At the end of summer time the clock of a segment that began behind the other is before it.
        let said = refused(segments(columns, ["2026/10/25 02:59:30.0", "2026/10/25 02:00:10.0"]), &paper());
        assert!(
            said.contains("set back") && said.contains("summer time") && said.contains("2026/10/25 02:00:10.0"),
            "{said}"
        );
        assert!(said.contains("line 81") && said.contains("make a file of each"), "{columns}: {said}");
        assert!(!said.contains("period_ms"), "rows would be one run by it: {said}");
    }
}

/// Numbers under the names and units of the first head would be those of other columns.
#[test]
fn a_labview_segment_of_other_channels_is_refused() {
    let text = segments("One", ["2026/03/04 10:00:00.0", "2026/03/04 11:00:00.0"]);
    for (from, to, words) in [
        ("u_pos\tu_neg", "u_neg\tu_pos", "u_neg,u_pos where the first has u_pos,u_neg"),
        ("kPa\tkPa", "mbar\tkPa", "mbar where the first has kPa"),
    ] {
        let (first, second) = text.split_at(text.rfind("Channels").unwrap());
        let said = refused(format!("{first}{}", second.replace(from, to)), &paper());
        assert!(said.contains("line 81: another header") && said.contains(words), "{said}");
    }
}

/// A LabVIEW file with a column of times before each channel, and this row of units.
fn multi(units: &str) -> String {
    let mut text = format!(
        "LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\tMulti\n***End_of_Header***\t\n\t\n\
         Channels\t4\t\t\t\t\t\t\t\nSamples\t60\t\t60\t\t60\t\t60\t\nY_Unit_Label\t{units}\n***End_of_Header***\t\t\t\t\t\t\t\t\n\
         X_Value\tu_pos\tX_Value\tu_neg\tX_Value\tp_pos_kpa\tX_Value\tp_neg_kpa\tComment\n"
    );
    for k in 0..ROWS {
        let channels = cells(k).map(|cell| format!("{}\t{cell}", seconds(k)));
        text += &(channels.join("\t") + "\n");
    }
    text
}

/// Units above the columns of their channels, as LabVIEW writes them, or one behind another, as others do.
#[test]
fn labview_units_are_those_of_their_channels() {
    for units in ["-\t\t-\t\tmbar\t\tkPa\t", "-\t-\tmbar\tkPa"] {
        let of = read(multi(units), &paper()).unwrap();
        assert_eq!((of.rows(), of.measured()), (ROWS, None), "{units:?}: {:?}", of.notes());
        let columns = of.require(["u_pos", "u_neg", "p_pos_kpa", "p_neg_kpa"]).unwrap();
        for k in 0..ROWS {
            // A mbar is a tenth of a kPa.
            for ((column, cell), kpa) in columns.iter().zip(cells(k)).zip([1.0, 1.0, 0.1, 1.0]) {
                let expected = kpa * cell.parse::<f64>().unwrap();
                assert!((column[k] - expected).abs() < 1e-9, "{units:?}, row {k}: {} for {expected}", column[k]);
            }
        }
    }
}

/// At another channel a unit would scale its numbers, and nothing would say so.
#[test]
fn labview_units_that_stand_elsewhere_are_refused_with_their_line() {
    for (units, why) in [
        ("\t-\t\t-\t\tmbar\t\tkPa", "one stands in column 3, which holds X_Value"),
        ("mbar\tkPa", "one stands in column 3, which holds X_Value"),
        ("-\t\t-\t\tmbar", "there are cells for 3 of 4 channels"),
        ("-\t\t-\t\tmbar\t\tkPa\t\tkPa", "one stands in column 10, which is behind the last channel"),
        ("mbar\tkPa\t\t\t\t\t\t", "each above its channel or one behind another"),
    ] {
        let said = refused(multi(units), &paper());
        assert!(said.contains("line 8: the units ") && said.contains(why), "{units:?}: {said}");
        assert!(said.contains("u_pos,u_neg,p_pos_kpa,p_neg_kpa") && said.contains("unit = "), "{units:?}: {said}");
    }
}

/// A LabVIEW file of two segments whose commands are written at 10 Hz and whose pressures at 50 Hz, as their heads alone say: no column of
/// times, or one of the first channel. `heads` are the rows with a cell for each channel, by segment.
fn own_heads(columns: &str, heads: [&str; 2]) -> String {
    let mut text = format!("LabVIEW Measurement\t\nSeparator\tTab\nX_Columns\t{columns}\n***End_of_Header***\t\n\t\n");
    for (segment, head) in heads.into_iter().enumerate() {
        text += &format!(
            "Channels\t4\n{head}\nY_Unit_Label\t-\t-\tkPa\tkPa\n***End_of_Header***\t\nX_Value\tu_pos\tu_neg\tp_pos_kpa\tp_neg_kpa\tComment\n"
        );
        for k in 0..ROWS {
            let slow = if 5 * k < ROWS { command(5 * k) } else { "" };
            let time = if columns == "One" && 5 * k < ROWS { format!("{:.2}", 0.1 * k as f64) } else { String::new() };
            let [.., p_pos, p_neg] = cells(segment * ROWS + k);
            text += &format!("{time}\t{slow}\t{slow}\t{p_pos}\t{p_neg}\n");
        }
    }
    text
}

/// Commands that change every tenth row.
fn command(k: usize) -> &'static str {
    if (k / 10).is_multiple_of(2) { "0.5" } else { "0.7" }
}

/// Rows and clocks of a segment's head: `Date`, `Time`, `X0` and `Delta_X` of each channel.
fn head(clocks: [&str; 2], x0: [&str; 2]) -> String {
    let each =
        |[of_commands, of_pressures]: [&str; 2]| [of_commands, of_commands, of_pressures, of_pressures].join("\t");
    format!(
        "Date\t{}\nTime\t{}\nX0\t{}\nDelta_X\t{}",
        each(["2026/03/04"; 2]),
        each(clocks),
        each(x0),
        each(["0.1", "0.02"])
    )
}

/// Samples of channels in one row were taken at different times where their steps differ: read by the first step, pressures were stretched
/// five times, and nothing said so.
#[test]
fn labview_channels_have_the_times_of_their_own_heads() {
    for columns in ["No", "One"] {
        // The second segment follows the first by its clock, or by `X0` where no column of times begins there.
        let by_x0 = (columns == "No").then(|| head(["10:00:00.00"; 2], ["1.2"; 2]));
        for second in [head(["10:00:01.20"; 2], ["0.0"; 2])].into_iter().chain(by_x0) {
            let first = head(["10:00:00.00"; 2], ["0.0"; 2]);
            let of = read(own_heads(columns, [&first, &second]), &paper()).unwrap();
            assert_eq!((of.rows(), of.measured()), (2 * ROWS, None), "{columns}: {:?}", of.notes());
            for (at, name) in [(2, "p_pos_kpa"), (3, "p_neg_kpa")] {
                let expected: Vec<f64> = (0..2 * ROWS).map(|k| cells(k)[at].parse().unwrap()).collect();
                assert_eq!(of.column(name).unwrap(), expected, "{columns} {name}");
            }
            for name in ["u_pos", "u_neg"] {
                let expected: Vec<f64> = (0..2 * ROWS).map(|k| command(k % ROWS).parse().unwrap()).collect();
                assert_eq!(of.column(name).unwrap(), expected, "{columns} {name}");
            }
            assert!(of.notes().join("\n").contains("times of each channel as its own head says"), "{:?}", of.notes());
        }
    }
}

/// Devices that began one after the other, by their clocks or by `X0`: the second one's samples belong to later rows.
#[test]
fn labview_channels_that_began_later_stand_in_later_rows() {
    for (clocks, x0) in [
        (["10:00:00.00", "10:00:00.10"], ["0.0", "0.0"]),
        (["10:00:00.00", "10:00:00.00"], ["0.0", "0.1"]),
        (["10:00:00.04", "10:00:00.00"], ["0.0", "0.14"]),
    ] {
        let text = own_heads("No", [&head(clocks, x0), ""]);
        let of = read(text.split_at(text.rfind("Channels").unwrap()).0, &paper()).unwrap();
        // Five rows of commands before the first pressure are left out: no run begins without all pressures.
        assert_eq!(of.rows(), ROWS, "{clocks:?}: {:?}", of.notes());
        for k in 0..ROWS - 10 {
            assert_eq!(of.column("u_pos").unwrap()[k], command(k + 5).parse::<f64>().unwrap(), "{clocks:?} row {k}");
            assert_eq!(of.column("p_pos_kpa").unwrap()[k], cells(k)[2].parse::<f64>().unwrap(), "{clocks:?} row {k}");
        }
    }
    // The same where each channel has a column of times, and devices within a microsecond began together.
    for (clock, later) in [("10:00:00.100000", 5), ("10:00:00.000001", 0)] {
        let clocks = format!("Time\t{0}\t\t{0}\t\t{clock}\t\t{clock}\t\n", "10:00:00.000000");
        let text = multi("-\t\t-\t\tkPa\t\tkPa\t").replace("Y_Unit_Label", &format!("{clocks}Y_Unit_Label"));
        let of = read(text, &paper()).unwrap();
        for k in 0..ROWS - 10 {
            let [u_pos, ..] = cells(k + later);
            assert_eq!(of.column("u_pos").unwrap()[k], u_pos.parse::<f64>().unwrap(), "{clock} row {k}");
            assert_eq!(of.column("p_pos_kpa").unwrap()[k], cells(k)[2].parse::<f64>().unwrap(), "{clock} row {k}");
        }
    }
    // Times that are counted from an instant of their own do not depend on clocks.
    let text = own_heads("No", [&head(["10:00:00.00", "10:00:00.10"], ["0.0"; 2]), ""])
        .replace("X_Columns", "Time_Pref\tAbsolute\nX_Columns");
    let of = read(text.split_at(text.rfind("Channels").unwrap()).0, &paper()).unwrap();
    assert_eq!(of.column("u_pos").unwrap()[5], command(5).parse::<f64>().unwrap());
    assert_eq!(of.column("u_pos").unwrap()[10], command(10).parse::<f64>().unwrap());
}

/// A step at the wrong channel stretches its times.
#[test]
fn labview_times_that_may_be_those_of_other_channels_are_refused_with_their_line() {
    let whole = head(["10:00:00.00"; 2], ["0.0"; 2]);
    for (from, to, line, why) in [
        ("Delta_X\t0.1\t0.1\t0.02\t0.02", "Delta_X\t0.1\t0.02", 9, "there are cells for 2 of 4 channels"),
        ("Delta_X\t0.1\t0.1\t0.02\t0.02", "Delta_X\t0.1\t\t0.02\t0.02", 9, "not every channel has one"),
        ("X0\t0.0\t0.0\t0.0\t0.0", "X0\t0.0\t0.0\tnone\t0.0", 8, "none is no number"),
    ] {
        let said = refused(own_heads("No", [&whole.replace(from, to), &whole]), &paper());
        assert!(said.contains(&format!("line {}: the times ", line + 1)) && said.contains(why), "{said}");
        assert!(said.contains("u_pos,u_neg,p_pos_kpa,p_neg_kpa") && said.contains("X_Columns Multi"), "{said}");
    }
}
