//! Random points of the design box.

use rand::RngExt;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::parameters::{Bounds, COUNT, Point};

/// Draws per sample before the box is taken to hold nothing feasible.
const MOST_DRAWS: usize = 10_000;

/// Chance of a free parameter of a face sample to lie on one of its bounds.
const ON_BOUND: f64 = 1.0 / 3.0;

/// Streams of the choices of face samples; those of the points are the indices.
const FACES: u64 = 1 << 63;

/// As [`sample`], with a share `faces` (0 to 1) of the samples on faces, edges and
/// corners of the box, where optima tend to lie and uniform points are rare: there
/// each free parameter takes one of its bounds with a chance of a third. The other
/// samples are those of [`sample`], whatever the share.
pub fn sample_with_faces(
    bounds: &Bounds,
    seed: u64,
    index: u64,
    faces: f64,
    accept: &dyn Fn(&Point) -> bool,
) -> Option<Point> {
    let mut choices = ChaCha8Rng::seed_from_u64(seed);
    choices.set_stream(FACES | index);
    if choices.random::<f64>() >= faces {
        return sample(bounds, seed, index, accept);
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(index);
    (0..MOST_DRAWS).find_map(|_| {
        let unit: [f64; COUNT] = std::array::from_fn(|_| {
            let (inside, choice): (f64, f64) = (rng.random(), choices.random());
            // A face's two ends are equally likely.
            if choice >= ON_BOUND { inside } else { f64::from(u8::from(choice < 0.5 * ON_BOUND)) }
        });
        let x = bounds.from_unit(&unit);
        accept(&x).then_some(x)
    })
}

/// Sample `index` of a study: the first draw of its own random stream which
/// `accept` takes, uniform over the accepted part of the box. A pure function of
/// bounds, seed and index; `None` when nothing acceptable is found.
pub fn sample(bounds: &Bounds, seed: u64, index: u64, accept: &dyn Fn(&Point) -> bool) -> Option<Point> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(index);
    (0..MOST_DRAWS).find_map(|_| {
        let unit: [f64; COUNT] = std::array::from_fn(|_| rng.random());
        let x = bounds.from_unit(&unit);
        accept(&x).then_some(x)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_depends_on_seed_and_index_alone() {
        let bounds = Bounds::default();
        let all = |_: &Point| true;
        let a = sample(&bounds, 7, 41, &all);
        assert_eq!(a, sample(&bounds, 7, 41, &all));
        assert_ne!(a, sample(&bounds, 7, 42, &all));
        assert_ne!(a, sample(&bounds, 8, 41, &all));
        assert_eq!(sample(&bounds, 7, 0, &|_| false), None);
    }

    #[test]
    fn a_share_of_the_samples_lies_on_faces_and_leaves_the_others_alone() {
        let bounds = Bounds::default();
        let all = |_: &Point| true;
        let on_bound = |x: &Point| (0..COUNT).filter(|&i| x[i] == bounds.lower[i] || x[i] == bounds.upper[i]).count();
        let (mut faces, mut coordinates) = (0, 0);
        for index in 0..2000 {
            let (Some(plain), Some(x)) =
                (sample(&bounds, 7, index, &all), sample_with_faces(&bounds, 7, index, 0.2, &all))
            else {
                panic!("everything is accepted")
            };
            assert_eq!(sample_with_faces(&bounds, 7, index, 0.0, &all), Some(plain));
            if x != plain {
                faces += 1;
                coordinates += on_bound(&x);
            }
        }
        // 400 expected less the 2 % whose ten coordinates all stay inside; ten thirds of them on bounds.
        assert!((340..=450).contains(&faces), "{faces}");
        let mean = f64::from(u32::try_from(coordinates).unwrap_or(0)) / f64::from(faces);
        assert!((3.1..3.7).contains(&mean), "{mean}");
    }
}
