//! Whole nodes looked at ahead of their segments: for levels with many registers, whose
//! unit of roots and quotients is what takes the time.

use super::{MAX_COLUMNS, Node, Pair, Seen, Sheet, first_row_added, see};
use crate::uvlm::level::{Level, Real};

/// How many nodes are looked at before their segments are evaluated; even.
const AHEAD: usize = 4;
const SLOTS: usize = 2 * MAX_COLUMNS;

/// The last nodes seen, a row and a few more, node n in slot n modulo a power of two.
/// No larger than the row needs, so that it stays in the nearest cache.
pub(super) struct Ring<S: Level, T: Real> {
    slots: [Seen<S, T>; SLOTS],
    mask: usize,
}

impl<S: Level, T: Real> Ring<S, T> {
    #[inline(always)]
    pub(super) fn new(simd: S, columns: usize) -> Self {
        let mask = (columns + AHEAD + 3).next_power_of_two() - 1;
        Self { slots: [Seen::nowhere(simd); SLOTS], mask: mask & (SLOTS - 1) }
    }

    #[inline(always)]
    fn at(&self, n: usize) -> &Seen<S, T> {
        &self.slots[n & self.mask & (SLOTS - 1)]
    }

    #[inline(always)]
    fn see(&mut self, simd: S, n: usize, node: &Node<T>, target: &[T::Lanes<S>; 3]) {
        self.slots[n & self.mask & (SLOTS - 1)] = see(simd, node.place, node.core2, target);
    }
}

/// Adds the velocity at a register of targets. Node after node in one loop: the roots of
/// nodes ahead and the quotients of the nodes behind are under way while segments are
/// evaluated, for either takes as long as all the rest.
#[inline(always)]
pub(super) fn induce<S: Level, T: Real>(
    simd: S,
    sheet: &Sheet<'_, T>,
    target: &[T::Lanes<S>; 3],
    mut velocity: [T::Lanes<S>; 3],
    ring: &mut Ring<S, T>,
) -> [T::Lanes<S>; 3] {
    let columns = sheet.columns;
    for (n, node) in sheet.nodes[..columns].iter().enumerate() {
        ring.see(simd, n, node, target);
        if n > 0 {
            velocity = first_row_added(simd, node, ring.at(n - 1), ring.at(n), velocity);
        }
    }
    let (pairs, odd) = sheet.nodes[columns..].as_chunks::<2>();
    for (i, node) in sheet.nodes[columns..].iter().take(AHEAD).enumerate() {
        ring.see(simd, columns + i, node, target);
    }
    let Some(mut before) = pairs.first() else { return velocity };
    let mut inboard = ring.at(columns - 1).r;
    let (mut p, mut q) = (Pair::none(simd), Pair::none(simd));
    let mut n = columns;
    for (i, pair) in pairs.iter().enumerate() {
        let ahead = &pairs[(i + AHEAD / 2).min(pairs.len() - 1)];
        ring.see(simd, n + AHEAD, &ahead[0], target);
        velocity = p.added(simd, &before[0], ring.at(n - 2), velocity);
        p = Pair::undivided(simd, &pair[0], [inboard, ring.at(n - columns).r, ring.at(n).r]);
        ring.see(simd, n + AHEAD + 1, &ahead[1], target);
        velocity = q.added(simd, &before[1], ring.at(n - 1), velocity);
        q = Pair::undivided(simd, &pair[1], [ring.at(n).r, ring.at(n + 1 - columns).r, ring.at(n + 1).r]);
        inboard = ring.at(n + 1).r;
        p.divide_both(&mut q, simd);
        before = pair;
        n += 2;
    }
    velocity = p.added(simd, &before[0], ring.at(n - 2), velocity);
    velocity = q.added(simd, &before[1], ring.at(n - 1), velocity);
    if let [node] = odd {
        ring.see(simd, n, node, target);
        let mut p = Pair::undivided(simd, node, [inboard, ring.at(n - columns).r, ring.at(n).r]);
        p.divide(simd);
        velocity = p.added(simd, node, ring.at(n), velocity);
    }
    velocity
}
