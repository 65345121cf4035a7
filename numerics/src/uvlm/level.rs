//! Arithmetic on registers of numbers, at the widest level the processor has.
//!
//! Every operation is one correctly rounded IEEE operation, on every level: the
//! square root is built from single-precision square root and division (exact
//! roundings too) and one step of third order, which is faster than the hardware's
//! square root in double precision and the same everywhere. Lanes never mix.

use pulp::{NullaryFnOnce, Scalar, Simd};

/// An instruction level.
pub trait Level: Simd {
    /// Numbers of single precision, as many as `f64s` has.
    type Singles: Copy;
    /// Whether many roots should be under way, each a stage further at a time ([`Real::root_begin`]).
    const ROOTS_IN_STAGES: bool;
    /// √x to single precision. `x` must lie between 1e-37 and 1e38.
    fn rough_root(self, x: Self::f64s) -> Self::Singles;
    /// 1/x in single precision.
    fn rough_inverse(self, x: Self::Singles) -> Self::f64s;
}

impl Level for Scalar {
    type Singles = f32;
    const ROOTS_IN_STAGES: bool = false;

    #[inline(always)]
    fn rough_root(self, x: f64) -> f32 {
        (x as f32).sqrt()
    }

    #[inline(always)]
    fn rough_inverse(self, x: f32) -> f64 {
        f64::from(1.0 / x)
    }
}

#[cfg(target_arch = "x86_64")]
impl Level for pulp::x86::V3 {
    type Singles = pulp::f32x4;
    const ROOTS_IN_STAGES: bool = true;

    #[inline(always)]
    fn rough_root(self, x: Self::f64s) -> Self::Singles {
        self.sqrt_f32x4(self.convert_f64x4_to_f32x4(x))
    }

    #[inline(always)]
    fn rough_inverse(self, x: Self::Singles) -> Self::f64s {
        self.convert_f32x4_to_f64x4(self.div_f32x4(self.splat_f32x4(1.0), x))
    }
}

#[cfg(target_arch = "x86_64")]
impl Level for pulp::x86::V4 {
    type Singles = pulp::f32x8;
    const ROOTS_IN_STAGES: bool = false;

    #[inline(always)]
    fn rough_root(self, x: Self::f64s) -> Self::Singles {
        self.sqrt_f32x8(self.convert_f64x8_to_f32x8(x))
    }

    #[inline(always)]
    fn rough_inverse(self, x: Self::Singles) -> Self::f64s {
        self.convert_f32x8_to_f64x8(self.div_f32x8(self.splat_f32x8(1.0), x))
    }
}

#[cfg(target_arch = "aarch64")]
impl Level for pulp::aarch64::Neon {
    type Singles = [f32; 2];
    const ROOTS_IN_STAGES: bool = false;

    #[inline(always)]
    fn rough_root(self, x: Self::f64s) -> Self::Singles {
        let [a, b]: [f64; 2] = pulp::cast(x);
        [(a as f32).sqrt(), (b as f32).sqrt()]
    }

    #[inline(always)]
    fn rough_inverse(self, [a, b]: Self::Singles) -> Self::f64s {
        pulp::cast([f64::from(1.0 / a), f64::from(1.0 / b)])
    }
}

/// Work to be compiled for each level.
pub trait Work {
    /// Does it. Implementations are `#[inline(always)]` and call nothing that is not.
    fn run<S: Level>(self, simd: S);
}

struct Run<W, S> {
    work: W,
    simd: S,
}

impl<W: Work, S: Level> NullaryFnOnce for Run<W, S> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.work.run(self.simd);
    }
}

/// Does work at the best level of this processor.
pub fn dispatch(work: impl Work) {
    match pulp::Arch::new() {
        #[cfg(target_arch = "x86_64")]
        pulp::Arch::V4(simd) => simd.vectorize(Run { work, simd }),
        #[cfg(target_arch = "x86_64")]
        pulp::Arch::V3(simd) => simd.vectorize(Run { work, simd }),
        #[cfg(target_arch = "aarch64")]
        pulp::Arch::Neon(simd) => simd.vectorize(Run { work, simd }),
        _ => Run { work, simd: Scalar }.call(),
    }
}

