//! The dataset in each of its formats. Unless asked for, rows hold numbers only, never where or
//! when they were computed: the same study flown elsewhere gives the same bytes of text.

mod table;

use manduca_numerics::parameters::{OUTPUTS, TABLE};
use manduca_protocol::ids::StudyId;
use manduca_protocol::study::StudySpec;
use manduca_protocol::task::{Estimate, Provenance, SimulateOutcome};
use manduca_protocol::text::cell;
use manduca_protocol::view::DatasetRow;
use manduca_protocol::who::ComputedBy;

use table::TableWriter;

use crate::http::parts::media_ranges;

/// How rows are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Format {
    /// One array.
    Json,
    /// One object per line.
    NdJson,
    /// RFC 4180, one header line.
    Csv,
    /// A Parquet file.
    Parquet,
}

impl Format {
    /// What is offered, for refusals.
    pub(crate) const OFFERED: &'static str =
        "application/json, text/csv, application/x-ndjson and application/vnd.apache.parquet";

    /// By its short name in a query string.
    pub(crate) fn named(name: &str) -> Option<Self> {
        match name {
            "json" => Some(Self::Json),
            "ndjson" => Some(Self::NdJson),
            "csv" => Some(Self::Csv),
            "parquet" => Some(Self::Parquet),
            _ => None,
        }
    }

    /// The first media type of an Accept header which is offered; JSON where there is none.
    pub(crate) fn accepted(accept: Option<&str>) -> Option<Self> {
        let Some(accept) = accept else { return Some(Self::Json) };
        media_ranges(accept).find_map(|range| match range {
            "application/json" | "application/*" | "*/*" => Some(Self::Json),
            "application/x-ndjson" => Some(Self::NdJson),
            "text/csv" | "text/*" => Some(Self::Csv),
            "application/vnd.apache.parquet" => Some(Self::Parquet),
            _ => None,
        })
    }

    /// Its media type.
    pub(crate) fn media_type(self) -> &'static str {
        match self {
            Self::Json => "application/json",
            Self::NdJson => "application/x-ndjson",
            Self::Csv => "text/csv; charset=utf-8; header=present",
            Self::Parquet => "application/vnd.apache.parquet",
        }
    }

    /// What comes before the first row of a text.
    fn head(self, provenance: bool) -> String {
        match self {
            Self::Json => "[".into(),
            Self::NdJson | Self::Parquet => String::new(),
            Self::Csv => csv_header(provenance),
        }
    }

    /// What comes after the last row of a text.
    fn tail(self) -> &'static str {
        match self {
            Self::Json => "\n]\n",
            Self::NdJson | Self::Csv | Self::Parquet => "",
        }
    }

    /// Appends a row to a text.
    fn append(self, row: &DatasetRow, first: bool, text: &mut String) -> Result<(), serde_json::Error> {
        match self {
            Self::Json => {
                text.push_str(if first { "\n" } else { ",\n" });
                text.push_str(&serde_json::to_string(row)?);
            }
            Self::NdJson => {
                text.push_str(&serde_json::to_string(row)?);
                text.push('\n');
            }
            Self::Csv => csv_row(row, text)?,
            Self::Parquet => {}
        }
        Ok(())
    }
}

