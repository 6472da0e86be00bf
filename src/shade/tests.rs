//! What user surfaces are told about points.

use super::bsdf::Smoothness;
use super::{Bsdf, Interaction, lookup};
use crate::lanes::{Num, SingleLane, Vector};
use crate::scene::{
    Anisotropy, Colour, ColourSpace, Effects, Finish, Material, Mipmap, NormalMap, Object, Points,
    Principled, Procedural, ProceduralSurface, Scalar, Scene, Surface, Texture, TextureRef, Wrap,
};
use crate::stream::Hit;
use glam::{Vec2, Vec3, Vec4};

/// Two triangles in the xy plane with texture coordinates that are scaled and turned, and a texture of noise.
fn scene() -> Scene {
    let mut scene = Scene::default();
    scene.mesh.positions = vec![Vec3::ZERO, Vec3::X * 2.0, Vec3::Y, Vec3::new(2.0, 1.0, 0.3)];
    scene.mesh.uvs = [[0.1, 0.9], [1.7, 1.2], [0.0, 0.1], [2.2, 0.3]].map(Vec2::from).to_vec();
    scene.mesh.triangles = vec![[0, 1, 2], [2, 1, 3]];
    scene.mesh.materials = vec![0; 2];
    scene.materials = vec![Material::fallback()];
    let texels = (0..256u32).map(|i| crate::geom::mix(i).to_le_bytes()).collect();
    let (wrap_u, wrap_v, mipmap) = (Wrap::Repeat, Wrap::Repeat, Mipmap::default());
    let (width, height, space) = (16, 16, ColourSpace::Linear);
    scene.textures.push(Texture {
        name: "noise".into(),
        width,
        height,
        texels,
        space,
        wrap_u,
        wrap_v,
        mipmap,
    });
    scene.add_mipmaps();
    scene
}

/// A point of triangle `primitive` seen from `wo` by a ray whose cone has this width.
fn seen(scene: &Scene, wo: Vec3, primitive: u32, width: f32) -> Interaction<SingleLane> {
    let direction = Vector::from(-wo.normalize());
    let hit = Hit { t: 3.0, u: 0.3, v: 0.2, primitive };
    Interaction::new(scene, &scene.materials[0], direction, &hit.into(), width.into())
}

/// Directions from above and from below.
const VIEWS: [Vec3; 3] = [Vec3::new(0.3, 0.2, 1.0), Vec3::new(-0.9, 0.1, 0.05), Vec3::new(0.1, 0.5, -0.8)];

#[test]
fn tangent_frames_are_orthonormal_and_follow_the_texture_on_both_sides() {
    let mut scene = scene();
    let rows: [Vec<Vec4>; 2] = [Vec::new(), vec![Vec4::new(0.5, 0.8, 0.1, -1.0); 4]];
    for tangents in rows {
        let given = !tangents.is_empty();
        scene.mesh.tangents = tangents;
        for normals in [Vec::new(), vec![Vec3::new(0.2, -0.1, 1.0).normalize(); 4]] {
            scene.mesh.normals = normals;
            let frames = VIEWS.map(|wo| {
                let at = seen(&scene, wo, 1, 0.0);
                let frame = at.points(&scene).tangent_frame();
                let [t, b, n] = [frame.tangent, frame.bitangent, frame.normal].map(Vec3::from);
                assert!([t, b, n].iter().all(|v| (v.length() - 1.0).abs() < 1e-5), "{t} {b} {n}");
                assert!(t.dot(b).abs() < 1e-5 && b.dot(n).abs() < 1e-5 && n.dot(t).abs() < 1e-5);
                assert_eq!(n, Vec3::from(at.basis.normal));
                if !given {
                    // A step along the tangent changes u alone, up to the shading normal's tilt.
                    let [a, b1, c] = scene.mesh.triangles[1].map(|i| scene.mesh.positions[i as usize]);
                    let [ua, ub, uc] = scene.mesh.triangles[1].map(|i| scene.mesh.uvs[i as usize]);
                    let grows = |along: Vec3| {
                        let (e1, e2) = (b1 - a, c - a);
                        let [d11, d12, d22] = [e1.dot(e1), e1.dot(e2), e2.dot(e2)];
                        let [p, q] = [along.dot(e1), along.dot(e2)];
                        let determinant = d11 * d22 - d12 * d12;
                        let (u, v) = ((d22 * p - d12 * q) / determinant, (d11 * q - d12 * p) / determinant);
                        (ub - ua) * u + (uc - ua) * v
                    };
                    assert!(grows(t).x > 0.0 && grows(b).y < 0.0, "u grows along t, and b points up");
                }
                [t, b]
            });
            // From behind the tangents are the same, not mirrored.
            let [above, _, below] = frames;
            assert!(above[0].dot(below[0]) > 0.9 && above[1].dot(below[1]) > 0.9, "{frames:?}");
        }
    }
    scene.mesh.uvs.clear();
    scene.mesh.tangents.clear();
    let frame = seen(&scene, VIEWS[0], 0, 0.0).points(&scene).tangent_frame();
    let [t, n] = [frame.tangent, frame.normal].map(Vec3::from);
    assert!((t.length() - 1.0).abs() < 1e-6 && t.dot(n).abs() < 1e-6, "any tangent will do");
}

