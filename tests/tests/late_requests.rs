//! Requests that take work, and whose askers do not wait for it: nothing is carried out late, and nothing new begins before
//! the work is really over.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tests::alone;
use tests::laboratory::{Laboratory, Plan, SOCKET, SOON};

/// Ticks after which a model can be compared on them, and that takes half a second or more.
const SOME_SECONDS: u64 = 650;
/// Longer than the daemon takes to see a request or a client that has left, shorter than comparing a model.
const MOMENT: Duration = Duration::from_millis(20);

fn send(laboratory: &Laboratory, request: &Value) -> UnixStream {
    let mut stream = UnixStream::connect(laboratory.folder.join(SOCKET)).unwrap();
    stream.set_read_timeout(Some(SOON)).unwrap();
    stream.write_all(format!("{request}\n").as_bytes()).unwrap();
    stream
}

fn answer(stream: UnixStream) -> Value {
    let mut line = String::new();
    BufReader::new(stream).read_line(&mut line).unwrap();
    serde_json::from_str(&line).unwrap_or_else(|e| panic!("{e}: {line:?}"))
}

fn is_busy(reply: &Value) -> bool {
    reply["error"].as_str().is_some_and(|error| error.contains("is being loaded or checked"))
}

/// Tests of the thorough tier (docs/testing.md).
mod thorough {
    use super::*;

    #[test]
    #[ignore = "thorough: docs/testing.md"]
    fn a_model_whose_asker_has_left_never_comes_into_force_and_bars_others_until_its_work_is_over() {
        let _alone = alone();
        let laboratory = Plan::new("control.auto_arm = true\npolicy.active = \"fallback\"").in_real_time().start();
        let status = laboratory.wait_for("some seconds old", |s| s["status"]["tick"].as_u64() >= Some(SOME_SECONDS));
        assert_eq!(status["running"]["model"], "dual_pressure", "{status}");
        let bench = json!({"ask": "model", "file": "bench"});
        let experiment = json!({"ask": "experiment", "file": "/e.csv", "csv": "time_s,u_pos,u_neg\n0,1,1\n1,1,1\n"});

        let first = send(&laboratory, &bench);
        std::thread::sleep(MOMENT);
        let second = answer(send(&laboratory, &bench));
        assert!(is_busy(&second), "{second}");
        drop(first);
        std::thread::sleep(MOMENT);
        // Nobody waits for it any more, and still it computes: whatever began now would be beside it.
        for request in [&bench, &experiment, &json!({"ask": "swap", "name": "nobody"})] {
            let reply = answer(send(&laboratory, request));
            assert!(is_busy(&reply), "{request}: {reply}");
        }
        let until = Instant::now() + SOON;
        let reply = loop {
            let reply = answer(send(&laboratory, &json!({"ask": "swap", "name": "nobody"})));
            if !is_busy(&reply) {
                break reply;
            }
            assert!(Instant::now() < until, "{reply}");
            std::thread::sleep(MOMENT);
        };
        assert!(reply["error"].as_str().unwrap().contains("no policy nobody"), "{reply}");
        assert_eq!(reply["running"]["model"], "dual_pressure", "put in force after its asker had left: {reply}");

        // One that is waited for comes into force. Frames that a busy machine missed break the run, and it is asked again as it says.
        let until = Instant::now() + SOON;
        let reply = loop {
            let reply = answer(send(&laboratory, &bench));
            let is_too_short = reply["error"].as_str().is_some_and(|error| error.contains("keep the rig armed for"));
            if !is_too_short || Instant::now() > until {
                break reply;
            }
            std::thread::sleep(Duration::from_secs(1));
        };
        assert_eq!((&reply["ok"], &reply["running"]["model"]), (&true.into(), &"bench".into()), "{reply}");
        laboratory.close().check_replay();
    }
}
