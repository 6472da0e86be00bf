//! Tests of all BSDFs: samples follow `evaluate`, no light is lost, and directions are reciprocal.

use super::{Dielectric, MIN_ROUGHNESS, Matte, Mirror, Principled, Smoothness};
use crate::geom::{Sampler, warp};
use crate::lanes::SingleLane;
use crate::scene::{self, Colour, Scalar, Scene, TexturePoint};
use crate::shade::CoatShape;
use crate::shade::single::{Bsdf, Smooth};
use glam::Vec3;
use std::f32::consts::{PI, TAU};

mod coats;
mod openpbr;
mod sampling;

fn principled(edit: impl FnOnce(&mut scene::Principled)) -> Bsdf<'static> {
    seen_from(true, edit)
}

fn seen_from(outside: bool, edit: impl FnOnce(&mut scene::Principled)) -> Bsdf<'static> {
    described(outside, None, edit)
}

/// A surface with coats whose normals are tilted.
fn leaning(edit: impl FnOnce(&mut scene::Principled)) -> Bsdf<'static> {
    let normal = Vec3::new(0.3, -0.2, 0.9).normalize().into();
    described(true, Some(CoatShape { normal, bumps: 0.0.into() }), edit)
}

fn described(
    outside: bool,
    coat: Option<CoatShape<SingleLane>>,
    edit: impl FnOnce(&mut scene::Principled),
) -> Bsdf<'static> {
    let mut surface = scene::Principled::default();
    edit(&mut surface);
    let point = TexturePoint::without_width([0.0.into(); 2], 0.into(), [0.0.into(); 2]);
    let scene = Scene::default();
    Bsdf(super::Bsdf::Principled(Principled::new(
        &scene,
        &surface,
        &point,
        &coat,
        outside.into(),
        Smoothness::EXACT,
    )))
}

fn rough(roughness: f32) -> impl FnOnce(&mut scene::Principled) {
    move |s| s.roughness = Scalar::constant(roughness)
}

fn brushed(strength: f32) -> impl Fn(&mut scene::Principled) {
    move |s| {
        let strength = Scalar::constant(strength);
        s.anisotropy = Some(scene::Anisotropy { strength, rotation: 0.0, direction: None });
    }
}

fn velvet(colour: Vec3, roughness: f32) -> impl Fn(&mut scene::Principled) {
    move |s| {
        let (colour, roughness) = (Colour::constant(colour), Scalar::constant(roughness));
        s.sheen = Some(scene::Sheen { colour, roughness });
    }
}

fn translucent(share: f32) -> impl Fn(&mut scene::Principled) {
    move |s| {
        let (share, colour) = (Scalar::constant(share), Colour::constant(Vec3::ONE));
        s.diffuse_transmission = Some(scene::DiffuseTransmission { share, colour });
    }
}

fn soapy(nanometres: f32) -> impl Fn(&mut scene::Principled) {
    move |s| {
        s.iridescence = Some(scene::Iridescence {
            strength: Scalar::constant(1.0),
            ior: 1.33,
            thickness_nm: [nanometres; 2],
            thickness_texture: None,
        });
    }
}

/// Surfaces that lose some light even if they are white.
fn lossy() -> Vec<(String, Bsdf<'static>)> {
    let mut all = Vec::new();
    for roughness in [0.1, 0.4, 1.0] {
        let mut add = |name: &str, edit: &dyn Fn(&mut scene::Principled)| {
            let bsdf = principled(|s| {
                rough(roughness)(s);
                edit(s);
            });
            all.push((format!("{name} of roughness {roughness}"), bsdf));
        };
        for fibres in [0.0, 0.3, 0.6, 1.0] {
            add(&format!("velvet of {fibres}"), &velvet(Vec3::new(1.0, 0.6, 0.2), fibres));
            add(&format!("metal velvet of {fibres}"), &|s| {
                s.metallic = Scalar::constant(1.0);
                velvet(Vec3::ONE, fibres)(s);
            });
        }
        for nanometres in [0.0, 150.0, 400.0, 1000.0] {
            add(&format!("{nanometres} nm on white"), &soapy(nanometres));
            add(&format!("{nanometres} nm on metal"), &|s| {
                s.metallic = Scalar::constant(1.0);
                soapy(nanometres)(s);
            });
            add(&format!("{nanometres} nm on glass"), &|s| {
                s.transmission = Scalar::constant(1.0);
                soapy(nanometres)(s);
            });
        }
        add("film on a body of glass", &|s| {
            s.transmission = Scalar::constant(1.0);
            s.thin = false;
            soapy(400.0)(s);
        });
        add("all at once", &|s| {
            s.metallic = Scalar::constant(0.4);
            brushed(0.6)(s);
            velvet(Vec3::new(0.3, 0.9, 0.5), 0.4)(s);
            soapy(450.0)(s);
            s.clearcoat = Scalar::constant(0.5);
            s.clearcoat_roughness = Scalar::constant(0.3);
        });
    }
    all
}

