//! What the user may have meant.

/// The candidate closest to `given`, if it is close enough to be a slip of the keyboard.
pub fn nearest<'a>(given: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let given = given.to_lowercase();
    let best = candidates.into_iter().map(|c| (distance(&given, &c.to_lowercase()), c)).min()?;
    (best.0 <= 1 + given.chars().count().min(64) / 4).then_some(best.1)
}

/// "unknown WHAT "given"; did you mean "x"? (known: x, y, z)".
pub fn unknown(what: &str, given: &str, candidates: &[&str]) -> String {
    let meant = nearest(given, candidates.iter().copied());
    let meant = meant.map_or(String::new(), |m| format!("; did you mean \"{m}\"?"));
    let list = match candidates {
        [] => format!("no {what} is defined"),
        _ if candidates.len() > 40 => format!("known: {} and more", candidates[..40].join(", ")),
        _ => format!("known: {}", candidates.join(", ")),
    };
    format!("unknown {what} \"{given}\"{meant} ({list})")
}

/// Adds a suggestion to a deserialiser's "unknown field `x`, expected one of `a`, `b`".
pub fn with_suggestion(message: &str) -> String {
    let names: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    match names.split_first() {
        Some((given, known)) if message.starts_with("unknown field") => {
            let meant = nearest(given, known.iter().copied());
            let meant = meant.map_or(String::new(), |m| format!("did you mean `{m}`? "));
            format!("unknown key `{given}`; {meant}keys allowed here: {}", known.join(", "))
        }
        Some((name, [])) if message.starts_with("missing field") => {
            format!("the key `{name}` is missing here; add it")
        }
        _ => message.to_owned(),
    }
}

/// Levenshtein distance, over at most 64 characters of each.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().take(64).collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().take(64).enumerate() {
        let mut diagonal = std::mem::replace(&mut row[0], i + 1);
        for (j, &y) in b.iter().enumerate() {
            let change = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = change.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_are_recognised_and_other_words_are_not() {
        assert_eq!(nearest("sliver", ["gold", "silver"]), Some("silver"));
        assert_eq!(nearest("Gold", ["gold", "silver"]), Some("gold"));
        assert_eq!(nearest("plastic", ["gold", "silver"]), None);
        assert_eq!(distance("kitten", "sitting"), 3);
        let known = ["gold", "silver"];
        let said = r#"unknown material "sliver"; did you mean "silver"? (known: gold, silver)"#;
        assert_eq!(unknown("material", "sliver", &known), said);
        assert_eq!(unknown("material", "nix", &[]), r#"unknown material "nix" (no material is defined)"#);
    }
}
