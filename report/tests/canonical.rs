//! Every canonical check, row by row, at both settings.

use manduca_report::canonical::{
    added_mass, induced_drag, invariants, oscillation, other_code, plate, steady, sudden_start, symmetries, wagner,
};
use manduca_report::check::{Group, Setup};

/// Where the default settings do not reach a tolerance, what they do reach:
/// quantity, and the greatest error accepted. A better default may pass.
type Known<'a> = [(&'a str, f64)];

/// With small cores everything passes; at the default settings everything but what is known.
fn assert_group(group: &Group, rows: usize, known: &Known<'_>) {
    assert!(group.rows.len() >= rows, "{}: only {} rows", group.title, group.rows.len());
    let faults: Vec<_> = group
        .rows
        .iter()
        .filter(|row| {
            let is_known = |(what, limit): &(&str, f64)| {
                *what == row.what && row.setup == Setup::Production && row.error().abs() <= *limit
            };
            !row.pass() && !known.iter().any(is_known)
        })
        .map(|row| {
            format!("{} ({}): {:?}, got {}, off by {}", row.what, row.setup.name(), row.expected, row.got, row.error())
        })
        .collect();
    assert!(faults.is_empty(), "{}\n{}", group.title, faults.join("\n"));
    for (what, _) in known {
        assert!(group.rows.iter().any(|row| row.what == *what), "{}: no row `{what}`", group.title);
    }
}

#[test]
fn two_dimensional_plate() {
    assert_group(&plate::group(), 14, &[]);
}

#[test]
fn wagner_sudden_start() {
    assert_group(&wagner::group(), 25, &[]);
}

/// Eight panels are few for fast oscillation: measured 4.7 and 7.0 % of lift in plunge, 4.1
/// and 7.7 % in pitch. With small cores the same lattice and step leave as much.
#[test]
fn theodorsen_and_garrick() {
    let known = [
        ("plunge, k = 1: lift", 0.055),
        ("plunge, k = 2: lift", 0.08),
        ("pitch about c/4, k = 1: lift", 0.05),
        ("pitch about c/4, k = 2: lift", 0.09),
    ];
    assert_group(&oscillation::group(), 70, &known);
}

/// A lattice has too much added mass by about 1/N: measured 8.3, 9.5 and 10.0 % with eight panels.
#[test]
fn added_mass_of_plates() {
    let known = [
        ("aspect ratio 1, default lattice", 0.095),
        ("aspect ratio 2, default lattice", 0.105),
        ("aspect ratio 4, default lattice", 0.11),
    ];
    assert_group(&added_mass::group(), 9, &known);
}

/// Measured 1.9 and 2.1 % with the default lattice as it is.
#[test]
fn steady_lift_slopes() {
    let known =
        [("aspect ratio 4, default lattice and step", 0.025), ("aspect ratio 8, default lattice and step", 0.025)];
    assert_group(&steady::group(), 12, &known);
}

/// The published values are those of four panels whose first row is a step behind the edge, which
/// is too much lift at first (Wagner's plate is met, and finer lattices stay where the default one
/// is): the default lattice has 11.8, 6.1, 14.0, 8.3 and 4.0 % less.
#[test]
fn sudden_start_of_finite_wings() {
    let known = [
        ("aspect ratio 4, U t/c = 0.5, default lattice and step", 0.12),
        ("aspect ratio 4, U t/c = 1, default lattice and step", 0.065),
        ("aspect ratio 8, U t/c = 0.5, default lattice and step", 0.145),
        ("aspect ratio 8, U t/c = 1, default lattice and step", 0.085),
        ("aspect ratio 8, U t/c = 2, default lattice and step", 0.045),
    ];
    assert_group(&sudden_start::group(), 30, &known);
}

/// Ten strips along half an elliptic wing: measured 3.3 %.
#[test]
fn induced_drag_of_wings() {
    assert_group(&induced_drag::group(), 6, &[("elliptic wing, aspect ratio 8, default lattice", 0.04)]);
}

#[test]
fn invariants_hold_to_rounding() {
    assert_group(&invariants::group(), 10, &[]);
}

#[test]
fn laws_of_hovering() {
    assert_group(&symmetries::group(), 5, &[]);
}

/// Measured 2.5 mN below the lowest of the other codes: their range is met with a
/// bound core of 0.05 c, not with a thin one.
#[test]
fn other_codes() {
    let group = other_code::group();
    let lattice = group.rows.last().map(|row| row.what.clone()).unwrap_or_default();
    assert_group(&group, 3, &[("6 x 12 panels, 40 steps", 2.7), (&lattice, 2.7)]);
}
