//! What the air does not know: where it is, when it is, which way is up, and
//! whether the wing moves or the axes. All to rounding.

use manduca_numerics::insect::Insect;
use manduca_numerics::kinematics::{Attitude, ElevationPhase, Stroke, Vector};
use manduca_numerics::math::sin_cos;
use manduca_numerics::parameters::Point;
use manduca_numerics::uvlm::{Air, Planform, Pose, Settings, Solver, WingLoad, solver_of};

use super::scheme::Scheme;
use crate::check::{Expected, Group, Row, Setup};

/// A stroke without symmetry of its own.
pub const STROKE: Point = [26.0, 15.0, -6.0, 3.0, 8.0, 55.0, 7.0, 55.0, 0.3, 1.3];
/// Strokes flown: just so many that the wing comes back to its wake, which with small
/// cores magnifies rounding.
const STROKES: f64 = 0.75;

/// What rounding may do: at the default settings the wake moves in single precision.
fn rounding(settings: &Settings) -> f64 {
    if settings.single_precision_wake == 1 { 1e-6 } else { 3e-8 }
}

/// A hawkmoth's wing flown along given poses.
struct Flight {
    settings: Settings,
    planform: Planform,
    stroke: Stroke,
    poses: Vec<Pose>,
}

impl Flight {
    /// `first` is the number of the stroke's first step: whole strokes change nothing.
    fn new(settings: Settings, first: usize) -> Self {
        let insect = Insect::default();
        let stroke = Stroke::new(&STROKE, ElevationPhase::Plus);
        let steps = settings.steps_per_stroke;
        let pose = |step: usize| {
            let attitude = Attitude::new(&stroke.angles(step as f64 / steps as f64));
            Pose::hinged(insect.hinge_offset_m, &attitude)
        };
        let count = (STROKES * steps as f64) as usize;
        let poses = (first..first + count).map(pose).collect();
        Self { settings, planform: Planform::of_insect(&insect, &settings), stroke, poses }
    }

    fn changed(&self, change: impl Fn(usize, &Pose) -> Pose) -> Self {
        let poses = self.poses.iter().enumerate().map(|(i, pose)| change(i, pose)).collect();
        Self { poses, planform: self.planform.clone(), ..*self }
    }

    fn dt(&self) -> f64 {
        self.stroke.period() / self.settings.steps_per_stroke as f64
    }

    fn solver(&self, air: Air) -> Solver {
        let insect = Insect::default();
        let tip = insect.wing_length_m * 4.0 * STROKE[5].to_radians() * self.stroke.frequency;
        let speeds: Vec<f64> = self.planform.span.iter().map(|r| tip * r / insect.wing_length_m).collect();
        solver_of(&self.planform, &self.settings, insect.mean_chord_m, self.stroke.period(), &speeds, air)
    }

    fn loads(&self, air: Air) -> Vec<WingLoad> {
        let mut solver = self.solver(air);
        self.poses.iter().map(|pose| solver.step(pose, self.dt())).collect::<Option<_>>().unwrap_or_default()
    }
}

/// Still air of the standard density.
fn still() -> Air {
    Air::still(Insect::default().air_density_kg_m3)
}

/// Greatest difference of forces and of moments over their greatest sizes.
fn difference(a: &[WingLoad], b: &[WingLoad], turned: impl Fn(&WingLoad) -> WingLoad) -> f64 {
    if a.is_empty() || a.len() != b.len() {
        return f64::NAN;
    }
    let most = |f: &dyn Fn(&WingLoad) -> f64| a.iter().map(f).fold(0.0, f64::max);
    let (force, moment) = (most(&|l| l.force.norm()), most(&|l| l.moment.norm()));
    let off = a.iter().zip(b).map(|(a, b)| {
        let a = turned(a);
        ((a.force - b.force).norm() / force).max((a.moment - b.moment).norm() / moment)
    });
    off.fold(0.0, f64::max)
}

/// Turned nose up about y.
fn rotated(v: &Vector, angle: f64) -> Vector {
    let (s, c) = sin_cos(angle);
    Vector::new(c * v.x - s * v.z, v.y, s * v.x + c * v.z)
}

fn rotation(flight: &Flight) -> f64 {
    let angle = 0.7;
    let turn = |v: &Vector| rotated(v, angle);
    let other = flight.changed(|_, p| Pose {
        origin: turn(&p.origin),
        e_r: turn(&p.e_r),
        e_c: turn(&p.e_c),
        velocity: turn(&p.velocity),
        omega: turn(&p.omega),
    });
    difference(&flight.loads(still()), &other.loads(still()), |l| WingLoad {
        force: turn(&l.force),
        moment: turn(&l.moment),
    })
}

