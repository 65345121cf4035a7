//! Documents in Markdown: paragraphs, tables, figures, and numbers as people read them.

use std::fmt::{self, Display, Write as _};

/// A document under way.
#[derive(Debug, Clone, Default)]
pub struct Document {
    text: String,
}

impl Document {
    /// An empty document with a title.
    pub fn new(title: &str) -> Self {
        Self { text: format!("# {title}\n") }
    }

    /// A heading of the second level.
    pub fn heading(&mut self, text: &str) {
        self.push(format_args!("## {text}"));
    }

    /// A heading of the third level.
    pub fn subheading(&mut self, text: &str) {
        self.push(format_args!("### {text}"));
    }

    /// A paragraph, broken into lines of at most 100 characters.
    pub fn paragraph(&mut self, text: &str) {
        self.push(wrapped(text, 100));
    }

    /// A table, with an empty line around it.
    pub fn table(&mut self, table: &Table) {
        self.push(table);
    }

    /// A picture with words for those who cannot see it.
    pub fn figure(&mut self, path: &str, words: &str) {
        self.push(format_args!("![{words}]({path})"));
    }

    /// The whole text.
    pub fn text(&self) -> &str {
        &self.text
    }

    fn push(&mut self, block: impl Display) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.text, "\n{}", block.to_string().trim_end());
    }
}

/// Breaks a paragraph into lines between words.
fn wrapped(text: &str, width: usize) -> String {
    let mut lines = String::new();
    let mut length = 0;
    for word in text.split_whitespace() {
        let long = word.chars().count();
        if length > 0 && length + 1 + long > width {
            lines.push('\n');
            length = 0;
        } else if length > 0 {
            lines.push(' ');
            length += 1;
        }
        lines.push_str(word);
        length += long;
    }
    lines
}

/// A table: the first column and columns with words to the left, columns of numbers to the right.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    header: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    /// A table without rows.
    pub fn new<S: Into<String>>(header: impl IntoIterator<Item = S>) -> Self {
        Self { header: header.into_iter().map(Into::into).collect(), rows: Vec::new() }
    }

    /// Adds a row; missing cells are empty.
    pub fn row<S: Into<String>>(&mut self, cells: impl IntoIterator<Item = S>) {
        let mut cells: Vec<String> = cells.into_iter().map(Into::into).collect();
        cells.resize(self.header.len(), String::new());
        self.rows.push(cells);
    }
}

impl Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let line = |cells: &[String]| {
            let cells: Vec<_> = cells.iter().map(|c| c.replace('|', "\\|")).collect();
            format!("| {} |", cells.join(" | "))
        };
        writeln!(f, "{}", line(&self.header))?;
        let rules = (0..self.header.len()).map(|i| {
            let numeric = i > 0 && !self.rows.is_empty() && self.rows.iter().all(|row| is_number(&row[i]));
            if numeric { "---:" } else { "---" }
        });
        writeln!(f, "|{}|", rules.collect::<Vec<_>>().join("|"))?;
        self.rows.iter().try_for_each(|row| writeln!(f, "{}", line(row)))
    }
}

/// Whether a cell is a number, perhaps with its error or unit, or stands for one which is missing.
fn is_number(cell: &str) -> bool {
    cell.is_empty() || cell == "-" || cell.trim_start_matches(['-', '+']).starts_with(|c: char| c.is_ascii_digit())
}

/// A number with so many significant digits; very small and very large ones by powers of ten.
///
/// ```
/// use manduca_report::markdown::significant;
/// assert_eq!(significant(0.012345, 3), "0.0123");
/// assert_eq!(significant(1.2e-9, 2), "1.2e-9");
/// ```
pub fn significant(x: f64, digits: usize) -> String {
    if x == 0.0 || !x.is_finite() {
        return x.to_string();
    }
    let scientific = format!("{:.*e}", digits.saturating_sub(1), x);
    let exponent = scientific.split_once('e').and_then(|(_, e)| e.parse::<i32>().ok()).unwrap_or(0);
    if !(-3..6).contains(&exponent) {
        return scientific;
    }
    fixed(x, usize::try_from(digits as i32 - 1 - exponent).unwrap_or(0))
}

/// A number with so many digits after the point; zero has no sign.
pub fn fixed(x: f64, decimals: usize) -> String {
    let text = format!("{x:.decimals$}");
    match text.strip_prefix('-') {
        Some(size) if size.chars().all(|c| matches!(c, '0' | '.')) => size.to_owned(),
        _ => text,
    }
}

/// A share as a signed percentage.
///
/// ```
/// assert_eq!(manduca_report::markdown::percent(-0.0312, 1), "-3.1 %");
/// ```
pub fn percent(share: f64, decimals: usize) -> String {
    format!("{} %", signed(100.0 * share, decimals))
}

/// A number with its sign, also where positive.
pub fn signed(x: f64, decimals: usize) -> String {
    let text = fixed(x, decimals);
    if text.starts_with('-') || text.chars().all(|c| matches!(c, '0' | '.')) { text } else { format!("+{text}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_as_people_read_them() {
        let texts = [1234.5, 0.97812, -3.0, 2.5e-7, 1e9, 0.0].map(|x| significant(x, 3));
        assert_eq!(texts, ["1234", "0.978", "-3.00", "2.50e-7", "1.00e9", "0"]);
        assert_eq!((fixed(-0.0004, 3), fixed(-0.0006, 3)), ("0.000".into(), "-0.001".into()));
        assert_eq!((signed(0.04, 1), signed(0.05, 2), signed(-1.0, 0)), ("0.0".into(), "+0.05".into(), "-1".into()));
    }

    #[test]
    fn columns_of_numbers_are_right_aligned() {
        let mut table = Table::new(["case", "L/W", "D|W"]);
        table.row(["one", "1.00 ± 0.01", "-"]);
        table.row(["two", "-0.2"]);
        let text = "| case | L/W | D\\|W |\n|---|---:|---:|\n| one | 1.00 ± 0.01 | - |\n| two | -0.2 |  |\n";
        assert_eq!(table.to_string(), text);
    }

    #[test]
    fn paragraphs_are_broken_between_words() {
        let text = wrapped("one two three\n four", 8);
        assert_eq!(text, "one two\nthree\nfour");
        let mut document = Document::new("T");
        document.heading("H");
        document.paragraph("p");
        assert_eq!(document.text(), "# T\n\n## H\n\np\n");
    }
}
