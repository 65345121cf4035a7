//! How far each vortex segment is spread, by who looks at it and how old it is.

/// Core radii, m, and the time in which the wake's core develops.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cores {
    /// Bound segments and the edge line as the wing sees them.
    pub bound: f64,
    /// Bound segments as the wake sees them.
    pub bound_on_wake: f64,
    /// Wake as the wake sees it.
    pub wake_on_wake: f64,
    /// Wake just shed as the wing sees it.
    pub fresh_on_wing: f64,
    /// Developed wake as the wing sees it.
    pub developed_on_wing: f64,
    /// What wake gains where it lies over the wing, as the wing sees it; 0 for nothing.
    pub over_wing: f64,
    /// Time constant between the two, s.
    pub growth_time: f64,
    /// Growth of the squared core of all wake with age, m²/s.
    pub spreading: f64,
}

impl Cores {
    /// One small core for everything, for wakes which do not come back.
    pub fn uniform(radius: f64) -> Self {
        Self {
            bound: radius,
            bound_on_wake: radius,
            wake_on_wake: radius,
            fresh_on_wing: radius,
            developed_on_wing: radius,
            over_wing: 0.0,
            growth_time: 1.0,
            spreading: 0.0,
        }
    }

    /// Core of wake of an age in seconds as the wake sees it: rc² = rw² + s age.
    pub(super) fn on_wake(&self, age: f64) -> f64 {
        (self.wake_on_wake.powi(2) + self.spreading * age).sqrt()
    }

    /// Core of wake of an age t in seconds as the wing sees it:
    /// rc² = (rn + (rw - rn)(1 - exp(-t/τ)))² + s t (1 - exp(-t²/τ²)). Near the edge it
    /// grows in proportion to age, hence to distance; as the root of age it would blur
    /// the edge's own wake more with every shorter step.
    pub(super) fn on_wing(&self, age: f64) -> f64 {
        let grown = 1.0 - crate::math::exp(-age / self.growth_time);
        let core = self.fresh_on_wing + (self.developed_on_wing - self.fresh_on_wing) * grown;
        let late = (age / self.growth_time).powi(2);
        let spread = self.spreading * age * (1.0 - crate::math::exp(-late));
        (core * core + spread).sqrt()
    }

    /// What the square of the core of wake gains as the wing sees it, m², a distance h `above` the
    /// wing's plane and a `ahead` of the trailing edge, m:
    ///
    /// Δrc² = ro² a² / (a² + ro²) (1 - h² / 4 ro²)²,  a > 0, h < 2 ro
    ///
    /// Behind the edge the wing sees its wake along the sheet, from farther than its rows lie apart. Where
    /// the edge goes forward the wing lies in the sheet or passes through it, and of a core smaller than
    /// the distance of rows or panels it would see single lines instead of a sheet.
    pub(super) fn over_wing2(&self, above: f64, ahead: impl FnOnce() -> f64) -> f64 {
        let core2 = self.over_wing * self.over_wing;
        let far = above * above / (4.0 * core2);
        // Nearly all wake is far, or there is no such core and `far` no number.
        if far.is_nan() || far >= 1.0 {
            return 0.0;
        }
        let ahead = ahead().max(0.0);
        core2 * ahead * ahead / (ahead * ahead + core2) * (1.0 - far).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cores_grow_with_age_as_documented() {
        let cores = Cores {
            bound: 0.001,
            bound_on_wake: 0.1,
            wake_on_wake: 0.25,
            fresh_on_wing: 0.01,
            developed_on_wing: 0.3,
            over_wing: 0.1,
            growth_time: 0.5,
            spreading: 1.0,
        };
        assert_eq!((cores.on_wing(0.0), cores.on_wake(0.0)), (0.01, 0.25));
        // In proportion to age at first: twice the age, twice the growth.
        let grown = |age: f64| cores.on_wing(age) - 0.01;
        assert!((grown(2e-3) / grown(1e-3) - 2.0).abs() < 0.01);
        // Spread to one length after one unit of time, on top of what it was.
        assert!((cores.on_wake(1.0) - (0.25_f64.powi(2) + 1.0).sqrt()).abs() < 1e-15);
        assert!((cores.on_wing(40.0) - (0.3_f64.powi(2) + 40.0).sqrt()).abs() < 1e-9);
        // Nothing behind the edge and two cores above the wing, all of it far ahead and close by.
        for (above, ahead) in [(0.0, 0.0), (0.0, -0.1), (0.2, 0.5), (-0.3, 0.5)] {
            assert_eq!(cores.over_wing2(above, || ahead), 0.0, "{above} {ahead}");
        }
        assert!((cores.over_wing2(0.0, || 0.1) - 0.005).abs() < 1e-15);
        assert!((cores.over_wing2(0.1, || 1e6) - 0.01 * 0.75_f64.powi(2)).abs() < 1e-12);
        for above in [0.0, 0.1] {
            assert_eq!(Cores { over_wing: 0.0, ..cores }.over_wing2(above, || 0.1), 0.0);
        }
    }
}
