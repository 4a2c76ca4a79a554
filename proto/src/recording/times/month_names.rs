//! Dates whose month is a word: `29. März 2026`, `Mar 29, 2026`, `Sun Mar 29 01:59:00 2026`.
//!
//! A logger writes months in the language of the computer that it runs on. Names are told by how they begin, so that `Sept.`, `Sep` and
//! `September` are one; what begins alike in several of these languages is the same month in all of them.

/// Beginnings of the names of the months in English, German, French, Spanish, Italian, Portuguese, Dutch, Swedish, Danish and Norwegian.
const NAMES: [&[&str]; 12] = [
    &["jan", "jän", "ene", "gen", "janv"],
    &["feb", "fév", "fev"],
    &["mar", "mär", "mrz", "mrt", "maa"],
    &["apr", "avr", "abr"],
    &["may", "mai", "mag", "mei", "maj"],
    &["jun", "juin", "giu"],
    &["jul", "juil", "lug"],
    &["aug", "aoû", "aou", "ago"],
    &["sep", "set"],
    &["oct", "okt", "ott", "out"],
    &["nov"],
    &["dec", "dez", "déc", "dic", "des"],
];

/// The month, from 1, that a word names; `None` of other words.
pub(crate) fn month_of(word: &str) -> Option<i64> {
    let word = word.trim_end_matches(['.', ',']).to_lowercase();
    if !word.chars().all(char::is_alphabetic) {
        return None;
    }
    let at = NAMES.iter().position(|names| names.iter().any(|name| word.starts_with(name)))?;
    Some(at as i64 + 1)
}

/// Writes a moment with its date in numbers, `2026-03-29 01:59:00`, where a text's words are a day, a month by name, a year of four
/// digits and what else belongs to a time, a day of the week among them; `None` of other texts.
pub(crate) fn in_numbers(text: &str) -> Option<String> {
    let words: Vec<&str> = text.split_whitespace().collect();
    // Nearly every cell of a file ends here.
    if words.len() < 3 || !text.contains(char::is_alphabetic) {
        return None;
    }
    let month_at = words.iter().position(|word| month_of(word).is_some())?;
    let month = month_of(words.get(month_at)?)?;
    let digits = |word: &str, lengths: [usize; 2]| {
        let bare = word.trim_end_matches(['.', ',']);
        let is_number = bare.bytes().all(|byte| byte.is_ascii_digit());
        (is_number && (lengths[0]..=lengths[1]).contains(&bare.len())).then(|| bare.to_owned())
    };
    // A day stands beside its month, a year anywhere behind.
    let day_at = [month_at.checked_sub(1), Some(month_at + 1)]
        .into_iter()
        .flatten()
        .find(|at| words.get(*at).is_some_and(|word| digits(word, [1, 2]).is_some()))?;
    let year_at =
        (month_at + 1..words.len()).find(|at| words.get(*at).is_some_and(|word| digits(word, [4, 4]).is_some()))?;
    let (day, year) = (digits(words.get(day_at)?, [1, 2])?, digits(words.get(year_at)?, [4, 4])?);
    // Before the date nothing but the day of the week stands, and that is a word.
    let first = day_at.min(month_at);
    let is_word = |word: &&str| word.trim_end_matches(['.', ',']).chars().all(char::is_alphabetic);
    if first > 1 || !words.iter().take(first).all(is_word) {
        return None;
    }
    let rest = words.iter().enumerate().filter(|(at, _)| *at >= first && ![day_at, month_at, year_at].contains(at));
    let rest: Vec<&str> = rest.map(|(_, word)| *word).collect();
    Some(format!("{year}-{month:02}-{day:0>2} {}", rest.join(" ")).trim_end().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn months_are_told_in_the_languages_of_loggers() {
        let all = [
            "Januar Februar März April Mai Juni Juli August September Oktober November Dezember",
            "janv. févr. mars avr. mai juin juil. août sept. oct. nov. déc.",
            "enero febrero marzo abril mayo junio julio agosto septiembre octubre noviembre diciembre",
            "gennaio febbraio marzo aprile maggio giugno luglio agosto settembre ottobre novembre dicembre",
            "janeiro fevereiro março abril maio junho julho agosto setembro outubro novembro dezembro",
            "jan. feb. mrt. apr. mei juni juli aug. sep. okt. nov. dec.",
            "Jan Feb Mrz Apr Mai Jun Jul Aug Sep Okt Nov Dez",
        ];
        for names in all {
            let found: Vec<Option<i64>> = names.split(' ').map(month_of).collect();
            assert_eq!(found, (1..=12).map(Some).collect::<Vec<_>>(), "{names}");
        }
        assert!(["", "kPa", "mean", "3", "u_pos", "sample"].iter().all(|word| month_of(word).is_none()));
    }

    #[test]
    fn words_that_are_no_date_stay() {
        for text in
            ["run 3 of Mar", "pressure at 4 Mar", "Mar 2026", "opened the vent 4 Mar 2026", "29.03.2026 01:59:00"]
        {
            assert_eq!(in_numbers(text), None, "{text}");
        }
        assert_eq!(in_numbers("4. Okt 2026").as_deref(), Some("2026-10-04"));
        assert_eq!(in_numbers("Wed Mar 4 01:59:45.02 CET 2026").as_deref(), Some("2026-03-04 01:59:45.02 CET"));
    }
}
