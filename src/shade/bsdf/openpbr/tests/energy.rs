//! Energy, reciprocity, and the same bits at every width.

use super::*;
use crate::lanes::SingleLane;

/// Surfaces of random parameters. Half of their colours are white, so that nothing hides a gain of energy.
fn random(i: u32) -> Numbers {
    let sampler = Sampler::new(i, 0, 99);
    let x = |dimension: u32| sampler.pair(dimension)[0];
    let some = |dimension: u32, share: f32| {
        let [a, b] = sampler.pair(dimension);
        if a < share { b } else { 0.0 }
    };
    let colour = |dimension: u32| {
        let [a, b] = sampler.pair(dimension);
        if a < 0.5 { Vec3::ONE } else { Vec3::new(b, x(dimension + 1), 1.0) }
    };
    Numbers {
        base: colour(0),
        diffuse_roughness: some(2, 0.5),
        metalness: if x(3) < 0.3 { 1.0 } else { some(4, 0.3) },
        specular_weight: if x(5) < 0.6 { 1.0 } else { 1.5 * x(6) },
        specular_color: colour(7),
        roughness: x(9),
        anisotropy: some(10, 0.3),
        ior: if x(11) < 0.1 { 0.6 + 0.4 * x(12) } else { 1.0 + 1.5 * x(12) },
        transmission: (if x(13) < 0.2 { 1.0 } else { some(14, 0.3) }, colour(15)),
        subsurface: (if x(35) < 0.1 { 1.0 } else { some(36, 0.3) }, colour(37)),
        subsurface_anisotropy: 2.0 * x(39) - 1.0,
        enters: x(40) < 0.7,
        coat: if x(17) < 0.2 { 1.0 } else { some(18, 0.3) },
        coat_color: colour(19),
        coat_roughness: some(21, 0.7),
        coat_anisotropy: some(33, 0.3),
        coat_ior: if x(34) < 0.2 { 0.3 + 0.7 * x(22) } else { 1.0 + 1.2 * x(22) },
        coat_darkening: x(23),
        fuzz: some(24, 0.3),
        fuzz_color: colour(25),
        fuzz_roughness: x(27),
        film: some(28, 0.3),
        film_thickness: x(29),
        film_ior: 1.0 + 1.5 * x(30),
        thin: x(31) < 0.2,
        outside: x(32) < 0.8,
    }
}

/// Directions above the surface, down to grazing ones.
fn directions(count: u32) -> impl Iterator<Item = Vec3> {
    (0..count).map(move |i| direction(((i as f32 + 0.5) / count as f32).sqrt(), 2.4 * i as f32))
}

#[test]
fn no_surface_returns_more_light_than_arrives() {
    let surfaces = if std::env::var_os("RAYSTREAM_ALL_VIEWS").is_some() { 600 } else { 24 };
    for i in 0..surfaces {
        let numbers = random(i);
        for wo in directions(32) {
            let light = |samples| {
                let [reflected, passed] = furnace(&numbers, wo, samples);
                assert!(reflected.min_element() >= 0.0, "{reflected} from {wo}: {numbers:?}");
                (reflected + passed).max_element()
            };
            // Few samples have more noise than the tolerance.
            let few = light(1 << 13);
            let light = if few < 1.005 { few } else { light(1 << 18) };
            assert!(light < 1.005, "{light} from {wo}: {numbers:?}");
        }
    }
}

#[test]
fn no_coat_over_white_gains_light() {
    let white = Numbers {
        base: Vec3::ONE,
        specular_weight: 0.0,
        coat: 1.0,
        coat_darkening: 0.0,
        ..Numbers::default()
    };
    let all = [0.4, 0.6, 0.9, 0.982, 1.6].into_iter().flat_map(|coat_ior| {
        let coats = [(0.0, 0.0), (0.2, 0.0), (0.3, 0.9), (0.6, 0.6)];
        let surfaces = coats.map(|(coat_roughness, coat_anisotropy)| {
            [1.0, 0.3].map(|coat| Numbers { coat, coat_ior, coat_roughness, coat_anisotropy, ..white })
        });
        surfaces.into_iter().flatten()
    });
    for numbers in all {
        for wo in directions(8).chain([Vec3::Z]) {
            let light = furnace(&numbers, wo, 1 << 13)[0].max_element();
            assert!(light < 1.005, "{light} from {wo}: {numbers:?}");
        }
    }
}

