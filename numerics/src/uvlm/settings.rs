//! Every choice of the vortex lattice, as data.

use crate::insect::Insect;
use crate::table::table;

table! {
    /// Settings of the vortex-lattice solver. Lengths are in mean chords, times
    /// in strokes, so that the same settings serve any insect and frequency (and
    /// forces scale exactly with f²).
    pub struct Settings {
        chordwise_panels: usize = 6, 1..=32, "", "panels along the chord";
        spanwise_panels: usize = 17, 1..=48, "", "panels along one wing";
        steps_per_stroke: usize = 68, 8..=720, "", "time steps per stroke";
        steps_by_speed: f64 = 0.65, 0.0..=0.95, "", "share of the time steps dealt out by the trailing edge's speed, the rest evenly";
        strokes: usize = 10, 1..=200, "", "strokes flown, from rest, at least";
        strokes_dropped: usize = 4, 0..=100, "", "first strokes left out of the means (the wake builds up)";
        strokes_most: usize = 20, 1..=400, "", "strokes flown at most: two more at a time while a standard error is above `standard_error`";
        standard_error: f64 = 0.005, 0.0..=1.0, "", "standard error of M+, P+ and, in W, of the forces along and normal to the stroke plane at which no more strokes are flown";
        wake_strokes: f64 = 2.0, 0.1..=20.0, "strokes", "how long the free wake is remembered ring by ring";
        wake_joined_after: f64 = 0.125, 0.0..=20.0, "strokes", "age from which every other row of wake is joined to its neighbour, again from four times that age, and so on";
        wake_tail: f64 = 2.0, 0.0..=6.0, "c", "radius of the sinks which stand for the wake forgotten; 0 leaves them out";
        first_row: f64 = 0.25, 0.05..=2.0, "steps", "place of the line which stands for the wake shed in a step, behind the trailing edge, as a plate sees it";
        edge_inset: f64 = 0.17, 0.0..=0.5, "", "how far root and tip of the lattice are drawn in, in widths of the end strips";
        bound_core: f64 = 0.001, 1e-6..=0.5, "c", "core of bound segments and of the trailing-edge line as the wing sees them";
        bound_core_on_wake: f64 = 0.1, 1e-6..=1.0, "c", "core of bound segments as the wake sees them";
        wake_core_on_wake: f64 = 0.125, 0.01..=2.0, "c", "core of wake just shed as the wake sees it";
        wake_core_on_wing: f64 = 0.3, 0.001..=2.0, "c", "core to which fresh wake develops as the wing sees it";
        fresh_core_on_wing: f64 = 0.01, 1e-6..=2.0, "c", "core of the wake just shed as the wing sees it";
        core_over_wing: f64 = 0.1, 0.0..=2.0, "c", "core which wake gains where it lies over the wing, ahead of the trailing edge, as the wing sees it; 0 leaves it out";
        core_growth_time: f64 = 0.5, 0.001..=10.0, "strokes", "time in which the core seen by the wing develops and begins to spread";
        wake_spreading: f64 = 1.2, 0.0..=5.0, "c", "core to which all wake spreads in one stroke, growing with the root of age";
        suction_to_lift: f64 = 0.5, 0.0..=1.0, "", "share of the leading-edge suction turned into vortex lift (Polhamus)";
        suction_in_plane: f64 = 0.0, 0.0..=1.0, "", "share of the leading-edge suction kept in the wing's plane";
        spanwise_cosine: f64 = 0.5, 0.0..=1.0, "", "spanwise spacing: 0 uniform, 1 cosine";
        single_precision_wake: usize = 1, 0..=1, "", "1: velocities of the wake's nodes in single precision, 0: in double";
    }
}

impl Settings {
    /// Strokes which enter the means, at least.
    pub fn strokes_kept(&self) -> usize {
        self.strokes.saturating_sub(self.strokes_dropped)
    }

