//! The values of a published implementation, where they lie beside the checkout.

use super::super::eon::Eon;
use super::super::film::Film;
use super::super::interface::Interface;
use super::super::metal::Metal;
use super::super::{alphas, modulated};
use super::*;
use crate::lanes::SingleLane;
use std::collections::HashMap;
use std::path::PathBuf;

/// A table: its rows, each with the numbers by column. Empty cells are absent.
fn table(name: &str) -> Option<Vec<HashMap<String, f32>>> {
    let beside = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/reference/openpbr");
    let folder = std::env::var_os("RAYSTREAM_OPENPBR_REFERENCE").map_or_else(beside, PathBuf::from);
    let Ok(text) = std::fs::read_to_string(folder.join(name)) else {
        println!("skipped: {} is not there", folder.join(name).display());
        return None;
    };
    let mut lines = text.lines();
    let columns: Vec<&str> = lines.next()?.split(',').collect();
    let row = |line: &str| {
        let cells = columns.iter().zip(line.split(','));
        let number = |(name, cell): (&&str, &str)| {
            let cell = if *name == "slice" {
                SLICES.iter().position(|s| *s == cell)?.to_string()
            } else {
                cell.into()
            };
            Some((name.to_string(), cell.parse().ok()?))
        };
        cells.filter_map(number).collect()
    };
    Some(lines.map(row).collect())
}

/// The kinds of slices that are compared.
const SLICES: [&str; 8] = [
    "eon_brdf",
    "f82_fresnel",
    "dielectric_fresnel",
    "specular_weight_ior",
    "ggx_alpha",
    "ggx",
    "thin_film",
    "coat_absorption",
];

fn num(x: f32) -> Num<SingleLane> {
    Num::from(x)
}

fn grey(x: f32) -> Vector<SingleLane> {
    Vector::grey(num(x))
}

/// The value of this implementation for a row of `slices.csv`, and the row's.
fn slice(row: &HashMap<String, f32>) -> Option<(&'static str, Vec<(f32, f32)>)> {
    let kind = SLICES[*row.get("slice")? as usize];
    let of = |name: &str| row.get(name).copied().unwrap_or_default();
    let (view, light) = (of("cos_view"), of("cos_light"));
    let wo = direction(view, of("phi_view_deg").to_radians());
    let wi = direction(light, of("phi_light_deg").to_radians());
    let values = match kind {
        "eon_brdf" => {
            let eon = Eon { colour: grey(of("base_color")), roughness: num(of("base_diffuse_roughness")) };
            vec![(eon.brdf(wo.into(), wi.into()).x.get(), of("value_2"))]
        }
        "f82_fresnel" => {
            let (f0, edge) = (grey(of("base_color")), grey(of("specular_color")));
            vec![(Metal { f0, edge, weight: num(1.0) }.at(num(view)).x.get(), of("value_1"))]
        }
        "dielectric_fresnel" => {
            let eta = num(of("specular_ior"));
            vec![(Interface { eta, film: None }.at(num(view)).x.get(), of("value_1"))]
        }
        "specular_weight_ior" => {
            let (eta, _) = modulated(num(of("specular_ior")), num(of("specular_weight")));
            vec![(eta.get(), of("value_1"))]
        }
        "ggx_alpha" => {
            let [along, across] =
                alphas(num(of("specular_roughness")), num(of("specular_roughness_anisotropy")));
            vec![(along.get(), of("value_1")), (across.get(), of("value_2"))]
        }
        "ggx" => {
            let [along, across] =
                alphas(num(of("specular_roughness")), num(of("specular_roughness_anisotropy")));
            let ggx = crate::shade::bsdf::ggx::Ggx { alpha: [along, across] };
            let half = (wo + wi).normalize();
            // The density of visible normals is D G1 cos / z.
            let visible = ggx.visible(wo.into(), half.into()).get();
            let g1 = ggx.g1(wo.into()).get();
            vec![(visible * view / (g1 * wo.dot(half)), of("value_1"))]
        }
        "thin_film" => {
            let ior = num(of("thin_film_ior"));
            let film = Film { weight: num(1.0), thickness: num(of("thin_film_thickness")), ior, eta: ior };
            let light = if of("base_metalness") == 1.0 {
                film.on_metal(grey(of("base_color")), grey(of("specular_color")), num(view))
            } else {
                film.on_dielectric(num(of("specular_ior")), num(view))
            };
            let values = ["value_1", "value_2", "value_3"].map(of);
            Vec3::from(light).to_array().into_iter().zip(values).collect()
        }
        "coat_absorption" => {
            let mut numbers = Numbers { coat: 1.0, coat_ior: of("coat_ior"), ..Numbers::default() };
            numbers.coat_color = Vec3::splat(of("coat_color"));
            let (coat, _) = numbers.bsdf(SingleLane).coat.expect("a coat");
            let one_way = coat.one_way(num(view)).x.get();
            vec![(1.0 + (one_way - 1.0) * of("coat_weight"), of("value_1"))]
        }
        _ => return None,
    };
    Some((kind, values))
}

