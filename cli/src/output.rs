//! The two streams: answers on standard output, everything else on standard error. All text for people passes here,
//! and what would act on their terminal is spelt: names and reasons come from other users and from workers.

use std::fmt;
use std::io::{self, IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};

use comfy_table::{CellAlignment, LineStyle, Table, TableStyle};
use manduca_protocol::text::{shown, shown_in_line, shown_json};
use serde::Serialize;

/// A line under the header and nothing else: easy on eyes and on `awk`.
const PLAIN: TableStyle = TableStyle::new().header_separator(LineStyle::none().fill('─').junction('─'));

/// Where answers go.
pub struct Output {
    writer: Box<dyn Write>,
    terminal: bool,
    colour: bool,
}

impl Output {
    /// Standard output; coloured only on a terminal which does not object.
    pub fn stdout() -> Self {
        let terminal = io::stdout().is_terminal();
        let colour = terminal && std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty());
        Self { writer: Box::new(io::stdout().lock()), terminal, colour }
    }

    /// Any writer, never coloured.
    #[cfg(test)]
    pub fn to(writer: impl Write + 'static) -> Self {
        Self { writer: Box::new(writer), terminal: false, colour: false }
    }

    /// One line, or several.
    pub fn line(&mut self, text: impl fmt::Display) -> io::Result<()> {
        writeln!(self.writer, "{}", shown(&text.to_string()))
    }

    /// A heading.
    pub fn heading(&mut self, text: impl fmt::Display) -> io::Result<()> {
        if self.colour { writeln!(self.writer, "\x1b[1m{}\x1b[0m", shown(&text.to_string())) } else { self.line(text) }
    }

    /// One JSON object.
    pub fn json(&mut self, value: &impl Serialize) -> io::Result<()> {
        writeln!(self.writer, "{}", shown_json(&serde_json::to_string_pretty(value)?))
    }

    /// A table: words to the left, numbers to the right.
    pub fn table(&mut self, header: &[String], rows: &[Vec<String>]) -> io::Result<()> {
        let mut table = Table::new();
        table.load_style(PLAIN);
        table.set_header(header);
        // A cell has one line, and its width is that of what is shown.
        table.add_rows(rows.iter().map(|row| row.iter().map(|cell| shown_in_line(cell))));
        for (i, column) in table.column_iter_mut().enumerate() {
            if rows.iter().all(|row| row.get(i).is_none_or(|cell| is_number(cell))) {
                column.set_cell_alignment(CellAlignment::Right);
            }
        }
        self.line(table.trim_fmt())
    }

    /// For bulk: the bytes as they are, but on a terminal, where they are text and shown as such.
    pub fn writer(&mut self) -> &mut dyn Write {
        if self.terminal { self } else { &mut *self.writer }
    }
}

/// Bytes for a terminal. A character cut in two by the end of a part is shown as one that is unknown.
impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let text = String::from_utf8_lossy(bytes).replace("\r\n", "\n");
        self.writer.write_all(shown(&text).as_bytes())?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.flush()
    }
}

/// A number of things: `1 job`, `2 jobs`.
pub fn counted(count: u64, thing: &str) -> String {
    format!("{count} {thing}{}", if count == 1 { "" } else { "s" })
}

/// Whether a cell is a number, perhaps with its error or unit, or stands for one which is missing.
fn is_number(cell: &str) -> bool {
    cell == "-" || cell.trim_start_matches('-').starts_with(|c: char| c.is_ascii_digit())
}

/// Whether only errors are told.
static QUIET: AtomicBool = AtomicBool::new(false);

/// From now on nothing but errors is said on standard error.
pub fn hush() {
    QUIET.store(true, Ordering::Relaxed);
}

/// Whether nothing but errors is to be said.
pub fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Whether what is said is JSON, as the log lines are.
static JSON: AtomicBool = AtomicBool::new(false);

/// From now on each thing said on standard error is a JSON object.
pub fn speak_json() {
    JSON.store(true, Ordering::Relaxed);
}

/// Whether each thing said on standard error is a JSON object.
pub fn speaks_json() -> bool {
    JSON.load(Ordering::Relaxed)
}

/// Says something which is not the answer.
pub fn note(text: impl fmt::Display) {
    if !is_quiet() {
        say("INFO", &text.to_string(), None);
    }
}

/// Says what went wrong.
pub fn complain(text: impl fmt::Display) {
    say("ERROR", &text.to_string(), None);
}

/// Says what went wrong, and what to do about it.
pub fn complain_with(text: impl fmt::Display, advice: Option<&str>) {
    say("ERROR", &text.to_string(), advice);
}

fn say(level: &str, text: &str, advice: Option<&str>) {
    let line = if speaks_json() {
        let mut line = serde_json::json!({
            "timestamp": jiff::Timestamp::now().to_string(), "level": level, "message": shown(text),
        });
        if let Some(advice) = advice {
            line["advice"] = advice.into();
        }
        line.to_string()
    } else {
        let advice = advice.map(|advice| format!("\n  -> {advice}")).unwrap_or_default();
        format!("{}{advice}", shown(text))
    };
    // With standard error gone there is no one left to tell.
    let _ = writeln!(io::stderr().lock(), "{line}");
}

#[cfg(test)]
mod tests {
    use super::capture::output;

    #[test]
    fn nothing_that_is_shown_acts_on_a_terminal() {
        const BAD: &str = "a\u{1b}]0;owned\u{7}\u{9b}2J\u{202e}b\r";
        let (mut out, captured) = output();
        out.line(BAD).unwrap();
        out.heading(BAD).unwrap();
        out.json(&[BAD]).unwrap();
        out.table(&["name".into()], &[vec![BAD.into()], vec!["two\nlines".into()]]).unwrap();
        let said = captured.text();
        assert!(!said.contains(|c: char| manduca_protocol::text::acts(c) && c != '\n'), "{said:?}");
        assert!(said.contains("a\\u{1b}]0;owned\\u{7}\\u{9b}2J\\u{202e}b\\u{d}") && said.contains("two\\u{a}lines"));
        let (mut out, captured) = output();
        out.terminal = true;
        out.writer().write_all(format!("{BAD},1\r\nx").as_bytes()).unwrap();
        assert_eq!(captured.text(), "a\\u{1b}]0;owned\\u{7}\\u{9b}2J\\u{202e}b\\u{d},1\nx");
        let (mut out, captured) = output();
        out.writer().write_all(BAD.as_bytes()).unwrap();
        assert_eq!(captured.text(), BAD, "a file has the bytes as they are");
    }
}

#[cfg(test)]
pub mod capture {
    //! Output as a test sees it.

    use super::*;
    use std::sync::{Arc, Mutex};

    /// What was written, shared.
    #[derive(Clone, Default)]
    pub struct Captured(Arc<Mutex<Vec<u8>>>);

    impl Captured {
        /// As text.
        pub fn text(&self) -> String {
            String::from_utf8(self.0.lock().unwrap().clone()).unwrap()
        }
    }

    impl Write for Captured {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().unwrap().write(bytes)
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    /// An output and what it wrote.
    pub fn output() -> (Output, Captured) {
        let captured = Captured::default();
        (Output::to(captured.clone()), captured)
    }
}
