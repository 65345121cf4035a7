use super::*;
use crate::math::sin;
use crate::optimise::sqp::Differentiable;
use crate::parameters::{Bounds, COUNT, Point};
use crate::surrogate::Jacobian;

/// A made-up flight: lift grows with the first two, drag and moment vanish on a
/// curve, power is least inside; differences give the jacobian.
fn truth(x: &Point) -> [f64; 4] {
    let u = Bounds::default().to_unit(x);
    let rest: f64 = u[5..].iter().map(|v| (v - 0.3).powi(2)).sum();
    let lift = 0.4 + 0.9 * u[0] + 0.3 * u[1] * u[2];
    let drag = u[2] - 0.5 + 0.2 * sin(2.0 * u[3]);
    let moment = 0.5 * (u[3] - 0.4) + 0.3 * u[4] * u[1];
    let power = 0.3 + u[0].powi(2) + 0.5 * (u[1] - 0.2).powi(2) + rest + 0.1 * u[4];
    [lift, drag, moment, power]
}

/// A surrogate of it with errors of several per cent, largest where power is small.
fn surrogate(x: &Point) -> [f64; 4] {
    let (y, u) = (truth(x), Bounds::default().to_unit(x));
    [y[0] + 0.08 - 0.1 * u[1], y[1] + 0.05 * sin(3.0 * u[5]), y[2] - 0.04 * u[0], y[3] - 0.15 * (1.0 - u[0]) * u[9]]
}

/// One of these functions with its derivatives.
struct Smooth(fn(&Point) -> [f64; 4]);

impl Differentiable for Smooth {
    fn jacobians_into(&self, xs: &[Point], out: &mut [Jacobian]) {
        for (x, place) in xs.iter().zip(out) {
            *place = jacobian(&self.0, x);
        }
    }
}

fn jacobian(f: &dyn Fn(&Point) -> [f64; 4], x: &Point) -> Jacobian {
    let bounds = Bounds::default();
    let mut jacobian = [[0.0; COUNT]; 4];
    for i in 0..COUNT {
        let step = 1e-6 * (bounds.upper[i] - bounds.lower[i]);
        let (mut a, mut b) = (*x, *x);
        (a[i], b[i]) = (x[i] + step, x[i] - step);
        let (a, b) = (f(&a), f(&b));
        for k in 0..4 {
            jacobian[k][i] = (a[k] - b[k]) / (2.0 * step);
        }
    }
    (f(x), jacobian)
}

/// Augmented Lagrangian with projected gradient steps: slow, short and independent of the optimisers.
fn minimise(model: &dyn Differentiable, bounds: &Bounds, start: &Point) -> Option<Point> {
    let f = |x: &Point| {
        let mut out = [([0.0; 4], [[0.0; COUNT]; 4])];
        model.jacobians_into(std::slice::from_ref(x), &mut out);
        out[0]
    };
    let (mut x, mut price) = (*start, [0.0; 3]);
    for outer in 0..30 {
        let weight = 3.0 * (1.0 + f64::from(outer));
        for _ in 0..150 {
            let (y, j) = f(&x);
            let trim = [y[0] - 1.0, y[1], y[2]];
            for i in 0..COUNT {
                let width = Bounds::default().upper[i] - Bounds::default().lower[i];
                let slope = j[3][i] + (0..3).map(|k| (price[k] + weight * trim[k]) * j[k][i]).sum::<f64>();
                x[i] = (x[i] - 0.2 / weight * slope * width * width).clamp(bounds.lower[i], bounds.upper[i]);
            }
        }
        let y = f(&x).0;
        for (price, off) in price.iter_mut().zip([y[0] - 1.0, y[1], y[2]]) {
            *price += weight * off;
        }
    }
    Some(x)
}

fn tools() -> Tools<'static> {
    Tools { surrogate: &Smooth(surrogate), minimise: &minimise, clear: &|_| true }
}

/// Rounds until done: what is flown, why it ended, which is best, what was predicted of it.
fn refined(settings: &RefineSettings, fly: &dyn Fn(&Point) -> Option<[f64; 4]>) -> (Vec<Flown>, Next) {
    let bounds = Bounds::default();
    let fly = |x: &Point| Flown { x: *x, means: fly(x).map(|y| (y, [2e-4; 4])) };
    let centre = bounds.from_unit(&[0.5; COUNT]);
    let start = minimise(&Smooth(surrogate), &bounds, &centre).expect("a start");
    let mut flown = vec![fly(&start)];
    let mut region = Region { round: 0, radius: settings.radius, candidate: None };
    loop {
        match step(&tools(), &bounds, settings, &flown, &region) {
            Next::Fly { region: next, batch } => {
                flown.extend(batch.iter().map(fly));
                region = next;
            }
            done => return (flown, done),
        }
    }
}

#[test]
fn prediction_and_simulation_come_to_agree_at_the_true_optimum() {
    let bounds = Bounds::default();
    let settings = RefineSettings { seed: 5, ..RefineSettings::default() };
    let (flown, done) = refined(&settings, &|x| Some(truth(x)));
    let Next::Done { stop, best, predicted } = done else { panic!("not done") };
    let found = flown[best].means.expect("means").0;
    assert_eq!(stop, RefineStop::Agreed, "{} flown, {found:?}", flown.len());
    assert!(flown.len() <= settings.simulations);
    // The surrogate's own optimum is off by far more.
    assert!(off_trim(&flown[0].means.expect("means").0) > 0.05);
    assert!(off_trim(&found) < 3e-3, "{found:?}");
    assert!((0..4).all(|k| (predicted[k] - found[k]).abs() < 2e-3), "{predicted:?} {found:?}");
    let optimum = minimise(&Smooth(truth), &bounds, &flown[best].x).expect("an optimum");
    let least = truth(&optimum);
    assert!((found[3] - least[3]).abs() < 0.01, "{found:?} {least:?}");
}

#[test]
fn rounds_depend_on_the_seed_alone_and_keep_to_the_budget() {
    let settings = RefineSettings { simulations: 20, seed: 9, ..RefineSettings::default() };
    let (a, done) = refined(&settings, &|x| Some(truth(x)));
    let (b, again) = refined(&settings, &|x| Some(truth(x)));
    assert_eq!((&a, &done), (&b, &again));
    assert!(a.len() <= 20);
    let (c, _) = refined(&RefineSettings { seed: 10, ..settings }, &|x| Some(truth(x)));
    assert_ne!(a, c);
}

#[test]
fn where_nothing_can_be_flown_there_is_nothing_to_refine() {
    let (flown, done) = refined(&RefineSettings::default(), &|_| None);
    assert_eq!(flown.len(), 1);
    assert!(matches!(done, Next::Done { stop: RefineStop::Nothing, .. }));
}
