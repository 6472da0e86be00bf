//! Surface interactions: the points that rays hit, their shading bases and their texture footprints.

use super::geometry::{Geometry, Hits};
use super::normals::{MIN_COSINE, bend_where, map_normal, rough_direction};
use super::turn::Turn;
use crate::geom::Basis;
use crate::lanes::{Lanes, Mask, Num, OutlinedTask, Prefetch, Vector};
use crate::scene::corners::{corner_uvs, tangent_basis};
use crate::scene::{
    Anisotropy, BlockFinishes, Finish, Footprint, Material, NormalMap, OwnSurface, Points, Scalar, Scene,
    Surface, TexturePoint, TextureRef, TriangleMesh,
};
use crate::stream::Hit;

/// Points on surfaces of one material, each with the direction `wo` towards its viewer. Normals lie on `wo`'s
/// side of the triangle, so `wo` is always in the upper hemisphere of [`Interaction::basis`].
#[derive(Clone, Copy, Debug)]
pub struct Interaction<L: Lanes> {
    /// The point on the triangle, interpolated by the hit's barycentrics.
    pub position: Vector<L>,
    /// Unit direction back along the ray.
    pub wo: Vector<L>,
    /// Unit normal of the triangle.
    pub normal: Vector<L>,
    /// Shading basis around the interpolated and mapped normal. The normal is bent no further than it takes
    /// to keep `wo` above it. For surfaces with a mirror-like share, the mirrored `wo` also stays above the
    /// triangle. The x axis has a meaning only on anisotropic surfaces, which are rougher along it.
    pub basis: Basis<L>,
    /// The shape of the coats where their normals differ from those of the layers below.
    pub coat: Option<CoatShape<L>>,
    /// Point at which the inputs of the material are looked up.
    pub texture: TexturePoint<L>,
    /// Lanes that are hit on the front: `wo` is on the side from which the triangle's vertices run
    /// counter-clockwise.
    pub front: Mask<L>,
    /// Lanes whose `wo` is outside of the body. The vertex normals point outside; without them the front is
    /// outside.
    pub outside: Mask<L>,
    /// The finish of a procedural surface that emits light, computes opacity, bends normals or is computed in blocks.
    /// For other surfaces [`super::Bsdf::new`] computes what it needs.
    pub finish: Option<Finish<L>>,
    /// Start of scattered rays (not mirrored or refracted ones): `position` raised to the surface that the
    /// vertex normals suggest. The edges of a smooth body of few triangles then cast no shadows on it (Hanika
    /// 2021, *Hacking the Shadow Terminator*), and [`Interaction::is_above`] lets light from below its facets in.
    pub raised: Vector<L>,
    /// Distance from the triangle at which rays start.
    offset: Num<L>,
}

/// Normals and bumps of coats that differ from the surface below.
#[derive(Clone, Copy, Debug)]
pub struct CoatShape<L: Lanes> {
    /// Unit normals of the coats in the shading basis, bent like the surface's own normals.
    pub normal: Vector<L>,
    /// [`Footprint::bumps`] of the coats.
    pub bumps: Num<L>,
}

