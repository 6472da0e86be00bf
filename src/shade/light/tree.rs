//! Light trees choose among many lights by the light that each may contribute at a point.

use super::{LightBounds, Receiver};
use crate::geom::octahedral;
use crate::lanes::{Int, Lanes, Mask, Num, OutlinedTask, Vector};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// A binary tree of bounded lights (Conty Estevez and Kulla 2018, with the bounds of pbrt-v4). From the root
/// on, a child is chosen in proportion to the most light that its bounds may send to the receiver. This
/// depends on the distance, the angle off the axis and the angle of incidence. Lights that cannot reach the
/// receiver have probability 0.
#[derive(Clone, Debug)]
pub struct LightTree {
    /// The two children of each fork, side by side. The root's children are the first.
    children: Vec<Child>,
    /// The path from the root to each light. Bit `n` is the child taken at the fork of depth `n`.
    paths: Vec<u32>,
}

/// A child of a fork.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Child {
    centre: [f32; 3],
    radius: f32,
    /// Octahedral encoding, 16 bits a coordinate.
    axis: u32,
    power: f32,
    /// Lower half: cosine of the spread, rounded down. Upper half: cosine of the reach.
    cosines: u32,
    /// Index of the child's fork or, with [`LEAF`], of its light. May have the flag [`TWO_SIDED`].
    next: u32,
}

/// Words of a [`Child`]. A fork has two.
const WORDS: usize = size_of::<Child>() / 4;
const _: () = assert!(WORDS == 8, "rows of eight are read at once");

const LEAF: u32 = 1 << 31;
const TWO_SIDED: u32 = 1 << 30;
const INDEX: u32 = TWO_SIDED - 1;

/// The most forks on a path: a path has one bit for each and is stored in a word.
const MAX_DEPTH: u32 = 32;

/// Up to this many lights are sorted by one thread.
const ALONE: usize = 4096;

/// Candidate planes of each axis.
const BINS: usize = 12;

/// Bounds of the rounding errors of cosines: to the receiver's normal, which is stored with ten bits a
/// coordinate, and to the axis.
const NORMAL_SLACK: f32 = 0.006;
const AXIS_SLACK: f32 = 1e-3;

impl LightTree {
    /// A tree of at least two lights. Threads build its parts; it is the same by any number of them.
    pub fn new(lights: &[LightBounds]) -> Self {
        assert!((2..INDEX as usize / 2).contains(&lights.len()), "{} lights", lights.len());
        let mut order: Vec<u32> = (0..lights.len() as u32).collect();
        let mut ordered = vec![0; lights.len()];
        let mut children = vec![Child::zeroed(); 2 * (lights.len() - 1)];
        let all = Part { lights, order: &mut order, paths: &mut ordered, children: &mut children, fork: 0 };
        all.build(0, 0);
        let mut paths = vec![0; lights.len()];
        for (&light, &path) in order.iter().zip(&ordered) {
            paths[light as usize] = path;
        }
        Self { children, paths }
    }

    /// Chooses a light for each receiver by `u` in [0, 1). Returns the lights, their probabilities, which are
    /// 0 if no light reaches the receiver, and the remainders of `u`.
    #[inline(always)]
    pub fn choose<L: Lanes>(&self, receiver: &Receiver<L>, u: Num<L>) -> (Int<L>, Num<L>, Num<L>) {
        u.lanes().outlined(SampleTree { tree: self, receiver: *receiver, u })
    }

    /// The probability with which [`LightTree::choose`] returns these lights for these receivers.
    #[inline(always)]
    pub fn probability<L: Lanes>(&self, receiver: &Receiver<L>, light: Int<L>) -> Num<L> {
        light.lanes().outlined(TreeProbability { tree: self, receiver: *receiver, light })
    }

    /// Computes the probabilities of the children of forks.
    #[inline(always)]
    fn weigh<L: Lanes>(&self, fork: Int<L>, receiver: &Receiver<L>, normal: Vector<L>) -> Fork<L> {
        let table: &[u32] = bytemuck::cast_slice(&self.children);
        let left: [Int<L>; WORDS] = (fork << 1).rows(table);
        let right: [Int<L>; WORDS] = ((fork << 1) + 1).rows(table);
        let (a, b) =
            (importance(&left, receiver.position, normal), importance(&right, receiver.position, normal));
        let sum = a + b;
        let there = sum.above(0.0);
        Fork {
            probabilities: [(a / sum).only(there), (b / sum).only(there)],
            next: [left[WORDS - 1], right[WORDS - 1]],
        }
    }
}