/// The integral of the density over all directions.
struct Density<'a> {
    of: &'a Numbers,
    wo: Vec3,
}

impl LaneTask for Density<'_> {
    type Output = f32;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> f32 {
        const COUNT: u32 = 1 << 14;
        let bsdf = self.of.bsdf(l);
        let wo = Vector::splat(l, self.wo);
        let mut sum = 0.0;
        for first in (0..COUNT).step_by(L::LANES) {
            let sampler = Sampler::of(Int::splat(l, 23), Int::iota(l) + first, 5);
            let mut wi = crate::geom::warp::lanes::cosine_hemisphere(sampler.two(Int::splat(l, 0)));
            let density = crate::geom::warp::lanes::cosine_hemisphere_pdf(wi.z);
            for _ in 0..2 {
                let (_, pdf) = evaluate(&bsdf, wo, wi);
                sum += (pdf / density).to_array().as_ref().iter().sum::<f32>();
                wi.z = -wi.z;
            }
        }
        sum / COUNT as f32
    }
}

#[test]
fn densities_are_those_of_the_samples() {
    let coated =
        Numbers { metalness: 1.0, coat: 1.0, coat_roughness: 0.6, roughness: 0.6, ..Numbers::default() };
    for coat_anisotropy in [0.0, 0.5, 0.8] {
        let numbers = Numbers { coat_anisotropy, ..coated };
        for wo in directions(6) {
            let integral = SimdLevel::detect().run(Density { of: &numbers, wo });
            // Some samples of facets go below the surface.
            assert!(integral < 1.01 && integral > 0.8, "{integral} from {wo}: {numbers:?}");
        }
    }
}

#[test]
fn white_surfaces_lose_little() {
    for roughness in [0.0, 0.1, 0.3, 0.6, 1.0] {
        let white = Numbers { base: Vec3::ONE, roughness, ..Numbers::default() };
        let glass = Numbers { transmission: (1.0, Vec3::ONE), ..white };
        let wax = Numbers { subsurface: (1.0, Vec3::ONE), ..white };
        let half = Numbers { transmission: (0.5, Vec3::ONE), ..wax };
        let all = [
            ("glossy", white, 0.02),
            ("rough diffuse", Numbers { diffuse_roughness: 0.8, ..white }, 0.06),
            ("metal", Numbers { metalness: 1.0, ..white }, 0.04),
            ("glass", glass, 0.1),
            ("glass from inside", Numbers { outside: false, ..glass }, 0.1),
            ("thin glass", Numbers { thin: true, ..glass }, 0.12),
            ("wax", wax, 0.02),
            ("wax from inside", Numbers { outside: false, ..wax }, 0.02),
            ("wax as others show it", Numbers { enters: false, ..wax }, 0.02),
            ("paper", Numbers { thin: true, ..wax }, 0.02),
            ("half glass from inside", Numbers { outside: false, ..half }, 0.06),
            ("coated wax", Numbers { coat: 1.0, coat_roughness: 0.2, ..wax }, 0.06),
            ("coated", Numbers { coat: 1.0, coat_roughness: 0.2, ..white }, 0.05),
            ("half coated", Numbers { coat: 0.5, ..white }, 0.05),
            ("in fuzz", Numbers { fuzz: 1.0, ..white }, 0.12),
        ];
        for (name, numbers, lost) in all {
            for wo in directions(32) {
                let [reflected, passed] = furnace(&numbers, wo, 1 << 11);
                let light = (reflected + passed).min_element();
                let there = light > 1.0 - lost && light < 1.008;
                // The upper limit has room for the noise of few samples.
                assert!(there, "{name} of roughness {roughness} from {wo}: {light}");
            }
        }
    }
}