/// Adds coats of increasing index, outermost first, with these roughnesses and this tint.
fn varnished(roughnesses: &[f32], tint: Vec3) -> impl Fn(&mut scene::Principled) {
    let mut coats = Vec::new();
    for (i, &roughness) in roughnesses.iter().enumerate() {
        coats.push(scene::Coat { weight: 1.0 - 0.1 * i as f32, ior: 1.3 + 0.2 * i as f32, roughness, tint });
    }
    move |s| s.coats = scene::Coats::new(&coats).expect("not too many")
}

fn glass(eta: f32) -> Bsdf<'static> {
    Bsdf(super::Bsdf::Dielectric(Dielectric { eta: eta.into(), transmittance: Vec3::ONE.into() }))
}

/// White surfaces that absorb nothing.
fn lossless() -> Vec<(String, Bsdf<'static>)> {
    lossless_of(&[0.0, 0.04, 0.1, 0.25, 0.5, 0.75, 1.0], &[0.0, 0.3, 1.0])
}

/// Surfaces that absorb nothing, with the given roughnesses of the surface and of the coat.
fn lossless_of(roughnesses: &[f32], coats: &[f32]) -> Vec<(String, Bsdf<'static>)> {
    let mut all = vec![
        ("matte".to_owned(), Bsdf(super::Bsdf::Matte(Matte { reflectance: Vec3::ONE.into() }))),
        ("mirror".to_owned(), Bsdf(super::Bsdf::Mirror(Mirror { reflectance: Vec3::ONE.into() }))),
    ];
    for eta in [1.5, 1.0 / 1.5, 1.0, 2.4] {
        all.push((format!("dielectric {eta}"), glass(eta)));
    }
    for &roughness in roughnesses {
        all.extend(translucent_of(roughness, coats[0]));
        let mut add = |name: &str, outside: bool, edit: &dyn Fn(&mut scene::Principled)| {
            let bsdf = seen_from(outside, |s| {
                rough(roughness)(s);
                edit(s);
            });
            all.push((format!("{name} of roughness {roughness}"), bsdf));
        };
        add("dielectric over white", true, &|_| {});
        add("metal", true, &|s| s.metallic = Scalar::constant(1.0));
        add("half metal", true, &|s| s.metallic = Scalar::constant(0.5));
        add("strong index over white", true, &|s| s.ior = 2.4);
        for strength in [0.3, 0.7, 1.0] {
            add(&format!("metal brushed by {strength}"), true, &|s| {
                s.metallic = Scalar::constant(1.0);
                brushed(strength)(s);
            });
            add(&format!("white, brushed by {strength}"), true, &brushed(strength));
        }
        add("thin glass", true, &|s| s.transmission = Scalar::constant(1.0));
        add("half thin glass", true, &|s| s.transmission = Scalar::constant(0.5));
        for outside in [true, false] {
            add("solid glass", outside, &|s| {
                s.transmission = Scalar::constant(1.0);
                s.thin = false;
            });
            for ior in [1.1, 2.4] {
                add(&format!("body of index {ior}"), outside, &|s| {
                    s.transmission = Scalar::constant(1.0);
                    s.thin = false;
                    s.ior = ior;
                });
            }
            add("body with a dull reflection", outside, &|s| {
                s.transmission = Scalar::constant(1.0);
                s.thin = false;
                s.specular = Scalar::constant(0.3);
                s.specular_colour = Colour::constant(Vec3::new(1.0, 0.5, 0.0));
            });
            add("half solid glass, coated", outside, &|s| {
                s.transmission = Scalar::constant(0.5);
                s.thin = false;
                s.clearcoat = Scalar::constant(0.7);
                s.clearcoat_roughness = Scalar::constant(coats[0]);
            });
        }
        for &coat in coats {
            add("coated metal", true, &|s| {
                s.metallic = Scalar::constant(1.0);
                s.clearcoat = Scalar::constant(1.0);
                s.clearcoat_roughness = Scalar::constant(coat);
            });
            add("coated white", true, &|s| {
                s.clearcoat = Scalar::constant(0.5);
                s.clearcoat_roughness = Scalar::constant(coat);
            });
        }
    }
    all
}

