//! Optima under further bounds.

use crate::optimise::OptimiseError;
use crate::optimise::sqp::{Flight, LocalOptimum, SqpSettings, minimise};
use crate::parameters::{COUNT, TABLE};
use std::ops::ControlFlow;

/// Which bound of the parameter is moved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The parameter must be at least the limit.
    Lower,
    /// The parameter must be at most the limit.
    Upper,
}

/// One point of a front.
#[derive(Debug, Clone, PartialEq)]
pub struct FrontPoint {
    /// The bound.
    pub limit: f64,
    /// Least power under it; none where no stroke in trim was found.
    pub optimum: Option<LocalOptimum>,
}

/// The optimum without a further bound, and a point with its side for each limit.
pub type WholeFront = (LocalOptimum, Vec<(Side, FrontPoint)>);

/// Least power against a bound of one parameter: the epsilon-constraint front (Haimes,
/// Lasdon & Wismer 1971) of power and that parameter.
///
/// Each limit is searched for itself. A tighter bound cannot cost less power; where it
/// seems to, a wider search missed its optimum.
///
/// # Errors
/// When a limit lies outside the box, or settings are out of range.
pub fn front(
    flight: &Flight<'_>,
    settings: &SqpSettings,
    (parameter, side): (usize, Side),
    limits: &[f64],
) -> Result<Vec<FrontPoint>, OptimiseError> {
    let point = |&limit: &f64| {
        inside(flight, parameter, limit)?;
        let mut flight = *flight;
        match side {
            Side::Lower => flight.bounds.lower[parameter] = limit,
            Side::Upper => flight.bounds.upper[parameter] = limit,
        }
        Ok(FrontPoint { limit, optimum: best(&flight, settings)? })
    };
    limits.iter().map(point).collect()
}

/// The whole front about the optimum: limits below its value bound the parameter from above,
/// limits above it from below, so that every limit asks for something.
///
/// Returns the optimum without a further bound, and a point with its side for each limit, in their order; none when
/// `on`, asked before each search, said not to go on.
///
/// # Errors
/// As [`front`], and when no stroke of the box is in trim.
pub fn whole_front(
    flight: &Flight<'_>,
    settings: &SqpSettings,
    parameter: usize,
    limits: &[f64],
    on: &dyn Fn() -> bool,
) -> Result<Option<WholeFront>, OptimiseError> {
    let optimum = best(flight, settings)?.ok_or(OptimiseError::NothingConverged { starts: settings.starts })?;
    let point = |limit: f64| {
        inside(flight, parameter, limit)?;
        let side = if limit < optimum.point[parameter] { Side::Upper } else { Side::Lower };
        let found = front(flight, settings, (parameter, side), &[limit])?.pop();
        Ok((side, found.unwrap_or(FrontPoint { limit, optimum: None })))
    };
    let mut points = Vec::with_capacity(limits.len());
    for &limit in limits {
        if !on() {
            return Ok(None);
        }
        points.push(point(limit)?);
    }
    Ok(Some((optimum, points)))
}

/// Limits evenly spread over a parameter's bounds, both among them.
pub fn even_limits((lower, upper): (f64, f64), points: u32) -> Vec<f64> {
    let most = f64::from(points.saturating_sub(1));
    let even = |i: u32| if i + 1 == points { upper } else { lower + (upper - lower) * f64::from(i) / most };
    (0..points).map(even).collect()
}

/// Least power with parameters held at values, `(place in the table, value)`; none where no
/// stroke in trim was found. The paper's case II holds stroke plane, mean elevation and
/// elevation amplitude.
///
/// # Errors
/// When a value lies outside the box, or settings are out of range.
pub fn held(
    flight: &Flight<'_>,
    settings: &SqpSettings,
    values: &[(usize, f64)],
) -> Result<Option<LocalOptimum>, OptimiseError> {
    let mut narrowed = *flight;
    for &(parameter, value) in values {
        inside(flight, parameter, value)?;
        (narrowed.bounds.lower[parameter], narrowed.bounds.upper[parameter]) = (value, value);
    }
    best(&narrowed, settings)
}

fn inside(flight: &Flight<'_>, parameter: usize, value: f64) -> Result<(), OptimiseError> {
    let (lower, upper) = (flight.bounds.lower, flight.bounds.upper);
    if parameter < COUNT && (lower[parameter]..=upper[parameter]).contains(&value) {
        return Ok(());
    }
    let setting = TABLE.get(parameter).map_or("parameter", |row| row.name);
    Err(OptimiseError::Setting { setting, value, range: "inside the box" })
}

fn best(flight: &Flight<'_>, settings: &SqpSettings) -> Result<Option<LocalOptimum>, OptimiseError> {
    match minimise(flight, settings, &mut |_| ControlFlow::Continue(())) {
        Ok(found) => Ok(Some(found.best().clone())),
        Err(OptimiseError::NothingConverged { .. }) => Ok(None),
        Err(error) => Err(error),
    }
}
