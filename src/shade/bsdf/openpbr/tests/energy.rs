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
        coat: if x(17) < 0.2 { 1.0 } else { some(18, 0.3) },
        coat_color: colour(19),
        coat_roughness: some(21, 0.7),
        coat_ior: 1.0 + 1.2 * x(22),
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
            let [reflected, passed] = furnace(&numbers, wo, 1 << 13);
            let light = (reflected + passed).max_element();
            assert!(light < 1.005 && reflected.min_element() >= 0.0, "{light} from {wo}: {numbers:?}");
        }
    }
}

#[test]
fn white_surfaces_lose_little() {
    for roughness in [0.0, 0.1, 0.3, 0.6, 1.0] {
        let white = Numbers { base: Vec3::ONE, roughness, ..Numbers::default() };
        let glass = Numbers { transmission: (1.0, Vec3::ONE), ..white };
        let all = [
            ("glossy", white, 0.02),
            ("rough diffuse", Numbers { diffuse_roughness: 0.8, ..white }, 0.06),
            ("metal", Numbers { metalness: 1.0, ..white }, 0.04),
            ("glass", glass, 0.1),
            ("glass from inside", Numbers { outside: false, ..glass }, 0.1),
            ("thin glass", Numbers { thin: true, ..glass }, 0.12),
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
    let l = SingleLane::default();
    let mut crossed = 0;
    for i in 0..400 {
        let numbers = Numbers { outside: true, ..random(i) };
        let (near, far) = (numbers.bsdf(l), Numbers { outside: numbers.thin, ..numbers }.bsdf(l));
        let index = near.through.map_or(1.0, |through| if through.thin { 1.0 } else { through.index.get() });
        for (k, wo) in directions(32).enumerate() {
            let wi = crate::geom::warp::cosine_hemisphere(Sampler::new(i, k as u32, 8).pair(0));
            if wi.z < 0.02 || wo.z < 0.02 {
                continue;
            }
            let value = |bsdf: &OpenPbr<SingleLane>, wo: Vec3, wi: Vec3| {
                Vec3::from(bsdf.evaluate(wo.into(), wi.into()).0) / wi.z.abs()
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

/// The bits of samples and of what they evaluate to.
struct Bits<'a>(&'a Numbers);

impl LaneTask for Bits<'_> {
    type Output = Vec<u32>;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Vec<u32> {
        let bsdf = self.0.bsdf(l);
        let mut bits = Vec::new();
        for wo in directions(4) {
            let wo = Vector::splat(l, wo);
            for first in (0..32).step_by(L::LANES) {
                let sampler = Sampler::of(Int::splat(l, 5), Int::iota(l) + first, 1);
                let [u, pair] = [0, 1].map(|dimension| Int::splat(l, dimension));
                let sample = bsdf.sample(wo, sampler.one(u), sampler.two(pair));
                let (value, pdf) = bsdf.evaluate(wo, sample.wi);
                let columns = [
                    sample.wi.x,
                    sample.wi.z,
                    sample.weight.x,
                    sample.weight.z,
                    sample.pdf,
                    value.x,
                    value.y,
                    pdf,
                ]
                .map(|column| column.only(sample.valid).to_array());
                for lane in 0..L::LANES {
                    bits.extend(columns.iter().map(|column| column[lane].to_bits()));
                }
            }
        }
        bits
    }
}

#[test]
fn every_width_has_the_same_bits() {
    for i in 0..200 {
        let numbers = random(i);
        let one = Bits(&numbers).run(SingleLane::default());
        assert!(one == SimdLevel::detect().run(Bits(&numbers)), "{numbers:?}");
    }
}
