//! Names in tables that older programs wrote, as they are called now, so that tables of both can be joined.

use serde::{Deserialize, Deserializer};

/// Names of earlier tables, and the present ones; a name that ends in a space goes on.
const NAMES: [(&str, &str); 4] = [
    ("limit (rig and reference known)", crate::table::OPTIMUM),
    ("iterative learning, flight ", "iterative learning, run "),
    (" drawn around ", " randomised around "),
    ("(contract ", "(layout v"),
];

/// A name of a table as this program would write it.
pub(crate) fn present_name(written: &str) -> String {
    NAMES.iter().fold(written.to_owned(), |name, (then, now)| name.replace(then, now))
}

/// Reads one name.
pub(crate) fn one<'de, D: Deserializer<'de>>(from: D) -> Result<String, D::Error> {
    Ok(present_name(&String::deserialize(from)?))
}

/// Reads a list of names.
pub(crate) fn each<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<String>, D::Error> {
    Ok(Vec::<String>::deserialize(from)?.iter().map(|name| present_name(name)).collect())
}