#[test]
fn footprints_and_texels_are_those_of_textures() {
    let mut scene = scene();
    for wo in VIEWS {
        for width in [0.0, 0.01, 0.4] {
            let at = seen(&scene, wo, 1, width);
            let points = at.points(&scene);
            let footprint = points.texture_footprint();
            assert_eq!(points.footprint().get(), at.texture.footprint.width.get());
            assert_eq!(footprint.dither.get(), at.texture.footprint.dither.get());
            let image = TextureRef { rotation: 0.3, scale: Vec2::new(2.0, 0.5), ..TextureRef::plain(0) };
            let colour = Colour { texture: Some(image), ..Colour::constant(Vec3::ONE) };
            let expected = Vec3::from(lookup::colour(&scene, &colour, &at.texture));
            let [r, g, b, _] = points.texture(&image).map(Num::get);
            assert_eq!(Vec3::new(r, g, b), expected);
        }
    }
    // The footprint is known in scenes without textures, too.
    let expected = seen(&scene, VIEWS[0], 1, 0.1).texture.footprint.width.get();
    scene.textures.clear();
    let at = seen(&scene, VIEWS[0], 1, 0.1);
    assert!(at.texture.footprint.width.get() == 0.0 && at.points(&scene).footprint().get() == expected);
}

#[test]
fn points_name_their_triangle_and_the_instance_that_owns_it() {
    let mut scene = scene();
    assert_eq!(seen(&scene, Vec3::Z, 1, 0.0).points(&scene).object().get(), u32::MAX, "no table");
    let node = scene.objects.add(Object::new("node"));
    let [first, second] = [0, 1].map(|instance| {
        let object = scene.objects.add(Object::new("copy").below(Some(node)));
        scene.objects.assign(instance, object);
        object
    });
    for (primitive, object) in [(0, first), (1, second)] {
        let points = seen(&scene, Vec3::Z, primitive, 0.2).points(&scene);
        assert_eq!((points.primitive.get(), points.object().get()), (primitive, object));
        assert_eq!(points.barycentric.map(Num::get), [0.3, 0.2]);
        let [a, b, c] = scene.mesh.corners(primitive);
        assert!((points.area.get() - 0.5 * (b - a).cross(c - a).length()).abs() < 1e-6);
        assert!(points.width.get() == 0.2 && points.front.get());
    }
    let below = seen(&scene, Vec3::NEG_Z, 0, 0.0).points(&scene);
    assert!(!below.front.get() && Vec3::from(below.geometric_normal).z < 0.0);
    assert_eq!(Vec3::from(below.wo), Vec3::NEG_Z);
}

/// A surface whose finish is given.
#[derive(Clone, Debug)]
struct Given {
    transmission: f32,
    roughness: f32,
    tilt: Vec3,
    effects: Effects,
}

impl Procedural for Given {
    #[inline(always)]
    fn finish<L: crate::lanes::Lanes>(&self, points: &Points<L>) -> Finish<L> {
        let l = points.lanes();
        let frame = points.tangent_frame();
        let mut finish = Finish {
            colour: Vector::splat(l, Vec3::new(0.9, 0.5, 0.2)),
            roughness: Num::splat(l, self.roughness),
            transmission: Num::splat(l, self.transmission),
            ..Finish::matte(points)
        };
        if self.effects.has_normals {
            let Vec3 { x, y, z } = self.tilt;
            finish.normal = frame.tangent * x + frame.bitangent * y + frame.normal * z;
        }
        finish
    }

