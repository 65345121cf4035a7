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
fn minimise(model: &dyn Differentiable, bounds: &Bounds, start: &Point) -> Option<Minimum> {
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
    // Its prices are of the constraint's value, those asked for are of the value asked for.
    Some(Minimum { point: x, prices: price.map(|p: f64| -p) })
}

fn tools() -> Tools<'static> {
    tools_on(&Smooth(surrogate))
}

fn tools_on(surrogate: &dyn Differentiable) -> Tools<'_> {
    Tools { surrogate, minimise: &minimise, clear: &|_| true }
}

/// Rounds until done: what is flown, why it ended, which is best, what was predicted of it.
fn refined(settings: &RefineSettings, fly: &dyn Fn(&Point) -> Option<[f64; 4]>) -> (Vec<Flown>, Next) {
    let bounds = Bounds::default();
    let fly = |x: &Point| Flown { x: *x, means: fly(x).map(|y| (y, [2e-4; 4])) };
    let centre = bounds.from_unit(&[0.5; COUNT]);
    let start = minimise(&Smooth(surrogate), &bounds, &centre).expect("a start").point;
    refined_from(&tools(), fly(&start), settings, &fly)
}

/// [`refined`] from a stroke flown, with tools of one's own.
fn refined_from(
    tools: &Tools<'_>,
    start: Flown,
    settings: &RefineSettings,
    fly: &dyn Fn(&Point) -> Flown,
) -> (Vec<Flown>, Next) {
    let bounds = Bounds::default();
    let mut flown = vec![start];
    let mut region = Region::default();
    loop {
        match step(tools, &bounds, settings, &flown, &region) {
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
    let settings = RefineSettings { seed: 5, ..RefineSettings::default() };
    let (flown, done) = refined(&settings, &|x| Some(truth(x)));
    assert!(flown.len() <= settings.simulations);
    assert_optimal(&flown, &done);
    // The surrogate's own optimum is off by far more.
    assert!(off_trim(&flown[0].means.expect("means").0) > 0.05);
}

/// The best stroke flown is the true optimum, in trim and as predicted.
fn assert_optimal(flown: &[Flown], done: &Next) {
    let bounds = Bounds::default();
    let Next::Done { stop, best, predicted, region } = done else { panic!("not done") };
    let found = flown[*best].means.expect("means").0;
    assert_eq!(*stop, RefineStop::Agreed, "{} flown, {found:?}", flown.len());
    assert!(off_trim(&found) < 3e-3, "{found:?}");
    assert!((0..4).all(|k| (predicted[k] - found[k]).abs() < 2e-3), "{predicted:?} {found:?}");
    let optimum = minimise(&Smooth(truth), &bounds, &flown[*best].x).expect("an optimum");
    let least = truth(&optimum.point);
    assert!((found[3] - least[3]).abs() < 0.01, "{found:?} {least:?}");
    // What it costs to be in trim to the last digit, and a weight which keeps the least merit there.
    let prices = region.prices.expect("prices");
    assert!((trimmed_power(&found, &prices) - found[3]).abs() <= region.weight * off_trim(&found));
    assert!((0..3).all(|k| (prices[k] - optimum.prices[k]).abs() < 0.1), "{prices:?} {:?}", optimum.prices);
    assert!(prices.iter().all(|p| p.abs() < region.weight));
}

/// A prediction which held tells a value, not a slope: nothing is called the best before strokes
/// lie all around it.
#[test]
fn an_answer_is_surrounded_before_it_is_given() {
    let (bounds, settings) = (Bounds::default(), RefineSettings::default());
    let fly = |x: &Point| Flown { x: *x, means: Some((truth(x), [2e-4; 4])) };
    let optimum = minimise(&Smooth(truth), &bounds, &bounds.from_unit(&[0.5; COUNT])).expect("an optimum").point;
    let exact = Smooth(truth);
    let tools = tools_on(&exact);
    let mut flown = vec![fly(&optimum); 2];
    let region = Region { round: 1, candidate: Some((1, truth(&optimum))), ..Region::default() };
    let Next::Fly { region, batch } = step(&tools, &bounds, &settings, &flown, &region) else { panic!("done") };
    assert_eq!(batch.len(), settings.batch);
    flown.extend(batch.iter().map(fly));
    let done = step(&tools, &bounds, &settings, &flown, &region);
    assert!(matches!(done, Next::Done { stop: RefineStop::Agreed, .. }), "{done:?}");
}

/// Without a surrogate: what was flown near the optimum stands in for it.
#[test]
fn strokes_flown_nearby_are_enough_to_begin_with() {
    let bounds = Bounds::default();
    let fly = |x: &Point| Flown { x: *x, means: Some((truth(x), [2e-4; 4])) };
    let off = bounds.from_unit(&[0.5; COUNT]);
    let optimum = minimise(&Smooth(truth), &bounds, &off).expect("an optimum").point;
    // A search left strokes about a place a few per cent of the box away from the optimum.
    let near = |i: u64| {
        let spread = crate::sampling::sample(&bounds, 17, i, &|_| true).expect("a point");
        let x = std::array::from_fn(|k| optimum[k] + 0.25 * (spread[k] - off[k]));
        fly(&crate::optimise::clamped(&bounds, &x))
    };
    let flown: Vec<Flown> = (0..300).map(near).collect();
    let start = flown[11];
    assert!(off_trim(&start.means.expect("means").0) > 0.02);
    let model = Local::fit(&bounds, &start.x, &flown).expect("a model");
    let (flown, done) = refined_from(&tools_on(&model), start, &RefineSettings::default(), &fly);
    assert!(flown.len() <= 100, "{}", flown.len());
    assert_optimal(&flown, &done);
}

/// Power is bought at 8 a unit of lift: with a weight of 2 the least merit would be on the ground.
#[test]
fn the_weight_of_the_trim_is_above_its_prices() {
    let steep = |x: &Point| {
        let u = Bounds::default().to_unit(x);
        [0.5 + u[0], u[1] - 0.5, u[2] - 0.5, 8.0 * u[0] + 0.1 * u[3..].iter().sum::<f64>()]
    };
    struct Steep<F>(F);
    impl<F: Fn(&Point) -> [f64; 4] + Sync> Differentiable for Steep<F> {
        fn jacobians_into(&self, xs: &[Point], out: &mut [Jacobian]) {
            for (x, place) in xs.iter().zip(out) {
                *place = jacobian(&self.0, x);
            }
        }
    }
    let model = Steep(steep);
    let fly = |x: &Point| Flown { x: *x, means: Some((steep(x), [2e-4; 4])) };
    let start = fly(&Bounds::default().from_unit(&[0.3; COUNT]));
    let (flown, done) = refined_from(&tools_on(&model), start, &RefineSettings::default(), &fly);
    let Next::Done { best, region, .. } = done else { panic!("not done") };
    assert!(region.weight > 8.0, "{region:?}");
    assert!(off_trim(&flown[best].means.expect("means").0) < 5e-3, "{:?}", flown[best]);
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
