//! THE table of the ten design parameters.
//!
//! Validation, network inputs, genes, CSV columns, API documentation and plots
//! all read it, so they cannot disagree.

/// How many design parameters there are.
pub const COUNT: usize = 10;

/// One row of the table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// Name on the wire, in study files and in CSV headers.
    pub name: &'static str,
    /// Symbol in the literature.
    pub symbol: &'static str,
    /// Unit of the value, empty where dimensionless.
    pub unit: &'static str,
    /// Lower bound of the paper's design box (Table 2).
    pub lower: f64,
    /// Upper bound of the paper's design box (Table 2).
    pub upper: f64,
    /// Lowest value the model accepts at all.
    pub least: f64,
    /// Highest value the model accepts at all.
    pub most: f64,
    /// What it is, in a few words.
    pub meaning: &'static str,
}

#[rustfmt::skip]
const fn row(
    name: &'static str, symbol: &'static str, unit: &'static str,
    (lower, upper): (f64, f64), (least, most): (f64, f64), meaning: &'static str,
) -> Parameter {
    Parameter { name, symbol, unit, lower, upper, least, most, meaning }
}

/// The ten design parameters in their one order.
///
/// Bounds: Nguyen et al. 2019, Table 2. `least..most` is what the equations can
/// carry (a wing cannot sweep past the plane of symmetry behind the body).
#[rustfmt::skip]
pub const TABLE: [Parameter; COUNT] = [
    row("frequency_hz", "f", "Hz", (15.0, 40.0), (1.0, 300.0), "flapping frequency"),
    row("stroke_plane_deg", "β", "°", (0.0, 50.0), (-90.0, 90.0), "stroke plane angle, forward edge down"),
    row("sweep_mean_deg", "φ0", "°", (-25.0, 25.0), (-60.0, 60.0), "mean sweep, positive ventral (forward)"),
    row("elevation_mean_deg", "θ0", "°", (-25.0, 25.0), (-60.0, 60.0), "mean elevation above the stroke plane"),
    row("rotation_mean_deg", "α0", "°", (-25.0, 25.0), (-60.0, 60.0), "mean rotation"),
    row("sweep_amplitude_deg", "φa", "°", (30.0, 60.0), (0.0, 90.0), "sweep amplitude"),
    row("elevation_amplitude_deg", "θa", "°", (0.0, 30.0), (0.0, 60.0), "elevation amplitude, twice per stroke"),
    row("rotation_amplitude_deg", "αa", "°", (25.0, 75.0), (0.0, 90.0), "rotation amplitude"),
    row("sweep_shape", "K", "", (0.0, 1.0), (0.0, 1.0), "0 sinusoidal sweep, 1 triangular"),
    row("rotation_shape", "C", "", (0.0, 5.0), (0.0, 20.0), "0 sinusoidal rotation, large: square"),
];

/// Place of a parameter in the table.
///
/// ```
/// assert_eq!(manduca_numerics::parameters::index("sweep_mean_deg"), Some(2));
/// ```
pub fn index(name: &str) -> Option<usize> {
    TABLE.iter().position(|p| p.name == name)
}

/// The symbols in letters which every keyboard has, table order.
const SPELT: [&str; COUNT] = ["f", "beta", "phi0", "theta0", "alpha0", "phia", "thetaa", "alphaa", "k", "c"];

/// Place of a parameter which a person names: by its name, its symbol, or the symbol spelt in Latin letters
/// (`beta`, `phi0`, `phi_a`). Case, `_` and `-` do not matter.
///
/// ```
/// use manduca_numerics::parameters::{find, index};
/// assert_eq!(find("beta"), index("stroke_plane_deg"));
/// assert_eq!(find("φa"), index("sweep_amplitude_deg"));
/// assert_eq!(find("colour"), None);
/// ```
pub fn find(text: &str) -> Option<usize> {
    let plain = |text: &str| text.trim().to_lowercase().replace(['_', '-'], "");
    let wanted = plain(text);
    (0..COUNT).find(|&i| {
        let Parameter { name, symbol, .. } = TABLE[i];
        [name, symbol, SPELT[i]].iter().any(|known| plain(known) == wanted)
    })
}

