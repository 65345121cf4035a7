//! Roots in stages: for levels with few registers and processors which look but some two hundred
//! instructions ahead.
//!
//! A double-precision root is a chain of some seventy cycles. Begun and ended in one turn of the
//! loop, it fills what the processor looks ahead with operations which wait. Here each turn does
//! one link of the chain for each of several nodes, whose last link was made turns ago and waits
//! in memory, so that nothing waits when its turn comes; the compiler cannot move the links
//! together again, for it does not know that it is the same memory. The operations are those of
//! [`super::ahead`], and so are the bits.

use super::{MAX_COLUMNS, Node, Pair, Seen, Sheet, first_row_added, look, see};
use crate::uvlm::level::{Level, Real};

/// By how many pairs of nodes each stage is ahead of the segments: offsets and squared distance,
const LOOK: usize = 6;
/// its root to single precision,
const BEGIN: usize = 5;
/// that root's inverse,
const GO_ON: usize = 3;
/// and the root itself.
const END: usize = 1;
/// Room for a row and the stages, in pairs.
const PAIRS: usize = MAX_COLUMNS;
/// Room for what the stages in between leave, in pairs.
const BETWEEN: usize = 4;

/// The last nodes looked at, a row and those under way, in pairs; pair i in place i modulo a power
/// of two. No longer than the row needs, so that it stays in the nearest cache.
pub(super) struct Line<S: Level, T: Real> {
    seen: [[Seen<S, T>; 2]; PAIRS],
    begun: [[T::Begun<S>; 2]; BETWEEN],
    seeds: [[T::Seed<S>; 2]; BETWEEN],
    mask: usize,
}

impl<S: Level, T: Real> Line<S, T> {
    #[inline(always)]
    pub(super) fn new(simd: S, columns: usize) -> Self {
        let begun = T::root_begin(simd, T::splat(simd, T::of(1.0)));
        let pairs = (columns.div_ceil(2) + LOOK + 4).next_power_of_two();
        Self {
            seen: [[Seen::nowhere(simd); 2]; PAIRS],
            begun: [[begun; 2]; BETWEEN],
            seeds: [[T::root_go_on(simd, begun); 2]; BETWEEN],
            mask: pairs - 1,
        }
    }

    #[inline(always)]
    fn pair(&mut self, i: usize) -> &mut [Seen<S, T>; 2] {
        &mut self.seen[i & self.mask & (PAIRS - 1)]
    }

    /// A node: 2 i and 2 i + 1 are pair i.
    #[inline(always)]
    fn at(&mut self, n: usize) -> &mut Seen<S, T> {
        &mut self.seen.as_flattened_mut()[n & (2 * self.mask + 1) & (2 * PAIRS - 1)]
    }

    #[inline(always)]
    fn look(&mut self, simd: S, i: usize, [a, b]: &[Node<T>; 2], target: &[T::Lanes<S>; 3]) {
        *self.pair(i) = [look(simd, a.place, a.core2, target), look(simd, b.place, b.core2, target)];
    }

    #[inline(always)]
    fn begin(&mut self, simd: S, i: usize) {
        let [a, b] = self.pair(i);
        self.begun[i % BETWEEN] = [T::root_begin(simd, a.r), T::root_begin(simd, b.r)];
    }

    #[inline(always)]
    fn go_on(&mut self, simd: S, i: usize) {
        let [a, b] = self.begun[i % BETWEEN];
        self.seeds[i % BETWEEN] = [T::root_go_on(simd, a), T::root_go_on(simd, b)];
    }

    #[inline(always)]
    fn end(&mut self, simd: S, i: usize) {
        let [s, t] = self.seeds[i % BETWEEN];
        let [a, b] = self.pair(i);
        a.r = T::root_end(simd, a.r, s);
        b.r = T::root_end(simd, b.r, t);
    }

