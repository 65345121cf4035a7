//! The vortex lattice beside the blade elements a user would otherwise pick: Fig. 3.

use std::f64::consts::TAU;
use std::io;

use manduca_numerics::cases::{Case, case};
use manduca_numerics::insect::Insect;
use manduca_numerics::parameters::at;
use manduca_numerics::quasi_steady;
use manduca_numerics::simulation::{Model, Moment};
use manduca_numerics::wing::Outline;

use crate::flights::{Flight, fly_with_history};
use crate::markdown::{Document, Table, fixed};
use crate::plot::{Figure, Mark, Panel, Series};

/// Name of the stroke and of its coefficients' ordinates.
const STROKE: &str = "reference";

/// What makes loads of one wing to coefficients (paper Eq. 2).
#[derive(Debug, Clone, Copy)]
struct Scale {
    /// ½ρ U² S, N.
    force_n: f64,
    /// U_ref = 2 φ_pp f r_2, m/s.
    speed_m_s: f64,
}

impl Scale {
    /// C_L = L/(½ρ U² S), C_P = P/(½ρ U³ S), U = 2 φ_pp f r_2 the wing's mean speed at the radius
    /// of its second moment of area, S the area of one wing, and the loads its own.
    fn of(case: &Case, insect: &Insect) -> Self {
        let outline = Outline::new(insect);
        let length = insect.wing_length_m;
        let area = length * outline.integrate(|_, _| 1.0);
        let second = length.powi(3) * outline.integrate(|x, _| x * x);
        let peak_to_peak = 2.0 * case.parameters[at::SWEEP_AMPLITUDE] * TAU / 360.0;
        let speed_m_s = 2.0 * peak_to_peak * case.parameters[at::FREQUENCY] * (second / area).sqrt();
        Self { force_n: 0.5 * insect.air_density_kg_m3 * speed_m_s * speed_m_s * area, speed_m_s }
    }

    /// C_L, C_D and C_P of an instant of both wings.
    fn coefficients(&self, moment: &Moment) -> [f64; 3] {
        let aerodynamic_w: f64 = moment.snapshot.joints.iter().map(|j| j.aerodynamic_w).sum();
        let forces = [moment.snapshot.lift_n, moment.snapshot.drag_n].map(|f| 0.5 * f / self.force_n);
        [forces[0], forces[1], 0.5 * aerodynamic_w / (self.force_n * self.speed_m_s)]
    }
}

pub(super) fn write(document: &mut Document, figures: &mut Vec<(&'static str, String)>) -> io::Result<()> {
    let Some(moth) = case(STROKE) else { return Ok(()) };
    let insect = Insect::default();
    let scale = Scale::of(moth, &insect);
    let lattice = Flight::of_case(moth).simulation();
    let blades = manduca_numerics::simulation::Simulation {
        model: Model::QuasiSteady(quasi_steady::Settings::default()),
        ..lattice
    };
    let mut table = Table::new(["mean of the stroke", "C_L", "C_D", "C_P"]);
    let mut panels: Vec<Panel> = ["lift coefficient C_L", "drag coefficient C_D", "aerodynamic power coefficient C_P"]
        .map(|y| Panel { x: "time t f, strokes".into(), y: y.into(), series: Vec::new() })
        .into();
    for (name, simulation) in [("vortex lattice", &lattice), ("blade elements", &blades)] {
        let (_, moments) = fly_with_history(simulation).map_err(|e| io::Error::other(format!("{name}: {e}")))?;
        let rows: Vec<(f64, f64, [f64; 3])> =
            moments.iter().map(|m| (m.phase, m.share, scale.coefficients(m))).collect();
        let mean = |k: usize| rows.iter().map(|(_, share, c)| share * c[k]).sum::<f64>();
        table.row([name.to_owned(), fixed(mean(0), 3), fixed(mean(1), 3), fixed(mean(2), 3)]);
        for (k, panel) in panels.iter_mut().enumerate() {
            panel.series.push(Series::new(name, Mark::Line, rows.iter().map(|(phase, _, c)| (*phase, c[k]))));
        }
    }
    document.heading("The model beside blade elements (Fig. 3)");
    document.paragraph(&format!(
        "One stroke of the moth as measured, by the vortex lattice and by our quasi-steady blade elements (Berman & Wang \
         2007), as the coefficients of Eq. 2: loads of one wing over ½ρU²S and ½ρU³S, U = 2 φpp f r2 = {} m/s its mean \
         speed at the radius of its second moment of area. Lift is up and drag rearward, as all through these pages. The \
         paper's own figure is of another stroke, measured by Lee et al., which it does not tabulate.",
        fixed(scale.speed_m_s, 2)
    ));
    document.table(&table);
    figures.push(("coefficients.svg", Figure { panels, columns: 3 }.svg()?));
    document.figure(
        "figures/coefficients.svg",
        "Lift, drag and power coefficients of the vortex lattice and of blade elements",
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sweep of some 2 rad at 26 Hz, the second moment's radius about half of 48.5 mm: 2 · 2 · 26 · 0.025 m/s.
    #[test]
    fn the_reference_speed_is_that_of_the_moth() {
        let moth = case(STROKE).unwrap();
        let scale = Scale::of(moth, &Insect::default());
        assert!((2.3..3.0).contains(&scale.speed_m_s), "{scale:?}");
        let mut document = Document::new("x");
        let mut figures = Vec::new();
        write(&mut document, &mut figures).unwrap();
        let row = document.text().lines().find(|l| l.contains("blade elements |")).unwrap().to_owned();
        // Mean lift of blade elements, 0.90 W, over both wings' ½ρU²S.
        let insect = Insect::default();
        let expected = 0.90 * insect.weight_n() / (2.0 * scale.force_n);
        let found: f64 = row.split('|').nth(2).unwrap().trim().parse().unwrap();
        assert!((found / expected - 1.0).abs() < 0.02, "{found} {expected}");
        assert_eq!(figures.len(), 1);
    }
}
