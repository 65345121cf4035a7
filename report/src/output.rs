//! A report on its way to the disk.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// A document with its figures, computed and not yet written.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Name of the file.
    pub name: &'static str,
    /// The document.
    pub text: String,
    /// File names and texts of the figures.
    pub figures: Vec<(&'static str, String)>,
}

impl Report {
    /// Writes the document into a folder and its figures into `figures` there; returns the paths.
    ///
    /// # Errors
    /// When a folder or a file cannot be written.
    pub fn write(&self, folder: &Path) -> io::Result<Vec<PathBuf>> {
        let figures = folder.join("figures");
        fs::create_dir_all(&figures)?;
        let mut paths = vec![folder.join(self.name)];
        write_whole(&paths[0], &self.text)?;
        for (name, svg) in &self.figures {
            let path = figures.join(name);
            write_whole(&path, svg)?;
            paths.push(path);
        }
        Ok(paths)
    }
}

/// Writes a file beside its place and moves it there when it is complete: a failure leaves the old one.
fn write_whole(path: &Path, text: &str) -> io::Result<()> {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(format!(".{}-new", std::process::id()));
    let beside = path.with_file_name(name);
    let written = fs::write(&beside, text).and_then(|()| fs::rename(&beside, path));
    if written.is_err() {
        // It may not even have been made.
        let _ = fs::remove_file(&beside);
    }
    written
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_is_a_document_and_its_figures() {
        let folder = tempfile::tempdir().unwrap();
        let report = Report { name: "x.md", text: "text".into(), figures: vec![("f.svg", "<svg/>".into())] };
        let paths = report.write(folder.path()).unwrap();
        assert_eq!(paths, [folder.path().join("x.md"), folder.path().join("figures").join("f.svg")]);
        assert_eq!(fs::read_to_string(&paths[1]).unwrap(), "<svg/>");
    }
}
