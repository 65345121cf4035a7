//! Objects read strictly. Serde would take a list for an object, its fields in
//! their order, and the last of several entries of a map under one name; in a
//! study either is a mistake.

use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;

use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};

/// Reads an object, which must not be a list.
///
/// # Errors
/// When it is none, or its fields are not those of `T`.
pub fn object<'de, T: Deserialize<'de>, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
    struct Fields<T>(PhantomData<T>);
    impl<'de, T: Deserialize<'de>> Visitor<'de> for Fields<T> {
        type Value = T;
        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("an object with named fields")
        }
        fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<T, A::Error> {
            T::deserialize(MapAccessDeserializer::new(map))
        }
    }
    deserializer.deserialize_map(Fields(PhantomData))
}

/// Reads a list of such objects.
pub(crate) fn objects<'de, T: Deserialize<'de>, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<T>, D::Error> {
    struct Item<T>(T);
    impl<'de, T: Deserialize<'de>> Deserialize<'de> for Item<T> {
        fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
            object(deserializer).map(Item)
        }
    }
    Ok(Vec::<Item<T>>::deserialize(deserializer)?.into_iter().map(|item| item.0).collect())
}

/// Reads a map which has each name once.
pub(crate) fn map<'de, T: Deserialize<'de>, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<BTreeMap<String, T>, D::Error> {
    struct Entries<T>(PhantomData<T>);
    impl<'de, T: Deserialize<'de>> Visitor<'de> for Entries<T> {
        type Value = BTreeMap<String, T>;
        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("an object")
        }
        fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
            let mut entries = BTreeMap::new();
            while let Some(name) = map.next_key::<String>()? {
                if entries.contains_key(&name) {
                    return Err(A::Error::custom(format!("duplicate field `{name}`")));
                }
                let value = map.next_value()?;
                entries.insert(name, value);
            }
            Ok(entries)
        }
    }
    deserializer.deserialize_map(Entries(PhantomData))
}

/// Most entries of a list with one per network or output.
const FEW: usize = 64;
/// Most individuals of a generation which survive.
const MOST_SURVIVORS: usize = 4 * crate::resolve::MAX_FLOWN_POPULATION as usize;

/// Reads a list of at most so many items; one which is longer is refused where it becomes so.
pub(crate) fn list<'de, const MOST: usize, T: Deserialize<'de>, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Vec<T>, D::Error> {
    struct Items<const MOST: usize, T>(PhantomData<T>);
    impl<'de, const MOST: usize, T: Deserialize<'de>> Visitor<'de> for Items<MOST, T> {
        type Value = Vec<T>;
        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            write!(f, "a list of at most {MOST} items")
        }
        fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Vec<T>, A::Error> {
            let mut read = Vec::new();
            while let Some(item) = items.next_element()? {
                if read.len() == MOST {
                    return Err(A::Error::custom(format!("has more than {MOST} items")));
                }
                read.push(item);
            }
            Ok(read)
        }
    }
    deserializer.deserialize_seq(Items::<MOST, T>(PhantomData))
}

/// Reads a list with an entry per network or output, where one is given.
pub(crate) fn few_given<'de, T: Deserialize<'de>, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<Option<Vec<T>>, D::Error> {
    list::<FEW, T, D>(deserializer).map(Some)
}

/// Reads the fitness of survivors, where it is given.
pub(crate) fn elite_given<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Vec<Option<f64>>>, D::Error> {
    list::<MOST_SURVIVORS, Option<f64>, D>(deserializer).map(Some)
}

#[cfg(test)]
mod tests {
    use crate::study::StudySpec;

    /// What is said of a good study with a part replaced.
    fn refusal(part: &str) -> String {
        let good = r#"{"name":"a","sampling":{"samples":30}}"#;
        assert!(serde_json::from_str::<StudySpec>(good).is_ok());
        let text = match part.strip_prefix("\"sampling\"") {
            Some(_) => format!(r#"{{"name":"a",{part}}}"#),
            None => format!(r#"{{"name":"a","sampling":{{"samples":30}},{part}}}"#),
        };
        serde_json::from_str::<StudySpec>(&text).unwrap_err().to_string()
    }

    #[test]
    fn a_list_is_no_object() {
        for part in [
            r#""sampling":[30,0]"#,
            r#""model":["uvlm"]"#,
            r#""surrogate":[80,100,6,0.8,0.1]"#,
            r#""optimisations":[["one"]]"#,
            r#""optimisations":[{"name":"one"},["two"]]"#,
        ] {
            let told = refusal(part);
            assert!(told.contains("invalid type: sequence, expected an object with named fields"), "{part}: {told}");
        }
    }

    #[test]
    fn a_name_is_given_once() {
        for (part, name) in [
            (r#""parameters":{"frequency_hz":20,"frequency_hz":30}"#, "frequency_hz"),
            (r#""model":{"solver":{"strokes":4,"strokes":8}}"#, "strokes"),
            (r#""model":{"insect_changes":{"mass_kg":1e-3,"mass_kg":1e-3}}"#, "mass_kg"),
            (r#""optimisations":[{"name":"a","parameters":{"sweep_shape":0,"sweep_shape":0}}]"#, "sweep_shape"),
            (r#""model":{},"model":{}"#, "model"),
        ] {
            let told = refusal(part);
            assert!(told.contains(&format!("duplicate field `{name}`")), "{part}: {told}");
        }
    }
}
