//! The dataset as a Parquet file, written while it is read: a row group at a time is in memory.
//! Columns are those of the CSV with their types; each carries its unit, and the file what its
//! numbers come from.

use std::collections::HashMap;
use std::sync::Arc;

use arrow_array::{ArrayRef, Float64Array, Int64Array, RecordBatch, StringArray};
use arrow_schema::{DataType, Field, Schema, SchemaRef};
use manduca_numerics::parameters::{OUTPUTS, TABLE};
use manduca_protocol::ids::StudyId;
use manduca_protocol::study::StudySpec;
use manduca_protocol::task::{Estimate, SimulateOutcome};
use manduca_protocol::view::DatasetRow;
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;

use super::{Format, ORIGIN, WriteError, csv_numbers, estimates};

/// Rows of a row group: some 2 MB while it is written.
const GROUP: usize = 8192;

/// A Parquet file under way.
pub(crate) struct TableWriter {
    writer: ArrowWriter<Vec<u8>>,
    schema: SchemaRef,
    digest: blake3::Hasher,
    rows: u64,
}

impl TableWriter {
    /// Of a study begun with a version of the solver.
    ///
    /// # Errors
    /// When its head cannot be written.
    pub(crate) fn new(
        provenance: bool,
        study: StudyId,
        spec: &StudySpec,
        solver_version: &str,
    ) -> Result<Self, WriteError> {
        let facts = [
            ("study", study.to_string()),
            ("name", spec.name.clone()),
            ("seed", spec.seed.to_string()),
            ("solver_version", solver_version.to_owned()),
            ("model", serde_json::to_string(&spec.model)?),
        ];
        let facts = facts.map(|(key, value)| KeyValue::new(format!("manduca.{key}"), value));
        let properties = WriterProperties::builder()
            .set_created_by(format!("manduca {}", env!("CARGO_PKG_VERSION")))
            .set_compression(Compression::ZSTD(ZstdLevel::default()))
            .set_max_row_group_row_count(Some(GROUP))
            .set_key_value_metadata(Some(facts.to_vec()));
        let schema = Arc::new(schema(provenance));
        let writer = ArrowWriter::try_new(Vec::new(), schema.clone(), Some(properties.build()))?;
        let mut digest = blake3::Hasher::new();
        digest.update(Format::Csv.head(false).as_bytes());
        Ok(Self { writer, schema, digest, rows: 0 })
    }

    /// Takes rows, and gives the bytes of the row groups which are full.
    ///
    /// # Errors
    /// When they cannot be written.
    pub(crate) fn rows(&mut self, rows: &[DatasetRow]) -> Result<Vec<u8>, WriteError> {
        let mut text = String::new();
        for row in rows {
            // The digest is of the numbers, whoever computed them.
            csv_numbers(row, &mut text)?;
        }
        self.digest.update(text.as_bytes());
        self.rows += rows.len() as u64;
        self.writer.write(&batch(&self.schema, rows)?)?;
        self.written()
    }

    /// What comes after the last row: the last row group and the footer.
    ///
    /// # Errors
    /// When they cannot be written.
    pub(crate) fn end(mut self) -> Result<Vec<u8>, WriteError> {
        let facts = [
            ("rows", self.rows.to_string()),
            // Of the bytes of the same dataset as CSV, without provenance.
            ("dataset_blake3", self.digest.finalize().to_hex().to_string()),
        ];
        for (key, value) in facts {
            self.writer.append_key_value_metadata(KeyValue::new(format!("manduca.{key}"), value));
        }
        self.writer.finish()?;
        self.written()
    }

    fn written(&mut self) -> Result<Vec<u8>, WriteError> {
        self.writer.sync().map_err(ParquetError::from)?;
        Ok(std::mem::take(self.writer.inner_mut()))
    }
}

/// Unit of a column by the end of its name; 1 for scaled values.
fn unit(name: &str) -> &'static str {
    let name = name.strip_suffix("_se").unwrap_or(name);
    let units = [("_hz", "Hz"), ("_deg", "degree"), ("_nm", "N m"), ("_n", "N"), ("_w", "W")];
    units.iter().find(|(ending, _)| name.ends_with(ending)).map_or("1", |(_, unit)| unit)
}

