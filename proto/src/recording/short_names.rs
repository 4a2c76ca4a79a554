//! Short names of files that tell them apart.

/// The end of a path that no other of the paths has: its file name, or with as many folders before it as it takes.
///
/// Two runs that are both called `flight.mcap` become `monday/flight.mcap` and `tuesday/flight.mcap`. A path that stands
/// twice is the same file and keeps its short name.
pub fn short_name<'a>(path: &str, among: impl IntoIterator<Item = &'a str>) -> String {
    let parts = |path: &'a str| -> Vec<&'a str> { path.rsplit(['/', '\\']).filter(|part| !part.is_empty()).collect() };
    let own: Vec<&str> = path.rsplit(['/', '\\']).filter(|part| !part.is_empty()).collect();
    let shared = |other: &'a str| parts(other).iter().zip(&own).take_while(|(a, b)| *a == *b).count();
    let most = among.into_iter().filter(|other| *other != path).map(shared).max().unwrap_or(0);
    let take = (most + 1).min(own.len());
    let name: Vec<&str> = own.iter().take(take).rev().copied().collect();
    if name.is_empty() { path.to_owned() } else { name.join("/") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_much_of_a_path_as_tells_it_apart() {
        let all = ["a/monday/flight.mcap", "b/monday/flight.mcap", "other.csv", "monday/flight.mcap"];
        let short = all.map(|path| short_name(path, all));
        assert_eq!(short, ["a/monday/flight.mcap", "b/monday/flight.mcap", "other.csv", "monday/flight.mcap"]);
        let two = ["out/1/flight.mcap", "out/2/flight.mcap"];
        assert_eq!(two.map(|path| short_name(path, two)), ["1/flight.mcap", "2/flight.mcap"]);
        assert_eq!(short_name("x/run.csv", ["x/run.csv", "x/run.csv"]), "run.csv");
        assert_eq!(short_name("c:\\data\\run.csv", []), "run.csv");
        assert_eq!(short_name("/", []), "/");
    }
}
