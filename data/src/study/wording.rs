//! Says in the words of the study what the TOML reader refused.

use super::{locate::Places, validate::StudyError};

/// Units that a key may end in.
const UNITS: [&str; 29] = [
    "pa",
    "hpa",
    "kpa",
    "mpa",
    "gpa",
    "mmhg",
    "n",
    "kn",
    "mn",
    "kg",
    "g",
    "mm",
    "um",
    "cm",
    "m",
    "in",
    "ev",
    "kev",
    "mev",
    "deg",
    "s",
    "ms",
    "min",
    "rad",
    "percent",
    "g_per_cm3",
    "kg_per_m3",
    "g_per_ml",
    "kgf",
];

/// Path, line and remedy for an error of the TOML reader.
pub(super) fn refused(error: &toml::de::Error, text: &str) -> StudyError {
    let places = Places::of(text);
    let span = error.span();
    let path = span.as_ref().map_or("", |span| places.path_at(span.start)).to_owned();
    let message = error.message().split_whitespace().collect::<Vec<_>>().join(" ");
    StudyError::new(&path, span, &reword(&message), &places, text)
}

fn reword(message: &str) -> String {
    let mut quoted = message.split('`').skip(1).step_by(2);
    if message.starts_with("unknown field") {
        let key = quoted.next().unwrap_or_default();
        return unknown_key(key, &quoted.collect::<Vec<_>>());
    }
    if message.starts_with("unknown variant") {
        let word = quoted.next().unwrap_or_default();
        let known: Vec<_> = quoted.collect();
        return format!("{word:?} is not known; write one of: {}", known.join(", "));
    }
    if message.starts_with("missing field") {
        return format!("the key `{}` is missing", quoted.next().unwrap_or_default());
    }
    message.to_owned()
}

fn unknown_key(key: &str, known: &[&str]) -> String {
    let (stem, unit) = split_unit(key);
    let twin = known.iter().find(|k| split_unit(k).0 == stem && !split_unit(k).1.is_empty());
    if let Some(twin) = twin {
        let wanted = split_unit(twin).1;
        let given = if unit.is_empty() { "no unit" } else { unit };
        return format!("unknown key; convert it from {given} to {wanted} and name it `{twin}`");
    }
    let near = known.iter().map(|k| (distance(key, k), k)).min();
    match near {
        Some((steps, near)) if steps <= 2 => format!("unknown key; did you mean `{near}`?"),
        Some(_) => format!("unknown key; there are: {}", known.join(", ")),
        None => "unknown key; there are none here".into(),
    }
}

/// `young_kpa` -> (`young`, `kpa`); the unit is empty when there is none.
fn split_unit(key: &str) -> (&str, &str) {
    let split = |unit: &&str| {
        let stem = key.strip_suffix(*unit)?.strip_suffix('_')?;
        Some((stem, &key[stem.len() + 1..]))
    };
    // The longest unit wins: `density_g_per_cm3` does not end in `cm3` alone.
    UNITS.iter().filter_map(split).min_by_key(|(stem, _)| stem.len()).unwrap_or((key, ""))
}

/// Number of letters to insert, delete or replace.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, ca) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, cb) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(ca != *cb);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}