/// Why rows cannot be written.
#[derive(Debug, thiserror::Error)]
pub(crate) enum WriteError {
    #[error("a row cannot be written as text")]
    Json(#[from] serde_json::Error),
    #[error("a table cannot be written")]
    Parquet(#[from] parquet::errors::ParquetError),
    #[error("rows do not fit their columns")]
    Arrow(#[from] arrow_schema::ArrowError),
}

/// A dataset being written: a head, rows in any number of parts, an end.
pub(crate) enum Writer {
    /// As text.
    Text {
        format: Format,
        /// Whether rows tell their origin.
        provenance: bool,
        /// Whether the next row is the first.
        first: bool,
    },
    /// As a table.
    Table(Box<TableWriter>),
}

impl Writer {
    /// Of a study begun with a version of the solver.
    ///
    /// # Errors
    /// When the head of a table cannot be written.
    pub(crate) fn new(
        format: Format,
        provenance: bool,
        study: StudyId,
        spec: &StudySpec,
        solver_version: &str,
    ) -> Result<Self, WriteError> {
        Ok(match format {
            Format::Parquet => Self::Table(Box::new(TableWriter::new(provenance, study, spec, solver_version)?)),
            format => Self::Text { format, provenance, first: true },
        })
    }

    /// What comes before the first row.
    pub(crate) fn head(&self) -> Vec<u8> {
        match self {
            Self::Text { format, provenance, .. } => format.head(*provenance).into_bytes(),
            Self::Table(_) => Vec::new(),
        }
    }

    /// Takes rows and gives what is to be sent so far: of a table nothing, often.
    ///
    /// # Errors
    /// When they cannot be written.
    pub(crate) fn rows(&mut self, rows: &[DatasetRow]) -> Result<Vec<u8>, WriteError> {
        match self {
            Self::Text { format, first, .. } => {
                let mut text = String::new();
                for row in rows {
                    format.append(row, *first, &mut text)?;
                    *first = false;
                }
                Ok(text.into_bytes())
            }
            Self::Table(table) => table.rows(rows),
        }
    }

    /// What comes after the last row.
    ///
    /// # Errors
    /// When the end of a table cannot be written.
    pub(crate) fn end(self) -> Result<Vec<u8>, WriteError> {
        match self {
            Self::Text { format, .. } => Ok(format.tail().into()),
            Self::Table(table) => table.end(),
        }
    }
}

/// Columns which tell the origin of a row.
const ORIGIN: [&str; 6] = ["computed_job", "worker", "worker_name", "token", "level", "wall_s"];

fn csv_header(provenance: bool) -> String {
    let mut columns = vec!["sample".to_owned(), "outcome".to_owned()];
    columns.extend(TABLE.iter().map(|p| p.name.to_owned()));
    for name in OUTPUTS.iter().map(|o| o.1).chain(OUTPUTS.iter().map(|o| o.0)) {
        columns.extend([name.to_owned(), format!("{name}_se")]);
    }
    columns.extend(["reason".to_owned(), "solver_version".to_owned()]);
    columns.extend(ORIGIN.iter().filter(|_| provenance).map(|&name| name.to_owned()));
    columns.join(",") + "\r\n"
}

fn csv_row(row: &DatasetRow, text: &mut String) -> Result<(), serde_json::Error> {
    csv_numbers(row, text)?;
    if let Some(provenance) = &row.provenance {
        // Before the end of the line.
        text.truncate(text.len() - LINE_END.len());
        csv_origin(row.computed_by.as_ref(), provenance, text)?;
        text.push_str(LINE_END);
    }
    Ok(())
}

const LINE_END: &str = "\r\n";

/// A row without its origin, with the end of its line.
fn csv_numbers(row: &DatasetRow, text: &mut String) -> Result<(), serde_json::Error> {
    text.push_str(&row.sample.to_string());
    let (outcome, reason) = match &row.result.outcome {
        SimulateOutcome::Ok { .. } => ("ok", ""),
        SimulateOutcome::Infeasible { reason } => ("infeasible", reason.as_str()),
    };
    text.push(',');
    text.push_str(outcome);
    for value in row.parameters.0 {
        number(value, text)?;
    }
    match estimates(&row.result.outcome) {
        Some(estimates) => {
            for Estimate { mean, se } in estimates {
                number(mean, text)?;
                number(se, text)?;
            }
        }
        None => text.push_str(&",".repeat(4 * OUTPUTS.len())),
    }
    for field in [reason, &row.result.solver_version] {
        text.push(',');
        push_quoted(field, text);
    }
    text.push_str(LINE_END);
    Ok(())
}

fn csv_origin(by: Option<&ComputedBy>, provenance: &Provenance, text: &mut String) -> Result<(), serde_json::Error> {
    let fields = [
        by.map(|by| by.job.to_string()),
        by.map(|by| by.worker.to_string()),
        by.map(|by| by.worker_name.clone()),
        by.and_then(|by| by.token.clone()),
        Some(provenance.level.clone()),
    ];
    for field in fields {
        text.push(',');
        push_quoted(&field.unwrap_or_default(), text);
    }
    number(provenance.wall_s, text)
}

/// The means of a row in the order of their columns: in SI units, then scaled.
fn estimates(outcome: &SimulateOutcome) -> Option<[Estimate; 8]> {
    let SimulateOutcome::Ok { means: m, scaled: s, .. } = outcome else { return None };
    Some([m.lift_n, m.drag_n, m.pitch_moment_nm, m.power_w, s.lift, s.drag, s.pitch_moment, s.power])
}

/// A number as JSON writes it: the shortest text which reads back as the same number.
fn number(value: f64, text: &mut String) -> Result<(), serde_json::Error> {
    text.push(',');
    text.push_str(&serde_json::to_string(&value)?);
    Ok(())
}

/// A text as a cell: quoted where it must be, and never a formula.
fn push_quoted(field: &str, text: &mut String) {
    let field = cell(field);
    if field.contains(['"', ',', '\n', '\r']) {
        text.push('"');
        text.push_str(&field.replace('"', "\"\""));
        text.push('"');
    } else {
        text.push_str(&field);
    }
}

#[cfg(test)]
mod tests {
    use manduca_protocol::point::ParameterValues;
    use manduca_protocol::task::SimulateResult;

    use super::*;

    #[test]
    fn every_row_has_the_columns_of_the_header() {
        let outcome = SimulateOutcome::Infeasible { reason: "no \"lift\", none".into() };
        let result = SimulateResult { outcome, solver_version: "1".into() };
        let parameters = ParameterValues([0.1; 10]);
        let mut row = DatasetRow { sample: 7, parameters, result, computed_by: None, provenance: None };
        let mut text = String::new();
        Format::Csv.append(&row, true, &mut text).expect("a row");
        row.provenance = Some(Provenance { wall_s: 0.5, level: "avx2".into() });
        let mut longer = String::new();
        Format::Csv.append(&row, true, &mut longer).expect("a row");
        assert_eq!(Format::Csv.head(true).matches(',').count(), longer.matches(',').count() - 1, "{longer}");
        let header = Format::Csv.head(false);
        assert_eq!(header.matches(',').count(), text.matches(',').count() - 1, "{text}");
        assert!(text.starts_with("7,infeasible,0.1,") && text.ends_with(",\"no \"\"lift\"\", none\",1\r\n"), "{text}");
    }

    #[test]
    fn no_reason_is_a_formula_or_acts_on_a_terminal() {
        let row = |reason: &str| {
            let outcome = SimulateOutcome::Infeasible { reason: reason.into() };
            let result = SimulateResult { outcome, solver_version: "9".into() };
            let parameters = ParameterValues([-0.5; 10]);
            let row = DatasetRow { sample: 7, parameters, result, computed_by: None, provenance: None };
            let mut text = String::new();
            Format::Csv.append(&row, true, &mut text).expect("a row");
            text
        };
        let end = |reason: &str| row(reason).rsplit_once(",,").expect("empty cells").1.to_owned();
        assert_eq!(end("=HYPERLINK(1)"), "'=HYPERLINK(1),9\r\n");
        assert_eq!(end("-1+1"), "'-1+1,9\r\n");
        assert_eq!(end("@a,b"), "\"'@a,b\",9\r\n");
        assert_eq!(end("a\u{1b}[2J"), "a\\u{1b}[2J,9\r\n");
        assert!(row("x").starts_with("7,infeasible,-0.5,-0.5,"), "numbers are as they are");
    }

    #[test]
    fn the_accept_header_chooses() {
        assert_eq!(Format::accepted(None), Some(Format::Json));
        assert_eq!(Format::accepted(Some("image/png, text/csv;q=0.5")), Some(Format::Csv));
        assert_eq!(Format::accepted(Some("image/png")), None);
    }
}
