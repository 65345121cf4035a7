//! A flight step by step: its rows and the vortex rings of chosen steps, as they
//! are written to files.

use manduca_numerics::history::{Instant, Wake};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::point::ParameterValues;

/// Declares a row which is also a table: its columns and cells are its fields.
macro_rules! row {
    ($(#[$meta:meta])* pub struct $name:ident { $($field:ident: $type:ty, $meaning:literal;)* }) => {
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
        pub struct $name {
            $(#[doc = $meaning] pub $field: $type,)*
        }

        impl $name {
            /// Names of the fields in their order: the header of a CSV file.
            pub const COLUMNS: &'static [&'static str] = &[$(stringify!($field)),*];

            /// The fields as text, numbers so that they are read back as the same.
            pub fn cells(&self) -> Vec<String> {
                vec![$(self.$field.to_string()),*]
            }
        }
    };
}

row! {
    /// One step of a flight, both wings. Means over a stroke's rows, weighted by `share`, are
    /// that stroke's means.
    pub struct HistoryRow {
        stroke: u32, "Number of the stroke, from 1.";
        step: u32, "Number of the step in its stroke, from 0.";
        phase: f64, "Time since the stroke began, in strokes.";
        share: f64, "Weight of the step in means over its stroke; those of a stroke sum to one.";
        time_s: f64, "Time since the flight began, s.";
        sweep_deg: f64, "Sweep, positive forward.";
        elevation_deg: f64, "Elevation above the stroke plane.";
        rotation_deg: f64, "Rotation, from the stroke plane to the chord.";
        sweep_rate_deg_s: f64, "Rate of sweep, degrees per second.";
        elevation_rate_deg_s: f64, "Rate of elevation, degrees per second.";
        rotation_rate_deg_s: f64, "Rate of rotation, degrees per second.";
        lift_n: f64, "Lift, up, N.";
        drag_n: f64, "Drag, rearward, N.";
        pitch_moment_nm: f64, "Pitching moment about the centre of mass, nose up, N m.";
        power_w: f64, "Power required: the sum over the joints, W.";
        sweep_aerodynamic_w: f64, "Power of the sweep against the air, W.";
        sweep_inertial_w: f64, "Power of the sweep against the wing's inertia, W.";
        sweep_required_w: f64, "Positive part of their sum, less what a spring returns, W.";
        elevation_aerodynamic_w: f64, "Power of the elevation against the air, W.";
        elevation_inertial_w: f64, "Power of the elevation against the wing's inertia, W.";
        elevation_required_w: f64, "Positive part of their sum, less what a spring returns, W.";
        rotation_aerodynamic_w: f64, "Power of the rotation against the air, W.";
        rotation_inertial_w: f64, "Power of the rotation against the wing's inertia, W.";
        rotation_required_w: f64, "Positive part of their sum, less what a spring returns, W.";
    }
}

fn count(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}

impl From<&Instant> for HistoryRow {
    fn from(instant: &Instant) -> Self {
        let (moment, shown) = (&instant.moment, &instant.moment.snapshot);
        let [sweep, elevation, rotation] = &shown.angles;
        let joints = &shown.joints;
        Self {
            stroke: count(moment.stroke),
            step: count(moment.step),
            phase: moment.phase,
            share: moment.share,
            time_s: instant.time_s,
            sweep_deg: sweep.value.to_degrees(),
            elevation_deg: elevation.value.to_degrees(),
            rotation_deg: rotation.value.to_degrees(),
            sweep_rate_deg_s: sweep.rate.to_degrees(),
            elevation_rate_deg_s: elevation.rate.to_degrees(),
            rotation_rate_deg_s: rotation.rate.to_degrees(),
            lift_n: shown.lift_n,
            drag_n: shown.drag_n,
            pitch_moment_nm: shown.moment_nm,
            power_w: joints.iter().map(|j| j.required_w).sum(),
            sweep_aerodynamic_w: joints[0].aerodynamic_w,
            sweep_inertial_w: joints[0].inertial_w,
            sweep_required_w: joints[0].required_w,
            elevation_aerodynamic_w: joints[1].aerodynamic_w,
            elevation_inertial_w: joints[1].inertial_w,
            elevation_required_w: joints[1].required_w,
            rotation_aerodynamic_w: joints[2].aerodynamic_w,
            rotation_inertial_w: joints[2].inertial_w,
            rotation_required_w: joints[2].required_w,
        }
    }
}

/// The history of a flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct History {
    /// The stroke flown.
    pub parameters: ParameterValues,
    /// Strokes at the beginning which are not in the means of the flight.
    pub strokes_dropped: u32,
    /// Version of the numbers.
    pub solver_version: String,
    /// Why the flight broke off or was not begun, where that is so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub infeasible: Option<String>,
    /// Every step flown, in order.
    pub rows: Vec<HistoryRow>,
}

/// What the numbers of [`WakeStep`] are measured in; it travels with them.
pub const AXES: &str = "earth axes, m: x forward, y to the left, z up; origin midway between the hinges; \
the stroke plane is tilted in them by stroke_plane_deg, forward edge down";
/// Whose rings they are.
pub const SIDE: &str = "the left wing and its wake; the right wing's are the mirror image in y = 0, \
where every circulation turns the other way";
/// Which way circulations turn.
pub const SENSE: &str = "m2/s per ring; positive runs from node (row, column + 1) to (row, column) and on to \
(row + 1, column); each ring's strength is added on the edges it shares";