    fn effects(&self) -> Effects {
        self.effects
    }
}

/// Makes the scene's material the given one.
fn put_on(scene: &mut Scene, given: &Given) {
    scene.procedurals = vec![ProceduralSurface::new(given.clone())];
    scene.materials[0].surface = Surface::Procedural(0);
}

#[test]
fn transmission_is_that_of_the_built_in_surface() {
    let thin = Effects::default().thin_transmission();
    for (effects, thin, ior) in [(thin, true, 1.5), (Effects::default().body_transmission(1.3), false, 1.3)] {
        for roughness in [0.0, 0.4, 1.0] {
            let given = Given { transmission: 0.7, roughness, tilt: Vec3::Z, effects };
            let mut built_in = scene();
            built_in.materials[0].surface = Surface::Principled(Principled {
                base_colour: Colour::constant(Vec3::new(0.9, 0.5, 0.2)),
                roughness: Scalar::constant(roughness),
                transmission: Scalar::constant(0.7),
                thin,
                ior,
                ..Principled::default()
            });
            let mut computed = scene();
            put_on(&mut computed, &given);
            for wo in VIEWS {
                let results = [&built_in, &computed].map(|scene| {
                    let at = seen(scene, wo, 0, 0.0);
                    let bsdf = Bsdf::new(scene, &scene.materials[0].surface, &at, Smoothness::EXACT);
                    let local = at.basis.local(at.wo);
                    let mut numbers = Vec::new();
                    for u in [0.1, 0.35, 0.6, 0.85] {
                        let sample = bsdf.sample(local, u.into(), [0.3.into(), u.into()]);
                        let (value, pdf) = bsdf.evaluate(local, sample.wi);
                        let [wi, weight, value] = [sample.wi, sample.weight, value].map(Vec3::from);
                        numbers.push(f32::from(u8::from(sample.valid.get())));
                        if sample.valid.get() {
                            numbers.extend([wi, weight, value].map(|v| v.to_array()).as_flattened());
                            numbers.extend([pdf.get(), sample.eta.get()]);
                        }
                    }
                    numbers
                });
                let [a, b] = &results;
                let near = |(a, b): (&f32, &f32)| (a - b).abs() <= 1e-4 * (1.0 + a.abs());
                assert!(a.len() == b.len() && a.iter().zip(b).all(near), "{given:?} from {wo}: {a:?}, {b:?}");
            }
        }
    }
}

#[test]
fn computed_normals_bend_like_those_of_a_normal_map() {
    let texel = [200u8, 90, 220, 255];
    let tilt = Vec3::from([0, 1, 2].map(|k| f32::from(texel[k]) / 255.0 * 2.0 - 1.0));
    let mut mapped = scene();
    mapped.textures[0] = Texture {
        width: 1,
        height: 1,
        texels: [texel].into(),
        mipmap: Mipmap::default(),
        ..mapped.textures[0].clone()
    };
    mapped.materials[0].normal_map = Some(NormalMap { texture: TextureRef::plain(0), scale: 1.0 });
    mapped.materials[0].surface = Surface::Principled(Principled::default());
    let mut computed = scene();
    put_on(
        &mut computed,
        &Given { transmission: 0.0, roughness: 1.0, tilt, effects: Effects::default().normals() },
    );
    for wo in [VIEWS[0], VIEWS[1]] {
        let [a, b] = [&mapped, &computed].map(|scene| Vec3::from(seen(scene, wo, 0, 0.0).basis.normal));
        assert!((a - b).length() < 1e-4, "{a} and {b} from {wo}");
    }
}

/// The same scene with other coordinates in set 0, and with those of its textures in set 2.
fn with_coordinates_in_set_2(scene: &Scene) -> Scene {
    let mut moved = scene.clone();
    let uvs = std::mem::replace(&mut moved.mesh.uvs, vec![Vec2::new(0.3, 0.7); 4]);
    moved.mesh.more_uvs = vec![Vec::new(), uvs];
    moved
}