impl<L: Lanes> Interaction<L> {
    /// The interactions of rays of unit direction with the triangles that they hit, all of material
    /// `material`. `width` is the width of the rays' [`super::Cone`]s at the hits.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn new(
        scene: &Scene,
        material: &Material,
        direction: Vector<L>,
        hits: &Hits<L>,
        width: Num<L>,
    ) -> Self {
        let mut new = Self::without_finish(scene, material, direction, hits, width);
        new.set_finish(scene, material, None);
        new
    }

    /// Sets the finish of a procedural surface where it acts before scattering, and bends the normals by it. `finishes`
    /// are those of a block, if they are known.
    ///
    /// It changes the interactions where they are: moved, they would take a finish along, also where there is none.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn set_finish(&mut self, scene: &Scene, material: &Material, finishes: Option<BlockFinishes<'_>>) {
        let Surface::Procedural(index) = material.surface else { return };
        let surface = &scene.procedurals[index as usize];
        let l = self.wo.lanes();
        let finish = match finishes {
            Some(finishes) => finishes.finish(l, surface.effects()),
            None if surface.effects().act_before_scattering() => surface.finish(&self.points(scene)),
            None => return,
        };
        let effects = surface.effects();
        if effects.has_normals || effects.has_anisotropy {
            let old = self.basis;
            let turn = Turn { old, finish: &finish, effects, triangle: self.normal, wo: self.wo };
            let (basis, changed) = l.outlined(turn);
            self.basis = basis;
            if let Some(coat) = &mut self.coat {
                coat.normal = Vector::select(changed, basis.local(old.world(coat.normal)), coat.normal);
            }
        }
        self.finish = Some(finish);
    }

    /// [`Interaction::new`] before [`Interaction::set_finish`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn without_finish(
        scene: &Scene,
        material: &Material,
        direction: Vector<L>,
        hits: &Hits<L>,
        width: Num<L>,
    ) -> Self {
        let at = Geometry::new(&scene.mesh, direction, hits);
        let (barycentric, area) = ([hits.u, hits.v], at.plane.twice_area * 0.5);
        let mut texture = TexturePoint::without_width(at.uv, hits.primitive, barycentric);
        (texture.width, texture.area) = (width, area);
        if !scene.mesh.uvs.is_empty() && !scene.textures.is_empty() {
            let cosine = at.wo.dot(at.plane.normal);
            texture.footprint =
                Footprint::of_cone(width, cosine, at.plane.twice_area, &at.corner_uvs, barycentric);
            texture.cosine = cosine;
        }
        let maps = Maps::of(scene, material);
        let basis;
        let mut coat = None;
        if maps.are_none() {
            let matte = matches!(material.surface, Surface::Matte { .. });
            basis = Basis::around(bend_where(at.outward, at.smooth, at.normal, at.wo, matte));
        } else {
            // Copies: both stay in registers where no call refers to them.
            let (at, point) = (at, texture);
            let bases = at.wo.lanes().outlined(Bases { scene, material, maps, at: &at, texture: &point });
            (basis, coat) = (bases.basis, bases.coat);
            texture.footprint.bumps = bases.bumps;
        }
        Self {
            position: at.position,
            wo: at.wo,
            normal: at.normal,
            basis,
            coat,
            finish: None,
            // Field by field: `texture` as a whole would be a call of `memcpy`, around which registers are saved.
            texture: TexturePoint { footprint: Footprint { ..texture.footprint }, ..texture },
            front: at.front,
            outside: at.outside,
            raised: at.raised(),
            offset: at.plane.offset,
        }
    }

    /// The points as user surfaces see them.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn points<'s>(&self, scene: &'s Scene) -> Points<'s, L> {
        Points {
            position: self.position,
            normal: self.basis.normal,
            geometric_normal: self.normal,
            wo: self.wo,
            uv: self.texture.uv,
            barycentric: self.texture.barycentric,
            width: self.texture.width,
            area: self.texture.area,
            primitive: self.texture.primitive,
            front: self.front,
            bumps: self.texture.footprint.bumps,
            scene,
            own: None,
        }
    }

    /// Radiance that the points emit towards their viewers by computation. `None` if `material` computes none.
    /// [`super::lookup::emission`] gives what [`Material::emission`] emits.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn computed_emission(&self, scene: &Scene, material: &Material) -> Option<Vector<L>> {
        let (Some(finish), Surface::Procedural(index)) = (&self.finish, material.surface) else {
            return None;
        };
        let effects = scene.procedurals[index as usize].effects();
        if !effects.emits() {
            return None;
        }
        Some(finish.emission.clamp(0.0, effects.emission_bound))
    }

    /// The probability that rays meet the surface instead of passing. `None` if `material` is opaque.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn opacity(&self, scene: &Scene, material: &Material) -> Option<Num<L>> {
        let (Some(finish), Surface::Procedural(index)) = (&self.finish, material.surface) else {
            return None;
        };
        scene.procedurals[index as usize].effects().has_opacity.then_some(finish.opacity.clamp(0.0, 1.0))
    }

    /// The world directions of mirrored or refracted rays that have direction `local` in the shading basis.
    /// In the lanes of `crosses` they go to the other side of the surface.
    ///
    /// Around a bent normal, a direction may lie on one side of the normal and on the other side of the
    /// triangle. It is then laid along the triangle, on the side of the normal. Otherwise it would count as
    /// having crossed a surface that it did not cross.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn smooth_direction(&self, local: Vector<L>, crosses: Mask<L>) -> Vector<L> {
        let wi = self.basis.world(local).normalize();
        let one = Num::splat(local.lanes(), 1.0);
        let side = Num::select(crosses, -one, one);
        let height = wi.dot(self.normal) * side;
        let lift = (MIN_COSINE - height) * side;
        let (lifted, _) = (wi + self.normal * lift).normalize_or(wi);
        Vector::select(height.below(MIN_COSINE), lifted, wi)
    }

    /// The start of rays from `point` ([`Interaction::position`] or [`Interaction::raised`]) towards `wi`. It
    /// is offset from the triangle to the side that `wi` points to.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn origin(&self, point: Vector<L>, wi: Vector<L>) -> Vector<L> {
        let below = wi.dot(self.normal).below(0.0);
        point + self.normal * Num::select(below, -self.offset, self.offset)
    }

    /// Lanes in which scattered rays start above the triangle by more than its rounding.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn is_raised(&self) -> Mask<L> {
        (self.raised - self.position).dot(self.normal).gt(self.offset)
    }

    /// Lanes in which `wi` points away from the surface: above the triangle or, where rays start above it, above the
    /// shading normal's plane. Such a ray from [`Interaction::raised`] is not stopped by the triangle itself, so light
    /// from below a facet ends where it does on the smooth body (Hanika 2021).
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn is_above(&self, wi: Vector<L>) -> Mask<L> {
        wi.dot(self.normal).above(0.0) | (self.is_raised() & wi.dot(self.basis.normal).above(0.0))
    }

    /// The start of scattered rays towards `wi`: [`Interaction::raised`] or, if `wi` points below the surface
    /// ([`Interaction::is_above`]), [`Interaction::position`], with an offset.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn scattered_origin(&self, wi: Vector<L>) -> Vector<L> {
        let rises = self.is_raised() & wi.dot(self.basis.normal).above(0.0);
        let below = wi.dot(self.normal).below(0.0) & !rises;
        let point = Vector::select(below, self.position, self.raised);
        point + self.normal * Num::select(below, -self.offset, self.offset)
    }

    /// The normal above which light reaches the points: that of the triangle, or the shading normal where scattered
    /// rays start above it.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn facing(&self) -> Vector<L> {
        Vector::select(self.is_raised(), self.basis.normal, self.normal)
    }
}

