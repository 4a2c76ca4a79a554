//! Files whose own lines do not name the columns, as oscilloscopes and trend programs write them: the refusal says the keys by which a person
//! names them, and with these keys the file is read.

#![allow(clippy::unwrap_used, clippy::panic, reason = "the helpers of a test fail by panicking, as the test does")]

mod logged;

use logged::{HEADER, ROWS, assert_whole, cells, read, refused, row, seconds, table, with};

/// The keys that every such refusal names.
const KEYS: [&str; 2] = ["[recording] names = [\"…\", …]", "header_line = … for the last line above the data"];

/// Columns of the rig under the names that the map gives.
const COLUMNS: &str =
    "columns.u_pos = \"a\"\ncolumns.u_neg = \"b\"\ncolumns.p_pos_kpa = \"c\"\ncolumns.p_neg_kpa = \"d\"";

/// A file of this head and these rows is refused with the keys, and read with them.
#[track_caller]
fn names_its_way_out(text: &str, map: &str, said: &str) {
    let refusal = refused(text, &with(""));
    assert!(refusal.contains(said) && KEYS.iter().all(|key| refusal.contains(key)), "{refusal}");
    let recording = read(text, &with(&format!("{map}\n{COLUMNS}"))).unwrap_or_else(|error| panic!("{error}"));
    assert_whole(&recording, said);
}

/// Numbers for channels, and a line of their units alone: `Volt` four times is no name.
#[test]
fn an_oscilloscope_that_numbers_its_channels() {
    let text = table("x-axis,1,2,3,4\nsecond,Volt,Volt,Volt,Volt\n", seconds, ",", ".", "");
    let map = "names = [\"t\", \"a\", \"b\", \"c\", \"d\"]\nheader_line = 2\ntime = \"t\"";
    names_its_way_out(&text, map, "Volt stands there twice: name all 5 columns");
}

/// A clock beside each channel, under a block of settings.
#[test]
fn a_scope_view_with_a_clock_beside_each_channel() {
    let mut text = "Name\tScope Project\nFile\tC:\\scope.csv\n\nName\tPWM1\tName\tPWM2\tName\tP1\tName\tP2\n\
                    Data-Type\tREAL32\tData-Type\tREAL32\tData-Type\tREAL32\tData-Type\tREAL32\n\
                    SampleTime[ms]\t20\tSampleTime[ms]\t20\tSampleTime[ms]\t20\tSampleTime[ms]\t20\n\n"
        .to_owned();
    for k in 0..ROWS {
        let of = cells(k).map(|cell| format!("{}\t{cell}", 20 * k));
        text += &format!("{}\n", of.join("\t"));
    }
    let map = "names = [\"t\", \"a\", \"t2\", \"b\", \"t3\", \"c\", \"t4\", \"d\"]\nheader_line = 6\n\
               time = { from = \"t\", unit = \"ms\" }";
    names_its_way_out(&text, map, "stands there twice: name all 8 columns");
}

/// A block of settings that is as wide as the data, with a date in it, and an empty cell before and behind each row.
#[test]
fn a_recorder_with_a_block_of_settings() {
    let head = "Model,DL850\nTraceName,CH1,CH2,CH3,CH4\nBlockSize,60,60,60,60\nVUnit,V,V,V,V\nHResolution,2.0E-02,2.0E-02,2.0E-02,2.0E-02\n\
                HUnit,s,s,s,s\nDisplayPointNo.,1,1,1,1\nDate,2026/03/29\nTime,10:00:00\n";
    let text = table(head, |_| String::new(), ",", ".", ",");
    let map = "names = [\"none\", \"a\", \"b\", \"c\", \"d\"]\nheader_line = 9\nperiod_ms = 20.0";
    names_its_way_out(&text, map, "cells where the header has");
}

