//! The ten parameters on the wire: an object with ten named numbers.

use manduca_numerics::parameters::{COUNT, Point, TABLE, index};
use serde::de::{Error, MapAccess, Visitor};
use serde::ser::SerializeMap;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use utoipa::openapi::RefOr;
use utoipa::openapi::schema::{Object, ObjectBuilder, Schema, Type};
use utoipa::{PartialSchema, ToSchema};

/// Ten parameter values, all required, in table units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParameterValues(pub Point);

impl Serialize for ParameterValues {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(COUNT))?;
        for (p, value) in TABLE.iter().zip(&self.0) {
            map.serialize_entry(p.name, value)?;
        }
        map.end()
    }
}

impl<'de> Deserialize<'de> for ParameterValues {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Named;
        impl<'de> Visitor<'de> for Named {
            type Value = ParameterValues;
            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                write!(f, "an object with the ten parameters by name")
            }
            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
                let mut values = [None; COUNT];
                while let Some(name) = map.next_key::<String>()? {
                    let i = index(&name).ok_or_else(|| A::Error::custom(format!("unknown parameter `{name}`")))?;
                    if values[i].replace(map.next_value::<f64>()?).is_some() {
                        return Err(A::Error::custom(format!("parameter `{name}` given twice")));
                    }
                }
                let mut point = [0.0; COUNT];
                for (i, value) in values.into_iter().enumerate() {
                    point[i] =
                        value.ok_or_else(|| A::Error::custom(format!("parameter `{}` is missing", TABLE[i].name)))?;
                }
                Ok(ParameterValues(point))
            }
        }
        deserializer.deserialize_map(Named)
    }
}

impl PartialSchema for ParameterValues {
    fn schema() -> RefOr<Schema> {
        let mut object = ObjectBuilder::new().schema_type(Type::Object);
        for p in &TABLE {
            let number = Object::with_type(Type::Number);
            let number =
                ObjectBuilder::from(number).description(Some(format!("{} {} [{}]", p.symbol, p.meaning, p.unit)));
            object = object.property(p.name, number).required(p.name);
        }
        object.into()
    }
}

impl ToSchema for ParameterValues {}