/// Names of the levels this processor has, for tests.
#[cfg(test)]
pub fn available() -> Vec<&'static str> {
    let mut levels = vec!["scalar"];
    #[cfg(target_arch = "x86_64")]
    {
        levels.extend(pulp::x86::V3::try_new().map(|_| "avx2"));
        levels.extend(pulp::x86::V4::try_new().map(|_| "avx512"));
    }
    levels
}

/// Does work at a level that is available.
#[cfg(test)]
pub fn run_at(level: &str, work: impl Work) {
    match level {
        #[cfg(target_arch = "x86_64")]
        "avx512" => pulp::x86::V4::try_new().map(|simd| simd.vectorize(Run { work, simd })).expect("available"),
        #[cfg(target_arch = "x86_64")]
        "avx2" => pulp::x86::V3::try_new().map(|simd| simd.vectorize(Run { work, simd })).expect("available"),
        _ => Run { work, simd: Scalar }.call(),
    }
}

/// Largest number of lanes of any level and precision: arrays are padded to it.
pub const MOST_LANES: usize = 16;

/// A precision.
pub trait Real: Copy + Default + 'static {
    /// A register of such numbers.
    type Lanes<S: Level>: Copy;
    /// Added to denominators: keeps a node's own velocity 0 instead of 0/0.
    const SMALLEST: Self;
    /// Whether one division and three products are faster than two divisions: where roots wait for
    /// the same unit.
    const DIVIDES_TOGETHER: bool;
    /// A number of this precision.
    fn of(x: f64) -> Self;
    /// The number in double precision.
    fn double(self) -> f64;
    /// Numbers in a register.
    fn lanes<S: Level>() -> usize;
    /// The same number in every lane.
    fn splat<S: Level>(simd: S, a: Self) -> Self::Lanes<S>;
    /// The first numbers of a slice.
    fn load<S: Level>(simd: S, from: &[Self]) -> Self::Lanes<S>;
    /// To the first numbers of a slice.
    fn store<S: Level>(simd: S, to: &mut [Self], a: Self::Lanes<S>);
    /// a + b
    fn add<S: Level>(simd: S, a: Self::Lanes<S>, b: Self::Lanes<S>) -> Self::Lanes<S>;
    /// a - b
    fn sub<S: Level>(simd: S, a: Self::Lanes<S>, b: Self::Lanes<S>) -> Self::Lanes<S>;
    /// a b
    fn mul<S: Level>(simd: S, a: Self::Lanes<S>, b: Self::Lanes<S>) -> Self::Lanes<S>;
    /// a / b
    fn div<S: Level>(simd: S, a: Self::Lanes<S>, b: Self::Lanes<S>) -> Self::Lanes<S>;
    /// a b + c, rounded once
    fn mul_add<S: Level>(simd: S, a: Self::Lanes<S>, b: Self::Lanes<S>, c: Self::Lanes<S>) -> Self::Lanes<S>;
    /// c - a b, rounded once
    fn sub_mul<S: Level>(simd: S, c: Self::Lanes<S>, a: Self::Lanes<S>, b: Self::Lanes<S>) -> Self::Lanes<S>;
    /// A root which was begun.
    type Begun<S: Level>: Copy;
    /// What a root is refined from.
    type Seed<S: Level>: Copy;
    /// First stage of √a.
    fn root_begin<S: Level>(simd: S, a: Self::Lanes<S>) -> Self::Begun<S>;
    /// Second stage of a root.
    fn root_go_on<S: Level>(simd: S, begun: Self::Begun<S>) -> Self::Seed<S>;
    /// Last stage of √a.
    fn root_end<S: Level>(simd: S, a: Self::Lanes<S>, seed: Self::Seed<S>) -> Self::Lanes<S>;
    /// √a
    #[inline(always)]
    fn root<S: Level>(simd: S, a: Self::Lanes<S>) -> Self::Lanes<S> {
        Self::root_end(simd, a, Self::root_go_on(simd, Self::root_begin(simd, a)))
    }
}

