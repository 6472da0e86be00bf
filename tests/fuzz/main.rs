//! Arbitrary triangles and rays, bit by bit against the definition: at every SIMD level, in random
//! splits, with and without a filter, on built and on refitted trees.
//!
//! Runs for `RAYSTREAM_FUZZ_SECONDS` (default 3), and on until `RAYSTREAM_FUZZ_QUERIES` answers have been compared
//! (default 0). A failure names its seed; `RAYSTREAM_FUZZ_SEED` runs that alone.

use glam::Vec3;
use raystream::bvh::{Bvh, Filter};
use raystream::geom::{CanonicalRay, MAX_COORDINATE};
use raystream::stream::{Hit, Ray, Tracer};
use raystream::trace::cpu::{CpuTracer, Oracle, SimdLevel};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Coordinates that have caused trouble somewhere: zeros, denormals, neighbours of 1, the largest allowed.
const NASTY: [f32; 20] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    1.0 + f32::EPSILON,
    1.0 - f32::EPSILON / 2.0,
    1e-45,
    -1e-45,
    1e-40,
    f32::MIN_POSITIVE,
    1e-20,
    1e-7,
    3.0,
    1e4,
    16_777_217.0,
    1e9,
    -1e9,
    MAX_COORDINATE,
    -MAX_COORDINATE,
];

/// What rays may hold besides.
const NO_COORDINATES: [f32; 8] =
    [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, 2e11, 1e-9, 1e9];

/// Numbers from a seed (splitmix64).
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z >> 32) as u32
    }

    fn below(&mut self, n: usize) -> usize {
        ((u64::from(self.bits()) * n as u64) >> 32) as usize
    }

    fn signed(&mut self) -> f32 {
        (self.bits() >> 8) as f32 / (1 << 23) as f32 - 1.0
    }

    fn of<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.below(all.len())]
    }
}

/// How the coordinates of a case are drawn.
#[derive(Clone, Copy)]
enum Taste {
    /// Ordinary numbers of one size.
    Even(f32),
    /// A few whole numbers: much coincides, much lies in common planes.
    Grid,
    /// From the list.
    Nasty,
    /// Any bits that are a coordinate.
    Bits,
}

impl Taste {
    fn any(random: &mut Random) -> Self {
        match random.below(6) {
            0 | 1 => Self::Even(random.of(&[1.0, 1.0, 1e-6, 1e5, 1e10])),
            2 => Self::Grid,
            3 | 4 => Self::Nasty,
            _ => Self::Bits,
        }
    }

    fn coordinate(self, random: &mut Random) -> f32 {
        match self {
            Self::Even(size) => size * random.signed(),
            Self::Grid => random.below(5) as f32 - 2.0,
            Self::Nasty if random.below(4) == 0 => random.signed(),
            Self::Nasty => random.of(&NASTY),
            Self::Bits => {
                let value = f32::from_bits(random.bits());
                if value.abs() <= MAX_COORDINATE { value } else { 0.25 }
            }
        }
    }

    fn point(self, random: &mut Random) -> Vec3 {
        Vec3::from_array([0; 3].map(|_| self.coordinate(random)))
    }
}

/// Lets a third through.
struct Holes;

fn is_masked(primitive: u32) -> bool {
    primitive % 3 == 1
}

impl Filter for Holes {
    fn accepts(&self, primitive: u32, u: f32, v: f32) -> bool {
        assert!(is_masked(primitive), "asked for triangle {primitive}");
        assert!((0.0..=1.0).contains(&u) && (0.0..=1.0).contains(&v), "asked at {u}, {v}");
        (u + v) * 9.0 % 3.0 > 1.0
    }
}

struct Case {
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    rays: Vec<Ray>,
    filter: Option<Arc<dyn Filter>>,
}

impl Case {
    fn new(random: &mut Random) -> Self {
        let taste = Taste::any(random);
        let count = random.of(&[0, 1, 2, 3, 7, 8, 9, 40, 64, 65, 200, 600]);
        let vertices = 1 + random.below(3 * count + 3);
        let positions: Vec<Vec3> = (0..vertices).map(|_| taste.point(random)).collect();
        // Neighbouring indices half of the time, so that triangles are small and share edges.
        let triangles = (0..count)
            .map(|_| {
                let first = random.below(vertices);
                let near = random.below(2) == 0;
                [0; 3].map(|_| if near { (first + random.below(3)) % vertices } else { random.below(vertices) } as u32)
            })
            .collect();
        let mut case = Self { positions, triangles, rays: Vec::new(), filter: None };
        let rays = random.of(&[1, 5, 17, 100, 300]);
        case.rays = (0..rays).map(|_| case.ray(taste, random)).collect();
        if random.below(3) == 0 {
            case.filter = Some(Arc::new(Holes));
        }
        // Rays of one origin take another way.
        if random.below(4) == 0 {
            let origin = case.rays[0].origin;
            case.rays.iter_mut().for_each(|ray| ray.origin = origin);
        }
        case
    }

    fn ray(&self, taste: Taste, random: &mut Random) -> Ray {
        let vertex = random.of(&self.positions);
        let other = random.of(&self.positions);
        let origin = match random.below(4) {
            0 => vertex,
            1 => Taste::any(random).point(random),
            _ => taste.point(random),
        };
        let direction = match random.below(6) {
            0 => Taste::any(random).point(random),
            1 => Vec3::AXES[random.below(3)] * random.signed(),
            2 => vertex.lerp(other, 0.5) - origin,
            3 => other - vertex,
            _ => vertex - origin,
        };
        let mut ray = Ray::new(origin, direction);
        if random.below(5) == 0 {
            ray.t_min = random.of(&NASTY);
            ray.t_max = random.of(&NASTY);
        }
        if random.below(12) == 0 {
            let value = random.of(&NO_COORDINATES);
            match random.below(4) {
                0 => ray.origin[random.below(3)] = value,
                1 => ray.direction[random.below(3)] = value,
                2 => ray.t_min = value,
                _ => ray.t_max = value,
            }
        }
        ray
    }