/// Surfaces that absorb nothing and transmit diffusely, and one of given glossiness.
fn translucent_of(roughness: f32, coat: f32) -> Vec<(String, Bsdf<'static>)> {
    let mut all = Vec::new();
    let mut add = |name: &str, outside: bool, edit: &dyn Fn(&mut scene::Principled)| {
        let bsdf = seen_from(outside, |s| {
            rough(roughness)(s);
            edit(s);
        });
        all.push((format!("{name} of roughness {roughness}"), bsdf));
    };
    add("leaf", true, &translucent(1.0));
    add("half a leaf, coated", true, &|s| {
        translucent(0.5)(s);
        s.clearcoat = Scalar::constant(0.7);
        s.clearcoat_roughness = Scalar::constant(coat);
    });
    add("half thin glass, half a leaf", true, &|s| {
        translucent(0.5)(s);
        s.transmission = Scalar::constant(0.5);
    });
    add("glossy", true, &|s| {
        s.glossiness = Some(Scalar::constant(1.0 - roughness));
        s.specular_colour = Colour::constant(Vec3::splat(0.5 / 0.04));
    });
    for outside in [true, false] {
        add("body of wax and glass", outside, &|s| {
            translucent(0.4)(s);
            s.transmission = Scalar::constant(0.5);
            s.thin = false;
        });
    }
    all
}