    /// The first row, which ends before pair `i`.
    #[inline(always)]
    fn first_row(
        &mut self,
        simd: S,
        i: usize,
        row: &[Node<T>],
        target: &[T::Lanes<S>; 3],
        mut velocity: [T::Lanes<S>; 3],
    ) -> [T::Lanes<S>; 3] {
        // What the loop takes before there are segments is multiplied by nought: it must be finite.
        *self.pair(i - 2) = [Seen::nowhere(simd); 2];
        let first = 2 * i - row.len();
        for (k, node) in row.iter().enumerate() {
            let here = see(simd, node.place, node.core2, target);
            if k > 0 {
                velocity = first_row_added(simd, node, self.at(first + k - 1), &here, velocity);
            }
            *self.at(first + k) = here;
        }
        velocity
    }

    /// Every stage as far ahead as it will be when the segments of pair `i` are evaluated.
    #[inline(always)]
    fn prime(&mut self, simd: S, i: usize, pairs: &[[Node<T>; 2]], target: &[T::Lanes<S>; 3]) {
        for a in 0..LOOK {
            self.look(simd, i + a, &pairs[a.min(pairs.len() - 1)], target);
            if a < BEGIN {
                self.begin(simd, i + a);
            }
            if a < GO_ON {
                self.go_on(simd, i + a);
            }
            if a < END {
                self.end(simd, i + a);
            }
        }
    }
}

/// Adds the velocity at a register of targets. Quotients are divided a turn after their segments
/// and counted two turns after.
#[inline(always)]
pub(super) fn induce<S: Level, T: Real>(
    simd: S,
    sheet: &Sheet<'_, T>,
    target: &[T::Lanes<S>; 3],
    velocity: [T::Lanes<S>; 3],
    line: &mut Line<S, T>,
) -> [T::Lanes<S>; 3] {
    let columns = sheet.columns;
    let (first, rest) = sheet.nodes.split_at(columns);
    // Far enough from nought to count backwards.
    let mut i = PAIRS;
    let mut velocity = line.first_row(simd, i, first, target, velocity);
    let (pairs, odd) = rest.as_chunks::<2>();
    let Some(mut last) = pairs.first() else { return velocity };
    line.prime(simd, i, pairs, target);
    let mut inboard = line.at(2 * i - 1).r;
    let none = Pair::none(simd);
    let ((mut p, mut q), (mut p_last, mut q_last)) = ((none, none), (none, none));
    let mut before_last = last;
    for (j, pair) in pairs.iter().enumerate() {
        line.look(simd, i + LOOK, &pairs[(j + LOOK).min(pairs.len() - 1)], target);
        line.begin(simd, i + BEGIN);
        line.go_on(simd, i + GO_ON);
        line.end(simd, i + END);
        let [a, b] = *line.pair(i - 2);
        velocity = p_last.added(simd, &before_last[0], &a, velocity);
        velocity = q_last.added(simd, &before_last[1], &b, velocity);
        (p_last, q_last) = (p, q);
        p_last.divide_both(&mut q_last, simd);
        let (above, beside) = (line.at(2 * i - columns).r, line.at(2 * i + 1 - columns).r);
        let [here, next] = *line.pair(i);
        p = Pair::undivided(simd, &pair[0], [inboard, above, here.r]);
        q = Pair::undivided(simd, &pair[1], [here.r, beside, next.r]);
        inboard = next.r;
        (before_last, last) = (last, pair);
        i += 1;
    }
    if pairs.len() > 1 {
        let [a, b] = *line.pair(i - 2);
        velocity = p_last.added(simd, &before_last[0], &a, velocity);
        velocity = q_last.added(simd, &before_last[1], &b, velocity);
    }
    p.divide_both(&mut q, simd);
    let [a, b] = *line.pair(i - 1);
    velocity = p.added(simd, &last[0], &a, velocity);
    velocity = q.added(simd, &last[1], &b, velocity);
    if let [node] = odd {
        let here = see(simd, node.place, node.core2, target);
        let mut p = Pair::undivided(simd, node, [inboard, line.at(2 * i - columns).r, here.r]);
        p.divide(simd);
        velocity = p.added(simd, node, &here, velocity);
    }
    velocity
}