    /// Vortex segments acting on nodes over so many strokes, about: each step all rings act on all
    /// nodes, while the wake grows by a row per step until it is as long as it is remembered. Time
    /// of a flight is nearly proportional to it.
    pub fn interactions(&self, strokes: usize) -> f64 {
        let steps = self.steps_per_stroke as f64;
        let (kept, joined) = (self.wake_strokes * steps, (self.wake_joined_after * steps).max(2.0));
        // Of the wake's rows a half is left from the age `joined` on, a quarter from four times that age, and so on.
        let rows = |step: f64| {
            let oldest = step.min(kept);
            let (mut rows, mut from, mut share) = (oldest, joined, 0.5);
            while from < oldest {
                rows -= share * (oldest - from);
                (from, share) = (4.0 * from, 0.5 * share);
            }
            rows
        };
        let wing = 1.5 * (self.chordwise_panels + 1) as f64;
        let columns = (self.spanwise_panels + 1) as f64;
        (0..strokes * self.steps_per_stroke).map(|step| (columns * (wing + rows(step as f64))).powi(2)).sum()
    }

    /// Checks what no single field shows.
    ///
    /// # Errors
    /// The field and the reason.
    pub fn check(&self) -> Result<(), (&'static str, String)> {
        use crate::table::Table;
        for field in Self::FIELDS {
            let value = self.get(field.name).unwrap_or(f64::NAN);
            field.check(value).map_err(|e| (field.name, e.to_string()))?;
        }
        if self.strokes_kept() < 1 {
            return Err(("strokes_dropped", format!("drops all {} strokes", self.strokes)));
        }
        // Where more may be flown, two more are: then there are three.
        if self.strokes_kept() < 2 && self.strokes + 2 > self.strokes_most {
            let why = format!("leaves one of {} strokes, and the standard error of one is unknown", self.strokes);
            return Err(("strokes_dropped", why));
        }
        Ok(())
    }

    /// The largest core of bound segments which the panels of a wing allow, in mean chords: cores as wide as panels
    /// blur them into each other, and the lattice blows up. With 1 to 12 panels along the chord and 6 and 17 along the
    /// wing it does from 1.5 to 3 times this on.
    pub fn most_bound_core(&self, insect: &Insect) -> f64 {
        let strip =
            (1.0 - insect.root_cutout) * insect.wing_length_m / insect.mean_chord_m / self.spanwise_panels as f64;
        (0.25 / self.chordwise_panels as f64).min(0.5 * strip)
    }

    /// Checks what only a wing shows.
    ///
    /// # Errors
    /// The field and the reason.
    pub fn check_on(&self, insect: &Insect) -> Result<(), (&'static str, String)> {
        let (most, core) = (self.most_bound_core(insect), self.bound_core);
        if core > most.max(Self::default().bound_core) {
            let why = format!(
                "{core} c is too wide for {} x {} panels: the lattice would blow up; at most {most:.3} c",
                self.chordwise_panels, self.spanwise_panels
            );
            return Err(("bound_core", why));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_stroke_kept_has_no_standard_error_and_is_refused() {
        let refused = |strokes, strokes_dropped, strokes_most| {
            let settings = Settings { strokes, strokes_dropped, strokes_most, ..Settings::default() };
            settings.check().err().map(|(field, _)| field)
        };
        for (strokes, dropped, most) in [(1, 0, 1), (5, 4, 5), (5, 4, 6), (1, 0, 2), (4, 4, 20), (3, 9, 20)] {
            assert_eq!(refused(strokes, dropped, most), Some("strokes_dropped"), "{strokes} {dropped} {most}");
        }
        // Two more are flown where they may be.
        for (strokes, dropped, most) in [(2, 0, 2), (6, 4, 6), (5, 4, 7), (1, 0, 20), (10, 4, 20)] {
            assert_eq!(refused(strokes, dropped, most), None, "{strokes} {dropped} {most}");
        }
    }

    #[test]
    fn a_core_must_fit_the_panels() {
        let hawkmoth = Insect::default();
        let fits = |chordwise_panels, spanwise_panels, bound_core| {
            Settings { chordwise_panels, spanwise_panels, bound_core, ..Settings::default() }
                .check_on(&hawkmoth)
                .is_ok()
        };
        assert!(fits(6, 17, 0.001) && fits(6, 17, 0.04) && fits(1, 6, 0.2) && fits(32, 48, 0.001));
        assert!(!fits(6, 17, 0.1) && !fits(6, 17, 0.05) && !fits(2, 6, 0.25) && !fits(1, 48, 0.2));
    }
}
