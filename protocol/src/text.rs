//! Texts of people and of workers: what a name may be, and how a text is shown without harm.

use std::borrow::Cow;

/// Whether a character acts on what shows it: control characters, which move a terminal's cursor or begin its
/// commands, and those that turn the direction of what follows or break lines in some programs.
pub fn acts(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Whether a character leaves the place where it stands empty: white space, and what Unicode calls default ignorable.
fn is_blank(c: char) -> bool {
    c.is_whitespace()
        || acts(c)
        || matches!(c,
            '\u{ad}' | '\u{34f}' | '\u{115f}' | '\u{1160}' | '\u{17b4}' | '\u{17b5}' | '\u{180b}'..='\u{180f}'
            | '\u{200b}'..='\u{200d}' | '\u{2060}'..='\u{206f}' | '\u{2800}' | '\u{3164}' | '\u{fe00}'..='\u{fe0f}'
            | '\u{feff}' | '\u{ffa0}' | '\u{fff0}'..='\u{fffb}' | '\u{1bca0}'..='\u{1bca3}'
            | '\u{1d159}' | '\u{1d173}'..='\u{1d17a}' | '\u{e0000}'..='\u{e0fff}')
}

/// Checks a name of at most `most` characters: one can read it, and it does nothing to what shows it.
///
/// # Errors
/// Returns what is wrong with it, as the end of a sentence.
pub fn check_name(name: &str, most: usize) -> Result<(), String> {
    if !(1..=most).contains(&name.chars().count()) {
        return Err(format!("must have 1 to {most} characters"));
    }
    if let Some(c) = name.chars().find(|&c| acts(c)) {
        return Err(format!("has the control character U+{:04X}", u32::from(c)));
    }
    if name.chars().all(is_blank) {
        return Err("has no character that can be seen".into());
    }
    Ok(())
}

/// Checks a text of at most `most` characters, which may have several lines and tabs.
///
/// # Errors
/// Returns what is wrong with it, as the end of a sentence.
pub fn check_prose(text: &str, most: usize) -> Result<(), String> {
    if text.chars().count() > most {
        return Err(format!("is longer than {most} characters"));
    }
    let lines = text.replace("\r\n", "\n");
    match lines.chars().find(|&c| acts(c) && c != '\n' && c != '\t') {
        Some(c) => Err(format!("has the control character U+{:04X}", u32::from(c))),
        None => Ok(()),
    }
}

/// A text as it may be shown: its lines and tabs stay, every other character that acts is spelt, as `\u{1b}`.
pub fn shown(text: &str) -> Cow<'_, str> {
    spelt(text, |c| acts(c) && c != '\n' && c != '\t')
}

/// A text as it may be shown within a line: line breaks are spelt too.
pub fn shown_in_line(text: &str) -> Cow<'_, str> {
    spelt(text, acts)
}

/// JSON as it may be shown: the same values, with every character that acts escaped in its strings.
pub fn shown_json(json: &str) -> Cow<'_, str> {
    let hidden = |c: char| (acts(c) && !c.is_ascii_control()) || c == '\u{7f}';
    if !json.contains(hidden) {
        return Cow::Borrowed(json);
    }
    // All of them lie in the basic plane, and outside strings there are none.
    let escaped = |c: char| if hidden(c) { format!("\\u{:04x}", u32::from(c)) } else { c.into() };
    Cow::Owned(json.chars().map(escaped).collect())
}

/// A text as a cell of a table that spreadsheets open: one that they would take for a formula begins with an
/// apostrophe, and characters that act are spelt. Numbers are no texts and are not passed here.
pub fn cell(text: &str) -> Cow<'_, str> {
    let is_formula = text.starts_with(['=', '+', '-', '@', '\t', '\r', '\n', '＝', '＋', '－', '＠']);
    let shown = shown(text);
    if is_formula { Cow::Owned(format!("'{shown}")) } else { shown }
}

fn spelt(text: &str, hidden: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.contains(&hidden) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if hidden(c) { shown.extend(c.escape_unicode()) } else { shown.push(c) }
    }
    Cow::Owned(shown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_can_be_read() {
        for fine in ["a", "case-I", " a ", "Müller", "翼", "أحمد", "🦋", "x\u{200d}y", "wing\u{a0}1", "-", "0"]
        {
            assert_eq!(check_name(fine, 100), Ok(()), "{fine}");
        }
        for blank in [
            " ",
            "   ",
            "\u{a0}",
            "\u{3000}",
            "\u{200b}",
            "\u{feff}\u{200d}",
            "\u{2800}",
            "\u{3164}",
            "\u{ad}",
            "\u{e0041}",
        ] {
            assert!(check_name(blank, 100).is_err_and(|why| why.contains("seen")), "{blank:?}");
        }
        for acting in
            ["a\nb", "a\tb", "\u{1b}[2J", "a\u{9b}", "a\u{7f}", "a\u{202e}b", "a\u{2066}b", "\u{2028}a", "\u{0}", "a\r"]
        {
            assert!(check_name(acting, 100).is_err_and(|why| why.contains("U+")), "{acting:?}");
        }
        assert!(check_name("", 100).is_err() && check_name(&"a".repeat(101), 100).is_err());
        assert_eq!(check_name(&"ü".repeat(100), 100), Ok(()));
    }

    #[test]
    fn prose_has_lines_and_tabs_and_nothing_else_that_acts() {
        for fine in ["", "two\nlines\tand a tab\r\n", "ü 翼"] {
            assert_eq!(check_prose(fine, 100), Ok(()), "{fine:?}");
        }
        for bad in ["\u{1b}]0;title\u{7}", "a\rb", "\u{85}", "\u{202d}"] {
            assert!(check_prose(bad, 100).is_err(), "{bad:?}");
        }
        assert!(check_prose(&"a".repeat(101), 100).is_err());
    }

    #[test]
    fn what_acts_is_spelt() {
        assert_eq!(shown("a\n\tb\u{1b}[31mc\u{9b}2J\u{202e}d\r"), "a\n\tb\\u{1b}[31mc\\u{9b}2J\\u{202e}d\\u{d}");
        assert_eq!(shown_in_line("a\nb\u{7}"), "a\\u{a}b\\u{7}");
        assert!(matches!(shown("plain ü"), Cow::Borrowed("plain ü")));
        let json = serde_json::to_string_pretty(&["a\u{1b}\u{9b}\u{202e}\u{7f}\n"]).expect("serialises");
        let safe = shown_json(&json);
        assert!(!safe.chars().any(|c| acts(c) && c != '\n'), "{safe}");
        assert_eq!(serde_json::from_str::<Vec<String>>(&safe).expect("JSON"), ["a\u{1b}\u{9b}\u{202e}\u{7f}\n"]);
    }

    #[test]
    fn no_cell_of_a_text_is_a_formula() {
        let cases = [
            ("=1+1", "'=1+1"),
            ("+1", "'+1"),
            ("-2", "'-2"),
            ("@SUM(A1)", "'@SUM(A1)"),
            ("\t=1", "'\t=1"),
            ("＝1", "'＝1"),
            ("a=1", "a=1"),
            ("", ""),
            ("5", "5"),
            ("=\u{1b}[2J", "'=\\u{1b}[2J"),
        ];
        for (text, expected) in cases {
            assert_eq!(cell(text), expected);
        }
    }
}