/// A column of numbers, with what it is and its unit.
fn number(name: &str, meaning: String, nullable: bool) -> Field {
    let told = [("unit".to_owned(), unit(name).to_owned()), ("meaning".to_owned(), meaning)];
    Field::new(name, DataType::Float64, nullable).with_metadata(HashMap::from(told))
}

fn schema(provenance: bool) -> Schema {
    let mut fields = vec![Field::new("sample", DataType::Int64, false), Field::new("outcome", DataType::Utf8, false)];
    fields.extend(TABLE.iter().map(|p| number(p.name, format!("{}, {}", p.symbol, p.meaning), false)));
    let si = OUTPUTS.iter().map(|(_, name, symbol, _)| (*name, format!("mean of which {symbol} is scaled")));
    let scaled = OUTPUTS.iter().map(|(name, _, symbol, by)| (*name, format!("{symbol}, over {by}")));
    for (name, meaning) in si.chain(scaled) {
        fields.push(number(name, meaning, true));
        fields.push(number(&format!("{name}_se"), "standard error of the mean".into(), true));
    }
    fields.extend([Field::new("reason", DataType::Utf8, true), Field::new("solver_version", DataType::Utf8, false)]);
    if provenance {
        let kind = |name| if name == "computed_job" { DataType::Int64 } else { DataType::Utf8 };
        let texts = ORIGIN.iter().filter(|&&name| name != "wall_s");
        fields.extend(texts.map(|&name| Field::new(name, kind(name), true)));
        let wall = HashMap::from([("unit".to_owned(), "s".to_owned())]);
        fields.push(Field::new("wall_s", DataType::Float64, true).with_metadata(wall));
    }
    Schema::new(fields)
}

fn batch(schema: &SchemaRef, rows: &[DatasetRow]) -> Result<RecordBatch, WriteError> {
    let floats = |values: Vec<Option<f64>>| -> ArrayRef { Arc::new(Float64Array::from(values)) };
    let samples: Vec<i64> = rows.iter().map(|row| i64::from(row.sample)).collect();
    let outcome = |row: &DatasetRow| match row.result.outcome {
        SimulateOutcome::Ok { .. } => "ok",
        SimulateOutcome::Infeasible { .. } => "infeasible",
    };
    let reason = |row: &DatasetRow| match &row.result.outcome {
        SimulateOutcome::Ok { .. } => None,
        SimulateOutcome::Infeasible { reason } => Some(reason.clone()),
    };
    let mut columns: Vec<ArrayRef> =
        vec![Arc::new(Int64Array::from(samples)), Arc::new(StringArray::from_iter_values(rows.iter().map(outcome)))];
    for i in 0..TABLE.len() {
        columns.push(floats(rows.iter().map(|row| Some(row.parameters.0[i])).collect()));
    }
    let found: Vec<Option<[Estimate; 8]>> = rows.iter().map(|row| estimates(&row.result.outcome)).collect();
    for i in 0..2 * OUTPUTS.len() {
        columns.push(floats(found.iter().map(|e| e.map(|e| e[i].mean)).collect()));
        columns.push(floats(found.iter().map(|e| e.map(|e| e[i].se)).collect()));
    }
    columns.push(Arc::new(StringArray::from_iter(rows.iter().map(reason))));
    columns.push(Arc::new(StringArray::from_iter_values(rows.iter().map(|row| &row.result.solver_version))));
    if schema.fields().len() > columns.len() {
        columns.extend(origin(rows));
    }
    Ok(RecordBatch::try_new(schema.clone(), columns)?)
}

/// The columns which tell the origin of rows, in the order of [`ORIGIN`].
fn origin(rows: &[DatasetRow]) -> [ArrayRef; ORIGIN.len()] {
    let by = || rows.iter().map(|row| row.computed_by.as_ref());
    let how = || rows.iter().map(|row| row.provenance.as_ref());
    [
        Arc::new(Int64Array::from_iter(by().map(|by| by.map(|by| by.job.0)))),
        Arc::new(StringArray::from_iter(by().map(|by| by.map(|by| by.worker.to_string())))),
        Arc::new(StringArray::from_iter(by().map(|by| by.map(|by| by.worker_name.clone())))),
        Arc::new(StringArray::from_iter(by().map(|by| by.and_then(|by| by.token.clone())))),
        Arc::new(StringArray::from_iter(how().map(|how| how.map(|how| how.level.clone())))),
        Arc::new(Float64Array::from_iter(how().map(|how| how.map(|how| how.wall_s)))),
    ]
}
