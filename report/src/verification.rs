//! The document on verification and validation.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::canonical::{self, oscillation, sudden_start, wagner};
use crate::check::Group;
use crate::markdown::Document;
use crate::plot::Figure;

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
        fs::write(&paths[0], &self.text)?;
        for (name, svg) in &self.figures {
            let path = figures.join(name);
            fs::write(&path, svg)?;
            paths.push(path);
        }
        Ok(paths)
    }
}

/// Computes everything; `tell` hears what is being done.
///
/// # Errors
/// When a figure cannot be drawn or a published stroke cannot be flown.
pub fn compute(tell: &mut dyn FnMut(&str)) -> io::Result<Report> {
    let mut document = Document::new("Verification and validation");
    let mut figures = Vec::new();
    tell("canonical checks");
    for group in canonical::all() {
        write_group(&mut document, &group);
    }
    let drawn: [(&'static str, fn() -> Figure); 3] = [
        ("wagner.svg", wagner::figure),
        ("theodorsen.svg", oscillation::figure),
        ("sudden-start.svg", sudden_start::figure),
    ];
    for (name, figure) in drawn {
        figures.push((name, figure().svg()?));
    }
    Ok(Report { name: "verification.md", text: document.text().to_owned(), figures })
}

fn write_group(document: &mut Document, group: &Group) {
    document.subheading(group.title);
    document.paragraph(&group.about);
    document.table(&group.table());
}