/// Rows that are all shorter than their header, one that is, and names that stand twice.
#[test]
fn ragged_rows_and_doubled_names_say_what_helps() {
    let rows = table("", seconds, ",", ".", ",1");
    let longer = format!("t,a,b,c,d,e,f\n{rows}");
    let map = "names = [\"t\", \"a\", \"b\", \"c\", \"d\", \"e\"]\nheader_line = 1\ntime = \"t\"";
    names_its_way_out(
        &longer,
        map,
        "line 2: 6 cells where the header has 7 columns, and so have most rows; name all 6 columns",
    );

    let whole = table(&format!("{HEADER}\n"), seconds, ",", ".", "");
    let row = whole.lines().nth(21).unwrap();
    let one_short = whole.replace(row, row.rsplit_once(',').unwrap().0);
    let said = refused(&one_short, &with(""));
    assert!(
        said.contains("line 22: 4 cells where the header has 5 columns; complete the row or leave it out"),
        "{said}"
    );
    assert!(said.contains("header_line = …") && said.contains("name all 5 columns"), "{said}");

    // Two cells of most numbers, and one of each that is whole.
    let halved = table(&format!("{HEADER}\n"), |k| format!("{}", 20 * k), ",", ",", "");
    let said = refused(&halved, &with(""));
    let halves = "; where these are halves of numbers with decimal commas, write points; otherwise ";
    let most = ", and so have most rows";
    assert!(
        said.contains(&format!("line 2: 9 cells where the header has 5 columns{most}{halves}name all 9 columns")),
        "{said}"
    );
    // Whole numbers with a column more than names: nothing tells them from halves, and naming the columns is said as well.
    let numbers = |k: usize| format!("{},{},{},{},{},7\n", 20 * k, k % 2, k % 3, 90 + k % 5, -(60 + (k % 5) as i64));
    let whole_numbers = format!("ms,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n{}", (0..ROWS).map(numbers).collect::<String>());
    let said = refused(&whole_numbers, &with(""));
    assert!(
        said.contains(&format!("line 2: 6 cells where the header has 5 columns{most}{halves}name all 6 columns")),
        "{said}"
    );

    let twice = table("time_s,u_pos,u_pos,p_pos_kpa,p_neg_kpa\n", seconds, ",", ".", "");
    let map = "names = [\"time_s\", \"a\", \"b\", \"c\", \"d\"]\nheader_line = 1";
    names_its_way_out(&twice, map, "column 3: u_pos stands here a second time");
}

/// Units in a row that holds further numbers: where the record begins, and its step. It is no lost row, and its volts count.
#[test]
fn units_beside_other_numbers_are_units() {
    // Each sensor is converted by its own range.
    let rig = with(
        "period_ms = 20.0\ncolumns.u_pos = { from = \"CH1\", scale = 1.0 }\ncolumns.u_neg = { from = \"CH2\", scale = 1.0 }\n\
                    columns.p_pos_kpa = \"CH3\"\ncolumns.p_neg_kpa = \"CH4\"",
    );
    let ranges = ["sensor_pos", "sensor_neg"].map(|name| {
        let sensor = &rig.sensors[name];
        (sensor.range_kpa_gauge, sensor.range_v)
    });
    let mut text = "X,CH1,CH2,CH3,CH4,Start,Increment,\nSequence,Volt,Volt,Volt,Volt,-3.0e-01,2.0e-02\n".to_owned();
    for k in 0..ROWS {
        let [a, b, c, d] = row(k);
        let volts = [c, d]
            .into_iter()
            .zip(ranges)
            .map(|(kpa, ([low, high], [from, to]))| from + (kpa - low) / (high - low) * (to - from));
        let volts: Vec<String> = volts.map(|v| format!("{v:.9}")).collect();
        text += &format!("{k},{a:.5},{b:.5},{},,\n", volts.join(","));
    }
    let recording = read(&text, &rig).unwrap_or_else(|error| panic!("{error}"));
    assert_whole(&recording, "volts");
    assert!(!recording.notes().join(" ").contains("lost"), "{:?}", recording.notes());
}

/// Cells that a spreadsheet has merged: a word over the first of the columns that it is for. Names that stand twice have it before them.
#[test]
fn words_over_merged_cells_tell_names_apart() {
    let text = table(";valve;;pressure;\ntime_s;pos;neg;pos;neg\n", seconds, ";", ".", "");
    let map = "columns.u_pos = \"valve pos\"\ncolumns.u_neg = \"valve neg\"\ncolumns.p_pos_kpa = \"pressure pos\"\n\
               columns.p_neg_kpa = \"pressure neg\"";
    let said = refused(&text, &with(""));
    assert!(said.contains("there are time_s,valve pos,valve neg,pressure pos,pressure neg;"), "{said}");
    assert_whole(&read(&text, &with(map)).unwrap(), "merged cells");
}

