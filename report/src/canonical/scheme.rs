//! The numerical settings of a check, in chords.

use std::f64::consts::PI;

use manduca_numerics::cases::CASES;
use manduca_numerics::insect::Insect;
use manduca_numerics::parameters::at;
use manduca_numerics::uvlm::Settings;

/// Settings of the solver and the chords travelled in what they call a stroke.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scheme {
    /// The settings.
    pub settings: Settings,
    /// Length of a stroke, chords.
    pub stroke: f64,
}

impl Scheme {
    /// One small core for everything (chords), time steps of so many chords.
    pub fn fine(core: f64, step: f64, chordwise_panels: usize) -> Self {
        let settings = Settings {
            chordwise_panels,
            bound_core: core,
            bound_core_on_wake: core,
            wake_core_on_wake: core,
            wake_core_on_wing: core,
            fresh_core_on_wing: core,
            core_over_wing: core,
            wake_spreading: 0.0,
            wake_tail: 0.0,
            wake_joined_after: 20.0,
            edge_inset: 0.0,
            single_precision_wake: 0,
            ..Settings::default()
        };
        Self { settings, stroke: step * settings.steps_per_stroke as f64 }
    }

    /// The default settings; a stroke is as long as the hawkmoth's.
    pub fn production() -> Self {
        Self { settings: Settings::default(), stroke: hawkmoth_stroke() }
    }

    /// Lattice and step of the default settings, but one small core: what is left is the cores' doing.
    pub fn production_without_cores() -> Self {
        let production = Self::production();
        Self::fine(1e-6, production.step(), production.settings.chordwise_panels)
    }

    /// Travel in a time step, chords.
    pub fn step(&self) -> f64 {
        self.stroke / self.settings.steps_per_stroke as f64
    }

    /// The same with another time step; cores develop over the same distance and spread as far in it.
    pub fn with_step(mut self, step: f64) -> Self {
        let stroke = step * self.settings.steps_per_stroke as f64;
        self.settings.core_growth_time *= self.stroke / stroke;
        self.settings.wake_spreading *= (stroke / self.stroke).sqrt();
        self.stroke = stroke;
        self
    }

    /// The same with other chordwise panels.
    pub fn with_panels(mut self, chordwise_panels: usize) -> Self {
        self.settings.chordwise_panels = chordwise_panels;
        self
    }

    /// Reduced frequency ω b / U of the stroke itself.
    pub fn reduced_frequency(&self) -> f64 {
        PI / self.stroke
    }
}

/// Chords travelled by the station at the second radius of area in a stroke of the
/// hovering hawkmoth as measured: 4 φa r2 R / c.
pub fn hawkmoth_stroke() -> f64 {
    let insect = Insect::default();
    let measured = CASES.iter().find(|c| c.name == "reference").unwrap_or(&CASES[0]);
    let amplitude = measured.parameters[at::SWEEP_AMPLITUDE].to_radians();
    4.0 * amplitude * insect.area_radius_2 * insect.wing_length_m / insect.mean_chord_m
}

#[cfg(test)]
mod tests {
    use super::*;
    use manduca_numerics::table::Table;

    #[test]
    fn every_core_is_small_in_a_fine_scheme() {
        let scheme = Scheme::fine(1e-4, 0.1, 8);
        let cores: Vec<_> = Settings::FIELDS.iter().filter(|f| f.name.contains("core") && f.unit == "c").collect();
        assert!(cores.len() >= 5);
        for field in cores {
            assert_eq!(scheme.settings.get(field.name), Some(1e-4), "{}", field.name);
        }
        assert!((scheme.step() - 0.1).abs() < 1e-15);
    }

    #[test]
    fn another_step_keeps_the_growth_of_cores_in_chords() {
        let scheme = Scheme::production();
        let grown = |s: &Scheme| s.settings.core_growth_time * s.stroke;
        let other = scheme.with_step(0.5);
        assert!((other.step() - 0.5).abs() < 1e-12 && (grown(&other) - grown(&scheme)).abs() < 1e-12);
        // Square of the core over a chord.
        let spread = |s: &Scheme| s.settings.wake_spreading.powi(2) / s.stroke;
        assert!((spread(&other) / spread(&scheme) - 1.0).abs() < 1e-12);
        // 4 x 57.2° x 0.525 x 48.5 mm / 18.3 mm.
        assert!((scheme.stroke - 5.556).abs() < 0.001, "{}", scheme.stroke);
    }
}