/// Anisotropy along the tangent, of surfaces of user code that compute its strength.
const ALONG_TANGENT: Anisotropy =
    Anisotropy { strength: Scalar { factor: 0.0, texture: None }, rotation: 0.0, direction: None };

/// The maps that change a material's shading bases.
struct Maps<'a> {
    /// True if the material has a normal map.
    normal: bool,
    anisotropy: Option<&'a Anisotropy>,
    /// `None` if the coats share the material's normals. Otherwise the coats' own normal map, or `Some(None)`
    /// if they have no map.
    coat: Option<Option<&'a NormalMap>>,
    /// The set of texture coordinates along which the tangents lie where the mesh has none of its own: that of the
    /// first map of the three.
    set: u32,
}

/// The shading bases of a material with maps, out of line.
struct Bases<'a, L: Lanes> {
    scene: &'a Scene,
    material: &'a Material,
    maps: Maps<'a>,
    at: &'a Geometry<L>,
    texture: &'a TexturePoint<L>,
}

/// The result of [`Bases`]: shading bases, [`Footprint::bumps`] and the shape of coats with normals of their own.
struct Mapped<L: Lanes> {
    basis: Basis<L>,
    bumps: Num<L>,
    coat: Option<CoatShape<L>>,
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
            Some(map) => Some(coat_shape(scene, map, at, tangents.as_ref(), &texture, &basis)),
            None => None,
        };
        Mapped { basis, bumps: texture.footprint.bumps, coat }
    }
}