/// Settings of each channel between its unit and its numbers.
#[test]
fn settings_of_channels_are_no_names() {
    let head = "Created\t29.03.2026 10:00:00\n\ntime_s\tu_pos\tu_neg\tp_pos_kpa\tp_neg_kpa\ns\t-\t-\tbar\tbar\n\
                CH=1\tCH=2\tCH=3\tCH=4\tCH=5\nSR=50 Hz\tSR=50 Hz\tSR=50 Hz\tSR=50 Hz\tSR=50 Hz\n\n";
    let mut text = head.to_owned();
    for k in 0..ROWS {
        let [a, b, c, d] = row(k);
        text += &format!("{}\t{a:.5}\t{b:.5}\t{:.7}\t{:.7}\n", seconds(k), c / 100.0, d / 100.0);
    }
    let recording = read(&text, &with("")).unwrap_or_else(|error| panic!("{error}"));
    assert_whole(&recording, "settings of channels");
    assert!(recording.notes().join(" ").contains("p_pos_kpa in bar"), "{:?}", recording.notes());
    // A word alone is none either.
    let dspace = table(
        "\"dSPACE\"\n\"unit\",\"\",\"\",\"kPa\",\"kPa\"\n\"trace\",\"u_pos\",\"u_neg\",\"p_pos_kpa\",\"p_neg_kpa\"\n\"trace_values\"\n",
        seconds,
        ",",
        ".",
        "",
    );
    assert_whole(&read(dspace, &with("time = \"trace\"")).unwrap(), "a word before the numbers");
    // With nothing but a title above them they are the names.
    let named = table("logger 7\nt=s,a=-,b=-,c=kPa,d=kPa\n", seconds, ",", ".", "");
    let map = "time = \"t=s\"\ncolumns.u_pos = \"a=-\"\ncolumns.u_neg = \"b=-\"\ncolumns.p_pos_kpa = \"c=kPa\"\n\
               columns.p_neg_kpa = \"d=kPa\"";
    assert_whole(&read(&named, &with(map)).unwrap(), "names that hold a sign of equality");
}

/// A date and time of whole seconds beside the milliseconds, which alone would be a clock that is set back every second.
#[test]
fn milliseconds_beside_a_stamp_are_a_part_of_it() {
    let stamp = |k: usize| format!("{},2026/03/29 10:00:{:02},{}", k + 1, k / 50, 20 * (k % 50));
    let text = table("Number,Date&Time,ms,u_pos,u_neg,p_pos_kpa,p_neg_kpa,Alarm\n", stamp, ",", ".", ",LLLL");
    let recording = read(&text, &with("")).unwrap_or_else(|error| panic!("{error}"));
    assert_whole(&recording, "milliseconds");
    assert!(recording.notes().join(" ").contains("milliseconds from ms"), "{:?}", recording.notes());
}

/// Command that makes a table of JSON, of an object in each line or of one value: the two ask for other options.
#[test]
fn json_is_refused_with_the_command_that_makes_a_table_of_it() {
    let objects = |k: usize| format!("{{\"time_s\": {}, \"u_pos\": 0.5}}", 0.02 * k as f64);
    let lines: String = (0..20).map(|k| objects(k) + "\n").collect();
    let said = refused(&lines, &with(""));
    assert!(said.contains("pandas.read_json('FILE', lines=True, convert_dates=False).to_csv"), "{said}");
    let array = format!("[{}]", (0..20).map(objects).collect::<Vec<_>>().join(",\n"));
    let said = refused(&array, &with(""));
    assert!(said.contains("pandas.read_json('FILE', convert_dates=False).to_csv"), "{said}");
    let columns = "{\"time_s\": [0, 0.02], \"u_pos\": [0.5, 0.5]}\n";
    let said = refused(columns, &with(""));
    assert!(said.contains("pandas.read_json('FILE', convert_dates=False).to_csv"), "{said}");
}
