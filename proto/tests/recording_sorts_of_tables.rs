//! Tables as consoles, databases and data frames print them, and what a file is told where its columns need a key.

#![allow(clippy::unwrap_used, clippy::panic, reason = "the helpers of a test fail by panicking, as the test does")]

use model::rig::Rig;
use proto::recording::Recording;

const ROWS: usize = 60;
const NAMES: [&str; 5] = ["time_s", "u_pos", "u_neg", "p_pos_kpa", "p_neg_kpa"];

fn read_with(map: &str, bytes: impl AsRef<[u8]>) -> Result<Recording, String> {
    let rig = Rig::from_toml(&format!("{}\n[recording]\n{map}", model::rig::DUAL_PRESSURE)).unwrap();
    Recording::parse_for("x.csv", bytes.as_ref(), &rig).map_err(|error| error.to_string())
}

fn cells(k: usize) -> [f64; 5] {
    let x = k as f64;
    [0.02 * x, 0.5 + 0.001 * x, 0.6, 90.0 + (0.7 * x).sin(), -60.0 - (0.9 * x).cos()]
}

/// Lines of rows, each made of its number and its cells.
fn lines(line: impl Fn(usize, [String; 5]) -> String) -> String {
    (0..ROWS).map(|k| line(k, cells(k).map(|cell| format!("{cell:.4}"))) + "\n").collect()
}

/// The numbers are those of the rows, under their names.
#[track_caller]
fn assert_read(text: &str) {
    let of = read_with("", text).unwrap();
    assert_eq!((of.rows(), of.segments().len()), (ROWS, 1), "{:?}", of.notes());
    for (at, name) in NAMES.iter().enumerate().skip(1) {
        assert!((of.column(name).unwrap()[7] - cells(7)[at]).abs() < 1e-4, "{name}: {text}");
    }
}

#[test]
fn what_consoles_and_data_frames_print_is_read() {
    let printed = lines(|k, row| format!("{k:<6}{}", row.map(|cell| format!("{cell:>12}")).concat()));
    assert_read(&format!("      {}\n{printed}", NAMES.join("  ")));
    let queried = lines(|_, row| format!(" {} ", row.join(" | ")));
    assert_read(&format!(" {} \n--------+-------+-------+-----+-----\n{queried}({ROWS} rows)\n", NAMES.join(" | ")));
    let plain = lines(|_, row| row.join(","));
    assert_read(&format!(",cmd,cmd,sensor,sensor\n,u_pos,u_neg,p_pos_kpa,p_neg_kpa\ntime_s,,,,\n{plain}"));
    assert_read(&format!("name,u_pos,u_neg,p_pos_kpa,p_neg_kpa\nunit,-,-,kPa,kPa\ntime_s,,,,\n{plain}"));
    // Names that stand once are those of the last level, whatever else stands twice.
    let doubled = lines(|k, row| format!("{},{k},{}", row.join(","), 2 * k));
    assert_read(&format!(
        ",cmd,cmd,sensor,sensor,in,out\n,u_pos,u_neg,p_pos_kpa,p_neg_kpa,temp,temp\ntime_s,,,,,,\n{doubled}"
    ));
    // `temps` are times in French and temperatures beside another column of times.
    assert_read(&format!("Temps,u_pos,u_neg,p_pos_kpa,p_neg_kpa\n{plain}"));
    let warm = lines(|k, row| format!("{},{}", row.join(","), 20 + k % 3));
    assert_read(&format!("t_s,u_pos,u_neg,p_pos_kpa,p_neg_kpa,temps\n{warm}"));
    assert_read(&format!("time_s,u_pos [-],u_neg,p_pos_kpa [kPa (gauge)],p_neg_kpa [kPa(g)]\n{plain}"));
    let influx = lines(|k, row| {
        format!(",,0,2026-05-01T11:00:00Z,2026-05-01T12:00:{:06.3}Z,{}", 0.02 * k as f64, row[1..].join(","))
    });
    assert_read(&format!("#default,_result,,,,,,,\n,result,table,_start,_time,{}\n{influx}", NAMES[1..].join(",")));
}