#[test]
fn formulas_have_the_published_values() {
    let Some(rows) = table("slices.csv") else { return };
    let mut worst: HashMap<&str, (f32, usize)> = HashMap::new();
    for row in &rows {
        let Some((kind, values)) = slice(row) else { continue };
        let (most, count) = worst.entry(kind).or_default();
        for (found, expected) in values {
            let off = (found - expected).abs() / expected.abs().max(2e-3);
            assert!(off < 5e-3, "{kind}: {found} for {expected} in {row:?}");
            (*most, *count) = (most.max(off), *count + 1);
        }
    }
    assert_eq!(worst.len(), SLICES.len(), "{worst:?}");
    for (kind, (off, count)) in worst {
        println!("{kind}: {count} values, at most {:.4} % off", off * 100.0);
    }
}

fn numbers(row: &HashMap<String, f32>) -> Numbers {
    let of = |name: &str| row[name];
    let colour = |name: &str| Vec3::from(["r", "g", "b"].map(|c| row[&format!("{name}_{c}")]));
    Numbers {
        base: colour("base_color") * of("base_weight"),
        diffuse_roughness: of("base_diffuse_roughness"),
        metalness: of("base_metalness"),
        specular_weight: of("specular_weight"),
        specular_color: colour("specular_color"),
        roughness: of("specular_roughness"),
        anisotropy: of("specular_roughness_anisotropy"),
        ior: of("specular_ior"),
        transmission: (of("transmission_weight"), colour("transmission_color")),
        coat: of("coat_weight"),
        coat_color: colour("coat_color"),
        coat_roughness: of("coat_roughness"),
        coat_anisotropy: 0.0,
        coat_ior: of("coat_ior"),
        coat_darkening: of("coat_darkening"),
        fuzz: of("fuzz_weight"),
        fuzz_color: colour("fuzz_color"),
        fuzz_roughness: of("fuzz_roughness"),
        film: of("thin_film_weight"),
        film_thickness: of("thin_film_thickness"),
        film_ior: of("thin_film_ior"),
        thin: of("geometry_thin_walled") == 1.0,
        outside: true,
        ..Numbers::default()
    }
}

/// Reasons for which an albedo may be another: choices that the specification leaves open, or departures from it by the
/// published implementation, which its tables state.
fn reasons(of: &Numbers) -> Vec<&'static str> {
    let is_coated = of.coat > 0.0;
    let is_metal = of.metalness > 0.0;
    let is_translucent = of.transmission.0 > 0.0 && of.metalness < 1.0;
    let all = [
        (
            "a partial coat tints by lerp(1, T, weight)",
            is_coated && of.coat < 1.0 && of.coat_color != Vec3::ONE,
        ),
        ("a rough coat roughens by twice its variance", is_coated && of.coat_roughness > 0.1),
        ("a coat passes, darkens and bends light alike both ways", is_coated),
        ("fuzz is a reciprocal sheen", of.fuzz > 0.0),
        ("a film passes what it does not reflect", of.film > 0.0),
        ("a thin wall reflects by its whole ladder, rough ones too", of.thin && is_translucent),
        ("light between facets of metal is the whole series", is_metal && of.roughness > 0.5),
        ("light between facets of glass is tabulated by index", is_translucent && of.roughness > 0.5),
        ("reflectances of anisotropic facets differ by azimuth", of.anisotropy > 0.0),
    ];
    all.into_iter().filter(|(_, there)| *there).map(|(reason, _)| reason).collect()
}

#[test]
fn albedos_are_near_the_published_ones() {
    let Some(rows) = table("albedo.csv") else { return };
    let (mut sum, mut count, mut far) = (0.0, 0, 0);
    for row in &rows {
        let of = |name: &str| row[name];
        let numbers = numbers(row);
        let wo = Vec3::new(of("view_x"), of("view_y"), of("view_z"));
        let found = furnace(&numbers, wo, 1 << 11);
        let expected = ["reflect", "transmit"]
            .map(|side| Vec3::from(["r", "g", "b"].map(|c| row[&format!("albedo_{side}_{c}")])));
        let mut most = 0.0f32;
        for (found, expected) in found.into_iter().zip(expected) {
            let off = (found - expected).abs();
            (sum, count, most) = (sum + off.element_sum(), count + 3, most.max(off.max_element()));
        }
        if most > 0.05 {
            let reasons = reasons(&numbers);
            println!("set {} from {:.2}: {most:.3}: {}", of("set"), wo.z, reasons.join("; "));
            assert!(!reasons.is_empty(), "{found:?} for {expected:?} of {numbers:?}");
            far += 1;
        }
    }
    let mean = sum / count as f32;
    println!("albedos differ by {mean:.4} in the mean; {far} of {} rows by more than 0.05", rows.len());
    assert!(mean < 0.02, "{mean}");
}
