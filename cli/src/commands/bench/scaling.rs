//! How the solver's work and time grow with its settings.

use std::io;
use std::time::Instant;

use manduca_numerics::simulation::{Model, Simulation, simulate_watched};
use manduca_numerics::uvlm::{Settings, Solver};
use serde::Serialize;

use crate::output::Output;

/// One flight of the table.
#[derive(Debug, Serialize)]
pub struct Row {
    chordwise_panels: usize,
    spanwise_panels: usize,
    steps_per_stroke: usize,
    strokes: usize,
    wake_rows: usize,
    /// Segments on points.
    interactions: u64,
    seconds: f64,
}

/// A cheap lattice and what each doubling makes of it.
fn flights() -> [Settings; 8] {
    let base = Settings {
        chordwise_panels: 4,
        spanwise_panels: 8,
        steps_per_stroke: 24,
        strokes: 3,
        strokes_most: 3,
        strokes_dropped: 1,
        wake_strokes: 1.0,
        wake_joined_after: 20.0,
        ..Settings::default()
    };
    let finer = Settings { chordwise_panels: 8, spanwise_panels: 16, ..base };
    [
        base,
        Settings { chordwise_panels: 8, ..base },
        Settings { spanwise_panels: 16, ..base },
        Settings { strokes: 6, strokes_most: 6, ..base },
        Settings { wake_strokes: 2.0, ..base },
        Settings { steps_per_stroke: 48, ..base },
        Settings { steps_per_stroke: 48, ..finer },
        Settings { steps_per_stroke: 48, wake_strokes: 2.0, strokes: 6, strokes_most: 6, ..finer },
    ]
}

/// Flies the table on one core.
pub fn measure(simulation: &Simulation) -> Vec<Row> {
    flights().iter().map(|settings| row(simulation, settings)).collect()
}

fn row(simulation: &Simulation, settings: &Settings) -> Row {
    let flight = Simulation { model: Model::Uvlm(*settings), ..*simulation };
    let mut interactions = 0;
    let mut times = Vec::new();
    // The median of three where a flight is short, for the smallest take milliseconds.
    while times.len() < 3 && times.iter().sum::<f64>() < 0.3 {
        let start = Instant::now();
        let flown = simulate_watched(&flight, &mut |_, solver| {
            interactions = solver.map_or(0, Solver::interactions);
        });
        std::hint::black_box(flown.is_ok());
        times.push(start.elapsed().as_secs_f64());
    }
    times.sort_by(f64::total_cmp);
    Row {
        chordwise_panels: settings.chordwise_panels,
        spanwise_panels: settings.spanwise_panels,
        steps_per_stroke: settings.steps_per_stroke,
        strokes: settings.strokes,
        wake_rows: (settings.wake_strokes * settings.steps_per_stroke as f64).round() as usize,
        interactions,
        seconds: times[times.len() / 2],
    }
}

/// The table, beside what the first row took.
pub fn print(out: &mut Output, rows: &[Row]) -> io::Result<()> {
    let Some(first) = rows.first() else { return Ok(()) };
    out.line("\ngrowth (one core; the first row is 1)")?;
    let header = ["panels", "steps", "strokes", "wake rows", "1e6 interactions", "seconds", "work", "time"];
    let row = |r: &Row| {
        vec![
            format!("{} x {}", r.chordwise_panels, r.spanwise_panels),
            r.steps_per_stroke.to_string(),
            r.strokes.to_string(),
            r.wake_rows.to_string(),
            format!("{:.1}", r.interactions as f64 * 1e-6),
            format!("{:.4}", r.seconds),
            format!("{:.1}", r.interactions as f64 / first.interactions as f64),
            format!("{:.1}", r.seconds / first.seconds),
        ]
    };
    out.table(&header.map(String::from), &rows.iter().map(row).collect::<Vec<_>>())?;
    out.line("Strokes cost in proportion, panels along the span and rows of wake by their squares;")?;
    out.line("steps are rows of wake too: by their cubes.")
}
