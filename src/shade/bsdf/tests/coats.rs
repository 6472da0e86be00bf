//! One and several coats.

use super::*;

#[test]
fn white_stays_white_under_many_coats() {
    for (name, bsdf) in all_stacked(Vec3::ONE) {
        for wo in views() {
            let light = furnace(&bsdf, wo, 1 << 11);
            // Rough layers lose light that passes one of them at an angle and another at a different one.
            let lost = if name.starts_with("white") && !name.contains('5') { 0.02 } else { 0.15 };
            let is_all = light.max_element() < 1.015 && light.min_element() > 1.0 - lost;
            assert!(is_all, "{name} from {wo}: {light}");
        }
    }
}

#[test]
fn leaning_coats_mirror_around_their_own_normal() {
    let over = |roughness| {
        leaning(|s| {
            rough(roughness)(s);
            s.base_colour = Colour::constant(Vec3::ZERO);
            s.specular = Scalar::constant(0.0);
            s.clearcoat = Scalar::constant(1.0);
        })
    };
    let normal = Vec3::new(0.3, -0.2, 0.9).normalize();
    for wo in views() {
        let (way, weight) = over(0.5).smooth(wo).reflection.expect("a mirror");
        assert!((way - (normal * (2.0 * normal.dot(wo)) - wo)).length() < 1e-5);
        let fresnel = 0.04 + 0.96 * (1.0 - normal.dot(wo)).powi(5);
        assert!((weight - fresnel).abs().max_element() < 1e-4, "{weight} for {fresnel}");
        // Over smooth facets, which mirror into another direction, the coat is slightly rough and as bright.
        let light = furnace(&over(0.0), wo, 1 << 12);
        assert!((light - fresnel).abs().max_element() < 0.01, "{light} for {fresnel}");
    }
}

#[test]
fn one_coat_is_the_same_in_both_notations() {
    for roughness in [0.0, 0.2, 0.7] {
        for coat in [0.0, 0.1, 0.5, 1.0] {
            for metallic in [0.0, 0.6] {
                let [clear, stacked] = [false, true].map(|is_stack| {
                    principled(|s| {
                        rough(roughness)(s);
                        s.metallic = Scalar::constant(metallic);
                        let coat = scene::Coat { weight: 0.7, roughness: coat, ..scene::Coat::CLEAR };
                        if is_stack {
                            s.coats = scene::Coats::new(&[coat]).expect("one");
                        } else {
                            s.clearcoat = Scalar::constant(coat.weight);
                            s.clearcoat_roughness = Scalar::constant(coat.roughness);
                        }
                    })
                });
                for (i, wo) in views().enumerate() {
                    let [a, b] = [&clear, &stacked].map(|bsdf| bsdf.smooth(wo).reflection.map(|r| r.1));
                    let [a, b] = [a, b].map(Option::unwrap_or_default);
                    assert!((a - b).abs().max_element() < 1e-5, "{a} and {b}");
                    for k in 0..20 {
                        let wi = warp::cosine_hemisphere(Sampler::new(i as u32, k, 8).pair(0));
                        let (a, b) = (clear.evaluate(wo, wi).0, stacked.evaluate(wo, wi).0);
                        assert!((a - b).abs().max_element() <= 1e-3 * a.max_element(), "{a} and {b}");
                    }
                }
            }
        }
    }
}

#[test]
fn tints_deepen_with_the_refracted_path() {
    let tint = Vec3::new(0.9, 0.5, 0.04);
    let mirror = principled(|s| {
        rough(0.0)(s);
        s.metallic = Scalar::constant(1.0);
        s.coats = scene::Coats::new(&[scene::Coat { tint, ior: 1.7, ..scene::Coat::CLEAR }]).expect("one");
    });
    for wo in views() {
        let refracted = (1.0 - (1.0 - wo.z * wo.z) / (1.7 * 1.7)).sqrt();
        let f0 = (0.7f32 / 2.7).powi(2);
        let fresnel = f0 + (1.0 - f0) * (1.0 - wo.z).powi(5);
        let expected = tint.map(|c| libm::powf(c, 1.0 / refracted)) * (1.0 - fresnel) + fresnel;
        let (_, light) = mirror.smooth(wo).reflection.expect("a mirror");
        assert!((light - expected).abs().max_element() < 1e-4, "{light} for {expected}");
    }
}
