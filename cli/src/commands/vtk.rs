//! Wing and wake as files for ParaView: two `.vtp` per step, and a `.pvd` which lists them by time.

use std::fmt::Write;
use std::fs;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

use manduca_protocol::history::WakeStep;

use crate::file;

/// Writes the steps of a flight into a folder and returns the path of the collection.
///
/// # Errors
/// When the folder or a file cannot be written.
pub fn write(folder: &Path, steps: &[WakeStep]) -> io::Result<PathBuf> {
    fs::create_dir_all(folder)?;
    let mut listed = String::new();
    for (i, step) in steps.iter().enumerate() {
        let wing_rows = step.wing_rows as usize;
        // The line from which the wake springs belongs to both.
        let parts = [("wing", 0..wing_rows), ("wake", wing_rows - 1..step.nodes.len())];
        for (part, (kind, rows)) in parts.into_iter().enumerate() {
            let name = format!("{kind}-{i:04}.vtp");
            file::write(&folder.join(&name), poly_data(step, rows).as_bytes())?;
            let time = step.time_s;
            // Nothing fails to be appended to a text.
            let _ = writeln!(listed, r#"    <DataSet timestep="{time}" part="{part}" name="{kind}" file="{name}"/>"#);
        }
    }
    let path = folder.join("flight.pvd");
    let head = r#"<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">"#;
    let text = format!("{head}\n  <Collection>\n{listed}  </Collection>\n</VTKFile>\n");
    file::write(&path, text.as_bytes())?;
    Ok(path)
}

/// Rings of these rows of nodes, of both wings. The corners of a cell follow each other as its
/// positive circulation runs; those of the right wing mirrored, so that left and right have the
/// same circulation.
fn poly_data(step: &WakeStep, rows: Range<usize>) -> String {
    let columns = step.nodes.first().map_or(0, Vec::len);
    let count = rows.len() * columns;
    let left = || step.nodes[rows.clone()].iter().flatten();
    let points = left().copied().chain(left().map(|&[x, y, z]| [x, -y, z]));
    let places = (0..rows.len().saturating_sub(1)).flat_map(|r| (0..columns.saturating_sub(1)).map(move |c| (r, c)));
    let mut cells = [const { String::new() }; 4];
    let [corners, circulation, side, row] = &mut cells;
    let mut number = 0;
    for right in [false, true] {
        for (r, c) in places.clone() {
            let at = |r: usize, c: usize| r * columns + c + if right { count } else { 0 };
            let ring = [at(r, c + 1), at(r, c), at(r + 1, c), at(r + 1, c + 1)];
            let [a, b, c_, d] = if right { [ring[3], ring[2], ring[1], ring[0]] } else { ring };
            let _ = writeln!(corners, "{a} {b} {c_} {d}");
            let _ = writeln!(circulation, "{}", step.circulation_m2_s[rows.start + r][c]);
            let _ = writeln!(side, "{}", u8::from(right));
            let _ = writeln!(row, "{}", rows.start + r);
            number += 1;
        }
    }
    let array = |kind: &str, name: &str, more: &str, text: &str| {
        format!("<DataArray type=\"{kind}\" Name=\"{name}\"{more} format=\"ascii\">\n{text}</DataArray>\n")
    };
    let mut corners_text = String::new();
    for [x, y, z] in points {
        let _ = writeln!(corners_text, "{x} {y} {z}");
    }
    let offsets: String = (1..=number).map(|i| format!("{}\n", 4 * i)).collect();
    [
        "<VTKFile type=\"PolyData\" version=\"0.1\" byte_order=\"LittleEndian\">\n<PolyData>\n<FieldData>\n",
        &array("Float64", "TimeValue", " NumberOfTuples=\"1\"", &format!("{}\n", step.time_s)),
        "</FieldData>\n",
        &format!("<Piece NumberOfPoints=\"{}\" NumberOfPolys=\"{number}\">\n<Points>\n", 2 * count),
        &array("Float64", "Points", " NumberOfComponents=\"3\"", &corners_text),
        "</Points>\n<Polys>\n",
        &array("Int64", "connectivity", "", corners),
        &array("Int64", "offsets", "", &offsets),
        "</Polys>\n<CellData Scalars=\"circulation_m2_s\">\n",
        &array("Float64", "circulation_m2_s", "", circulation),
        &array("UInt8", "side", "", side),
        &array("Int64", "row", "", row),
        "</CellData>\n</Piece>\n</PolyData>\n</VTKFile>\n",
    ]
    .concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step() -> WakeStep {
        let node = |r: usize, c: usize| [-(r as f64), c as f64 + 1.0, 0.5];
        WakeStep {
            stroke: 2,
            step: 3,
            phase: 0.25,
            time_s: 0.0625,
            wing_rows: 2,
            nodes: (0..4).map(|r| (0..3).map(|c| node(r, c)).collect()).collect(),
            circulation_m2_s: vec![vec![1.0, 2.0], vec![3.0, 4.0], vec![5.0, 6.0]],
        }
    }

    fn numbers(text: &str, name: &str) -> Vec<f64> {
        let from = text.find(&format!("Name=\"{name}\"")).unwrap();
        let body = text[from..].split_once(">\n").unwrap().1.split_once("</DataArray>").unwrap().0;
        body.split_whitespace().map(|n| n.parse().unwrap()).collect()
    }

    #[test]
    fn both_wings_are_there_with_one_circulation_in_mirrored_senses() {
        let text = poly_data(&step(), 1..4);
        assert!(text.contains(r#"NumberOfPoints="18" NumberOfPolys="8""#), "{text}");
        let points = numbers(&text, "Points");
        assert_eq!((&points[..3], &points[27..30]), (&[-1.0, 1.0, 0.5][..], &[-1.0, -1.0, 0.5][..]));
        assert_eq!(numbers(&text, "circulation_m2_s"), [3.0, 4.0, 5.0, 6.0, 3.0, 4.0, 5.0, 6.0]);
        let corners = numbers(&text, "connectivity");
        assert_eq!((&corners[..4], &corners[16..20]), (&[1.0, 0.0, 3.0, 4.0][..], &[13.0, 12.0, 9.0, 10.0][..]));
        assert_eq!(numbers(&text, "offsets").last(), Some(&32.0));
        assert_eq!(numbers(&text, "TimeValue"), [0.0625]);
    }

    #[test]
    fn every_step_is_listed_at_its_time() {
        let folder = tempfile::tempdir().unwrap();
        let path = write(&folder.path().join("a/b"), &[step(), WakeStep { time_s: 0.125, ..step() }]).unwrap();
        let listed = fs::read_to_string(&path).unwrap();
        for file in ["wing-0000.vtp", "wake-0000.vtp", "wing-0001.vtp", "wake-0001.vtp"] {
            assert!(listed.contains(file) && path.with_file_name(file).is_file(), "{file} in {listed}");
        }
        assert_eq!((listed.matches("0.0625").count(), listed.matches("0.125").count()), (2, 2));
    }
}
