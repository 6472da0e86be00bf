//! Shading bases of materials whose maps change them, and the shape of coats that have their own.

use super::geometry::Geometry;
use super::interaction::CoatShape;
use super::normals::{bend_where, map_normal, rough_direction};
use crate::geom::Basis;
use crate::lanes::{Lanes, Mask, Num, OutlinedTask, Vector};
use crate::scene::corners::{corner_uvs, tangent_basis};
use crate::scene::{
    Anisotropy, Material, NormalMap, OpenPbr, OpenPbrCoatNormals, OwnSurface, Scalar, Scene, Surface,
    TexturePoint, TextureRef,
};
use glam::Vec3;

/// Anisotropy along the tangent, of surfaces of user code that compute its strength.
const ALONG_TANGENT: Anisotropy =
    Anisotropy { strength: Scalar { factor: 0.0, texture: None }, rotation: 0.0, direction: None };

/// The maps that change a material's shading bases.
pub(super) struct Maps<'a> {
    /// True if the material has a normal map.
    normal: bool,
    anisotropy: Option<&'a Anisotropy>,
    /// `None` if the coats share the material's shading basis.
    coat: Option<CoatMaps>,
    /// The set of texture coordinates along which the tangents lie where the mesh has none of its own: that of the
    /// first map of the three.
    set: u32,
}

/// The maps that change the shape of coats.
#[derive(Clone, Copy)]
struct CoatMaps {
    normals: OpenPbrCoatNormals,
    /// The direction along which they are rougher.
    along: Option<Anisotropy>,
}

impl CoatMaps {
    /// Maps of coats with normals of their own.
    #[inline(always)]
    fn of_normals(map: Option<NormalMap>) -> Self {
        let normals = match map {
            None => OpenPbrCoatNormals::Even,
            Some(map) => OpenPbrCoatNormals::Mapped(map),
        };
        Self { normals, along: None }
    }

    /// The maps of OpenPBR's coat, if it has a shape of its own.
    #[inline(always)]
    fn of_openpbr(surface: &OpenPbr) -> Option<Self> {
        let (coat, frame) = (surface.coat.as_ref()?, surface.coat.as_ref()?.frame.as_ref()?);
        let mut along = None;
        if coat.anisotropy.factor > 0.0 {
            along = coat.own_tangent().or(surface.specular_anisotropy);
        }
        Some(Self { normals: frame.normals, along })
    }

    /// The set of texture coordinates of the normal map.
    #[inline(always)]
    fn set(&self) -> Option<u32> {
        match &self.normals {
            OpenPbrCoatNormals::Mapped(map) => Some(map.texture.set),
            OpenPbrCoatNormals::Base | OpenPbrCoatNormals::Even => None,
        }
    }
}

/// The shading bases of a material with maps, out of line.
pub(super) struct Bases<'a, L: Lanes> {
    pub(super) scene: &'a Scene,
    pub(super) material: &'a Material,
    pub(super) maps: Maps<'a>,
    pub(super) at: &'a Geometry<L>,
    pub(super) texture: &'a TexturePoint<L>,
}

/// The result of [`Bases`]: shading bases, [`Footprint::bumps`] and the shape of coats with normals of their own.
pub(super) struct Mapped<L: Lanes> {
    pub(super) basis: Basis<L>,
    pub(super) bumps: Num<L>,
    pub(super) coat: Option<CoatShape<L>>,
}

impl<L: Lanes> OutlinedTask<L> for Bases<'_, L> {
    type Output = Mapped<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> Mapped<L> {
        let Self { scene, material, maps, at, texture } = self;
        let mut texture = *texture;
        let tangents = maps.tangents(scene, at);
        let basis = shading_basis(scene, material, at, maps.anisotropy, tangents.as_ref(), &mut texture);
        let coat = match maps.coat {
            Some(maps) => Some(coat_shape(scene, &maps, at, tangents.as_ref(), &texture, &basis)),
            None => None,
        };
        Mapped { basis, bumps: texture.footprint.bumps, coat }
    }
}

