//! Chromium without a window, which loads a page with a script at its end and prints what that saw.

#![allow(clippy::unwrap_used, clippy::panic, reason = "the helpers of a test fail by panicking, as the test does")]

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::{Command, Stdio};

/// Name of the Chromium that is installed; a line where there is none.
pub(crate) fn chromium() -> Option<&'static str> {
    let found = ["chromium", "chromium-browser", "google-chrome"].into_iter().find(|name| {
        Command::new(name)
            .arg("--version")
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
            .is_ok_and(|s| s.success())
    });
    if found.is_none() {
        println!("SKIPPED: no chromium here, so pages are not looked at in a browser");
    }
    found
}

/// Loads a page with the reader's hand in a window of a width, and answers what was seen.
pub(crate) fn seen(browser: &str, page: &str, hand: &str, name: &str, width: u32) -> BTreeMap<String, String> {
    let folder: PathBuf = std::env::temp_dir().join(format!("report-browser-{}-{name}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let file = folder.join("page.html");
    std::fs::write(&file, page.replace("</body>", &format!("{hand}</body>"))).unwrap();
    let output = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--virtual-time-budget=20000"])
        .arg(format!("--window-size={width},1200"))
        .arg(format!("--user-data-dir={}", folder.join("profile").display()))
        .arg("--dump-dom")
        .arg(format!("file://{}", file.display()))
        .output()
        .unwrap();
    let _ = std::fs::remove_dir_all(&folder);
    let dump = String::from_utf8_lossy(&output.stdout).into_owned();
    let Some((_, rest)) = dump.split_once("<pre id=\"seen\">") else {
        panic!("the page did not get through: {}", String::from_utf8_lossy(&output.stderr))
    };
    let text = rest.split("</pre>").next().unwrap_or_default();
    text.lines().filter_map(|line| line.split_once('=')).map(|(k, v)| (k.to_owned(), v.to_owned())).collect()
}
