//! Structures whose fields are also a table: name, unit, range, default, meaning.
//!
//! One declaration gives the typed structure the solver reads and the rows from
//! which study files are checked, options are made and documentation is written.

/// A field of such a structure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Field {
    /// Name, also on the wire.
    pub name: &'static str,
    /// Unit, empty where dimensionless.
    pub unit: &'static str,
    /// Least value accepted.
    pub min: f64,
    /// Greatest value accepted.
    pub max: f64,
    /// Default.
    pub default: f64,
    /// Whether only whole numbers are accepted.
    pub whole: bool,
    /// What it is.
    pub meaning: &'static str,
}

/// Why a field was not set.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FieldError {
    /// There is no field of this name.
    #[error("unknown field; known are {known}")]
    Unknown {
        /// The names there are.
        known: String,
    },
    /// The value is NaN, infinite or out of range.
    #[error("{value} is outside {min} to {max}{unit}")]
    Range {
        /// The value given.
        value: f64,
        /// Least accepted.
        min: f64,
        /// Greatest accepted.
        max: f64,
        /// Unit with a leading space, or empty.
        unit: String,
    },
    /// The value is not a whole number.
    #[error("{value} is not a whole number")]
    NotWhole {
        /// The value given.
        value: f64,
    },
}

impl Field {
    /// Checks a value against this field's range.
    pub fn check(&self, value: f64) -> Result<(), FieldError> {
        if !(self.min..=self.max).contains(&value) {
            let unit = if self.unit.is_empty() { String::new() } else { format!(" {}", self.unit) };
            return Err(FieldError::Range { value, min: self.min, max: self.max, unit });
        }
        if self.whole && value != value.trunc() {
            return Err(FieldError::NotWhole { value });
        }
        Ok(())
    }
}

/// A type a table field may have.
pub trait Value: Copy {
    /// Whether the type holds whole numbers only.
    const WHOLE: bool;
    /// As a number.
    fn to_number(self) -> f64;
    /// From a number already checked.
    fn from_number(value: f64) -> Self;
}

impl Value for f64 {
    const WHOLE: bool = false;
    fn to_number(self) -> f64 {
        self
    }
    fn from_number(value: f64) -> Self {
        value
    }
}

impl Value for usize {
    const WHOLE: bool = true;
    fn to_number(self) -> f64 {
        self as f64
    }
    fn from_number(value: f64) -> Self {
        value as usize
    }
}

/// A structure with a table.
pub trait Table: Sized + Default {
    /// The rows, in order of declaration.
    const FIELDS: &'static [Field];

    /// The value of a field.
    fn get(&self, name: &str) -> Option<f64>;

    /// Sets a field, checked against its row.
    ///
    /// # Errors
    /// When the name is unknown or the value is refused.
    fn set(&mut self, name: &str, value: f64) -> Result<(), FieldError>;

    /// Names and values in order of declaration.
    fn entries(&self) -> impl Iterator<Item = (&'static str, f64)> {
        Self::FIELDS.iter().filter_map(|f| Some((f.name, self.get(f.name)?)))
    }

    /// The error for a name which is not in the table.
    fn unknown() -> FieldError {
        let known: Vec<_> = Self::FIELDS.iter().map(|f| f.name).collect();
        FieldError::Unknown { known: known.join(", ") }
    }
}

/// Declares a structure and its table. Each field reads
/// `name: type = default, min..=max, "unit", "meaning";`.
macro_rules! table {
    (
        $(#[$meta:meta])*
        pub struct $name:ident {
            $($field:ident: $type:ty = $default:expr, $min:literal..=$max:literal, $unit:literal, $meaning:literal;)*
        }
    ) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct $name {
            $(#[doc = concat!($meaning, "; unit: `", $unit, "`.")] pub $field: $type,)*
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $default,)* }
            }
        }

        impl $crate::table::Table for $name {
            const FIELDS: &'static [$crate::table::Field] = &[$(
                $crate::table::Field {
                    name: stringify!($field),
                    unit: $unit,
                    min: $min as f64,
                    max: $max as f64,
                    default: $default as f64,
                    whole: <$type as $crate::table::Value>::WHOLE,
                    meaning: $meaning,
                },
            )*];

            fn get(&self, name: &str) -> Option<f64> {
                match name {
                    $(stringify!($field) => Some($crate::table::Value::to_number(self.$field)),)*
                    _ => None,
                }
            }

            fn set(&mut self, name: &str, value: f64) -> Result<(), $crate::table::FieldError> {
                let field = Self::FIELDS.iter().find(|f| f.name == name).ok_or_else(Self::unknown)?;
                field.check(value)?;
                match name {
                    $(stringify!($field) => self.$field = $crate::table::Value::from_number(value),)*
                    _ => return Err(Self::unknown()),
                }
                Ok(())
            }
        }
    };
}
pub(crate) use table;
