//! Random damage to a valid scene is refused, or renders.

use super::*;
use raystream::geom::Sampler;

/// Numbers that most fields refuse.
const ODD: [f32; 12] =
    [f32::NAN, f32::INFINITY, -f32::INFINITY, -1.0, -0.0, 0.0, 1.0, 1.5, 7.0, 1e11, 1e30, f32::MIN_POSITIVE];

/// A sequence of random numbers: its seed, and how many were drawn.
struct Random(u32, u32);

impl Random {
    fn below(&mut self, count: usize) -> usize {
        self.1 += 1;
        ((Sampler::new(self.0, 0, 35).single(self.1) * count as f32) as usize).min(count.saturating_sub(1))
    }

    fn odd(&mut self) -> f32 {
        ODD[self.below(ODD.len())]
    }

    fn index(&mut self) -> u32 {
        [0, 1, 2, 5, 7, 8, 39, 40, 1 << 28, u32::MAX][self.below(10)]
    }

    /// One of the elements; `None` if there are none.
    fn of<'a, T>(&mut self, elements: &'a mut [T]) -> Option<&'a mut T> {
        let index = self.below(elements.len());
        elements.get_mut(index)
    }
}

/// Changes one part of a scene.
fn damage(scene: &mut Scene, random: &mut Random) -> Option<()> {
    let (odd, index) = (random.odd(), random.index());
    match random.below(8) {
        0 => damage_arrays(scene, random),
        1 => damage_numbers(scene, random)?,
        2 => {
            let corner = random.below(3);
            random_triangle(scene, random)?[corner] = index;
        }
        3 => damage_material(random.below(scene.materials.len()), scene, random)?,
        4 => {
            let mix = random.of(&mut scene.mixes)?;
            mix.of[random.below(2)] = index;
        }
        5 => {
            let light = random.of(&mut scene.lights)?;
            match &mut light.shape {
                LightShape::Point { position } => position.x = odd,
                LightShape::Spot { cos_inner, .. } => *cos_inner = odd,
                LightShape::Directional { direction } => direction.y = odd,
                _ => return None,
            }
        }
        6 => {
            let Environment::Map(map) = &mut scene.environment else { return None };
            match random.below(3) {
                0 => map.width = index,
                1 => map.rotation_degrees = odd,
                _ => map.texels = vec![[odd; 3]; random.below(10)].into(),
            }
        }
        _ => {
            let texture = random.of(&mut scene.textures)?;
            match random.below(3) {
                0 => texture.width = index,
                1 => texture.height = index,
                _ => texture.texels = texture.texels[..random.below(17).min(texture.texels.len())].into(),
            }
        }
    }
    Some(())
}

fn random_triangle<'a>(scene: &'a mut Scene, random: &mut Random) -> Option<&'a mut [u32; 3]> {
    let triangles =
        if random.below(3) == 0 { &mut scene.shapes[0].triangles } else { &mut scene.mesh.triangles };
    random.of(triangles)
}

/// Makes an array shorter or longer, or empty.
fn damage_arrays(scene: &mut Scene, random: &mut Random) {
    let count = [0, 1, 19, 20, 21, 39, 41][random.below(7)];
    match random.below(11) {
        0 => scene.mesh.positions.resize(count, Vec3::ZERO),
        1 => scene.mesh.normals.resize(count, Vec3::ZERO),
        2 => scene.mesh.uvs.resize(count, Vec2::ZERO),
        3 => scene.mesh.tangents.resize(count, Vec4::ZERO),
        4 => scene.mesh.triangles.resize(count, [0, 1, 2]),
        5 => scene.mesh.materials.resize(count, 0),
        6 => scene.materials.truncate(random.below(9)),
        7 => scene.mesh.colours.resize(count, Vec4::ONE),
        8 => scene.mesh.more_uvs[0].resize(count, Vec2::ZERO),
        9 => scene.mesh.attributes[0].values.resize(count, 0.0),
        _ => scene.shapes[0].instances.truncate(random.below(3)),
    }
}

/// Writes an odd number into the geometry.
fn damage_numbers(scene: &mut Scene, random: &mut Random) -> Option<()> {
    let odd = random.odd();
    match random.below(9) {
        0 => random.of(&mut scene.mesh.positions)?.x = odd,
        1 => random.of(&mut scene.mesh.normals)?.y = odd,
        2 => random.of(&mut scene.mesh.uvs)?.x = odd,
        3 => random.of(&mut scene.mesh.tangents)?.z = odd,
        4 => random.of(&mut scene.shapes[0].positions)?.z = odd,
        5 => random.of(&mut scene.mesh.colours)?.w = odd,
        6 => random.of(&mut scene.mesh.more_uvs[0])?.y = odd,
        7 => *random.of(&mut scene.mesh.attributes[0].values)? = odd,
        _ => {
            let instance = random.of(&mut scene.shapes[0].instances)?;
            instance.placement.rows[random.below(3)][random.below(4)] = odd;
        }
    }
    Some(())
}

fn damage_material(which: usize, scene: &mut Scene, random: &mut Random) -> Option<()> {
    let (odd, index) = (random.odd(), random.index());
    let material = scene.materials.get_mut(which)?;
    match random.below(6) {
        0 => {
            let kinds = [Surface::Procedural(index), Surface::Scattering(index), Surface::Mix(index)];
            material.surface = kinds[random.below(3)];
        }
        1 => {
            material.emission = Some(Emission {
                radiance: Colour::constant(Vec3::splat(odd)),
                two_sided: true,
                is_light: true,
            })
        }
        2 => material.alpha.value.factor = odd,
        3 => {
            let (absorption, scattering) = (Vec3::splat(odd), Vec3::splat(odd));
            material.medium = Some(Medium { absorption, scattering, anisotropy: odd });
        }
        4 => {
            let texture = TextureRef { scale: Vec2::splat(odd), ..TextureRef::plain(index) };
            material.normal_map = Some(NormalMap { texture, scale: 1.0 });
        }
        _ => {
            let Surface::Principled(surface) = &mut material.surface else {
                material.surface = Surface::Dielectric { ior: odd, transmittance: Vec3::ONE };
                return Some(());
            };
            let numbers = [&mut surface.metallic, &mut surface.roughness, &mut surface.specular];
            numbers.into_iter().nth(random.below(3))?.factor = odd;
        }
    }
    Some(())
}

#[test]
fn random_damage_is_refused_or_renders() {
    let (service, units) = (service(), Units::cpu());
    let valid = PreparedScene::new(everything(), &units).expect("a valid scene");
    let (mut rendered, mut refused) = (0, 0);
    for seed in 0..1500 {
        let mut random = Random(seed, 0);
        let mut scene = Scene::clone(&valid.scene);
        for _ in 0..=random.below(3) {
            let _ = damage(&mut scene, &mut random);
        }
        let fresh = scene.validate();
        match valid.with_scene(scene) {
            Err(error) => {
                refused += 1;
                let fresh = fresh.expect_err("refused, too");
                assert_eq!(fresh.to_string(), error.to_string(), "seed {seed}");
            }
            Ok(prepared) => {
                rendered += 1;
                assert_eq!(fresh, Ok(()), "seed {seed}");
                picture(&service, &prepared);
                let whitted = Whitted::new(prepared.lit(), &camera(), settings()).expect("valid settings");
                hash(&service, &prepared, Arc::new(whitted));
            }
        }
    }
    assert!(rendered > 100 && refused > 500, "{rendered} rendered, {refused} refused");
}
