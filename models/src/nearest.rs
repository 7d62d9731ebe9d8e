//! Spelling suggestions for unknown names.

/// The known name nearest to `wanted` by edit distance, if at most `1 + length/3` edits apart or with the same first
/// four letters.
pub fn nearest<'a>(wanted: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let folded = wanted.to_lowercase();
    let scored = known.into_iter().map(|name| (strsim::levenshtein(&folded, &name.to_lowercase()), name));
    let (steps, name) = scored.min_by_key(|&(steps, _)| steps)?;
    let few = steps <= 1 + wanted.chars().count() / 3;
    let stem = wanted.chars().take(4).collect::<String>();
    (few || (stem.len() >= 4 && name.starts_with(&stem))).then_some(name)
}

/// `did you mean …`, for a message of the form ``unknown field `a`, expected one of `b`, `c` ``.
pub(crate) fn suggestion(message: &str) -> Option<String> {
    let line = message.lines().find(|line| line.contains("unknown field `") || line.contains("unknown variant `"))?;
    let mut quoted = line.split('`').skip(1).step_by(2);
    let unknown = quoted.next()?;
    let known: Vec<&str> = quoted.collect();
    nearest(unknown, known.iter().copied()).map(|near| format!("did you mean `{near}`?"))
}

/// Names joined by commas, for messages.
pub(crate) fn listed<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    names.into_iter().collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::nearest;

    #[test]
    fn the_nearest_name_is_few_edits_away_or_begins_alike() {
        assert_eq!(nearest("neo_hokean", ["newtonian", "neo_hookean"]), Some("neo_hookean"));
        assert_eq!(nearest("radius", ["centre_m", "radius_m"]), Some("radius_m"));
        assert_eq!(nearest("steel", ["newtonian", "snow"]), None);
    }
}