/// Some of the lights, and the part of a tree that is theirs.
struct Part<'a> {
    lights: &'a [LightBounds],
    /// Their indices, which are sorted by place in the tree.
    order: &'a mut [u32],
    /// Their paths, in the same order.
    paths: &'a mut [u32],
    /// The children of their forks: the first fork, all below its first child, all below its second.
    children: &'a mut [Child],
    /// Index of the first fork.
    fork: u32,
}

impl Part<'_> {
    /// Builds the part at the end of a path. Returns what a child says of it: its bounds and its `next` word.
    fn build(self, depth: u32, path: u32) -> (LightBounds, u32) {
        let Self { lights, order, paths, children, fork } = self;
        if let [light] = *order {
            paths[0] = path;
            return (lights[light as usize], LEAF | light);
        }
        let count = order.len();
        let middle = split(lights, order, depth);
        let (order, paths) = (order.split_at_mut(middle), paths.split_at_mut(middle));
        let (own, below) = children.split_at_mut(2);
        let below = below.split_at_mut(2 * (middle - 1));
        let left = Self { lights, order: order.0, paths: paths.0, children: below.0, fork: fork + 1 };
        let right =
            Self { lights, order: order.1, paths: paths.1, children: below.1, fork: fork + middle as u32 };
        let left = || left.build(depth + 1, path);
        let right = || right.build(depth + 1, path | 1 << depth);
        let (left, right) = if count > ALONE { rayon::join(left, right) } else { (left(), right()) };
        for (child, (bounds, next)) in own.iter_mut().zip([&left, &right]) {
            *child = Child::new(bounds, *next);
        }
        (left.0.union(&right.0), fork)
    }
}

/// The probabilities of a fork's children for a receiver, and their `next` words.
struct Fork<L: Lanes> {
    probabilities: [Num<L>; 2],
    next: [Int<L>; 2],
}

/// Lanes that have reached a light.
#[inline(always)]
fn is_leaf<L: Lanes>(next: Int<L>) -> Mask<L> {
    (next & LEAF).is(LEAF)
}

struct SampleTree<'a, L: Lanes> {
    tree: &'a LightTree,
    receiver: Receiver<L>,
    u: Num<L>,
}

impl<L: Lanes> OutlinedTask<L> for SampleTree<'_, L> {
    type Output = (Int<L>, Num<L>, Num<L>);

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) -> Self::Output {
        let normal = self.receiver.normal();
        let (mut u, mut probability) = (self.u, Num::splat(l, 1.0));
        let mut at = Int::splat(l, 0);
        for _ in 0..MAX_DEPTH {
            let going = !is_leaf(at);
            if going.none() {
                break;
            }
            // Lanes that have reached a light read the root again.
            let fork = Int::select(going, at & INDEX, Int::splat(l, 0));
            let Fork { probabilities: [first, second], next } = self.tree.weigh(fork, &self.receiver, normal);
            let left = u.lt(first);
            let taken = Num::select(left, first, second);
            let rest = Num::select(left, u, u - first) / taken;
            u = Num::select(going, rest.clamp(0.0, 1.0 - f32::EPSILON), u);
            probability = Num::select(going, probability * taken, probability);
            at = Int::select(going, Int::select(left, next[0], next[1]), at);
        }
        (at & INDEX, probability, u)
    }
}

struct TreeProbability<'a, L: Lanes> {
    tree: &'a LightTree,
    receiver: Receiver<L>,
    light: Int<L>,
}

impl<L: Lanes> OutlinedTask<L> for TreeProbability<'_, L> {
    type Output = Num<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) -> Num<L> {
        let normal = self.receiver.normal();
        let [mut path] = self.light.rows(&self.tree.paths);
        let mut probability = Num::splat(l, 1.0);
        let mut at = Int::splat(l, 0);
        for _ in 0..MAX_DEPTH {
            let going = !is_leaf(at);
            if going.none() {
                break;
            }
            let fork = Int::select(going, at & INDEX, Int::splat(l, 0));
            let Fork { probabilities: [first, second], next } = self.tree.weigh(fork, &self.receiver, normal);
            let left = (path & 1).is(0);
            probability = Num::select(going, probability * Num::select(left, first, second), probability);
            at = Int::select(going, Int::select(left, next[0], next[1]), at);
            path = path >> 1;
        }
        probability
    }
}

