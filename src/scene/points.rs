//! Points on surfaces, as user surfaces see them.

use super::corners::{self, Weights, blend, blend_uvs, corner_uvs, tangent_basis, vectors};
use super::erased_lanes::{LaneColumns, LaneValue};
use super::{
    BlockColumns, FieldType, Finish, Footprint, OwnSurface, Scene, SurfaceField, TexturePoint, TextureRef,
    WantedFields,
};
use crate::geom::Basis;
use crate::lanes::{Int, Lanes, MAX_LANES, Mask, Num, OutlinedTask, Vector};
use glam::Vec2;

/// Sink of the scalars of points, one column each. Truth values are 1 and 0.
pub(crate) trait PointSink {
    /// Takes the column of a scalar. Scalars are counted over all fields.
    fn put(&mut self, scalar: usize, column: &[f32; MAX_LANES]);
}

/// The bit of wanted fields that stands for the finish of [`Points::base`].
pub(crate) const BASE: u64 = 1 << 63;

/// Defines [`Points`] from the table of its fields.
macro_rules! points {
    (
        given {
            $($name:ident: $kind:ident as $type:ty, $unit:literal, $range:literal, $doc:literal;)*
        }
        computed {
            $(
                $lazy:ident: $lazy_kind:ident as $lazy_type:ty, $lazy_unit:literal, $lazy_range:literal,
                $lazy_doc:literal, $by:path;
            )*
        }
    ) => {
        /// Points on a surface, one in each lane. `docs/guide/surface-fields.md` lists the fields.
        #[derive(Clone, Copy, Debug)]
        pub struct Points<'s, L: Lanes> {
            $(#[doc = concat!($doc, " Unit: ", $unit, ". Range: ", $range, ".")] pub $name: $type,)*
            /// Roughness of the bumps that the normal map averages: [`Footprint::bumps`].
            pub(crate) bumps: Num<L>,
            pub(crate) scene: &'s Scene,
            /// The surface that the material has itself, if this one starts from it.
            pub(crate) own: Option<&'s OwnSurface>,
        }

        /// The fields of [`Points`].
        pub const POINT_FIELDS: &[SurfaceField] = &[
            $(SurfaceField {
                name: stringify!($name), kind: FieldType::$kind, unit: $unit, range: $range, default: "",
                is_computed: false, doc: $doc,
            },)*
            $(SurfaceField {
                name: stringify!($lazy), kind: FieldType::$lazy_kind, unit: $lazy_unit, range: $lazy_range,
                default: "", is_computed: true, doc: $lazy_doc,
            },)*
        ];

        /// The given fields of [`Points`] as columns.
        #[derive(Clone, Copy)]
        pub(super) struct PointColumns {
            $($name: LaneColumns<{ FieldType::$kind.numbers() }>,)*
            bumps: LaneColumns<1>,
        }

        impl<'s, L: Lanes> Points<'s, L> {
            #[inline(always)]
            pub(super) fn columns(&self) -> PointColumns {
                PointColumns { $($name: self.$name.columns(),)* bumps: self.bumps.columns() }
            }

            #[inline(always)]
            pub(super) fn of_columns(
                l: L,
                (scene, own): (&'s Scene, Option<&'s OwnSurface>),
                columns: &PointColumns,
            ) -> Self {
                let bumps = LaneValue::of_columns(l, &columns.bumps);
                Self { $($name: LaneValue::of_columns(l, &columns.$name),)* bumps, scene, own }
            }

            /// [`Points::write_to`] in line.
            #[inline(always)]
            fn write_fields(&self, all: WantedFields<'_>, sink: &mut dyn PointSink) {
                let (wanted, mut field, mut scalar) = (all.fields, 0, 0);
                $(
                    if wanted >> field & 1 == 1 {
                        let columns = LaneValue::columns(&self.$name);
                        columns.iter().enumerate().for_each(|(i, column)| sink.put(scalar + i, column));
                    }
                    field += 1;
                    scalar += FieldType::$kind.numbers();
                )*
                $(
                    if wanted >> field & 1 == 1 {
                        let columns = LaneValue::columns(&self.$lazy());
                        columns.iter().enumerate().for_each(|(i, column)| sink.put(scalar + i, column));
                    }
                    field += 1;
                    scalar += FieldType::$lazy_kind.numbers();
                )*
                debug_assert_eq!((field, scalar > 0), (POINT_FIELDS.len(), true));
                if wanted & BASE != 0 {
                    self.base().write_to(scalar, sink);
                }
                let mut scalar = BlockColumns::ATTRIBUTES;
                for attribute in all.attributes {
                    let numbers = self.attribute(&attribute.name);
                    for number in &numbers[..attribute.width as usize] {
                        sink.put(scalar, &LaneValue::columns(number)[0]);
                        scalar += 1;
                    }
                }
            }

            $(
                #[doc = concat!($lazy_doc, " Unit: ", $lazy_unit, ". Range: ", $lazy_range, ".")]
                #[inline(always)]
                pub fn $lazy(&self) -> $lazy_type {
                    $by(self)
                }
            )*
        }
    };
}