/// The motion seen in a vertical mirror across the stroke; turning vectors change sign with it.
fn mirror(flight: &Flight) -> f64 {
    let seen = |v: &Vector| Vector::new(-v.x, v.y, v.z);
    let turning = |v: &Vector| Vector::new(v.x, -v.y, -v.z);
    let other = flight.changed(|_, p| Pose {
        origin: seen(&p.origin),
        e_r: seen(&p.e_r),
        e_c: seen(&p.e_c),
        velocity: seen(&p.velocity),
        omega: turning(&p.omega),
    });
    difference(&flight.loads(still()), &other.loads(still()), |l| WingLoad {
        force: seen(&l.force),
        moment: turning(&l.moment),
    })
}

/// Seven strokes later and six wing lengths away.
fn shift(flight: &Flight) -> f64 {
    let away = Vector::new(0.25, 0.0, -0.15);
    let later = Flight::new(flight.settings, 7 * flight.settings.steps_per_stroke);
    let other = later.changed(|_, p| Pose { origin: p.origin + away, ..*p });
    difference(&flight.loads(still()), &other.loads(still()), |l| *l)
}

/// The wing flies through the air, or its axes do.
fn axes(flight: &Flight) -> f64 {
    let velocity = Vector::new(0.8, 0.0, -0.3);
    let dt = flight.dt();
    let flying =
        flight.changed(|i, p| Pose { origin: p.origin + velocity * (i as f64 * dt), velocity, ..*p }).loads(still());
    let carried = flight.loads(Air { velocity, ..still() });
    difference(&flying, &carried, |l| *l)
}

/// Circulation: every ring of the wake keeps what the edge had when it was shed, so that bound
/// circulation and starting vortices, which are the differences of successive rings, add up to
/// nothing. Greatest difference over the greatest circulation.
fn kelvin(flight: &Flight) -> f64 {
    // Joined rings carry a mean of what was shed.
    let settings = Settings { wake_joined_after: 20.0, ..flight.settings };
    let mut solver = Flight::new(settings, 0).solver(still());
    let strips = solver.lattice().strips;
    // Trailing-edge circulation of every step, newest first.
    let mut shed: Vec<Vec<f64>> = Vec::new();
    let (mut off, mut most) = (0.0_f64, 0.0_f64);
    for pose in &flight.poses {
        if solver.step(pose, flight.dt()).is_none() {
            return f64::NAN;
        }
        let bound = solver.circulation();
        shed.insert(0, bound[bound.len() - strips..].to_vec());
        let rings = solver.rings();
        let edge = (rings.bound_rows - 2) * strips;
        let rows: Vec<&[f64]> = rings.circulation[edge..].chunks(strips).collect();
        for strip in 0..strips {
            most = most.max(shed[0][strip].abs());
            let kept = rows.iter().zip(&shed).map(|(row, then)| (row[strip] - then[strip]).abs());
            off = kept.fold(off, f64::max);
        }
    }
    off / most
}

/// The checks.
pub fn group() -> Group {
    type Check = (&'static str, fn(&Flight) -> f64, fn(&Settings) -> f64);
    let checks: [Check; 5] = [
        ("motion turned by 0.7 rad in the plane of symmetry", rotation, rounding),
        ("motion seen in a mirror, fore and aft", mirror, rounding),
        ("seven strokes later, six wing lengths away", shift, rounding),
        ("wing flies or its axes do (0.85 m/s)", axes, rounding),
        ("Kelvin: bound circulation and starting vortices", kelvin, |_| 1e-12),
    ];
    let fine = Settings { spanwise_panels: 10, steps_per_stroke: 64, ..Scheme::fine(0.05, 0.125, 8).settings };
    let schemes = [(Setup::Fine, fine), (Setup::Production, Settings::default())];
    let rows = schemes.into_iter().flat_map(|(setup, settings)| {
        let flight = Flight::new(settings, 0);
        checks.map(|(what, difference, limit)| Row {
            what: what.to_owned(),
            source: "exact laws",
            setup,
            expected: Expected::Below(limit(&settings)),
            got: difference(&flight),
        })
    });
    Group {
        title: "Invariants",
        about: "Three quarters of the first stroke of a hawkmoth's wing, kinematics without any symmetry: greatest difference of force \
                and moment at any step over the greatest force and moment. Kelvin: circulation, over the greatest. \
                Fine: 8 x 10 panels, 64 steps and cores of 0.05 c, with which a wake that meets the wing again magnifies \
                rounding (on narrower strips it is chaos); default: the wake moves in single precision."
            .to_owned(),
        rows: rows.collect(),
    }
}
