//! Parts of a scene besides large arrays.

use super::FlatError;
use super::arrays::{Reader, Writer};
use crate::geom::Placement;
use crate::scene::{
    AnimationSpan, Averaging, Camera, CameraMotion, ColourSpace, Environment, EnvironmentMap, Instance,
    Light, Material, Mipmap, Mix, NamedCamera, Objects, Scene, Shape, SurfaceRequest, Texture, TriangleMesh,
    VertexAttribute, Wrap,
};
use glam::{Vec2, Vec3, Vec4};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

/// All of a scene but its large arrays, whose order is that of [`put`].
#[derive(Debug, Serialize, Deserialize)]
struct Small {
    /// Sets of texture coordinates besides the first.
    more_uvs: u32,
    /// Names and widths of vertex attributes.
    attributes: Vec<(String, u32)>,
    shapes: Vec<SmallShape>,
    objects: Objects,
    materials: Vec<Material>,
    textures: Vec<SmallTexture>,
    /// Arrays of texels, which textures may share.
    images: u32,
    mixes: Vec<Mix>,
    lights: Vec<Light>,
    environment: SmallEnvironment,
    camera: Option<Camera>,
    camera_motion: Option<CameraMotion>,
    cameras: Vec<NamedCamera>,
    surface_requests: Vec<SurfaceRequest>,
    options: BTreeMap<String, String>,
    warnings: Vec<String>,
    is_animated: bool,
    animations: Vec<AnimationSpan>,
    stroke_width: Option<f32>,
    variants: Vec<String>,
    files: Vec<PathBuf>,
}

/// The instances of a shape: rows of the placement, and the first triangle.
#[derive(Debug, Serialize, Deserialize)]
struct SmallShape(Vec<([[f32; 4]; 3], u32)>);

#[derive(Debug, Serialize, Deserialize)]
struct SmallTexture {
    name: String,
    size: [u32; 2],
    /// The number of its array of texels.
    image: u32,
    space: ColourSpace,
    wrap: [Wrap; 2],
    levels: Vec<u32>,
    mean: Averaging,
}

#[derive(Debug, Serialize, Deserialize)]
enum SmallEnvironment {
    Constant(Vec3),
    Map { size: [u32; 2], rotation_degrees: f32 },
}

/// Puts a scene into arrays, the small part first.
pub fn put<'a>(scene: &'a Scene, arrays: &mut Writer<'a>) -> Result<(), FlatError> {
    // A new field does not compile until it is written.
    let Scene {
        mesh,
        shapes,
        objects,
        materials,
        textures,
        procedurals,
        scatterings,
        mixes,
        lights,
        environment,
        camera,
        camera_motion,
        cameras,
        surface_requests,
        options,
        warnings,
        is_animated,
        animations,
        stroke_width,
        variants,
        files,
        // What a spec asks for, and what follows from the rest.
        moment: _,
        object_bounds: _,
    } = scene;
    if !procedurals.is_empty() || !scatterings.is_empty() {
        return Err(FlatError::Coded);
    }
    put_mesh(mesh, arrays);
    for shape in shapes.iter() {
        arrays.put(&shape.positions);
        arrays.put(&shape.triangles);
    }
    let mut images: Vec<&'a Arc<[[u8; 4]]>> = Vec::new();
    let textures = textures.iter().map(|texture| small_texture(texture, &mut images)).collect();
    images.iter().for_each(|image| arrays.put(&image[..]));
    let environment = put_environment(environment, arrays);
    let small = Small {
        more_uvs: mesh.more_uvs.len() as u32,
        attributes: mesh.attributes.iter().map(|one| (one.name.clone(), one.width)).collect(),
        shapes: shapes.iter().map(small_shape).collect(),
        objects: Objects::clone(objects),
        materials: materials.clone(),
        textures,
        images: images.len() as u32,
        mixes: mixes.clone(),
        lights: lights.clone(),
        environment,
        camera: *camera,
        camera_motion: camera_motion.clone(),
        cameras: cameras.clone(),
        surface_requests: surface_requests.clone(),
        options: options.clone(),
        warnings: warnings.clone(),
        is_animated: *is_animated,
        animations: animations.clone(),
        stroke_width: *stroke_width,
        variants: variants.clone(),
        files: files.clone(),
    };
    arrays.put_first(postcard::to_stdvec(&small).map_err(std::io::Error::other)?);
    Ok(())
}

fn put_environment<'a>(environment: &'a Environment, arrays: &mut Writer<'a>) -> SmallEnvironment {
    match environment {
        Environment::Constant(radiance) => SmallEnvironment::Constant(*radiance),
        Environment::Map(EnvironmentMap { width, height, texels, rotation_degrees }) => {
            arrays.put(&texels[..]);
            SmallEnvironment::Map { size: [*width, *height], rotation_degrees: *rotation_degrees }
        }
    }
}