/// The vortex rings of one step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WakeStep {
    /// Number of the stroke, from 1.
    pub stroke: u32,
    /// Number of the step in its stroke, from 0.
    pub step: u32,
    /// Time since the stroke began, in strokes.
    pub phase: f64,
    /// Time since the flight began, s.
    pub time_s: f64,
    /// Rows of nodes on the wing, from the leading edge; the last is the line from
    /// which the wake springs. The rows after it are wake, from young to old.
    pub wing_rows: u32,
    /// Corners of the rings: rows of nodes from root to tip, each `[x, y, z]`.
    #[schema(value_type = Vec<Vec<Vec<f64>>>)]
    pub nodes: Vec<Vec<[f64; 3]>>,
    /// Circulation of each ring, m²/s: one row and one column fewer than nodes.
    pub circulation_m2_s: Vec<Vec<f64>>,
}

impl From<&Wake> for WakeStep {
    fn from(wake: &Wake) -> Self {
        Self {
            stroke: count(wake.stroke),
            step: count(wake.step),
            phase: wake.phase,
            time_s: wake.time_s,
            wing_rows: count(wake.wing_rows),
            nodes: wake.corners.chunks(wake.columns).map(<[_]>::to_vec).collect(),
            circulation_m2_s: wake.circulation.chunks(wake.columns - 1).map(<[_]>::to_vec).collect(),
        }
    }
}

/// The vortex rings of chosen steps of a flight, and how to read them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct WakeHistory {
    /// [`AXES`].
    pub axes: String,
    /// [`SIDE`].
    pub side: String,
    /// [`SENSE`].
    pub circulation: String,
    /// The stroke flown.
    pub parameters: ParameterValues,
    /// Version of the numbers.
    pub solver_version: String,
    /// Why the flight broke off or was not begun, where that is so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub infeasible: Option<String>,
    /// The steps in order; those never reached are missing.
    pub steps: Vec<WakeStep>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use manduca_numerics::balance::Snapshot;
    use manduca_numerics::kinematics::Angle;
    use manduca_numerics::simulation::{JointPower, Moment};

    fn row() -> HistoryRow {
        let angle =
            |degrees: f64| Angle { value: degrees.to_radians(), rate: -degrees.to_radians(), acceleration: 0.0 };
        let joint = |w: f64| JointPower { aerodynamic_w: w, inertial_w: 10.0 * w, required_w: 100.0 * w };
        let snapshot = Snapshot {
            angles: [angle(10.0), angle(20.0), angle(90.0)],
            lift_n: 0.1,
            drag_n: 0.2,
            moment_nm: 0.3,
            joints: [joint(1.0), joint(2.0), joint(4.0)],
        };
        HistoryRow::from(&Instant {
            time_s: 0.25,
            moment: Moment { stroke: 2, step: 3, phase: 0.5, share: 0.125, snapshot },
        })
    }

    #[test]
    fn every_value_lands_under_its_name() {
        let json = serde_json::to_value(row()).unwrap();
        for (name, value) in [
            ("stroke", 2.0),
            ("step", 3.0),
            ("phase", 0.5),
            ("share", 0.125),
            ("time_s", 0.25),
            ("elevation_deg", 20.0),
            ("rotation_rate_deg_s", -90.0),
            ("lift_n", 0.1),
            ("drag_n", 0.2),
            ("pitch_moment_nm", 0.3),
            ("power_w", 700.0),
            ("sweep_aerodynamic_w", 1.0),
            ("elevation_inertial_w", 20.0),
            ("rotation_required_w", 400.0),
        ] {
            assert!((json[name].as_f64().unwrap() - value).abs() < 1e-12, "{name}: {}", json[name]);
        }
        assert_eq!(serde_json::from_value::<HistoryRow>(json).unwrap(), row());
    }

    #[test]
    fn cells_are_the_columns_and_lose_nothing() {
        let (row, cells) = (row(), row().cells());
        assert_eq!(cells.len(), HistoryRow::COLUMNS.len());
        let json = serde_json::to_value(row).unwrap();
        assert_eq!(json.as_object().unwrap().len(), cells.len());
        for (name, cell) in HistoryRow::COLUMNS.iter().zip(cells) {
            assert_eq!(cell.parse::<f64>().unwrap(), json[*name].as_f64().unwrap(), "{name}");
        }
    }

    #[test]
    fn rings_are_rows_of_nodes() {
        let corners: Vec<[f64; 3]> = (0..6).map(|i| [f64::from(i), 0.0, 0.0]).collect();
        let circulation = vec![7.0, 8.0];
        let wake = Wake { stroke: 1, step: 0, phase: 0.0, time_s: 0.0, columns: 3, wing_rows: 2, corners, circulation };
        let step = WakeStep::from(&wake);
        assert_eq!((step.nodes.len(), step.nodes[1][0][0]), (2, 3.0));
        assert_eq!(step.circulation_m2_s, [[7.0, 8.0]]);
    }
}
