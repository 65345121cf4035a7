//! One answer in three forms: a table for people, CSV and JSON for scripts.

use std::io;

use serde_json::{Map, Value};

use crate::output::Output;
use crate::render::fixed;

/// A column: its name for scripts, its title for people, its digits there.
pub struct Column {
    name: String,
    title: String,
    digits: usize,
}

impl Column {
    /// A column.
    pub fn new(name: impl Into<String>, title: impl Into<String>, digits: usize) -> Self {
        Self { name: name.into(), title: title.into(), digits }
    }
}

/// One entry.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// A word without comma or quote.
    Word(&'static str),
    /// A number, or none where there is no answer.
    Number(Option<f64>),
}

impl From<f64> for Cell {
    fn from(value: f64) -> Self {
        Self::Number(value.is_finite().then_some(value))
    }
}

/// What was found, and what people should know of it.
pub struct Answer {
    /// What it is of, such as study and seed.
    pub facts: Map<String, Value>,
    /// A sentence above the table.
    pub lead: String,
    /// The columns.
    pub columns: Vec<Column>,
    /// The rows, an entry per column.
    pub rows: Vec<Vec<Cell>>,
}

impl Answer {
    /// Writes it as asked for.
    pub fn write(mut self, out: &mut Output, csv: bool, json: bool) -> io::Result<()> {
        if csv {
            return self.csv(out);
        }
        if json {
            let rows: Vec<Value> = self.rows.iter().map(|row| self.object(row)).collect();
            self.facts.insert("rows".into(), rows.into());
            return out.json(&self.facts);
        }
        out.line(&self.lead)?;
        let header: Vec<String> = self.columns.iter().map(|c| c.title.clone()).collect();
        let text = |(column, cell): (&Column, &Cell)| match cell {
            Cell::Word(word) => (*word).to_owned(),
            Cell::Number(Some(value)) => fixed(*value, column.digits),
            Cell::Number(None) => "-".into(),
        };
        let rows: Vec<Vec<String>> =
            self.rows.iter().map(|row| self.columns.iter().zip(row).map(text).collect()).collect();
        out.table(&header, &rows)
    }

    fn object(&self, row: &[Cell]) -> Value {
        let value = |cell: &Cell| match cell {
            Cell::Word(word) => Value::from(*word),
            Cell::Number(value) => Value::from(*value),
        };
        Value::Object(self.columns.iter().zip(row).map(|(c, cell)| (c.name.clone(), value(cell))).collect())
    }

    fn csv(&self, out: &mut Output) -> io::Result<()> {
        let names: Vec<&str> = self.columns.iter().map(|c| c.name.as_str()).collect();
        out.line(names.join(","))?;
        for row in &self.rows {
            let text = |cell: &Cell| match cell {
                Cell::Word(word) => (*word).to_owned(),
                Cell::Number(value) => value.map_or_else(String::new, |v| v.to_string()),
            };
            out.line(row.iter().map(text).collect::<Vec<_>>().join(","))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::capture;

    fn written(csv: bool, json: bool) -> String {
        let answer = Answer {
            facts: [("study".to_owned(), Value::from("x"))].into_iter().collect(),
            lead: "of x".into(),
            columns: vec![Column::new("side", "side", 0), Column::new("power", "P+", 3)],
            rows: vec![vec![Cell::Word("at-most"), 0.123_456.into()], vec![Cell::Word("at-least"), f64::NAN.into()]],
        };
        let (mut out, captured) = capture::output();
        answer.write(&mut out, csv, json).unwrap();
        captured.text()
    }

    #[test]
    fn an_answer_has_three_forms() {
        assert_eq!(written(true, false), "side,power\nat-most,0.123456\nat-least,\n");
        let value: Value = serde_json::from_str(&written(false, true)).unwrap();
        assert_eq!((&value["study"], &value["rows"][0]["power"]), (&"x".into(), &0.123_456.into()));
        assert_eq!(value["rows"][1], serde_json::json!({ "side": "at-least", "power": null }));
        let table = written(false, false);
        assert!(table.starts_with("of x\n") && table.contains("0.123") && !table.contains("0.1234"), "{table}");
    }
}
