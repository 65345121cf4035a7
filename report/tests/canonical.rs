//! Every canonical check, row by row, at all settings.

use manduca_report::canonical::{
    added_mass, induced_drag, invariants, oscillation, other_code, plate, steady, sudden_start, symmetries, wagner,
};
use manduca_report::check::{Group, Setup};

/// Where a tolerance is not reached, what is: quantity, settings, and the greatest error accepted.
/// Better defaults may pass.
type Known<'a> = [(&'a str, Setup, f64)];

/// With small cores everything passes; with the default settings everything but what is known.
fn assert_group(group: &Group, rows: usize, known: &Known<'_>) {
    assert!(group.rows.len() >= rows, "{}: only {} rows", group.title, group.rows.len());
    let faults: Vec<_> = group
        .rows
        .iter()
        .filter(|row| {
            let is_known = |(what, setup, limit): &(&str, Setup, f64)| {
                *what == row.what && row.setup == *setup && row.setup != Setup::Fine && row.error().abs() <= *limit
            };
            !row.pass() && !known.iter().any(is_known)
        })
        .map(|row| {
            format!("{} ({}): {:?}, got {}, off by {}", row.what, row.setup.name(), row.expected, row.got, row.error())
        })
        .collect();
    assert!(faults.is_empty(), "{}\n{}", group.title, faults.join("\n"));
    for (what, setup, _) in known {
        let found = group.rows.iter().any(|row| row.what == *what && row.setup == *setup);
        assert!(found, "{}: no row `{what}` ({})", group.title, setup.name());
    }
}

#[test]
fn two_dimensional_plate() {
    assert_group(&plate::group(), 14, &[]);
}

#[test]
fn wagner_sudden_start() {
    assert_group(&wagner::group(), 30, &[]);
}

/// Steps of a hawkmoth's stroke are long for fast oscillation: measured 3.2 % of lift in plunge,
/// 5.1 % in pitch; with small cores they leave as much.
#[test]
fn theodorsen_and_garrick() {
    let known = [("plunge, k = 2: lift", Setup::Flown, 0.035), ("pitch about c/4, k = 2: lift", Setup::Flown, 0.055)];
    assert_group(&oscillation::group(), 105, &known);
}

/// A lattice has too much added mass by about 1/N: measured 9.2, 11.2 and 12.3 % with six panels.
#[test]
fn added_mass_of_plates() {
    let flown = |what, limit| (what, Setup::Flown, limit);
    let known = [flown("aspect ratio 1", 0.095), flown("aspect ratio 2", 0.115), flown("aspect ratio 4", 0.127)];
    assert_group(&added_mass::group(), 9, &known);
}

/// The default lattice is one of the lattices whose limit is asked for: measured 1.5 % too much.
#[test]
fn steady_lift_slopes() {
    assert_group(&steady::group(), 12, &[("aspect ratio 8, limit of fine lattices", Setup::Flown, 0.018)]);
}

/// The published values are those of four panels whose first row is a step behind the edge, which
/// is too much lift at first (Wagner's plate is met, and finer lattices stay where the default one
/// is): the default lattice has 11.7, 6.4, 13.7, 8.3 and 4.1 % less.
#[test]
fn sudden_start_of_finite_wings() {
    let flown = |what, limit| (what, Setup::Flown, limit);
    let known = [
        flown("aspect ratio 4, U t/c = 0.5", 0.12),
        flown("aspect ratio 4, U t/c = 1", 0.065),
        flown("aspect ratio 8, U t/c = 0.5", 0.145),
        flown("aspect ratio 8, U t/c = 1", 0.085),
        flown("aspect ratio 8, U t/c = 2", 0.045),
    ];
    assert_group(&sudden_start::group(), 30, &known);
}

#[test]
fn induced_drag_of_wings() {
    assert_group(&induced_drag::group(), 6, &[]);
}

#[test]
fn invariants_hold_to_rounding() {
    assert_group(&invariants::group(), 10, &[]);
}

#[test]
fn laws_of_hovering() {
    assert_group(&symmetries::group(), 5, &[]);
}

/// Measured 2.5 and 2.7 mN below the lowest of the other codes: their range is met with a
/// bound core of 0.05 c, not with a thin one.
#[test]
fn other_codes() {
    let mean = |setup, limit| ("mean lift, mN", setup, limit);
    assert_group(&other_code::group(), 5, &[mean(Setup::Production, 2.7), mean(Setup::Flown, 2.8)]);
}
