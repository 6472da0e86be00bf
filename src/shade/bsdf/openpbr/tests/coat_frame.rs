//! Coats with normals and tangents of their own.

use super::energy::{Density, directions, random};
use super::*;
use crate::lanes::SingleLane;

/// Normals of coats, from even ones to steep ones. Surfaces are seen from above these.
fn normals() -> [Vec3; 4] {
    [Vec3::new(0.0, 0.1, 1.0), Vec3::new(0.3, -0.2, 1.0), Vec3::new(-0.7, 0.4, 1.0), Vec3::new(1.5, 0.5, 1.0)]
}

/// Directions from which coat and base are seen.
fn views(normal: Vec3) -> impl Iterator<Item = Vec3> {
    directions(16).filter(move |wo| wo.dot(normal.normalize()) > 1e-3)
}

#[test]
fn no_coat_with_a_frame_gains_light() {
    let surfaces = if std::env::var_os("RAYSTREAM_ALL_VIEWS").is_some() { 300 } else { 12 };
    for i in 0..surfaces {
        let numbers = random(i);
        for normal in normals() {
            let coat = if numbers.coat > 0.0 { numbers.coat } else { 1.0 };
            let numbers = Numbers { coat, coat_frame: frame(normal), ..numbers };
            for wo in views(normal) {
                let light = |samples| {
                    let [reflected, passed] = furnace(&numbers, wo, samples);
                    assert!(reflected.min_element() >= 0.0, "{reflected} from {wo}: {numbers:?}");
                    (reflected + passed).max_element()
                };
                let few = light(1 << 13);
                let light = if few < 1.005 { few } else { light(1 << 18) };
                assert!(light < 1.005, "{light} from {wo}: {numbers:?}");
            }
        }
    }
}

#[test]
fn white_bases_under_a_tilted_coat_lose_little() {
    let white = Numbers {
        base: Vec3::ONE,
        specular_weight: 0.0,
        coat: 1.0,
        coat_darkening: 0.0,
        ..Numbers::default()
    };
    let metal =
        Numbers { base: Vec3::ONE, metalness: 1.0, coat: 1.0, coat_darkening: 0.0, ..Numbers::default() };
    for (name, numbers, lost) in [("white", white, 0.08), ("metal", metal, 0.16)] {
        for normal in &normals()[..2] {
            for coat_roughness in [0.0, 0.3] {
                let numbers = Numbers { coat_roughness, coat_frame: frame(*normal), ..numbers };
                for wo in views(*normal).filter(|wo| wo.z > 0.3) {
                    let light = furnace(&numbers, wo, 1 << 13)[0].min_element();
                    assert!(light > 1.0 - lost, "{name} {light} from {wo}: {numbers:?}");
                }
            }
        }
    }
}

#[test]
fn light_may_go_either_way_through_a_tilted_coat() {
    let l = SingleLane::default();
    let (mut crossed, mut seen) = (0, 0);
    for i in 0..200 {
        let [normal, tangent] = frame(normals()[i as usize % 4]).expect("a frame");
        let coat = 0.5 + 0.5 * Sampler::new(i, 1, 7).pair(0)[0];
        let numbers =
            Numbers { coat, coat_frame: Some([normal, tangent]), outside: true, enters: false, ..random(i) };
        let flipped = |w: Vec3| Vec3::new(w.x, w.y, -w.z);
        let other = Some([-flipped(normal), flipped(tangent)]);
        let (near, far) =
            (numbers.bsdf(l), Numbers { outside: numbers.thin, coat_frame: other, ..numbers }.bsdf(l));
        let none = (0.0, Vec3::ONE);
        let black =
            Numbers { base: Vec3::ZERO, metalness: 0.0, specular_weight: 0.0, transmission: none, ..numbers };
        let bare = Numbers { subsurface: none, ..black }.bsdf(l);
        let index = near.through.map_or(1.0, |through| if through.thin { 1.0 } else { through.index.get() });
        for (k, wo) in views(normal).enumerate() {
            let wi = crate::geom::warp::cosine_hemisphere(Sampler::new(i, k as u32, 8).pair(0));
            if wi.z < 0.02 || wo.z < 0.02 {
                continue;
            }
            let value = |bsdf: &OpenPbr<SingleLane>, wo: Vec3, wi: Vec3| {
                Vec3::from(evaluate(bsdf, wo.into(), wi.into()).0) / wi.z.abs()
            };
            // The coat's own lobe has the coat's cosine, so it is compared by itself, as is that of fibres.
            let own = [value(&bare, wo, wi), value(&bare, wi, wo)];
            let [there, back] = [value(&near, wo, wi) - own[0], value(&near, wi, wo) - own[1]];
            let (off, most) =
                ((there - back).abs().max_element(), there.max(own[0]).max(own[1]).max_element());
            assert!(off <= 3e-3 * most + 1e-6, "{there} and {back}: {numbers:?}");
            let cosines = [wo, wi].map(|w| w.dot(normal));
            if numbers.fuzz == 0.0 && cosines[1] > 0.02 && cosines[0] > 0.02 {
                let [there, back] = [own[0] * wi.z / cosines[1], own[1] * wo.z / cosines[0]];
                let off = (there - back).abs().max_element();
                assert!(off <= 3e-3 * there.max_element() + 1e-6, "coat: {there} and {back}: {numbers:?}");
                seen += u32::from(there != Vec3::ZERO);
            }
            let there = value(&near, wo, -wi) * (index * index);
            let back = value(&far, flipped(-wi), flipped(wo));
            let off = (there - back).abs().max_element();
            assert!(off <= 1e-2 * there.max_element() + 1e-5, "across: {there} and {back}: {numbers:?}");
            crossed += u32::from(there != Vec3::ZERO);
        }
    }
    assert!(crossed > 100 && seen > 100, "{crossed}, {seen}");
}