/// An angle of 0 to π.
#[derive(Clone, Copy)]
struct Angle<L: Lanes> {
    cosine: Num<L>,
    sine: Num<L>,
}

impl<L: Lanes> Angle<L> {
    #[inline(always)]
    fn of_cosine(cosine: Num<L>) -> Self {
        let cosine = cosine.clamp(-1.0, 1.0);
        Self { cosine, sine: (1.0 - cosine * cosine).sqrt() }
    }

    /// This angle less `other`, at least 0.
    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        let none = self.cosine.gt(other.cosine);
        let cosine = self.cosine * other.cosine + self.sine * other.sine;
        Self {
            cosine: Num::select(none, Num::splat(cosine.lanes(), 1.0), cosine),
            sine: (self.sine * other.cosine - self.cosine * other.sine).only(!none),
        }
    }
}

/// Upper bound, up to a constant factor, of the light that the bounded lights may send to receivers.
#[cfg_attr(not(unoptimised), inline(always))]
fn importance<L: Lanes>(side: &[Int<L>; WORDS], position: Vector<L>, normal: Vector<L>) -> Num<L> {
    let l = position.lanes();
    let centre = Vector::new(side[0].to_num_bits(), side[1].to_num_bits(), side[2].to_num_bits());
    let (radius, power) = (side[3].to_num_bits(), side[5].to_num_bits());
    let to = centre - position;
    let (distance2, radius2) = (to.length_squared(), radius * radius);
    let inside = distance2.le(radius2);
    let inverse = 1.0 / distance2.sqrt();
    let wi = to * inverse;
    // Half of the angle that the bounds subtend.
    let sine = (radius * inverse).clamp(0.0, 1.0);
    let extent = Angle { cosine: (1.0 - sine * sine).sqrt(), sine };
    let incidence = Angle::of_cosine(normal.dot(wi)).minus(extent).cosine + NORMAL_SLACK;

    const SCALE: f32 = 2.0 / 65535.0;
    let spread = Angle::of_cosine((side[6] & 0xffff).to_num() * SCALE - 1.0);
    let reach = (side[6] >> 16).to_num() * SCALE - 1.0;
    let axis = octahedral::decode::<L, 16>(side[4]);
    let off = -axis.dot(wi);
    let off = Num::select((side[7] & TWO_SIDED).is(TWO_SIDED), off.abs(), off);
    let emission = Angle::of_cosine(off).minus(spread).minus(extent).cosine + AXIS_SLACK;
    let reached = incidence.above(0.0) & emission.gt(reach);
    let share = (incidence * emission.clamp(AXIS_SLACK, f32::INFINITY)).only(reached);
    power * Num::select(inside, Num::splat(l, 1.0), share) / distance2.max(radius2)
}

impl Child {
    fn new(bounds: &LightBounds, next: u32) -> Self {
        let cosine = |angle: f32| ((libm::cosf(angle) * 0.5 + 0.5) * 65535.0).floor() as u32;
        Self {
            centre: bounds.centre().to_array(),
            // Never 0: a receiver at distance 0 counts as inside.
            radius: (bounds.radius() * (1.0 + 1e-5)).max(1e-15),
            axis: octahedral::encode::<_, 16>(bounds.axis.into()).get(),
            power: bounds.power,
            cosines: cosine(bounds.spread) | cosine(bounds.reach) << 16,
            next: next | if bounds.two_sided { TWO_SIDED } else { 0 },
        }
    }
}

/// Sorts lights by child and returns where the second child begins. The cheapest plane across the longest
/// axis divides them. They are halved if that plane would make the tree too deep, or if all lights are in one
/// place.
fn split(lights: &[LightBounds], order: &mut [u32], depth: u32) -> usize {
    let centre = |light: u32| lights[light as usize].centre();
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for &light in order.iter() {
        (low, high) = (low.min(centre(light)), high.max(centre(light)));
    }
    let size = high - low;
    let half = order.len() / 2;
    let levels = order.len().next_power_of_two().trailing_zeros();
    let longest = size.max_position();
    if depth + levels + 1 < MAX_DEPTH && size[longest] > 0.0 {
        let mut best = (f32::INFINITY, 0, 0);
        for (axis, found) in cheapest_planes(lights, order, low, size).into_iter().enumerate() {
            if let Some((cost, bin)) = found {
                // Thin nodes are worse than their surface suggests.
                let cost = cost * size[longest] / size[axis];
                if cost < best.0 {
                    best = (cost, axis, bin);
                }
            }
        }
        let (_, axis, last) = best;
        let is_left = |&light: &u32| bin(centre(light)[axis], low[axis], size[axis]) <= last;
        let (left, right): (Vec<u32>, Vec<u32>) = order.iter().partition(|light| is_left(light));
        if !left.is_empty() && !right.is_empty() {
            let middle = left.len();
            order[..middle].copy_from_slice(&left);
            order[middle..].copy_from_slice(&right);
            return middle;
        }
    }
    order.sort_by(|&a, &b| centre(a)[longest].total_cmp(&centre(b)[longest]).then(a.cmp(&b)));
    half
}

