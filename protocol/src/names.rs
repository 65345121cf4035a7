//! Names which people get wrong, and what they may have meant.

use manduca_numerics::parameters::{self, TABLE};

/// Likeness of two names, 0 to 1, from which one is suggested for the other.
const ALIKE: f64 = 0.75;
/// Longest name for which a likeness is looked for, bytes.
const LONGEST: usize = 64;

/// Says that there is no parameter of a name: which was meant, perhaps, and which there are.
pub fn unknown_parameter(text: &str) -> String {
    let meant = parameters::find(text).map(|i| TABLE[i].name);
    let meant = meant.or_else(|| nearest(text, TABLE.iter().map(|p| p.name)));
    format!("unknown parameter; {}known are {}", suggestion(meant), TABLE.map(|p| p.name).join(", "))
}

/// `did you mean x? `, or nothing.
pub(crate) fn suggestion(meant: Option<&str>) -> String {
    meant.map_or_else(String::new, |name| format!("did you mean {name}? "))
}

/// The known name most like a text, if any is much like it.
pub(crate) fn nearest<'a>(text: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    if text.len() > LONGEST {
        return None;
    }
    let text = text.trim().to_lowercase().replace('-', "_");
    let likeness = known.map(|name| (name, strsim::normalized_damerau_levenshtein(&text, name)));
    likeness.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, alike)| *alike >= ALIKE).map(|(name, _)| name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_meant_is_suggested() {
        for (text, meant) in [
            ("f", "did you mean frequency_hz?"),
            ("beta", "did you mean stroke_plane_deg?"),
            ("φ0", "did you mean sweep_mean_deg?"),
            ("frequency_khz", "did you mean frequency_hz?"),
            ("stroke_plan_deg", "did you mean stroke_plane_deg?"),
        ] {
            let told = unknown_parameter(text);
            assert!(told.contains(meant) && told.contains("rotation_shape"), "{text}: {told}");
        }
        assert!(!unknown_parameter("colour").contains("did you mean"));
    }
}