#[test]
fn light_may_go_either_way() {
    let l = SingleLane;
    let mut crossed = 0;
    for i in 0..400 {
        // Light that diffuses into a body comes out elsewhere.
        let numbers = Numbers { outside: true, enters: false, ..random(i) };
        let (near, far) = (numbers.bsdf(l), Numbers { outside: numbers.thin, ..numbers }.bsdf(l));
        let index = near.through.map_or(1.0, |through| if through.thin { 1.0 } else { through.index.get() });
        for (k, wo) in directions(32).enumerate() {
            let wi = crate::geom::warp::cosine_hemisphere(Sampler::new(i, k as u32, 8).pair(0));
            if wi.z < 0.02 || wo.z < 0.02 {
                continue;
            }
            let value = |bsdf: &OpenPbr<SingleLane>, wo: Vec3, wi: Vec3| {
                Vec3::from(evaluate(bsdf, wo.into(), wi.into()).0) / wi.z.abs()
            };
            let (there, back) = (value(&near, wo, wi), value(&near, wi, wo));
            let off = (there - back).abs().max_element();
            assert!(off <= 3e-3 * there.max_element() + 1e-6, "{there} and {back}: {numbers:?}");
            let flipped = |w: Vec3| Vec3::new(w.x, w.y, -w.z);
            let there = value(&near, wo, -wi) * (index * index);
            let back = value(&far, flipped(-wi), flipped(wo));
            let off = (there - back).abs().max_element();
            assert!(off <= 1e-2 * there.max_element() + 1e-5, "across: {there} and {back}: {numbers:?}");
            crossed += u32::from(there != Vec3::ZERO);
        }
    }
    assert!(crossed > 500, "{crossed}");
}

/// The bits of samples of surfaces in turn and of what they evaluate to.
struct Bits<'a>(&'a [Numbers]);

impl LaneTask for Bits<'_> {
    type Output = Vec<u32>;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Vec<u32> {
        let mut bits = Vec::new();
        for first in (0..32).step_by(L::LANES) {
            let bsdf = Numbers::lanes(l, self.0, first);
            let mut columns = Vec::new();
            for wo in directions(4) {
                let wo = Vector::splat(l, wo);
                let sampler = Sampler::of(Int::splat(l, 5), Int::iota(l) + first, 1);
                let [u, pair] = [0, 1].map(|dimension| Int::splat(l, dimension));
                let sample = sample(&bsdf, wo, sampler.one(u), sampler.two(pair));
                let (value, pdf) = evaluate(&bsdf, wo, sample.wi);
                let vectors = [sample.wi, sample.weight, value].map(|Vector { x, y, z }| [x, y, z]);
                let numbers = vectors.into_iter().flatten().chain([sample.pdf, pdf]);
                columns.extend(numbers.map(|column| column.only(sample.valid).to_array()));
            }
            for lane in 0..L::LANES {
                bits.extend(columns.iter().map(|column| column[lane].to_bits()));
            }
        }
        bits
    }
}

#[test]
fn every_width_has_the_same_bits() {
    for i in 0..150 {
        let (is_plain, is_thin) = (i % 3 == 0, i % 5 == 0);
        let all: [Numbers; 4] = std::array::from_fn(|k| {
            let mut numbers = random(4 * i + k as u32);
            (numbers.thin, numbers.enters) = (is_thin, i % 7 != 0);
            if k < 3 {
                numbers.roughness = [0.0, 0.3, 0.0][k];
            }
            if is_plain {
                (numbers.coat, numbers.fuzz) = (0.0, 0.0);
            }
            numbers
        });
        let one = Bits(&all).run(SingleLane);
        let wide = SimdLevel::detect().run(Bits(&all));
        let differs = (0..one.len()).find(|&k| one[k] != wide[k]);
        // 4 directions of 11 numbers for each lane.
        let of = differs.map(|k| &all[k / 44 % all.len()]);
        assert!(one.len() == wide.len() && of.is_none(), "{differs:?}: {of:?} in {all:?}");
    }
}