fn bin(x: f32, low: f32, size: f32) -> usize {
    (((x - low) / size * BINS as f32) as usize).min(BINS - 1)
}

/// The cheapest planes across the axes along which lights differ; see [`cheapest`].
fn cheapest_planes(
    lights: &[LightBounds],
    order: &[u32],
    low: Vec3,
    size: Vec3,
) -> [Option<(f32, usize)>; 3] {
    let across = |axis: usize| {
        (size[axis] > 0.0).then(|| cheapest(lights, order, low[axis], size[axis], axis)).flatten()
    };
    if order.len() <= ALONE {
        return [0, 1, 2].map(across);
    }
    let (x, (y, z)) = rayon::join(|| across(0), || rayon::join(|| across(1), || across(2)));
    [x, y, z]
}

/// The last bin before the cheapest plane across an axis, and the cost of both children.
fn cheapest(lights: &[LightBounds], order: &[u32], low: f32, size: f32, axis: usize) -> Option<(f32, usize)> {
    let mut bins: [Option<LightBounds>; BINS] = [None; BINS];
    for &light in order {
        let light = &lights[light as usize];
        let bin = &mut bins[bin(light.centre()[axis], low, size)];
        *bin = join(*bin, Some(*light));
    }
    let mut behind = [None; BINS];
    for k in (0..BINS - 1).rev() {
        behind[k] = join(behind[k + 1], bins[k + 1]);
    }
    let (mut before, mut best) = (None, None);
    for k in 0..BINS - 1 {
        // Behind an empty bin, a plane has the cost of the one before.
        if bins[k].is_none() {
            continue;
        }
        before = join(before, bins[k]);
        if let (Some(before), Some(behind)) = (&before, &behind[k]) {
            let cost = LightBounds::cost(before) + behind.cost();
            if best.is_none_or(|(least, _)| cost < least) {
                best = Some((cost, k));
            }
        }
    }
    best
}

fn join(a: Option<LightBounds>, b: Option<LightBounds>) -> Option<LightBounds> {
    match (a, b) {
        (Some(a), Some(b)) => Some(a.union(&b)),
        (a, b) => a.or(b),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{Sampler, warp};
    use std::f32::consts::FRAC_PI_2;

    /// Small lamps in a cube, every eighth of them in one place.
    fn lamps(count: u32) -> Vec<LightBounds> {
        let lamp = |i: u32| {
            let random = Sampler::new(if i.is_multiple_of(8) { 0 } else { i }, 0, 3);
            let low = Vec3::from([0, 1, 2].map(|k| random.single(k)));
            let axis = warp::sphere(random.pair(3));
            let high = low + Vec3::splat(0.01);
            LightBounds { low, high, axis, spread: 0.1, reach: FRAC_PI_2, power: 1.0, two_sided: false }
        };
        (0..count).map(lamp).collect()
    }

    #[test]
    fn the_path_of_each_light_leads_to_it_whatever_the_number_of_threads() {
        let lamps = lamps(3 * ALONE as u32);
        let by = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads start");
            pool.install(|| LightTree::new(&lamps))
        };
        let (tree, other) = (by(1), by(4));
        assert_eq!(
            bytemuck::cast_slice::<_, u32>(&tree.children),
            bytemuck::cast_slice::<_, u32>(&other.children)
        );
        assert_eq!(tree.paths, other.paths);
        for (light, &path) in tree.paths.iter().enumerate() {
            let (mut next, mut depth) = (0, 0);
            while next & LEAF == 0 {
                next = tree.children[2 * (next & INDEX) as usize + (path >> depth & 1) as usize].next;
                depth += 1;
            }
            assert_eq!((next & INDEX) as usize, light);
        }
    }
}
