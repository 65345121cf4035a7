//! Whether what came is all there is. A connection which breaks off is an error by itself; a proxy on
//! the way may end a broken answer as if it were whole.

use anyhow::{Result, bail};

use crate::args::DatasetFormat;

/// The header by which a coordinator says how many rows a dataset has at least.
const ROWS: &str = "manduca-rows";

/// Looks at a dataset while it arrives.
#[derive(Debug)]
pub struct Whole {
    format: DatasetFormat,
    expected: Option<u64>,
    lines: u64,
    is_quoted: bool,
    last: Vec<u8>,
}

impl Whole {
    /// Of an answer in a format.
    pub fn of(format: DatasetFormat, response: &reqwest::Response) -> Self {
        let expected = response.headers().get(ROWS).and_then(|value| value.to_str().ok()?.parse().ok());
        Self::new(format, expected)
    }

    fn new(format: DatasetFormat, expected: Option<u64>) -> Self {
        Self { format, expected, lines: 0, is_quoted: false, last: Vec::new() }
    }

    /// The next bytes.
    pub fn take(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.is_quoted ^= byte == b'"' && self.format == DatasetFormat::Csv;
            self.lines += u64::from(byte == b'\n' && !self.is_quoted);
        }
        self.last.extend_from_slice(&bytes[bytes.len().saturating_sub(4)..]);
        self.last.drain(..self.last.len().saturating_sub(4));
    }

    /// The end has come.
    ///
    /// # Errors
    /// When rows are missing.
    pub fn check(&self) -> Result<()> {
        let rows = match self.format {
            DatasetFormat::Csv => self.lines.saturating_sub(1),
            DatasetFormat::Ndjson => self.lines,
            DatasetFormat::Json if self.last.trim_ascii_end().ends_with(b"]") => return Ok(()),
            DatasetFormat::Parquet if self.last == b"PAR1" => return Ok(()),
            DatasetFormat::Json | DatasetFormat::Parquet => {
                bail!("the dataset broke off: its end is missing; ask again")
            }
        };
        match self.expected {
            Some(expected) if rows < expected => {
                bail!("the dataset broke off: {rows} of {expected} rows came; ask again")
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_whole(format: DatasetFormat, expected: Option<u64>, parts: &[&str]) -> bool {
        let mut whole = Whole::new(format, expected);
        parts.iter().for_each(|part| whole.take(part.as_bytes()));
        whole.check().is_ok()
    }

    #[test]
    fn a_dataset_which_lacks_rows_is_not_whole() {
        use DatasetFormat as F;
        let csv = ["sample,reason\r\n0,\"no ", "\"\"lift\"\"\nat all\"\r\n", "1,x\r\n"];
        assert!(is_whole(F::Csv, Some(2), &csv) && !is_whole(F::Csv, Some(3), &csv) && is_whole(F::Csv, None, &csv));
        assert!(!is_whole(F::Csv, Some(2), &csv[..2]) && !is_whole(F::Csv, Some(1), &[]));
        // A row cut in its middle is none.
        assert!(!is_whole(F::Ndjson, Some(2), &["{}\n{\"sam"]) && is_whole(F::Ndjson, Some(1), &["{}\n{}\n"]));
        assert!(is_whole(F::Json, None, &["[\n{}", "\n]", "\n"]) && !is_whole(F::Json, None, &["[\n{}", ",\n{"]));
        assert!(is_whole(F::Parquet, None, &["PAR1 rows P", "AR1"]) && !is_whole(F::Parquet, None, &["PAR1 rows"]));
        assert!(!is_whole(F::Parquet, None, &[]));
    }
}