#[test]
fn what_cannot_be_read_is_told_with_the_line_that_helps() {
    let blocks: String = NAMES[1..]
        .iter()
        .enumerate()
        .flat_map(|(at, name)| (0..ROWS).map(move |k| (at, *name, k)))
        .map(|(at, name, k)| {
            let time = format!("2026-05-01T12:00:{:06.3}Z", 0.02 * k as f64);
            format!(",,{at},2026-05-01T11:00:00Z,2026-05-01T13:00:00Z,{time},{:.4},{name},rig\n", cells(k)[at + 1])
        })
        .collect();
    let head = "#default,_result,,,,,,,\n,result,table,_start,_stop,_time,_value,_field,_measurement\n";
    let said = read_with("", format!("{head}{blocks}")).unwrap_err();
    let pivot = "read_csv('FILE', comment='#').pivot(index='_time', columns='_field', values='_value')";
    assert!(said.contains("one row per channel") && said.contains(pivot), "{said}");

    // Beside the values a quality and a finer clock, which are numbers as well; whole seconds do not tell rows apart.
    let rows: String = (0..ROWS)
        .flat_map(|k| NAMES[1..].iter().enumerate().map(move |(at, name)| (at, *name, k)))
        .map(|(at, name, k)| {
            let value = format!("{:.4}", cells(k)[at + 1]).replace('.', ",");
            format!("\"{name}\";\"01.05.2026 12:00:0{}\";{value};1;{}\r\n", k / 50, 20 * k)
        })
        .collect();
    let said = read_with("", format!("\"VarName\";\"TimeString\";\"VarValue\";\"Validity\";\"Time_ms\"\r\n{rows}"))
        .unwrap_err();
    let pivot = "read_csv('FILE', sep=None, engine='python', decimal=',').pivot(index='Time_ms', columns='VarName', values='VarValue')";
    assert!(said.contains("one row per channel") && said.contains(pivot), "{said}");

    let stamped = lines(|k, row| format!("1774749585,{},{}", 20_000_000 * k, row[1..].join(",")));
    let text = format!("header.stamp.sec,header.stamp.nanosec,{}\n{stamped}", NAMES[1..].join(","));
    let key = "time = [{ from = \"header.stamp.sec\" }, { from = \"header.stamp.nanosec\", scale = 1e-9 }]";
    let said = read_with("", &text).unwrap_err();
    assert!(said.contains(key), "{said}");
    assert_eq!(read_with(key, &text).unwrap().rows(), ROWS);
    // The seconds alone: their parts stand beside them.
    let stamp = |k: usize| format!("{},{}", 1_774_749_585 + k / 50, 20_000_000 * (k % 50));
    let stamped = lines(|k, row| format!("{},{}", stamp(k), row[1..].join(",")));
    let text = format!("header.stamp.sec,header.stamp.nanosec,{}\n{stamped}", NAMES[1..].join(","));
    let of_seconds = read_with("time = \"header.stamp.sec\"", &text).unwrap();
    assert_eq!((of_seconds.rows(), of_seconds.segments().len()), (ROWS, 1));
    let notes = of_seconds.notes().join(" ");
    assert!(notes.contains("nanoseconds from header.stamp.nanosec"), "{notes}");

    let quoted = lines(|_, row| row.join(","));
    let text = format!("time_s,/'Data'/'u_pos',u_neg,p_pos_kpa,p_neg_kpa\n{quoted}");
    let said = read_with("", &text).unwrap_err();
    assert!(said.contains("time_s,/'Data'/'u_pos',u_neg"), "{said}");
    assert_eq!(read_with("columns.u_pos = \"/'Data'/'u_pos'\"", &text).unwrap().rows(), ROWS);

    let said = read_with("", vec![0; 1 << 16]).unwrap_err();
    assert!(said.contains("nothing but zero bytes"), "{said}");
}

/// Columns that only the level above tells apart cannot be asked for by the last one's name.
#[test]
fn names_that_stand_twice_in_the_last_level_have_those_above_before_them() {
    let plain = lines(|_, row| row.join(","));
    let text = format!(",run,run,run,run\n,u,u,p,p\n,pos,neg,pos,neg\nt,,,,\n{plain}");
    let said = read_with("", &text).unwrap_err();
    assert!(said.contains("t,u pos,u neg,p pos,p neg"), "{said}");
    let map = ["u_pos", "u_neg"].map(|name| format!("columns.{name} = \"{}\"\n", name.replace('_', " "))).concat()
        + "columns.p_pos_kpa = \"p pos\"\ncolumns.p_neg_kpa = \"p neg\"\n";
    let of = read_with(&map, &text).unwrap();
    for (at, name) in NAMES.iter().enumerate().skip(1) {
        assert!((of.column(name).unwrap()[7] - cells(7)[at]).abs() < 1e-4, "{name}");
    }
}

/// An oscilloscope's file: a line of names that holds numbers, and one of units below it.
#[test]
fn names_that_are_given_stand_for_the_line_that_is_given() {
    let plain = lines(|_, row| row.join(","));
    let text = format!("x-axis,1,2,3,4\nsecond,Volt,Volt,Volt,Volt\n{plain}");
    let map = format!("header_line = 2\nnames = {NAMES:?}");
    let of = read_with(&map, &text).unwrap();
    assert_eq!((of.rows(), of.segments().len()), (ROWS, 1), "{:?}", of.notes());
    assert_eq!(of.column("u_pos").unwrap()[0], 0.5);
    // Rows above that look like data are none.
    let text = format!("9,9,9,9,9\n9,9,9,9,9\n{plain}");
    assert_eq!(read_with(&map, &text).unwrap().column("u_pos").unwrap()[0], 0.5);
    // Units in the line behind are units, and no data.
    let map = format!("header_line = 1\nnames = {NAMES:?}");
    let of = read_with(&map, format!("a,b,c,d,e\ns,-,-,mbar,mbar\n{}", lines(|_, row| row.join(",")))).unwrap();
    assert_eq!((of.rows(), of.segments().len()), (ROWS, 1), "{:?}", of.notes());
    assert!((of.column("p_pos_kpa").unwrap()[7] - 0.1 * cells(7)[3]).abs() < 1e-4, "{:?}", of.notes());
}