fn put_mesh<'a>(mesh: &'a TriangleMesh, arrays: &mut Writer<'a>) {
    let TriangleMesh {
        positions,
        normals,
        uvs,
        more_uvs,
        colours,
        tangents,
        attributes,
        triangles,
        materials,
    } = mesh;
    arrays.put(positions);
    arrays.put(normals);
    arrays.put(uvs);
    arrays.put(colours);
    arrays.put(tangents);
    arrays.put(triangles);
    arrays.put(materials);
    more_uvs.iter().for_each(|uvs| arrays.put(uvs));
    attributes.iter().for_each(|attribute| arrays.put(&attribute.values));
}

fn small_shape(shape: &Shape) -> SmallShape {
    let instances = shape.instances.iter();
    SmallShape(instances.map(|&Instance { placement, first }| (placement.rows, first)).collect())
}

fn small_texture<'a>(texture: &'a Texture, images: &mut Vec<&'a Arc<[[u8; 4]]>>) -> SmallTexture {
    let Texture { name, width, height, texels, space, wrap_u, wrap_v, mipmap } = texture;
    let image = images.iter().position(|image| Arc::ptr_eq(image, texels)).unwrap_or_else(|| {
        images.push(texels);
        images.len() - 1
    });
    SmallTexture {
        name: name.clone(),
        size: [*width, *height],
        image: image as u32,
        space: *space,
        wrap: [*wrap_u, *wrap_v],
        levels: mipmap.levels().to_vec(),
        mean: mipmap.mean(),
    }
}

/// Takes a scene from arrays.
pub fn take(arrays: &mut Reader) -> Result<Scene, FlatError> {
    let bytes: Vec<u8> = arrays.take()?;
    let small: Small = postcard::from_bytes(&bytes).map_err(FlatError::damaged)?;
    let mesh = take_mesh(arrays, small.more_uvs, small.attributes)?;
    let mut shapes = Vec::new();
    for SmallShape(instances) in small.shapes {
        let (positions, triangles) = (arrays.take::<Vec3>()?, arrays.take::<[u32; 3]>()?);
        let instances = instances.into_iter();
        let instances = instances.map(|(rows, first)| Instance { placement: Placement { rows }, first });
        shapes.push(Shape { positions, triangles, instances: instances.collect() });
    }
    let mut images = Vec::new();
    for _ in 0..small.images {
        images.push(arrays.take_shared::<[u8; 4]>()?);
    }
    let textures = small.textures.into_iter().map(|texture| whole_texture(texture, &images));
    let textures = textures.collect::<Result<_, _>>()?;
    let environment = match small.environment {
        SmallEnvironment::Constant(radiance) => Environment::Constant(radiance),
        SmallEnvironment::Map { size: [width, height], rotation_degrees } => {
            let texels = arrays.take_shared::<[f32; 3]>()?;
            Environment::Map(EnvironmentMap { width, height, texels, rotation_degrees })
        }
    };
    Ok(Scene {
        mesh: mesh.into(),
        shapes: shapes.into(),
        objects: small.objects.into(),
        materials: small.materials,
        textures,
        procedurals: Vec::new(),
        scatterings: Vec::new(),
        mixes: small.mixes,
        lights: small.lights,
        environment,
        camera: small.camera,
        camera_motion: small.camera_motion,
        cameras: small.cameras,
        surface_requests: small.surface_requests,
        options: small.options,
        warnings: small.warnings,
        is_animated: small.is_animated,
        animations: small.animations,
        stroke_width: small.stroke_width,
        variants: small.variants,
        files: small.files,
        ..Scene::default()
    })
}

fn take_mesh(
    arrays: &mut Reader,
    more_uvs: u32,
    attributes: Vec<(String, u32)>,
) -> Result<TriangleMesh, FlatError> {
    let mut mesh = TriangleMesh {
        positions: arrays.take::<Vec3>()?,
        normals: arrays.take::<Vec3>()?,
        uvs: arrays.take::<Vec2>()?,
        colours: arrays.take::<Vec4>()?,
        tangents: arrays.take::<Vec4>()?,
        triangles: arrays.take::<[u32; 3]>()?,
        materials: arrays.take::<u32>()?,
        more_uvs: Vec::new(),
        attributes: Vec::new(),
    };
    for _ in 0..more_uvs {
        mesh.more_uvs.push(arrays.take::<Vec2>()?);
    }
    for (name, width) in attributes {
        mesh.attributes.push(VertexAttribute { name, width, values: arrays.take::<f32>()? });
    }
    Ok(mesh)
}

fn whole_texture(small: SmallTexture, images: &[Arc<[[u8; 4]]>]) -> Result<Texture, FlatError> {
    let SmallTexture { name, size: [width, height], image, space, wrap: [wrap_u, wrap_v], levels, mean } =
        small;
    let texels = images.get(image as usize).map(Arc::clone);
    let texels = texels.ok_or_else(|| FlatError::damaged(format!("texture {name:?} has no texels")))?;
    let mipmap = Mipmap::of_levels(&levels, mean);
    let mipmap = mipmap.ok_or_else(|| FlatError::damaged(format!("texture {name:?} has no whole mipmap")))?;
    Ok(Texture { name, width, height, texels, space, wrap_u, wrap_v, mipmap })
}
