//! Names, options and surfaces of plug-ins.

use super::*;
use crate::lanes::{Lanes, Num, Vector};
use crate::scene::{
    Finish, Material, Points, Procedural, ProceduralSurface, Scattered, Scattering, ScatteringSurface,
    Surface, SurfaceRequest,
};
use glam::Vec3;

#[derive(Debug)]
struct Mine;

impl Procedural for Mine {
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        Finish::matte(points)
    }
}

impl Scattering for Mine {
    fn evaluate<L: Lanes>(&self, _: &Points<L>, _: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        (Vector::zero(wi.lanes()), Num::zero(wi.lanes()))
    }

    fn sample<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, _: Num<L>, _: [Num<L>; 2]) -> Scattered<L> {
        Scattered::evaluated(wo, self.evaluate(at, wo, wo))
    }
}

#[test]
fn surfaces_go_on_the_materials_of_their_name_and_misspelt_names_are_told() {
    let registry = Registry::built_in()
        .with_surface("wood", ProceduralSurface::new(Mine))
        .with_surface("dust", ScatteringSurface::new(Mine))
        .with_surface(String::from("nothing"), ScatteringSurface::new(Mine));
    let materials = ["dust", "stone", "wood", "dust"].map(|name| Material::matte(name, Vec3::ONE)).to_vec();
    let mut scene = Scene { materials, ..Scene::default() };
    let stone = scene.materials[1].surface;
    let warnings = registry.apply_surfaces(&mut scene, &[]).expect("no options");
    let expected = "the surface \"nothing\" is not used: no material is named \"nothing\"; the scene has \"dust\", \
                    \"stone\", \"wood\", \"dust\"";
    assert_eq!(warnings, [expected]);
    let surfaces: Vec<Surface> = scene.materials.iter().map(|material| material.surface).collect();
    let dust = Surface::Scattering(0);
    assert_eq!(surfaces, [dust, stone, Surface::Procedural(0), dust]);
    assert_eq!((scene.procedurals.len(), scene.scatterings.len()), (1, 1));
}

/// A surface that knows its option.
#[derive(Debug)]
struct Ringed(#[expect(dead_code, reason = "its Debug text is read")] f32);

impl Procedural for Ringed {
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        Finish::matte(points)
    }
}

fn rings(options: &PluginOptions) -> Result<ProceduralSurface, OptionError> {
    Ok(ProceduralSurface::new(Ringed(options.parse("rings")?)))
}

fn settings(texts: &[&str]) -> Vec<Setting> {
    texts.iter().map(|text| text.parse().expect("a setting")).collect()
}

#[test]
fn surfaces_get_options_from_defaults_the_scene_and_the_command_line() {
    let registry = Registry::built_in().with_surface_from("wood", rings).with_option(
        "wood",
        "rings",
        "7",
        "Rings per unit of length",
    );
    let scene = || {
        let materials = ["wood", "door"].map(|name| Material::matte(name, Vec3::ONE)).to_vec();
        let mut scene = Scene { materials, ..Scene::default() };
        let request = |surface: &str, rings: &str| SurfaceRequest {
            material: 1,
            surface: surface.into(),
            options: [("rings".to_owned(), rings.to_owned())].into(),
        };
        scene.surface_requests.push(request("wood", "9"));
        (scene, request)
    };
    let (mut both, _) = scene();
    assert_eq!(registry.apply_surfaces(&mut both, &[]).expect("valid"), Vec::<String>::new());
    let texts = |scene: &Scene| scene.procedurals.iter().map(|p| format!("{p:?}")).collect::<Vec<_>>();
    let found = texts(&both);
    assert!(found[0].contains("Ringed(7.0)") && found[1].contains("Ringed(9.0)"), "{found:?}");
    assert_eq!(both.materials[1].surface, Surface::Procedural(1));
    let (mut set, _) = scene();
    registry.apply_surfaces(&mut set, &settings(&["wood.rings=3"])).expect("valid");
    assert!(texts(&set).iter().all(|text| text.contains("Ringed(3.0)")), "{:?}", texts(&set));
    let (mut wrong, request) = scene();
    wrong.surface_requests = vec![request("wood", "many")];
    let error = format!("{:#}", registry.apply_surfaces(&mut wrong, &[]).expect_err("no number"));
    assert_eq!(error, "surface \"wood\" of material \"door\": option rings=many: invalid float literal");
    wrong.surface_requests = vec![request("wod", "1")];
    let warnings = registry.apply_surfaces(&mut wrong, &[]).expect("a warning");
    assert!(warnings.iter().any(|text| text.contains("asks for the surface \"wod\"")), "{warnings:?}");
}

#[test]
fn settings_of_unknown_options_are_refused_with_the_list() {
    let registry = Registry::built_in()
        .with_surface_from("wood", rings)
        .with_option("wood", "rings", "7", "Rings per unit of length")
        .with_surface_from("bark", rings)
        .with_option("bark", "rings", "7", "Rings per unit of length");
    let check = |integrator, text: &str| registry.check_settings(integrator, &settings(&[text]));
    assert_eq!(check("ambient-occlusion", "reach=1"), Ok(()));
    assert_eq!(check("path", "wood.rings=1"), Ok(()));
    let told = |integrator, text| check(integrator, text).expect_err("refused").to_string();
    assert_eq!(
        told("ambient-occlusion", "raech=1"),
        "--set: integrator ambient-occlusion has no option \"raech\"; the options are ambient-occlusion.reach, \
         wood.rings, bark.rings"
    );
    assert_eq!(
        told("path", "rings=1"),
        "--set rings: wood and bark have this option; write --set NAME.rings=VALUE"
    );
    assert!(told("path", "reach=1").contains("integrator path has no option \"reach\""));
    assert!(told("path", "stone.rings=1").starts_with("--set: stone has no option"));
}

#[test]
fn errors_of_any_type_are_told() {
    fn refuse(_: IntegratorParams) -> Result<AmbientOcclusion, std::io::Error> {
        Err(std::io::Error::other("no table"))
    }
    // It compiles: names are owned, errors are open.
    let registry = Registry::built_in().with(format!("mine {}", 1), String::from("Mine"), refuse);
    assert!(format!("{registry:?}").contains("mine 1"));
}