/// The key that is told of a command or a relay in another range is accepted as it stands, and makes the numbers that were meant.
#[test]
fn the_key_that_is_told_for_a_range_is_the_right_one() {
    let names = NAMES.join(",");
    let key_of = |said: &str| {
        let behind = said.split_once("[recording] ").unwrap().1;
        behind.split_inclusive(" }").next().unwrap().to_owned()
    };
    for (shut, open) in
        [(4.0, 20.0), (1000.0, 2000.0), (1.0, 5.0), (0.0, 10.0), (-1.0, 1.0), (0.0, 100.0), (0.0, 4095.0)]
    {
        let duty = |k: usize| (k % 11) as f64 / 10.0;
        let written = lines(|k, mut row| {
            row[1] = format!("{:.4}", shut + (open - shut) * duty(k));
            row.join(",")
        });
        let text = format!("{names}\n{written}");
        let said = read_with("", &text).unwrap_err();
        let of = read_with(&key_of(&said), &text).unwrap_or_else(|error| panic!("{said}: {error}"));
        let u = of.column("u_pos").unwrap();
        assert!((0..ROWS).all(|k| (u[k] - duty(k)).abs() < 1e-3), "{shut} … {open}: {said}");
    }
    // A measured voltage under a scale that the rig file has already: its own ends, and not a second scale.
    let measured = lines(|k, mut row| {
        row[1] = format!("{}", [-0.05, 4.0, 10.02][k % 3]);
        row.join(",")
    });
    let text = format!("{names}\n{measured}");
    let said = read_with("columns.u_pos = { from = \"u_pos\", scale = 0.1 }", &text).unwrap_err();
    assert!(said.contains("as it is scaled, u_pos goes from -0.005 to 1.002"), "{said}");
    let of = read_with(&key_of(&said), &text).unwrap();
    assert!((of.column("u_pos").unwrap()[1] - 0.4).abs() < 0.01, "{said}");

    let in_ma = lines(|k, mut row| {
        row[1] = format!("{}", 4 + 4 * (k % 5));
        row.join(",")
    });
    let said = read_with("", format!("{}\n{in_ma}", names.replace("u_pos", "u_pos [mA]"))).unwrap_err();
    assert!(said.contains("scale = 0.0625, offset = -0.25 }"), "{said}");

    let relay = |cell: &str| format!("{names},pump_on\n{}", lines(|_, row| format!("{},{cell}", row.join(","))));
    let said = read_with("", relay("24.0")).unwrap_err();
    assert_eq!(read_with(&key_of(&said), relay("24.0")).unwrap().column("pump_on").unwrap()[3].round(), 1.0, "{said}");
    let blank = read_with("", relay("")).unwrap();
    assert!(blank.notes().join("\n").contains("pump_on has nothing in any row"), "{:?}", blank.notes());

    let hex = lines(|k, mut row| {
        row[1] = format!("0x{:03X}", 4095 * (k % 3) / 2);
        row.join(",")
    });
    let said = read_with("", format!("{names}\n{hex}")).unwrap_err();
    assert!(said.contains("counts of 12 bits") && said.contains("scale = 0.0002442 }"), "{said}");
}

#[test]
fn clocks_that_were_set_are_told_with_the_distance_of_rows() {
    let names = NAMES.join(",");
    let at = |time: fn(usize) -> f64| {
        let moved = lines(|k, mut row| {
            row[0] = format!("{:.3}", time(k));
            row.join(",")
        });
        format!("{names}\n{moved}")
    };
    let key = "period_ms = 20.0";
    let set = at(|k| 0.02 * k as f64 + if k < 20 { 12.0 } else { 1_774_749_585.0 });
    let notes = read_with("", &set).unwrap().notes().join("\n");
    assert!(notes.contains("line 22: time_s goes on by") && notes.contains(key), "{notes}");
    let back = at(|k| 0.02 * k as f64 + if k < 40 { 2.0 } else { 1.5 });
    let said = read_with("", &back).unwrap_err();
    assert!(said.contains("the clock was set back") && said.contains(key) && !said.contains("sort"), "{said}");
    // Behind the hole another run may begin: the two are never one.
    for (text, segments) in [(set, 2), (back, 1)] {
        let of = read_with(key, &text).unwrap();
        assert_eq!((of.rows(), of.segments().len()), (ROWS, segments), "{:?}", of.notes());
        assert!(of.time_s().last().unwrap() - of.time_s()[0] < 3600.0, "{:?}", of.notes());
    }
}
