//! The insect as data: morphology, mass, air. Any other animal or robot is
//! another set of values.

use crate::table::{Table, table};

table! {
    /// An insect and the air around it, SI units. The default is the preset
    /// `hawkmoth`.
    ///
    /// Lengths and mass of the hawkmoth are those of Nguyen et al. 2019, Table 1,
    /// except mean chord and area, which are misprinted there: 4.33 mm and
    /// 460 mm² contradict the wing length and cannot carry the weight. They are
    /// taken from the specimen itself (Willmott & Ellington 1997, male M1).
    pub struct Insect {
        mass_kg: f64 = 1.5787e-3, 1e-7..=1.0, "kg", "body mass including the wings";
        wing_length_m: f64 = 0.0485, 1e-4..=1.0, "m", "wing length R from hinge to tip";
        mean_chord_m: f64 = 0.0183, 1e-5..=1.0, "m", "mean chord c; the area of one wing is R c";
        area_radius_1: f64 = 0.4586, 0.3..=0.7, "", "radius of the first moment of wing area, fraction of R";
        area_radius_2: f64 = 0.525, 0.31..=0.75, "", "radius of the second moment of wing area, fraction of R";
        feathering_axis: f64 = 0.27, 0.0..=1.0, "", "feathering axis behind the leading edge, fraction of chord";
        hinge_offset_m: f64 = 0.008, 0.0..=0.5, "m", "distance of each hinge from the plane of symmetry";
        root_cutout: f64 = 0.08, 0.0..=0.5, "", "inner end of the lifting surface, fraction of R";
        wing_mass_kg: f64 = 45e-6, 0.0..=0.5, "kg", "mass of one wing";
        wing_gyration_radius: f64 = 0.381, 0.2..=0.55, "", "radius of gyration of one wing about the hinge, fraction of R";
        hinge_to_cm_along_m: f64 = 0.011, -0.5..=0.5, "m", "centre of mass from the hinges along the body axis, towards the tail";
        hinge_to_cm_below_m: f64 = 0.004, -0.5..=0.5, "m", "centre of mass below the hinges, normal to the body axis";
        stroke_plane_to_body_deg: f64 = 120.0, 0.0..=180.0, "deg", "angle between stroke plane and body axis";
        body_pitch_inertia_kg_m2: f64 = 2.0e-7, 1e-14..=1.0, "kg m2", "pitching moment of inertia of the body about its centre of mass; no result depends on it: it is for stability, later";
        air_density_kg_m3: f64 = 1.225, 0.001..=2000.0, "kg/m3", "density of the air";
        gravity_m_s2: f64 = 9.81, 0.1..=30.0, "m/s2", "acceleration of gravity";
        power_scale_w: f64 = 0.0842, 1e-9..=1e6, "W", "P0, the scale of P+";
        moment_scale_m: f64 = 0.0183, 1e-5..=1.0, "m", "c in the scale W c of M+";
    }
}

/// Names of the presets.
pub const PRESETS: [&str; 2] = ["hawkmoth", "hawkmoth-f1"];

impl Insect {
    /// A preset by name.
    ///
    /// * `hawkmoth`: the insect of Nguyen et al. 2019 (*Manduca sexta*, male M1).
    /// * `hawkmoth-f1`: the female F1 of Sun, Wang & Xiong 2007, Acta Mech. Sinica 23.
    pub fn preset(name: &str) -> Option<Self> {
        match name {
            "hawkmoth" => Some(Self::default()),
            "hawkmoth-f1" => Some(Self {
                mass_kg: 1.648e-3,
                wing_length_m: 0.0519,
                mean_chord_m: 0.01826,
                wing_mass_kg: 47e-6,
                wing_gyration_radius: 0.3812,
                body_pitch_inertia_kg_m2: 2.08e-7,
                moment_scale_m: 0.01826,
                ..Self::default()
            }),
            _ => None,
        }
    }

    /// Weight W, N.
    pub fn weight_n(&self) -> f64 {
        self.mass_kg * self.gravity_m_s2
    }

    /// What L, D, M and P are divided by: W, W, W c, P0 (paper Eq. 4).
    pub fn scales(&self) -> [f64; 4] {
        let w = self.weight_n();
        [w, w, w * self.moment_scale_m, self.power_scale_w]
    }

    /// Centre of mass from the hinge line in stroke-plane axes (along it, normal to it), m.
    ///
    /// The body keeps its angle to the stroke plane, so these do not change with its tilt:
    /// with γ the supplement of that angle, x = -l1 cos γ + h sin γ, z = -l1 sin γ - h cos γ.
    pub fn centre_in_stroke_plane(&self) -> (f64, f64) {
        let (s, c) = crate::math::sin_cos((180.0 - self.stroke_plane_to_body_deg).to_radians());
        let (l, h) = (self.hinge_to_cm_along_m, self.hinge_to_cm_below_m);
        (-l * c + h * s, -l * s - h * c)
    }

    /// Checks what no single field shows.
    ///
    /// # Errors
    /// A sentence naming the field and the reason.
    pub fn check(&self) -> Result<(), (&'static str, String)> {
        for field in Self::FIELDS {
            let value = self.get(field.name).unwrap_or(f64::NAN);
            field.check(value).map_err(|e| (field.name, e.to_string()))?;
        }
        let (r1, r2) = (self.area_radius_1, self.area_radius_2);
        let k = r1 * (1.0 - r1) / (r2 * r2 - r1 * r1) - 1.0;
        // p and q of the beta distribution: above one half the chord is integrable squared, below five the end strips
        // have one to speak of.
        let possible = |p: f64| p > 0.5 && p < 5.0;
        if !(r2 > r1 && possible(r1 * k) && possible((1.0 - r1) * k)) {
            return Err(("area_radius_2", format!("no wing has area radii {r1} and {r2}")));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wings_without_chord_at_their_ends_are_refused() {
        assert!(Insect::default().check().is_ok());
        // p = q = 124 and 5.6: hardly any chord at the ends; 0.43: not integrable squared; r2 below r1.
        for (r1, r2) in [(0.5, 0.501), (0.5, 0.52), (0.5, 0.62), (0.6, 0.5)] {
            let insect = Insect { area_radius_1: r1, area_radius_2: r2, ..Insect::default() };
            assert_eq!(insect.check().unwrap_err().0, "area_radius_2", "{r1} {r2}");
        }
    }
}