/// Place of each parameter by name, for code which means one in particular.
#[allow(missing_docs)]
pub mod at {
    pub const FREQUENCY: usize = 0;
    pub const STROKE_PLANE: usize = 1;
    pub const SWEEP_MEAN: usize = 2;
    pub const ELEVATION_MEAN: usize = 3;
    pub const ROTATION_MEAN: usize = 4;
    pub const SWEEP_AMPLITUDE: usize = 5;
    pub const ELEVATION_AMPLITUDE: usize = 6;
    pub const ROTATION_AMPLITUDE: usize = 7;
    pub const SWEEP_SHAPE: usize = 8;
    pub const ROTATION_SHAPE: usize = 9;
}

/// A point of the design space: ten values in table order and table units.
pub type Point = [f64; COUNT];

/// Bounds of each parameter; `lower == upper` holds it at that value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Lower ends, table order.
    pub lower: Point,
    /// Upper ends, table order.
    pub upper: Point,
}

impl Default for Bounds {
    /// The paper's box (Table 2).
    fn default() -> Self {
        Self { lower: TABLE.map(|p| p.lower), upper: TABLE.map(|p| p.upper) }
    }
}

impl Bounds {
    /// Whether parameter `i` is held at one value.
    pub fn is_held(&self, i: usize) -> bool {
        self.lower[i] >= self.upper[i]
    }

    /// Maps a point to `[0, 1]` per parameter (paper Eq. 3); a held parameter maps to 0.
    pub fn to_unit(&self, x: &Point) -> Point {
        std::array::from_fn(|i| {
            let span = self.upper[i] - self.lower[i];
            if span > 0.0 { (x[i] - self.lower[i]) / span } else { 0.0 }
        })
    }

    /// The inverse of [`Bounds::to_unit`].
    pub fn from_unit(&self, u: &Point) -> Point {
        std::array::from_fn(|i| self.lower[i] + (self.upper[i] - self.lower[i]) * u[i])
    }
}

/// The four means the surrogate learns, in their one order: name of the scaled
/// value, name of the value in SI units, symbol, what it is scaled by.
pub const OUTPUTS: [(&str, &str, &str, &str); 4] = [
    ("lift", "lift_n", "L+", "W"),
    ("drag", "drag_n", "D+", "W"),
    ("pitch_moment", "pitch_moment_nm", "M+", "W c"),
    ("power", "power_w", "P+", "P0"),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unit_mapping_round_trips_and_holds() {
        let mut bounds = Bounds::default();
        (bounds.lower[1], bounds.upper[1]) = (15.0, 15.0);
        let x = bounds.from_unit(&[0.25; COUNT]);
        assert_eq!(x[1], 15.0);
        let u = bounds.to_unit(&x);
        for i in (0..COUNT).filter(|&i| i != 1) {
            assert!((u[i] - 0.25).abs() < 1e-14);
        }
    }

    #[test]
    fn a_parameter_has_one_name_however_it_is_written() {
        let spelt = ["f", "beta", "phi0", "theta_0", "Alpha0", "phi_a", "theta-a", "alphaa", "K", "c"];
        for (i, p) in TABLE.iter().enumerate() {
            for text in [p.name, p.symbol, spelt[i], &p.name.replace('_', "-"), &p.name.to_uppercase()] {
                assert_eq!(find(text), Some(i), "{text}");
            }
        }
        assert_eq!([find(""), find("phi"), find("frequency")], [None; 3]);
    }

    #[test]
    fn the_papers_box_lies_inside_what_the_model_accepts() {
        for p in &TABLE {
            assert!(p.least <= p.lower && p.lower < p.upper && p.upper <= p.most, "{}", p.name);
        }
        assert_eq!(index("rotation_shape"), Some(at::ROTATION_SHAPE));
    }
}
