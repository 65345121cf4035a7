//! Problems with published optima (Hock & Schittkowski 1981, Test Examples for Nonlinear
//! Programming Codes), and flights.

use super::*;
use crate::parameters::{COUNT, Point};

/// A function of few variables with its gradient.
type Smooth<'a> = dyn Fn(&[f64]) -> (f64, Vec<f64>) + 'a;

struct Published<'a> {
    name: &'static str,
    start: &'a [f64],
    lower: &'a [f64],
    upper: &'a [f64],
    value: &'a Smooth<'a>,
    equalities: Vec<&'a Smooth<'a>>,
    inequalities: Vec<&'a Smooth<'a>>,
    least: f64,
}

fn pad(values: &[f64]) -> Point {
    let mut point = [0.0; COUNT];
    point[..values.len()].copy_from_slice(values);
    point
}

fn solve(p: &Published<'_>) -> Sqp {
    let n = p.start.len();
    let mut sqp = Sqp::new(pad(p.lower), pad(p.upper), &pad(p.start), 1e-9, 200);
    while sqp.finished().is_none() {
        let x = &sqp.ask()[..n];
        let at = |f: &Smooth<'_>| {
            let (value, gradient) = f(x);
            (value, pad(&gradient))
        };
        let (value, gradient) = at(p.value);
        let equalities = p.equalities.iter().map(|f| at(f)).collect();
        let inequalities = p.inequalities.iter().enumerate().map(|(i, f)| (i, at(f).0, at(f).1)).collect();
        sqp.tell(Linear { value, gradient, equalities, inequalities });
    }
    assert_eq!(sqp.finished(), Some(SqpStop::Converged), "{}: {sqp:?}", p.name);
    let found = sqp.here().unwrap().value;
    assert!((found - p.least).abs() < 1e-8 * (1.0 + p.least.abs()), "{}: {found}", p.name);
    sqp
}

const FAR: [f64; 10] = [1e3; 10];
const NEAR: [f64; 10] = [-1e3; 10];

/// HS 71: min x1 x4 (x1 + x2 + x3) + x3, product >= 25, squares = 40, 1 <= x <= 5.
#[test]
fn hock_and_schittkowski_71() {
    let sqp = solve(&Published {
        name: "HS 71",
        start: &[1.0, 5.0, 5.0, 1.0],
        lower: &[1.0; 4],
        upper: &[5.0; 4],
        value: &|x| {
            let s = x[0] + x[1] + x[2];
            (x[0] * x[3] * s + x[2], vec![x[3] * (s + x[0]), x[0] * x[3], x[0] * x[3] + 1.0, x[0] * s])
        },
        equalities: vec![&|x| (x.iter().map(|v| v * v).sum::<f64>() - 40.0, x.iter().map(|v| 2.0 * v).collect())],
        inequalities: vec![&|x| {
            let product = x[0] * x[1] * x[2] * x[3];
            (product - 25.0, x.iter().map(|v| product / v).collect())
        }],
        least: 17.014_017_289_156_4,
    });
    let x = [1.0, 4.742_999_637, 3.821_149_979, 1.379_408_294];
    assert!(sqp.point().iter().zip(x).all(|(a, b)| (a - b).abs() < 1e-8), "{:?}", sqp.point());
    assert!(sqp.multipliers().bounds[0] > 1.0 && sqp.multipliers().inequalities[0].1 > 0.5);
}

/// HS 6: Rosenbrock's valley as a constraint; least 0 at (1, 1).
#[test]
fn hock_and_schittkowski_6_and_7() {
    solve(&Published {
        name: "HS 6",
        start: &[-1.2, 1.0],
        lower: &NEAR[..2],
        upper: &FAR[..2],
        value: &|x| ((1.0 - x[0]).powi(2), vec![-2.0 * (1.0 - x[0]), 0.0]),
        equalities: vec![&|x| (10.0 * (x[1] - x[0] * x[0]), vec![-20.0 * x[0], 10.0])],
        inequalities: vec![],
        least: 0.0,
    });
    solve(&Published {
        name: "HS 7",
        start: &[2.0, 2.0],
        lower: &NEAR[..2],
        upper: &FAR[..2],
        value: &|x| {
            let s = 1.0 + x[0] * x[0];
            (crate::math::ln(s) - x[1], vec![2.0 * x[0] / s, -1.0])
        },
        equalities: vec![&|x| {
            let s = 1.0 + x[0] * x[0];
            (s * s + x[1] * x[1] - 4.0, vec![4.0 * s * x[0], 2.0 * x[1]])
        }],
        inequalities: vec![],
        least: -3f64.sqrt(),
    });
}