impl<'a> Maps<'a> {
    /// True if the shading normals are the vertex normals, and no axis has a meaning.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn are_none(&self) -> bool {
        !self.normal && self.anisotropy.is_none() && self.coat.is_none()
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn of(scene: &'a Scene, material: &'a Material) -> Self {
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
            Surface::OpenPbr(of) => anisotropy = of.specular_anisotropy.as_ref(),
            _ => {}
        }
        if let Some(surface) = surface {
            let own_coat = surface.has_own_coat(material.normal_map.as_ref());
            coat = own_coat.then_some(surface.coat_normal_map.as_ref());
            anisotropy = surface.anisotropy.as_ref().or(anisotropy);
        }
        let direction = |grooves: &Anisotropy| grooves.direction.map(|TextureRef { set, .. }| set);
        let own = material.normal_map.as_ref().map(set).or_else(|| coat.flatten().map(set));
        Self { normal, anisotropy, coat, set: own.or_else(|| anisotropy.and_then(direction)).unwrap_or(0) }
    }

    /// The tangent bases and the lanes that have one; `None` if no map needs them.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn tangents<L: Lanes>(&self, scene: &Scene, at: &Geometry<L>) -> Option<(Basis<L>, Mask<L>)> {
        if !self.normal && self.anisotropy.is_none() && !matches!(self.coat, Some(Some(_))) {
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

/// The coats' normals in the shading bases, and the coats' bumps.
#[cfg_attr(not(unoptimised), inline(always))]
fn coat_shape<L: Lanes>(
    scene: &Scene,
    map: Option<&NormalMap>,
    at: &Geometry<L>,
    tangents: Option<&(Basis<L>, Mask<L>)>,
    texture: &TexturePoint<L>,
    basis: &Basis<L>,
) -> CoatShape<L> {
    let (mut normal, mut bumps, mut bent) = (at.outward, Num::zero(at.wo.lanes()), at.smooth);
    if let (Some(map), Some((tangents, there))) = (map, tangents) {
        let (mapped, rough) = map_normal(scene, map, texture, tangents);
        normal = Vector::select(*there, mapped, at.outward);
        bumps = rough.only(*there);
        bent |= *there;
    }
    CoatShape { normal: basis.local(bend_where(normal, bent, at.normal, at.wo, false)), bumps }
}

/// Meshes of fewer triangles fit a cache, and their hits are not prefetched.
const MIN_PREFETCHED: usize = 1 << 15;

/// Prefetches the data that [`Interaction::new`] will read about the hits of `rays`, starting at index `at`.
/// It prefetches the corners of the next `lanes` rays, and the vertex indices of the `lanes` rays after them.
/// In a large mesh each hit reads memory far from that of the hit before.
#[cfg_attr(not(unoptimised), inline(always))]
pub fn prefetch_hits(mesh: &TriangleMesh, hits: &[Hit], rays: &[u32], at: usize, lanes: usize) {
    if mesh.triangles.len() < MIN_PREFETCHED {
        return;
    }
    let prefetch = Prefetch::all_over(size_of_val(&*mesh.triangles) + size_of_val(&*mesh.positions));
    for &ray in rays.iter().skip(at + lanes).take(lanes) {
        prefetch.each([mesh.triangles.as_ptr().wrapping_add(hits[ray as usize].primitive as usize)]);
    }
    for &ray in rays.iter().skip(at).take(lanes) {
        for corner in mesh.triangles[hits[ray as usize].primitive as usize] {
            prefetch.each([mesh.positions.as_ptr().wrapping_add(corner as usize)]);
            if !mesh.normals.is_empty() {
                prefetch.each([mesh.normals.as_ptr().wrapping_add(corner as usize)]);
            }
            if !mesh.uvs.is_empty() {
                prefetch.each([mesh.uvs.as_ptr().wrapping_add(corner as usize)]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::geom::{Sampler, warp};
    use crate::scene::{
        Anisotropy, Colour, ColourSpace, Material, Mipmap, NormalMap, Principled, Scalar, Scene, Surface,
        Texture, TextureRef, Wrap,
    };
    use crate::shade::single::Interaction;
    use crate::stream::{Hit, Ray};
    use glam::{Vec2, Vec3, Vec4};

    fn shading(at: &Interaction) -> Vec3 {
        at.basis.normal.into()
    }

    /// One triangle in the xy plane, its front towards +z, u to the right, v downwards.
    fn triangle() -> Scene {
        let mut scene = Scene::default();
        scene.mesh.positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        scene.mesh.uvs = vec![Vec2::new(0.0, 1.0), Vec2::new(1.0, 1.0), Vec2::new(0.0, 0.0)];
        scene.mesh.triangles = vec![[0, 1, 2]];
        scene.mesh.materials = vec![0];
        scene.materials = vec![Material::fallback()];
        scene
    }

    fn seen(scene: &Scene, wo: Vec3) -> Interaction {
        let ray = Ray::new(Vec3::new(0.25, 0.5, 0.0) + wo * 3.0, wo * -2.0);
        let hit = Hit { t: 1.5 * wo.length(), u: 0.25, v: 0.5, primitive: 0 };
        Interaction::new(scene, &scene.materials[0], &ray, &hit)
    }

    #[test]
    fn a_hit_has_its_position_and_side() {
        let above = seen(&triangle(), Vec3::new(0.3, 0.0, 1.0));
        assert_eq!((above.position, above.uv), (Vec3::new(0.25, 0.5, 0.0), Vec2::new(0.25, 0.5)));
        assert_eq!((above.normal, shading(&above), above.raised), (Vec3::Z, Vec3::Z, above.position));
        assert!(above.front && above.outside && (above.wo.length() - 1.0).abs() < 1e-6);
        assert!(above.origin(above.position, Vec3::Z).z > 0.0);
        assert!(above.origin(above.position, Vec3::NEG_Z).z < 0.0);
        let below = seen(&triangle(), Vec3::NEG_Z);
        assert_eq!((below.normal, shading(&below)), (Vec3::NEG_Z, Vec3::NEG_Z));
        assert!(!below.front && !below.outside);
    }

    #[test]
    fn vertex_normals_define_the_outside_and_winding_the_front() {
        let mut scene = triangle();
        scene.mesh.normals = vec![Vec3::new(0.1, 0.0, -1.0).normalize(); 3];
        let above = seen(&scene, Vec3::Z);
        assert!(above.front && !above.outside);
        assert!(shading(&above).z > 0.9, "on the side of wo all the same");
        // A vertex without a normal: the triangle is flat.
        scene.mesh.normals[1] = Vec3::ZERO;
        assert_eq!(shading(&seen(&scene, Vec3::Z)), Vec3::Z);
    }

    #[test]
    fn smooth_rays_stay_on_their_side() {
        let mut scene = triangle();
        scene.materials[0].surface = Surface::Dielectric { ior: 1.5, transmittance: Vec3::ONE };
        scene.mesh.normals = vec![Vec3::new(0.7, 0.0, 0.3).normalize(); 3];
        let at = seen(&scene, Vec3::new(1.0, 0.0, 0.2));
        for i in 0..1000 {
            let local = warp::sphere(Sampler::new(0, i, 0).pair(0));
            let wi = at.smooth_direction(local);
            assert!((wi.length() - 1.0).abs() < 1e-5);
            assert!(wi.z * local.z.signum() > 0.0, "{local} went to {wi}");
        }
    }

    fn mapped(texel: [u8; 4]) -> Scene {
        let mut scene = triangle();
        scene.textures.push(Texture {
            name: String::new(),
            width: 1,
            height: 1,
            texels: [texel].into(),
            space: ColourSpace::Linear,
            wrap_u: Wrap::Repeat,
            wrap_v: Wrap::Repeat,
            mipmap: Mipmap::default(),
        });
        scene.materials[0].normal_map = Some(NormalMap { texture: TextureRef::plain(0), scale: 1.0 });
        scene.materials[0].surface = Surface::Matte { reflectance: Colour::constant(Vec3::ONE) };
        scene
    }

    #[test]
    fn normal_maps_have_x_along_u_and_y_up_in_the_image() {
        let right = shading(&seen(&mapped([200, 128, 200, 255]), Vec3::Z));
        assert!(right.x > 0.4 && right.y.abs() < 0.01, "{right}");
        let up = shading(&seen(&mapped([128, 200, 200, 255]), Vec3::Z));
        assert!(up.y > 0.4 && up.x.abs() < 0.01, "{up}");
        // The same bump from behind.
        let behind = shading(&seen(&mapped([200, 128, 200, 255]), Vec3::NEG_Z));
        assert!((behind + right).length() < 1e-5);
        // In a mirrored image u grows to the left, and so does x.
        let mut scene = mapped([200, 200, 200, 255]);
        scene.mesh.uvs.iter_mut().for_each(|uv| uv.x = -uv.x);
        let mirrored = shading(&seen(&scene, Vec3::Z));
        assert!(mirrored.x < -0.4 && mirrored.y > 0.4, "{mirrored}");
    }

    #[test]
    fn coats_have_normals_of_their_own_unless_the_maps_are_the_same() {
        let mut scene = mapped([200, 128, 200, 255]);
        let map = scene.materials[0].normal_map;
        let mut coat = |base, coat| {
            let (clearcoat, coat_normal_map) = (Scalar::constant(1.0), coat);
            scene.materials[0].surface =
                Surface::Principled(Principled { clearcoat, coat_normal_map, ..Principled::default() });
            scene.materials[0].normal_map = base;
            let at = seen(&scene, Vec3::Z);
            at.lane.coat.map(|coat| Vec3::from(at.basis.world(coat.normal)))
        };
        assert_eq!((coat(None, None), coat(map, map)), (None, None));
        assert!(coat(map, None).expect("even").dot(Vec3::Z) > 1.0 - 1e-6);
        let bumpy = coat(None, map).expect("bumpy");
        assert!(bumpy.x > 0.4 && bumpy.y.abs() < 0.01, "{bumpy}");
        let steeper = NormalMap { scale: 3.0, ..map.expect("a map") };
        let normal = coat(None, Some(steeper)).expect("bumpy");
        let mirrored = normal * (2.0 * normal.z) - Vec3::Z;
        assert!(mirrored.z > 0.0, "bent back until the mirrored view is above: {mirrored}");
    }

    #[test]
    fn anisotropic_surfaces_are_rougher_along_the_rotated_tangent() {
        let mut scene = mapped([128, 255, 128, 255]);
        let mut laid = |rotation, direction| {
            let anisotropy = Some(Anisotropy { strength: Scalar::constant(0.5), rotation, direction });
            scene.materials[0].surface =
                Surface::Principled(Principled { anisotropy, ..Principled::default() });
            scene.materials[0].normal_map = None;
            let at = seen(&scene, Vec3::new(0.3, 0.2, 1.0));
            let [x, y] = [at.basis.tangent, at.basis.bitangent].map(Vec3::from);
            assert!(x.dot(y).abs() < 1e-6 && (x.cross(y) - shading(&at)).length() < 1e-6);
            x
        };
        // u grows along x, and the top of the image is at +y.
        assert!((laid(0.0, None) - Vec3::X).length() < 1e-6);
        assert!((laid(std::f32::consts::FRAC_PI_2, None) - Vec3::Y).length() < 1e-6);
        // The red channel is in the middle and green at its end, so the direction is y.
        assert!(laid(0.0, Some(TextureRef::plain(0))).dot(Vec3::Y) > 0.999);
        assert!(laid(0.5, Some(TextureRef::plain(0))).x < -0.4);
        // Without texture coordinates any tangent will do, but it must have unit length.
        scene.mesh.uvs = vec![Vec2::ZERO; 3];
        assert!((Vec3::from(seen(&scene, Vec3::Z).basis.tangent).length() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn mesh_tangents_take_precedence() {
        let mut scene = mapped([200, 200, 200, 255]);
        scene.mesh.tangents = vec![Vec4::new(0.0, 1.0, 0.0, -1.0); 3];
        let normal = shading(&seen(&scene, Vec3::Z));
        // Bitangent = (z × y) · −1 = +x.
        assert!(normal.x > 0.4 && normal.y > 0.4, "{normal}");
        scene.mesh.tangents = vec![Vec4::ZERO; 3];
        scene.mesh.uvs = vec![Vec2::ZERO; 3];
        assert_eq!(shading(&seen(&scene, Vec3::Z)), Vec3::Z, "no direction at all: not mapped");
    }

    #[test]
    fn points_are_raised_to_the_sphere_that_the_normals_suggest() {
        let mut scene = triangle();
        let centre = Vec3::new(0.5, 0.5, -1.0);
        scene.mesh.normals = scene.mesh.positions.iter().map(|p| (*p - centre).normalize()).collect();
        let height = seen(&scene, Vec3::Z).raised.z;
        // The sphere is 0.199 above the triangle, and tangent planes lie outside of the sphere.
        assert!(height > 0.199 && height < 2.5 * 0.199, "{height}");
        // From inside the surface is concave, so the point is not raised.
        assert_eq!(seen(&scene, Vec3::NEG_Z).raised, Vec3::new(0.25, 0.5, 0.0));
    }
}