    fn max_abs(&self) -> f32 {
        let used = self.triangles.iter().flatten().map(|&i| self.positions[i as usize].abs().max_element());
        used.fold(0.0, f32::max)
    }

    /// The definition: every triangle, no tree.
    fn expected(&self, ray: &Ray) -> Hit {
        let prepared = CanonicalRay::new(ray.origin, ray.t_min, ray.direction, ray.t_max, self.max_abs());
        let mut best = Hit::NONE;
        for (primitive, corners) in (0..).zip(&self.triangles) {
            let [a, b, c] = corners.map(|i| self.positions[i as usize]);
            let Some(hit) = prepared.triangle(a, b, c) else { continue };
            let filter = self.filter.as_ref().filter(|_| is_masked(primitive));
            let there = filter.is_none_or(|filter| filter.accepts(primitive, hit.u, hit.v));
            if there && (best.is_miss() || hit.t < best.t) {
                best = Hit { t: hit.t, u: hit.u, v: hit.v, primitive };
            }
        }
        best
    }

    /// Compares every tracer with the definition. Returns the number of answers that were compared.
    fn check(&self, bvh: &Arc<Bvh>, random: &mut Random, what: &str) -> u64 {
        assert_eq!(bvh.validate(), Ok(()), "{what}");
        let bits = |hit: &Hit| [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.primitive];
        let expected: Vec<Hit> = self.rays.iter().map(|ray| self.expected(ray)).collect();
        let mut tracers: Vec<(&str, Box<dyn Tracer>)> =
            vec![("oracle", Box::new(Oracle::new(bvh.clone(), self.filter.clone())))];
        for level in SimdLevel::available() {
            let tracer = CpuTracer::new(bvh.clone(), self.filter.clone(), level).expect("available");
            tracers.push((level.name(), Box::new(tracer)));
        }
        let mut answers = 0;
        for (name, tracer) in tracers {
            let mut at = 0;
            while at < self.rays.len() {
                let end = (at + 1 + random.below(self.rays.len())).min(self.rays.len());
                let rays = &self.rays[at..end];
                let mut hits = vec![Hit { t: -7.0, u: 7.0, v: 7.0, primitive: 7 }; rays.len()];
                let mut occluded = vec![7; rays.len()];
                tracer.closest(rays, &mut hits);
                tracer.occluded(rays, &mut occluded);
                for (i, wanted) in expected[at..end].iter().enumerate() {
                    assert_eq!(bits(&hits[i]), bits(wanted), "{what}, {name}: {:?}", rays[i]);
                    assert_eq!(occluded[i], u32::from(!wanted.is_miss()), "{what}, {name}: {:?}", rays[i]);
                }
                answers += 2 * rays.len() as u64;
                at = end;
            }
        }
        answers
    }
}

/// One case from its seed. Returns the number of answers that were compared.
fn run(seed: u64) -> u64 {
    let random = &mut Random(seed);
    let mut case = Case::new(random);
    let mut bvh = Arc::new(Bvh::build(&case.positions, &case.triangles, is_masked));
    let mut answers = case.check(&bvh, random, &format!("seed {seed}, built"));
    if random.below(2) == 0 {
        let taste = Taste::any(random);
        case.positions.iter_mut().for_each(|position| *position = taste.point(random));
        let refit = Arc::make_mut(&mut bvh).refit(&case.positions, &case.triangles);
        assert_eq!(refit, Ok(()), "seed {seed}");
        answers += case.check(&bvh, random, &format!("seed {seed}, refitted"));
    }
    answers
}

fn variable(name: &str) -> Option<u64> {
    let value = std::env::var(name).ok()?;
    Some(value.parse().unwrap_or_else(|_| panic!("{name} is a whole number, not {value:?}")))
}

#[test]
fn every_tracer_follows_the_definition_on_arbitrary_input() {
    if let Some(seed) = variable("RAYSTREAM_FUZZ_SEED") {
        run(seed);
        return;
    }
    let least = variable("RAYSTREAM_FUZZ_QUERIES").unwrap_or(0);
    let budget = Duration::from_secs(variable("RAYSTREAM_FUZZ_SECONDS").unwrap_or(3));
    // Always the same first ones, then others each day.
    let day = std::time::SystemTime::UNIX_EPOCH.elapsed().map_or(0, |age| age.as_secs() / 86_400);
    let start = Instant::now();
    let (mut cases, mut answers) = (0, 0);
    while cases < 200 || start.elapsed() < budget || answers < least {
        answers += run(if cases < 200 { cases } else { (day << 32) | cases });
        cases += 1;
    }
    println!("{cases} cases, {answers} answers");
}

#[test]
fn cases_hit_and_miss() {
    let (mut hits, mut rays) = (0, 0);
    for seed in 0..300 {
        let case = Case::new(&mut Random(seed));
        rays += case.rays.len();
        hits += case.rays.iter().filter(|ray| !case.expected(ray).is_miss()).count();
    }
    assert!(hits * 10 > rays && hits * 10 < rays * 9, "{hits} of {rays} rays hit");
}
