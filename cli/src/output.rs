//! The two streams: answers on standard output, everything else on standard error.

use std::fmt;
use std::io::{self, IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};

use comfy_table::{CellAlignment, LineStyle, Table, TableStyle};
use serde::Serialize;

/// A line under the header and nothing else: easy on eyes and on `awk`.
const PLAIN: TableStyle = TableStyle::new().header_separator(LineStyle::none().fill('─').junction('─'));

/// Where answers go.
pub struct Output {
    writer: Box<dyn Write>,
    colour: bool,
}

impl Output {
    /// Standard output; coloured only on a terminal which does not object.
    pub fn stdout() -> Self {
        let colour = io::stdout().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty());
        Self { writer: Box::new(io::stdout().lock()), colour }
    }

    /// Any writer, never coloured.
    #[cfg(test)]
    pub fn to(writer: impl Write + 'static) -> Self {
        Self { writer: Box::new(writer), colour: false }
    }

    /// One line.
    pub fn line(&mut self, text: impl fmt::Display) -> io::Result<()> {
        writeln!(self.writer, "{text}")
    }

    /// A heading.
    pub fn heading(&mut self, text: impl fmt::Display) -> io::Result<()> {
        if self.colour { self.line(format_args!("\x1b[1m{text}\x1b[0m")) } else { self.line(text) }
    }

    /// One JSON object.
    pub fn json(&mut self, value: &impl Serialize) -> io::Result<()> {
        serde_json::to_writer_pretty(&mut self.writer, value)?;
        writeln!(self.writer)
    }

    /// A table: words to the left, numbers to the right.
    pub fn table(&mut self, header: &[String], rows: &[Vec<String>]) -> io::Result<()> {
        let mut table = Table::new();
        table.load_style(PLAIN);
        table.set_header(header);
        table.add_rows(rows);
        for (i, column) in table.column_iter_mut().enumerate() {
            if rows.iter().all(|row| row.get(i).is_none_or(|cell| is_number(cell))) {
                column.set_cell_alignment(CellAlignment::Right);
            }
        }
        self.line(table.trim_fmt())
    }

    /// The writer itself, for bulk.
    pub fn writer(&mut self) -> &mut dyn Write {
        &mut *self.writer
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

/// Says something which is not the answer.
pub fn note(text: impl fmt::Display) {
    if !is_quiet() {
        complain(text);
    }
}

/// Says what went wrong.
pub fn complain(text: impl fmt::Display) {
    // With standard error gone there is no one left to tell.
    let _ = writeln!(io::stderr().lock(), "{text}");
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
