//! Whole numbers as people write them: `100000`, and `1e5` or `100000.0`, which formats call fractions.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{Error, Unexpected, Visitor};
use serde::{Deserialize, Deserializer};

/// Largest whole number up to which every whole number is a double.
const EXACT: f64 = 9_007_199_254_740_992.0;

/// Reads a whole number, also one written as a fraction.
///
/// # Errors
/// When it is none, or `T` does not hold it.
pub(crate) fn number<'de, T: TryFrom<u64>, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
    struct Whole<T>(PhantomData<T>);
    impl<T: TryFrom<u64>> Whole<T> {
        fn of<E: Error>(&self, value: u64) -> Result<T, E> {
            T::try_from(value).map_err(|_| E::invalid_value(Unexpected::Unsigned(value), self))
        }
    }
    impl<T: TryFrom<u64>> Visitor<'_> for Whole<T> {
        type Value = T;
        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            let most = if size_of::<T>() == size_of::<u32>() { u64::from(u32::MAX) } else { u64::MAX };
            write!(f, "a whole number from 0 to {most}")
        }
        fn visit_u64<E: Error>(self, value: u64) -> Result<T, E> {
            self.of(value)
        }
        fn visit_i64<E: Error>(self, value: i64) -> Result<T, E> {
            let positive = u64::try_from(value).map_err(|_| E::invalid_value(Unexpected::Signed(value), &self))?;
            self.of(positive)
        }
        fn visit_f64<E: Error>(self, value: f64) -> Result<T, E> {
            if value.fract() != 0.0 || !(0.0..=EXACT).contains(&value) {
                return Err(E::invalid_value(Unexpected::Float(value), &self));
            }
            self.of(value as u64)
        }
    }
    deserializer.deserialize_u64(Whole(PhantomData))
}

/// Reads such a number, or null.
///
/// # Errors
/// As [`number`].
pub(crate) fn optional<'de, T: TryFrom<u64>, D: Deserializer<'de>>(deserializer: D) -> Result<Option<T>, D::Error> {
    struct Given<T>(T);
    impl<'de, T: TryFrom<u64>> Deserialize<'de> for Given<T> {
        fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
            number(deserializer).map(Self)
        }
    }
    Ok(Option::<Given<T>>::deserialize(deserializer)?.map(|given| given.0))
}

#[cfg(test)]
mod tests {
    use crate::study::StudySpec;

    fn samples(text: &str) -> Result<u32, String> {
        let json = format!(r#"{{"name":"a","sampling":{{"samples":{text}}}}}"#);
        let toml = format!("name = \"a\"\n[sampling]\nsamples = {text}\n");
        let by_json = serde_json::from_str::<StudySpec>(&json).map_err(|e| e.to_string());
        let by_toml = toml::from_str::<StudySpec>(&toml).map_err(|e| e.message().to_owned());
        let both = (by_json.map(|s| s.sampling.samples), by_toml.map(|s| s.sampling.samples));
        assert_eq!(both.0.clone().ok(), both.1.ok(), "{text}");
        both.0
    }

    #[test]
    fn a_whole_number_may_be_written_as_a_fraction() {
        assert_eq!([samples("100000"), samples("1e5"), samples("100000.0")], [const { Ok(100_000) }; 3]);
        for (text, told) in [("1e5", ""), ("0.5", "0.5"), ("-1", "-1"), ("1e10", "10000000000"), ("-1.0", "-1")] {
            let fault = samples(text).err().unwrap_or_default();
            assert!(fault.contains(told) && fault.is_empty() == told.is_empty(), "{text}: {fault}");
            assert!(told.is_empty() || fault.contains("a whole number from 0 to 4294967295"), "{text}: {fault}");
        }
    }

    #[test]
    fn every_count_of_a_study_is_read_so() {
        let text = "name = \"a\"\nseed = 2e3\n[sampling]\nsamples = 30.0\n[surrogate]\nneurons = 1e1\n\
                    [[optimisations]]\nname = \"b\"\npopulation = 1e4\nstarts = 5.0\n";
        let spec: StudySpec = toml::from_str(text).unwrap();
        let optimisation = &spec.optimisations[0];
        assert_eq!((spec.seed, spec.surrogate.neurons), (2000, 10));
        assert_eq!(
            (optimisation.population, optimisation.starts, optimisation.generations),
            (Some(10_000), 5, Some(300))
        );
    }
}