/// HS 43 (Rosen & Suzuki): least -44 at (0, 1, 2, -1), three inequalities, two at work.
#[test]
fn hock_and_schittkowski_43() {
    let sqp = solve(&Published {
        name: "HS 43",
        start: &[0.0; 4],
        lower: &NEAR[..4],
        upper: &FAR[..4],
        value: &|x| {
            let [a, b, c, d] = [x[0], x[1], x[2], x[3]];
            let value = a * a + b * b + 2.0 * c * c + d * d - 5.0 * a - 5.0 * b - 21.0 * c + 7.0 * d;
            (value, vec![2.0 * a - 5.0, 2.0 * b - 5.0, 4.0 * c - 21.0, 2.0 * d + 7.0])
        },
        equalities: vec![],
        inequalities: vec![
            &|x| {
                let [a, b, c, d] = [x[0], x[1], x[2], x[3]];
                let value = 8.0 - a * a - b * b - c * c - d * d - a + b - c + d;
                (value, vec![-2.0 * a - 1.0, -2.0 * b + 1.0, -2.0 * c - 1.0, -2.0 * d + 1.0])
            },
            &|x| {
                let [a, b, c, d] = [x[0], x[1], x[2], x[3]];
                let value = 10.0 - a * a - 2.0 * b * b - c * c - 2.0 * d * d + a + d;
                (value, vec![-2.0 * a + 1.0, -4.0 * b, -2.0 * c, -4.0 * d + 1.0])
            },
            &|x| {
                let [a, b, c, d] = [x[0], x[1], x[2], x[3]];
                let value = 5.0 - 2.0 * a * a - b * b - c * c - 2.0 * a + b + d;
                (value, vec![-4.0 * a - 2.0, -2.0 * b + 1.0, -2.0 * c, 1.0])
            },
        ],
        least: -44.0,
    });
    let names: Vec<(usize, f64)> = sqp.multipliers().inequalities.clone();
    assert_eq!(names.iter().map(|(n, _)| *n).collect::<Vec<_>>(), [0, 2]);
    assert!((names[0].1 - 1.0).abs() < 1e-6 && (names[1].1 - 2.0).abs() < 1e-6, "{names:?}");
}

/// HS 39 and HS 40: three and four variables, curved equalities.
#[test]
fn hock_and_schittkowski_39_and_40() {
    solve(&Published {
        name: "HS 39",
        start: &[2.0; 4],
        lower: &NEAR[..4],
        upper: &FAR[..4],
        value: &|x| (-x[0], vec![-1.0, 0.0, 0.0, 0.0]),
        equalities: vec![
            &|x| (x[1] - x[0].powi(3) - x[2] * x[2], vec![-3.0 * x[0] * x[0], 1.0, -2.0 * x[2], 0.0]),
            &|x| (x[0] * x[0] - x[1] - x[3] * x[3], vec![2.0 * x[0], -1.0, 0.0, -2.0 * x[3]]),
        ],
        inequalities: vec![],
        least: -1.0,
    });
    solve(&Published {
        name: "HS 40",
        start: &[0.8; 4],
        lower: &NEAR[..4],
        upper: &FAR[..4],
        value: &|x| {
            let p = -x[0] * x[1] * x[2] * x[3];
            (p, x.iter().map(|v| p / v).collect())
        },
        equalities: vec![
            &|x| (x[0].powi(3) + x[1] * x[1] - 1.0, vec![3.0 * x[0] * x[0], 2.0 * x[1], 0.0, 0.0]),
            &|x| (x[0] * x[0] * x[3] - x[2], vec![2.0 * x[0] * x[3], 0.0, -1.0, x[0] * x[0]]),
            &|x| (x[3] * x[3] - x[1], vec![0.0, -1.0, 0.0, 2.0 * x[3]]),
        ],
        inequalities: vec![],
        least: -0.25,
    });
}

/// Constraints which contradict each other within the box end a descent; they do not
/// converge, and neither does what is not a number.
#[test]
fn what_has_no_optimum_is_said() {
    let run = |value: f64, shift: f64| {
        let mut sqp = Sqp::new([0.0; COUNT], [1.0; COUNT], &[0.5; COUNT], 1e-9, 100);
        while sqp.finished().is_none() {
            let x = *sqp.ask();
            let mut gradient = [0.0; COUNT];
            gradient[0] = 1.0;
            sqp.tell(Linear {
                value: value * x[0],
                gradient,
                equalities: vec![(x[0] - shift, gradient)],
                inequalities: vec![],
            });
        }
        (sqp.finished(), sqp.violation())
    };
    assert_eq!(run(1.0, 0.25), (Some(SqpStop::Converged), 0.0));
    let (stop, violation) = run(1.0, 3.0);
    assert_eq!(stop, Some(SqpStop::Stalled));
    assert!((violation - 2.0).abs() < 1e-6);
    assert_eq!(run(f64::NAN, 0.25).0, Some(SqpStop::NotFinite));
}
