//! Numbers which look random and are the same in every run.

/// Marsaglia's xorshift.
#[derive(Debug)]
pub struct Chance(u64);

impl Chance {
    /// The sequence of a seed which is not zero.
    pub fn new(seed: u64) -> Self {
        assert_ne!(seed, 0, "zero stays zero");
        Self(seed)
    }

    /// The next number.
    #[expect(clippy::should_implement_trait, reason = "a sequence without an end needs no `Some`")]
    pub fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// True in so many of a hundred cases.
    pub fn in_hundred(&mut self, percent: u64) -> bool {
        // The lowest bits are the poorest.
        (self.next() >> 11) % 100 < percent
    }
}