/// Surfaces that scatter, including coloured ones.
fn scattering() -> Vec<(String, Bsdf<'static>)> {
    let mut all: Vec<(String, Bsdf<'static>)> =
        lossless().into_iter().filter(|(_, bsdf)| !bsdf.is_smooth()).collect();
    all.extend(lossy());
    all.push((
        "painted".into(),
        principled(|s| {
            s.base_colour = Colour::constant(Vec3::new(0.8, 0.3, 0.1));
            s.metallic = Scalar::constant(0.3);
            s.roughness = Scalar::constant(0.35);
            s.specular = Scalar::constant(0.6);
            s.specular_colour = Colour::constant(Vec3::new(0.9, 1.0, 2.0));
            s.clearcoat = Scalar::constant(0.8);
            s.clearcoat_roughness = Scalar::constant(0.15);
        }),
    ));
    all.extend([0.1, 0.3, 0.9].into_iter().flat_map(openpbr::of_roughness));
    all
}

fn direction(z: f32, phi: f32) -> Vec3 {
    let r = (1.0 - z * z).max(0.0).sqrt();
    Vec3::new(r * libm::cosf(phi), r * libm::sinf(phi), z)
}

/// Directions from straight above to grazing.
fn views() -> impl Iterator<Item = Vec3> {
    [1.0, 0.8, 0.45, 0.2, 0.07].into_iter().map(|z| direction(z, 0.9))
}

/// The directions in which a surface is tested: one of them, in turns, or all with `RAYSTREAM_ALL_VIEWS`.
fn in_turn(case: usize, views: impl IntoIterator<Item = Vec3>) -> Vec<Vec3> {
    let all: Vec<Vec3> = views.into_iter().collect();
    if std::env::var_os("RAYSTREAM_ALL_VIEWS").is_some() { all } else { vec![all[case % all.len()]] }
}

/// The mean weight of samples: the share of a white environment that is returned. Light that passes into
/// another medium counts as energy, without the change of its solid angle.
fn furnace(bsdf: &Bsdf, wo: Vec3, samples: u32) -> Vec3 {
    let sum: Vec3 = (0..samples)
        .filter_map(|i| {
            let sampler = Sampler::new(17, i, 3);
            let sample = bsdf.sample(wo, sampler.single(0), sampler.pair(1))?;
            Some(sample.weight * sample.eta * sample.eta)
        })
        .sum();
    sum / samples as f32
}

#[test]
fn a_white_furnace_returns_all_light() {
    for (name, bsdf) in lossless() {
        for wo in views() {
            let light = furnace(&bsdf, wo, 1 << 12);
            // The loss of a body's facets is interpolated, also over the index.
            let is_body = name.contains("body") || name.contains("solid");
            let allowed = if wo.z < 0.1 || is_body { 0.02 } else { 0.01 };
            // Light that passes a coat at one angle, and that rough facets then spread, may not leave at
            // another angle.
            let lost =
                if name.contains("coated") && !name.ends_with("roughness 0") { 0.085 } else { allowed };
            let is_all = light.max_element() < 1.0 + allowed && light.min_element() > 1.0 - lost;
            assert!(is_all, "{name} from {wo}: {light}");
        }
    }
}

/// Surfaces under several coats: two with flat coats, and one with tilted coats.
fn stacked(roughness: f32, coats: &[f32], tint: Vec3) -> [(String, Bsdf<'static>); 3] {
    let edit = |metallic: f32, clear: f32| {
        move |s: &mut scene::Principled| {
            rough(roughness)(s);
            s.metallic = Scalar::constant(metallic);
            s.clearcoat = Scalar::constant(clear);
            varnished(coats, tint)(s);
        }
    };
    let name = |of: &str| format!("{of} of roughness {roughness} under coats of {coats:?}");
    [
        (name("white"), principled(edit(0.0, 0.0))),
        (name("metal"), principled(edit(1.0, 0.8))),
        (name("leaning over half metal"), leaning(edit(0.5, 0.8))),
    ]
}

const STACKS: [&[f32]; 3] = [&[0.0], &[0.5, 0.0, 0.2], &[0.0; 8]];

/// Surfaces under several coats, of many roughnesses.
fn all_stacked(tint: Vec3) -> impl Iterator<Item = (String, Bsdf<'static>)> {
    let all = [0.0, 0.5].into_iter().flat_map(|roughness| STACKS.map(|coats| (roughness, coats)));
    all.flat_map(move |(roughness, coats)| stacked(roughness, coats, tint))
}

const VARNISH: Vec3 = Vec3::new(1.0, 0.6, 0.2);

#[test]
fn coloured_surfaces_gain_no_energy() {
    for (case, (name, bsdf)) in scattering().into_iter().chain(all_stacked(VARNISH)).enumerate() {
        for wo in in_turn(case, views()) {
            let light = furnace(&bsdf, wo, 1 << 13);
            assert!(light.max_element() < 1.02 && light.min_element() >= 0.0, "{name} from {wo}: {light}");
        }
    }
}

#[test]
fn sheen_and_films_lose_little_energy() {
    for (name, bsdf) in lossy().iter().filter(|(name, _)| !name.contains("at once")) {
        for wo in views() {
            let light = furnace(bsdf, wo, 1 << 12);
            // A film over a rough white body passes least at grazing angles, by its reflection at a facet
            // that lies flat.
            let least = if name.contains("metal velvet") { 0.5 } else { 0.2 };
            assert!(light.max_element() > least, "{name} from {wo}: {light}");
        }
    }
}

#[test]
fn sample_weights_are_evaluate_over_density() {
    for (name, bsdf) in scattering().into_iter().chain(all_stacked(VARNISH)) {
        for wo in views() {
            for i in 0..300 {
                let sampler = Sampler::new(5, i, 1);
                let Some(sample) = bsdf.sample(wo, sampler.single(0), sampler.pair(1)) else { continue };
                assert!((sample.wi.length() - 1.0).abs() < 1e-4, "{name}");
                if sample.specular {
                    assert!(sample.pdf == f32::INFINITY);
                    continue;
                }
                let (value, pdf) = bsdf.evaluate(wo, sample.wi);
                assert!((pdf - sample.pdf).abs() <= 1e-3 * pdf, "{name}: {pdf} and {}", sample.pdf);
                let off = (value - sample.weight * sample.pdf).abs().max_element();
                assert!(off <= 1e-3 * value.max_element(), "{name}: {value} and {sample:?}");
            }
        }
    }
}

#[test]
fn light_may_go_either_way() {
    // Tilted coats have another cosine than the layers below.
    let stacked = all_stacked(VARNISH).filter(|(name, _)| !name.contains("leaning"));
    for (name, bsdf) in scattering().into_iter().chain(stacked) {
        for (i, wo) in views().enumerate() {
            for k in 0..40 {
                let wi = warp::cosine_hemisphere(Sampler::new(i as u32, k, 8).pair(0));
                if wi.z < 0.02 {
                    continue;
                }
                let there = bsdf.evaluate(wo, wi).0 / wi.z;
                let back = bsdf.evaluate(wi, wo).0 / wo.z;
                let off = (there - back).abs().max_element();
                assert!(off <= 2e-3 * there.max_element(), "{name}: {there} and {back}");
            }
        }
    }
}

#[test]
fn light_may_cross_a_frosted_surface_either_way() {
    let mut crossed = 0;
    for roughness in [0.05, 0.2, 0.6, 1.0] {
        for (thin, ior) in [(true, 1.5), (false, 1.5), (false, 2.2), (false, 1.1)] {
            let side = |outside| {
                seen_from(outside, |s| {
                    rough(roughness)(s);
                    s.transmission = Scalar::constant(0.8);
                    s.base_colour = Colour::constant(Vec3::new(0.9, 0.5, 0.2));
                    s.specular_colour = Colour::constant(Vec3::new(1.0, 0.5, 0.2));
                    s.metallic = Scalar::constant(0.2);
                    s.clearcoat = Scalar::constant(if roughness > 0.5 { 0.6 } else { 0.0 });
                    if roughness < 0.1 {
                        translucent(0.5)(s);
                    }
                    (s.thin, s.ior) = (thin, ior);
                })
            };
            let (near, far) = (side(true), side(false));
            let ratio = if thin { 1.0 } else { ior * ior };
            for (i, wo) in views().enumerate() {
                for k in 0..200 {
                    let wi = -warp::cosine_hemisphere(Sampler::new(i as u32, k, 8).pair(0));
                    if wi.z > -0.02 {
                        continue;
                    }
                    let turned = |w: Vec3| Vec3::new(w.x, w.y, -w.z);
                    let there = near.evaluate(wo, wi).0 / -wi.z * ratio;
                    let back = far.evaluate(turned(wi), turned(wo)).0 / wo.z;
                    let off = (there - back).abs().max_element();
                    assert!(
                        off <= 5e-3 * there.max_element() + 1e-6,
                        "{roughness} {ior} thin {thin}, {wo} {wi}: {there} and {back}"
                    );
                    crossed += u32::from(there != Vec3::ZERO);
                }
            }
        }
    }
    assert!(crossed > 10_000, "{crossed}");
}

#[test]
fn a_coloured_reflection_at_normal_incidence_does_not_tint_the_base() {
    let specular = Vec3::new(0.9, 0.5, 0.1);
    let bsdf = principled(|s| {
        s.glossiness = Some(Scalar::constant(1.0));
        s.specular_colour = Colour::constant(specular / 0.04);
        s.base_colour = Colour::constant(Vec3::splat(0.8));
    });
    let (way, reflected) = bsdf.smooth(Vec3::Z).reflection.expect("it is smooth");
    assert!((way - Vec3::Z).length() < 1e-6 && (reflected - specular).abs().max_element() < 1e-3);
    // The diffuse base gets what the brightest channel leaves: its albedo is the specification's c_diff.
    let diffuse = furnace(&bsdf, Vec3::Z, 1 << 12) - specular;
    assert!((diffuse - Vec3::splat(0.8 * 0.1)).abs().max_element() < 0.01, "{diffuse}");
}

#[test]
fn the_least_frost_is_next_to_clear() {
    for (outside, thin) in [(true, false), (false, false), (true, true)] {
        let glass = |roughness: f32| {
            seen_from(outside, |s| {
                rough(roughness)(s);
                s.transmission = Scalar::constant(1.0);
                s.thin = thin;
            })
        };
        let (clear, frosted) = (glass(0.99 * MIN_ROUGHNESS), glass(1.01 * MIN_ROUGHNESS));
        assert!(!clear.is_frosted() && frosted.is_frosted());
        for wo in [direction(1.0, 0.0), direction(0.85, 0.7)] {
            let (way, weight) = clear.smooth(wo).transmission.expect("passes");
            assert_eq!(frosted.smooth(wo).transmission, None);
            let (mut mean, mut light, n) = (Vec3::ZERO, Vec3::ZERO, 1 << 12);
            for i in 0..n {
                let sampler = Sampler::new(4, i, 2);
                if let Some(sample) = frosted.sample(wo, sampler.single(0), sampler.pair(1))
                    && sample.wi.z < 0.0
                {
                    (mean, light) = (mean + sample.wi * sample.weight.x, light + sample.weight);
                }
            }
            assert!((mean.normalize() - way).length() < 5e-3, "{way} {}", mean.normalize());
            let off = (light / n as f32 / weight - Vec3::ONE).abs().max_element();
            assert!(off < 0.02, "{weight} {}", light / n as f32);
        }
    }
}

#[test]
fn smooth_directions_obey_snell_and_the_mirror() {
    let wo = direction(0.6, 0.4);
    let Smooth { reflection, transmission, eta } = glass(1.5).smooth(wo);
    let ((up, reflected), (down, passed)) = (reflection.expect("share"), transmission.expect("share"));
    assert_eq!(eta, 1.5);
    assert!((up - Vec3::new(-wo.x, -wo.y, wo.z)).length() < 1e-6);
    assert!((down.truncate() * 1.5 + wo.truncate()).length() < 1e-6 && down.z < 0.0);
    assert!((reflected + passed * 1.5 * 1.5 - Vec3::ONE).abs().max_element() < 1e-6);
    assert!(glass(1.0 / 1.5).smooth(direction(0.3, 0.0)).transmission.is_none(), "total reflection");
}