points! {
    given {
        position: Vec3f as Vector<L>, "world units", "finite", "Position in world space.";
        normal: Vec3f as Vector<L>, "world space", "unit length", "Shading normal on the viewer's side.";
        geometric_normal: Vec3f as Vector<L>, "world space", "unit length",
            "Normal of the triangle on the viewer's side.";
        wo: Vec3f as Vector<L>, "world space", "unit length", "Outgoing direction, towards the viewer.";
        uv: Vec2f as [Num<L>; 2], "texture coordinates", "finite", "Texture coordinates of the mesh; 0 without any.";
        barycentric: Vec2f as [Num<L>; 2], "1", "0 to 1", "Weights of the triangle's second and third corner.";
        width: F32 as Num<L>, "world units", "at least 0", "Diameter of the ray's cone at the point.";
        area: F32 as Num<L>, "square world units", "at least 0", "Area of the triangle.";
        primitive: U32 as Int<L>, "index", "below the number of triangles", "The triangle.";
        front: Bool as Mask<L>, "1", "false or true",
            "Whether the corners run counter-clockwise as seen by the viewer.";
    }
    computed {
        tangent: Vec3f as Vector<L>, "world space", "unit length",
            "Direction in which u grows, at right angles to the normal; any such direction without texture \
             coordinates.",
            Points::tangent_here;
        bitangent: Vec3f as Vector<L>, "world space", "unit length",
            "Direction to the top of the texture, at right angles to normal and tangent.", Points::bitangent_here;
        footprint: F32 as Num<L>, "texture coordinates", "at least 0",
            "Side of the square that the ray's cone covers in the texture; textures are filtered by it.",
            Points::footprint_here;
        vertex_colour: Vec3f as Vector<L>, "linear Rec. 709", "0 to 1",
            "Colour of the mesh's vertices, blended; white without any.", Points::vertex_colour_here;
        vertex_alpha: F32 as Num<L>, "1", "0 to 1", "Alpha of the mesh's vertices, blended; 1 without any.",
            Points::vertex_alpha_here;
        object: U32 as Int<L>, "index", "below the number of objects, or 4294967295 if the triangle has none",
            "The object in the scene's object table; each instance is an object of its own.", Points::object_here;
        uv1: Vec2f as [Num<L>; 2], "texture coordinates", "finite",
            "Texture coordinates of the mesh's second set; those of the first without one.", Points::second_uv_here;
        object_position: Vec3f as Vector<L>, "units of the object", "finite",
            "Position in the object's own space: that of a glTF node, and of a recipe's shape about its centre. It \
             moves and turns with the object. Where there is none, position.",
            Points::object_position_here;
        footprint1: F32 as Num<L>, "texture coordinates", "at least 0",
            "Side of the square that the ray's cone covers in the second set of texture coordinates.",
            Points::second_footprint_here;
        object_width: F32 as Num<L>, "units of the object", "at least 0",
            "Diameter of the ray's cone at the point in the object's own space.", Points::object_width_here;
        object_bounds_min: Vec3f as Vector<L>, "units of the object", "finite",
            "Least corner of the object's box in its own space. Where there is no object, that of the scene.",
            Points::object_bounds_min_here;
        object_bounds_max: Vec3f as Vector<L>, "units of the object", "finite", "Greatest corner of that box.",
            Points::object_bounds_max_here;
        time: F32 as Num<L>, "seconds", "finite",
            "Time that the picture shows: that of the scene's animation, or of the frame.", Points::time_here;
        frame: U32 as Int<L>, "index", "below the number of frames", "Frame; 0 in a single picture.",
            Points::frame_here;
        outside: Bool as Mask<L>, "1", "false or true",
            "Whether the viewer is outside of the body, on the side of the vertex normals; without these, front.",
            Points::outside_here;
        uv2: Vec2f as [Num<L>; 2], "texture coordinates", "finite",
            "Texture coordinates of the mesh's third set; those of the first without one.", Points::third_uv_here;
        uv3: Vec2f as [Num<L>; 2], "texture coordinates", "finite",
            "Texture coordinates of the mesh's fourth set; those of the first without one.", Points::fourth_uv_here;
        footprint2: F32 as Num<L>, "texture coordinates", "at least 0",
            "Side of the square that the ray's cone covers in the third set of texture coordinates.",
            Points::third_footprint_here;
        footprint3: F32 as Num<L>, "texture coordinates", "at least 0",
            "Side of the square that the ray's cone covers in the fourth set of texture coordinates.",
            Points::fourth_footprint_here;
    }
}