impl<'a> Maps<'a> {
    /// True if the shading normals are the vertex normals, and no axis has a meaning.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn are_none(&self) -> bool {
        !self.normal && self.anisotropy.is_none() && self.coat.is_none()
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn of(scene: &'a Scene, material: &'a Material) -> Self {
        let (set, normal) = (|map: &NormalMap| map.texture.set, material.normal_map.is_some());
        let (mut surface, mut anisotropy, mut coat) = (None, None, None);
        match &material.surface {
            Surface::Principled(of) => surface = Some(of),
            Surface::Procedural(index) => {
                let coded = &scene.procedurals[*index as usize];
                anisotropy = coded.effects().has_anisotropy.then_some(&ALONG_TANGENT);
                surface = coded.own().map(OwnSurface::surface);
            }
            Surface::Scattering(of) => {
                surface = scene.scatterings[*of as usize].own().map(OwnSurface::surface)
            }
            Surface::OpenPbr(of) => {
                anisotropy = of.specular_anisotropy.as_ref();
                coat = CoatMaps::of_openpbr(of);
            }
            _ => {}
        }
        if let Some(surface) = surface {
            let own_coat = surface.has_own_coat(material.normal_map.as_ref());
            coat = own_coat.then_some(CoatMaps::of_normals(surface.coat_normal_map));
            anisotropy = surface.anisotropy.as_ref().or(anisotropy);
        }
        let direction = |grooves: &Anisotropy| grooves.direction.map(|TextureRef { set, .. }| set);
        let own = material.normal_map.as_ref().map(set).or_else(|| coat.as_ref().and_then(CoatMaps::set));
        let along = coat.as_ref().and_then(|coat| coat.along.as_ref());
        let own = own.or_else(|| anisotropy.and_then(direction)).or_else(|| along.and_then(direction));
        Self { normal, anisotropy, coat, set: own.unwrap_or(0) }
    }

    /// The tangent bases and the lanes that have one; `None` if no map needs them.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn tangents<L: Lanes>(&self, scene: &Scene, at: &Geometry<L>) -> Option<(Basis<L>, Mask<L>)> {
        let has_own = matches!(&self.coat, Some(coat) if coat.set().is_some() || coat.along.is_some());
        if !self.normal && self.anisotropy.is_none() && !has_own {
            return None;
        }
        let set = self.set;
        let further;
        let mut uvs = &at.corner_uvs;
        if set != 0 {
            further = corner_uvs(scene.mesh.uv_set(set), &at.indices);
            uvs = &further;
        }
        Some(tangent_basis(&scene.mesh, &at.indices, &at.corners, uvs, &at.weights, at.outward))
    }
}

/// The shading bases: around the interpolated or mapped normals, bent where necessary. On anisotropic
/// surfaces the x axis is the rougher direction. Sets the bumps of the footprint.
#[cfg_attr(not(unoptimised), inline(always))]
fn shading_basis<L: Lanes>(
    scene: &Scene,
    material: &Material,
    at: &Geometry<L>,
    anisotropy: Option<&Anisotropy>,
    tangents: Option<&(Basis<L>, Mask<L>)>,
    texture: &mut TexturePoint<L>,
) -> Basis<L> {
    let (mut shading, mut bent) = (at.outward, at.smooth);
    if let (Some(map), Some((basis, there))) = (&material.normal_map, tangents) {
        let (mapped, bumps) = map_normal(scene, map, texture, basis);
        shading = Vector::select(*there, mapped, at.outward);
        texture.footprint.bumps = bumps.only(*there);
        bent |= *there;
    }
    let matte = matches!(material.surface, Surface::Matte { .. });
    let shading = bend_where(shading, bent, at.normal, at.wo, matte);
    let basis = Basis::around(shading);
    let (Some(anisotropy), Some((tangents, there))) = (anisotropy, tangents) else { return basis };
    let x = rough_direction(scene, anisotropy, texture, tangents);
    let (tangent, along) = (x - shading * x.dot(shading)).normalize_or(basis.tangent);
    let rough = Basis { tangent, bitangent: shading.cross(tangent), normal: shading };
    Basis::select(along & *there, rough, basis)
}

/// The coats' normals and tangents in the shading bases, and the coats' bumps.
#[cfg_attr(not(unoptimised), inline(always))]
fn coat_shape<L: Lanes>(
    scene: &Scene,
    maps: &CoatMaps,
    at: &Geometry<L>,
    tangents: Option<&(Basis<L>, Mask<L>)>,
    texture: &TexturePoint<L>,
    basis: &Basis<L>,
) -> CoatShape<L> {
    let (mut normal, mut bumps, mut bent) = (at.outward, Num::zero(at.wo.lanes()), at.smooth);
    if let (OpenPbrCoatNormals::Mapped(map), Some((tangents, there))) = (&maps.normals, tangents) {
        let (mapped, rough) = map_normal(scene, map, texture, tangents);
        normal = Vector::select(*there, mapped, at.outward);
        bumps = rough.only(*there);
        bent |= *there;
    }
    let local = if matches!(maps.normals, OpenPbrCoatNormals::Base) {
        bumps = texture.footprint.bumps;
        Vector::splat(at.wo.lanes(), Vec3::Z)
    } else {
        basis.local(bend_where(normal, bent, at.normal, at.wo, false))
    };
    let mut tangent = None;
    if let (Some(along), Some((tangents, there))) = (&maps.along, tangents) {
        let x = basis.local(rough_direction(scene, along, texture, tangents));
        let any = Basis::around(local).tangent;
        let (x, along) = (x - local * x.dot(local)).normalize_or(any);
        tangent = Some(Vector::select(along & *there, x, any));
    }
    CoatShape { normal: local, tangent, bumps }
}