#[test]
fn densities_of_tilted_coats_are_those_of_the_samples() {
    for normal in &normals()[..3] {
        let metal =
            Numbers { metalness: 1.0, coat: 1.0, coat_roughness: 0.5, roughness: 0.6, ..Numbers::default() };
        let numbers = Numbers { coat_anisotropy: 0.5, coat_frame: frame(*normal), ..metal };
        for wo in views(*normal).filter(|wo| wo.z > 0.2) {
            let integral = SimdLevel::detect().run(Density { of: &numbers, wo });
            assert!(integral < 1.02 && integral > 0.7, "{integral} from {wo}: {numbers:?}");
        }
    }
}

#[test]
fn a_frame_that_is_the_base_s_changes_nothing_but_rounding() {
    let l = SingleLane::default();
    for i in 0..100 {
        let numbers = Numbers { coat: 0.75, roughness: 0.2 + 0.8 * random(i).roughness, ..random(i) };
        let (plain, framed) = (numbers.bsdf(l), Numbers { coat_frame: frame(Vec3::Z), ..numbers }.bsdf(l));
        for (k, wo) in directions(8).enumerate() {
            let wi = crate::geom::warp::cosine_hemisphere(Sampler::new(i, k as u32, 8).pair(0));
            let [a, b] = [&plain, &framed].map(|bsdf| Vec3::from(evaluate(bsdf, wo.into(), wi.into()).0));
            assert!(
                (a - b).abs().max_element() <= 1e-5 * a.max_element().max(1.0),
                "{a} and {b}: {numbers:?}"
            );
            let [a, b] = [&plain, &framed].map(|bsdf| Vec3::from(bsdf.smooth(wo.into()).reflection));
            assert!((a - b).abs().max_element() <= 1e-5, "{a} and {b}: {numbers:?}");
        }
    }
}

#[test]
fn a_smooth_coat_mirrors_at_its_own_normal() {
    let l = SingleLane::default();
    let normal = Vec3::new(0.3, 0.1, 1.0).normalize();
    let wo = Vec3::new(0.2, -0.3, 1.0).normalize();
    let coated = Numbers { coat: 1.0, coat_frame: frame(normal), ..Numbers::default() };
    let way = Vec3::from(coated.bsdf(l).smooth(wo.into()).reflected);
    assert!((way - (normal * (2.0 * normal.dot(wo)) - wo)).length() < 1e-5, "{way}");
    let mirror = Numbers { roughness: 0.0, metalness: 1.0, ..coated };
    let smooth = mirror.bsdf(l).smooth(wo.into());
    assert_eq!(Vec3::from(smooth.reflected), Vec3::new(-wo.x, -wo.y, wo.z), "the base's mirror image");
    let (light, pdf) = evaluate(&mirror.bsdf(l), wo.into(), way.into());
    assert!(light.x.get() > 1.0 && pdf.get() > 1.0, "the coat beside it is rough");
}