/// [`Points::write_to`], out of line: it has the code of every field.
struct WriteTask<'a, 's, L: Lanes> {
    points: &'a Points<'s, L>,
    wanted: WantedFields<'a>,
    sink: &'a mut dyn PointSink,
}

impl<L: Lanes> OutlinedTask<L> for WriteTask<'_, '_, L> {
    type Output = ();

    #[inline(always)]
    fn run(self, _: L) {
        self.points.write_fields(self.wanted, self.sink);
    }
}

impl<L: Lanes> Points<'_, L> {
    /// Passes the scalars of what is wanted to a sink.
    #[inline(always)]
    pub(crate) fn write_to(&self, wanted: WantedFields<'_>, sink: &mut dyn PointSink) {
        self.lanes().outlined(WriteTask { points: self, wanted, sink });
    }

    /// The points' lanes.
    #[inline(always)]
    pub fn lanes(&self) -> L {
        self.width.lanes()
    }

    /// Linear RGBA of a texture of the scene at the points' texture coordinates, filtered like all textures.
    ///
    /// ```
    /// use raystream::lanes::{Lanes, Vector};
    /// use raystream::scene::{Finish, Points, Procedural, TextureRef};
    ///
    /// #[derive(Debug)]
    /// struct Poster {
    ///     image: TextureRef,
    /// }
    ///
    /// impl Procedural for Poster {
    ///     #[inline(always)]
    ///     fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
    ///         let [r, g, b, _] = points.texture(&self.image);
    ///         Finish { colour: Vector::new(r, g, b), ..Finish::matte(points) }
    ///     }
    /// }
    /// ```
    ///
    /// # Panics
    /// If the scene has no such texture.
    #[inline(always)]
    pub fn texture(&self, texture: &TextureRef) -> [Num<L>; 4] {
        TexturePoint { footprint: self.texture_footprint(), ..self.texture_point() }
            .look_up(self.scene, texture)
    }

    /// The numbers of a vertex attribute of the mesh, blended: zeros if it has none of this name, and beyond its width.
    ///
    /// ```
    /// use raystream::lanes::Lanes;
    /// use raystream::scene::{AttributeRequest, Finish, Points, Procedural};
    ///
    /// /// Dark where the mesh is wet.
    /// #[derive(Debug)]
    /// struct Wet {
    ///     attributes: [AttributeRequest; 1],
    /// }
    ///
    /// impl Procedural for Wet {
    ///     fn attributes(&self) -> &[AttributeRequest] {
    ///         &self.attributes
    ///     }
    ///
    ///     #[inline(always)]
    ///     fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
    ///         let [wetness, ..] = points.attribute("wetness");
    ///         let dry = Finish::matte(points);
    ///         Finish { colour: dry.colour * (1.0 - wetness * 0.5), ..dry }
    ///     }
    /// }
    /// ```
    #[inline(always)]
    pub fn attribute(&self, name: &str) -> [Num<L>; 4] {
        self.scene.mesh.attribute_at(name, self.primitive, self.barycentric)
    }

    /// The finish of the material itself, with its textures. Materials keep their emission, alpha and normal map beside
    /// a surface of user code, so here the finish is opaque, emits nothing and has the shading normal. Without a
    /// material's own surface it is [`Finish::matte`]: see [`super::Procedural::starts_from_material`].
    ///
    /// ```
    /// use raystream::lanes::Lanes;
    /// use raystream::scene::{Finish, Points, Procedural};
    ///
    /// /// The material, wet.
    /// #[derive(Debug)]
    /// struct Wet;
    ///
    /// impl Procedural for Wet {
    ///     fn starts_from_material(&self) -> bool {
    ///         true
    ///     }
    ///
    ///     #[inline(always)]
    ///     fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
    ///         let dry = points.base();
    ///         Finish { colour: dry.colour * 0.6, roughness: dry.roughness * 0.3, ..dry }
    ///     }
    /// }
    /// ```
    #[inline(always)]
    pub fn base(&self) -> Finish<L> {
        match self.own {
            None => Finish::matte(self),
            Some(own) => self.lanes().outlined(BaseTask { own, points: self }),
        }
    }

    /// The points at which the textures of the material itself are looked up.
    #[inline(always)]
    pub(super) fn own_texture_point(&self) -> TexturePoint<L> {
        let mut footprint = Footprint::point(self.lanes());
        if !self.scene.textures.is_empty() {
            footprint = self.texture_footprint();
        }
        footprint.bumps = self.bumps;
        TexturePoint { footprint, ..self.texture_point() }
    }

    /// The points without their footprint.
    #[inline(always)]
    fn texture_point(&self) -> TexturePoint<L> {
        let point = TexturePoint::without_width(self.uv, self.primitive, self.barycentric);
        TexturePoint {
            width: self.width,
            cosine: self.wo.dot(self.geometric_normal),
            area: self.area,
            ..point
        }
    }

    /// The footprint that [`Points::texture`] uses for textures of the first set of texture coordinates.
    #[inline(always)]
    pub fn texture_footprint(&self) -> Footprint<L> {
        self.footprint_in(&self.scene.mesh.uvs)
    }

    /// The footprint in a set of texture coordinates.
    #[inline(always)]
    fn footprint_in(&self, uvs: &[Vec2]) -> Footprint<L> {
        if uvs.is_empty() {
            return Footprint::point(self.lanes());
        }
        let uvs = corner_uvs(uvs, &corners::indices(&self.scene.mesh, self.primitive));
        let cosine = self.wo.dot(self.geometric_normal);
        Footprint::of_cone(self.width, cosine, self.area * 2.0, &uvs, self.barycentric)
    }

    /// Tangent, bitangent and normal.
    #[inline(always)]
    pub fn tangent_frame(&self) -> Basis<L> {
        let mesh = &self.scene.mesh;
        let indices = corners::indices(mesh, self.primitive);
        let [u, v] = self.barycentric;
        let weights: Weights<L> = [1.0 - u - v, u, v];
        // A mesh's tangents have a handedness that is meant for normals that point outside.
        let mut outside = self.front;
        if !mesh.normals.is_empty() {
            let side = blend(&vectors(&mesh.normals, &indices), &weights).dot(self.normal);
            outside = Mask::select(side.is_zero(), outside, side.above(0.0));
        }
        let outward = Vector::select(outside, self.normal, -self.normal);
        let (corners, uvs) = (vectors(&mesh.positions, &indices), corner_uvs(&mesh.uvs, &indices));
        let (basis, there) = tangent_basis(mesh, &indices, &corners, &uvs, &weights, outward);
        let any = Basis::around(self.normal);
        Basis {
            tangent: Vector::select(there, basis.tangent, any.tangent),
            bitangent: Vector::select(there, basis.bitangent, any.bitangent),
            normal: self.normal,
        }
    }

    #[inline(always)]
    fn tangent_here(&self) -> Vector<L> {
        self.tangent_frame().tangent
    }

    #[inline(always)]
    fn bitangent_here(&self) -> Vector<L> {
        self.tangent_frame().bitangent
    }

    #[inline(always)]
    fn second_uv_here(&self) -> [Num<L>; 2] {
        self.uv_of(1)
    }

    #[inline(always)]
    fn third_uv_here(&self) -> [Num<L>; 2] {
        self.uv_of(2)
    }

    #[inline(always)]
    fn fourth_uv_here(&self) -> [Num<L>; 2] {
        self.uv_of(3)
    }

    /// Texture coordinates of a set of the mesh; those of the first without one.
    #[inline(always)]
    fn uv_of(&self, set: u32) -> [Num<L>; 2] {
        let mesh = &self.scene.mesh;
        let uvs = mesh.uv_set(set);
        if uvs.is_empty() {
            return self.uv;
        }
        let [u, v] = self.barycentric;
        blend_uvs(&corner_uvs(uvs, &corners::indices(mesh, self.primitive)), &[1.0 - u - v, u, v])
    }

    #[inline(always)]
    fn footprint_here(&self) -> Num<L> {
        self.texture_footprint().width
    }

    #[inline(always)]
    fn second_footprint_here(&self) -> Num<L> {
        self.footprint_of(1)
    }

    #[inline(always)]
    fn third_footprint_here(&self) -> Num<L> {
        self.footprint_of(2)
    }

    #[inline(always)]
    fn fourth_footprint_here(&self) -> Num<L> {
        self.footprint_of(3)
    }

    #[inline(always)]
    fn footprint_of(&self, set: u32) -> Num<L> {
        let mesh = &self.scene.mesh;
        let uvs = mesh.uv_set(set);
        self.footprint_in(if uvs.is_empty() { &mesh.uvs } else { uvs }).width
    }

    #[inline(always)]
    fn object_width_here(&self) -> Num<L> {
        self.width * self.scene.objects.scale_at(self.primitive)
    }

    #[inline(always)]
    fn vertex_colour_here(&self) -> Vector<L> {
        let [r, g, b, _] = self.texture_point().vertex_colour(&self.scene.mesh);
        Vector::new(r, g, b)
    }

    #[inline(always)]
    fn vertex_alpha_here(&self) -> Num<L> {
        let [_, _, _, alpha] = self.texture_point().vertex_colour(&self.scene.mesh);
        alpha
    }

    #[inline(always)]
    fn object_here(&self) -> Int<L> {
        self.scene.objects.at(self.primitive)
    }

    #[inline(always)]
    fn object_bounds_min_here(&self) -> Vector<L> {
        self.scene.object_bounds_at(self.primitive)[0]
    }

    #[inline(always)]
    fn object_bounds_max_here(&self) -> Vector<L> {
        self.scene.object_bounds_at(self.primitive)[1]
    }

    #[inline(always)]
    fn outside_here(&self) -> Mask<L> {
        let mesh = &self.scene.mesh;
        if mesh.normals.is_empty() {
            return self.front;
        }
        let normals = vectors(&mesh.normals, &corners::indices(mesh, self.primitive));
        let [a, b, c] = &normals;
        let missing = a.is_zero() | b.is_zero() | c.is_zero();
        let [u, v] = self.barycentric;
        let side = blend(&normals, &[1.0 - u - v, u, v]).dot(self.geometric_normal);
        Mask::select(missing, self.front, side.ge(Num::zero(self.lanes())))
    }

    #[inline(always)]
    fn time_here(&self) -> Num<L> {
        Num::splat(self.lanes(), self.scene.moment.seconds)
    }

    #[inline(always)]
    fn frame_here(&self) -> Int<L> {
        Int::splat(self.lanes(), self.scene.moment.frame)
    }

    #[inline(always)]
    fn object_position_here(&self) -> Vector<L> {
        self.scene.objects.local_at(self.primitive, self.position)
    }
}

/// [`Points::base`], compiled out of line: it looks up all textures of a material.
struct BaseTask<'a, 's, L: Lanes> {
    own: &'s OwnSurface,
    points: &'a Points<'s, L>,
}

impl<L: Lanes> OutlinedTask<L> for BaseTask<'_, '_, L> {
    type Output = Finish<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> Finish<L> {
        self.own.finish(self.points)
    }
}