#[test]
fn textures_of_a_further_set_look_as_those_of_the_first() {
    let scene = scene();
    let moved = with_coordinates_in_set_2(&scene);
    let image = |set| TextureRef { set, rotation: 0.3, scale: Vec2::new(2.0, 0.5), ..TextureRef::plain(0) };
    for wo in VIEWS {
        for width in [0.0, 0.01, 0.4] {
            let [here, there] = [&scene, &moved].map(|scene| seen(scene, wo, 1, width));
            let texel = |scene: &Scene, at: &Interaction<SingleLane>, set| {
                let seen = at.texture.look_up(scene, &image(set)).map(Num::get);
                assert_eq!(at.points(scene).texture(&image(set)).map(Num::get), seen);
                seen
            };
            assert_eq!(texel(&moved, &there, 2), texel(&scene, &here, 0), "with its mipmap level");
            assert_ne!(texel(&moved, &there, 0), texel(&scene, &here, 0));
            assert_ne!(texel(&moved, &there, 1), texel(&scene, &here, 0), "no coordinates count as 0");
        }
    }
}

/// Gives a surface a normal map or grooves; returns the normal map of the material.
type Bump = fn(&mut Principled, Option<NormalMap>, Anisotropy) -> Option<NormalMap>;

#[test]
fn normal_maps_and_grooves_of_a_further_set_lie_along_its_tangents() {
    let plain = scene();
    let map = |set| NormalMap { texture: TextureRef { set, ..TextureRef::plain(0) }, scale: 0.5 };
    let grooves = |set| Anisotropy {
        strength: Scalar::constant(0.5),
        rotation: 0.2,
        direction: Some(TextureRef { set, ..TextureRef::plain(0) }),
    };
    let kinds: [Bump; 3] = [
        |_, map, _| map,
        |surface, _, grooves| {
            surface.anisotropy = Some(grooves);
            None
        },
        |surface, map, _| {
            (surface.clearcoat, surface.coat_normal_map) = (Scalar::constant(1.0), map);
            None
        },
    ];
    for kind in kinds {
        let described = |scene: &Scene, set: u32| {
            let mut scene = scene.clone();
            let mut surface = Principled::default();
            scene.materials[0].normal_map = kind(&mut surface, Some(map(set)), grooves(set));
            scene.materials[0].surface = Surface::Principled(surface);
            let at = seen(&scene, VIEWS[0], 1, 0.1);
            let coat = at.coat.map(|coat| Vec3::from(coat.normal));
            [at.basis.tangent, at.basis.normal].map(Vec3::from).into_iter().chain(coat).collect::<Vec<_>>()
        };
        assert_eq!(described(&with_coordinates_in_set_2(&plain), 2), described(&plain, 0));
    }
}

#[test]
fn vertex_colours_are_blended_and_multiply_factor_and_texture() {
    let mut scene = scene();
    let white = Colour { vertex: true, ..Colour::constant(Vec3::new(0.5, 1.0, 2.0)) };
    let factor = |scene: &Scene, colour: &Colour| {
        let at = seen(scene, VIEWS[0], 1, 0.1);
        Vec3::from(lookup::colour(scene, colour, &at.texture))
    };
    assert_eq!(factor(&scene, &white), white.factor, "a mesh without colours is white");
    let points = seen(&scene, VIEWS[0], 1, 0.1).points(&scene);
    assert_eq!((Vec3::from(points.vertex_colour()), points.vertex_alpha().get()), (Vec3::ONE, 1.0));
    scene.mesh.colours =
        [[0.1, 0.2, 0.3, 0.4], [0.5, 0.6, 0.7, 0.8], [0.9, 0.8, 0.7, 0.6], [0.3, 0.2, 0.1, 0.0]]
            .map(Vec4::from)
            .to_vec();
    let [a, b, c] = scene.mesh.triangles[1].map(|vertex| scene.mesh.colours[vertex as usize]);
    let blended = a * 0.5 + b * 0.3 + c * 0.2;
    assert!((factor(&scene, &white) - white.factor * blended.truncate()).length() < 1e-6);
    assert!((scene.mesh.colour_at(1, 0.3, 0.2) - blended).length() < 1e-6);
    let textured = Colour { texture: Some(TextureRef::plain(0)), ..white };
    let expected = factor(&scene, &Colour { vertex: false, ..textured }) * blended.truncate();
    assert!((factor(&scene, &textured) - expected).length() < 1e-6);
    assert_eq!(factor(&scene, &Colour::constant(Vec3::ONE)), Vec3::ONE, "a material without them");
    let points = seen(&scene, VIEWS[0], 1, 0.1).points(&scene);
    assert!((Vec3::from(points.vertex_colour()) - blended.truncate()).length() < 1e-6);
    assert!((points.vertex_alpha().get() - blended.w).abs() < 1e-6);
}