macro_rules! real {
    ($real:ident, $lanes:ident, $count:ident, $smallest:expr, $together:expr,
     root: $begun:ty, $begin:expr, $seed:ty, $go_on:expr, $end:expr,
     $splat:ident, $as:ident, $as_mut:ident, $add:ident, $sub:ident, $mul:ident, $div:ident, $fma:ident, $fnma:ident) => {
        impl Real for $real {
            type Lanes<S: Level> = S::$lanes;
            const SMALLEST: Self = $smallest;
            const DIVIDES_TOGETHER: bool = $together;
            #[inline(always)]
            fn of(x: f64) -> Self {
                x as $real
            }
            #[inline(always)]
            fn double(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            fn lanes<S: Level>() -> usize {
                S::$count
            }
            #[inline(always)]
            fn splat<S: Level>(simd: S, a: Self) -> S::$lanes {
                simd.$splat(a)
            }
            #[inline(always)]
            fn load<S: Level>(_: S, from: &[Self]) -> S::$lanes {
                S::$as(&from[..S::$count]).0[0]
            }
            #[inline(always)]
            fn store<S: Level>(_: S, to: &mut [Self], a: S::$lanes) {
                S::$as_mut(&mut to[..S::$count]).0[0] = a;
            }
            #[inline(always)]
            fn add<S: Level>(simd: S, a: S::$lanes, b: S::$lanes) -> S::$lanes {
                simd.$add(a, b)
            }
            #[inline(always)]
            fn sub<S: Level>(simd: S, a: S::$lanes, b: S::$lanes) -> S::$lanes {
                simd.$sub(a, b)
            }
            #[inline(always)]
            fn mul<S: Level>(simd: S, a: S::$lanes, b: S::$lanes) -> S::$lanes {
                simd.$mul(a, b)
            }
            #[inline(always)]
            fn div<S: Level>(simd: S, a: S::$lanes, b: S::$lanes) -> S::$lanes {
                simd.$div(a, b)
            }
            #[inline(always)]
            fn mul_add<S: Level>(simd: S, a: S::$lanes, b: S::$lanes, c: S::$lanes) -> S::$lanes {
                simd.$fma(a, b, c)
            }
            #[inline(always)]
            fn sub_mul<S: Level>(simd: S, c: S::$lanes, a: S::$lanes, b: S::$lanes) -> S::$lanes {
                simd.$fnma(a, b, c)
            }
            type Begun<S: Level> = $begun;
            type Seed<S: Level> = $seed;
            #[inline(always)]
            fn root_begin<S: Level>(simd: S, a: S::$lanes) -> $begun {
                $begin(simd, a)
            }
            #[inline(always)]
            fn root_go_on<S: Level>(simd: S, begun: $begun) -> $seed {
                $go_on(simd, begun)
            }
            #[inline(always)]
            fn root_end<S: Level>(simd: S, a: S::$lanes, seed: $seed) -> S::$lanes {
                $end(simd, a, seed)
            }
        }
    };
}

/// √x = x y with y = 1/√x refined from its seed: y (1 + h/2 + 3h²/8), h = 1 - x y²,
/// whose error 5h³/16 is below 1e-20 relative.
#[inline(always)]
fn refined_root<S: Level>(simd: S, x: S::f64s, seed: S::f64s) -> S::f64s {
    let root = simd.mul_f64s(x, seed);
    let h = simd.negate_mul_add_f64s(root, seed, simd.splat_f64s(1.0));
    let factor = simd.mul_f64s(h, simd.mul_add_f64s(h, simd.splat_f64s(0.375), simd.splat_f64s(0.5)));
    simd.mul_add_f64s(root, factor, root)
}

#[inline(always)]
fn nothing<S: Level, T>(_: S, _: T) {}

/// The processor's own root, in one stage.
#[inline(always)]
fn whole_root<S: Level>(simd: S, x: S::f32s, (): ()) -> S::f32s {
    simd.sqrt_f32s(x)
}

real!(
    f64,
    f64s,
    F64_LANES,
    1e-60,
    false,
    root: S::Singles,
    S::rough_root,
    S::f64s,
    S::rough_inverse,
    refined_root,
    splat_f64s,
    as_simd_f64s,
    as_mut_simd_f64s,
    add_f64s,
    sub_f64s,
    mul_f64s,
    div_f64s,
    mul_add_f64s,
    negate_mul_add_f64s
);
real!(
    f32,
    f32s,
    F32_LANES,
    1e-18,
    true,
    root: (),
    nothing,
    (),
    nothing,
    whole_root,
    splat_f32s,
    as_simd_f32s,
    as_mut_simd_f32s,
    add_f32s,
    sub_f32s,
    mul_f32s,
    div_f32s,
    mul_add_f32s,
    negate_mul_add_f32s
);
