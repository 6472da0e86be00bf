//! An alpha test as data.

/// An alpha test as data, from which a device decides what a [`super::Filter`] decides, to the bit.
///
/// Alpha at a hit is the material's factor, times a texel, times the alpha of the vertices. It is computed in single
/// precision, each operation rounded once:
///
/// - A corner's values weigh `1 - u - v`, `u` and `v`, and are added in this order.
/// - Texture coordinates are scaled, rotated if there is a rotation (`cosine · x + sine · y`, `cosine · y - sine · x`),
///   and moved by the offset.
/// - The texel is the bilinear mean of four (rows first); of three planes a third of the sum, by a product.
///
/// Triangles with numbers that are not finite or greater than 2⁴⁰ stay the filter's.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AlphaTable {
    rows: Vec<AlphaRow>,
    triangles: Vec<AlphaTriangle>,
    materials: Vec<AlphaMaterial>,
    images: Vec<AlphaImage>,
    decodings: Vec<[f32; 256]>,
    texels: Vec<u8>,
}

/// The part of a table that decides a primitive's hits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AlphaRow {
    /// All count.
    Opaque,
    /// The filter's.
    Filter,
    /// An index into [`AlphaTable::triangles`].
    Triangle(u32),
}

/// A masked triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlphaTriangle {
    /// Texture coordinates of the corners.
    pub uvs: [[f32; 2]; 3],
    /// Alpha of the corners.
    pub alphas: [f32; 3],
    /// Index into [`AlphaTable::materials`].
    pub material: u32,
}

/// A material's alpha.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlphaMaterial {
    /// Meaning of alpha.
    pub rule: AlphaRule,
    /// Factor, whose product with the texel comes first.
    pub factor: f32,
    /// True if the alpha of the vertices multiplies the product.
    pub vertex: bool,
    /// The texel's origin; without one it is 1.
    pub look_up: Option<AlphaLookUp>,
}

/// The decision about a hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AlphaRule {
    /// Hits count where alpha is at least so much.
    AtLeast(f32),
    /// Hits count where alpha is above a hash of primitive, u and v in units of 2⁻²⁴:
    /// `mix(primitive ^ mix(u ^ mix(v))) >> 8` of the words of u and v, with [`crate::geom::mix`].
    Chance,
}

/// A look-up in an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AlphaLookUp {
    /// Index that [`AlphaTable::add_image`] has returned.
    pub image: u32,
    /// Continuation beyond the edges, across and down.
    pub addressing: [Addressing; 2],
    /// Factor of the texture coordinates.
    pub scale: [f32; 2],
    /// Sine and cosine.
    pub rotation: Option<[f32; 2]>,
    /// Sum of the texture coordinates.
    pub offset: [f32; 2],
}

/// Continuation of an image beyond its edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Addressing {
    /// The image repeats.
    Repeat,
    /// The image repeats, every second time mirrored.
    Mirror,
    /// The edge texel continues.
    Clamp,
}

/// An image of one channel or three.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AlphaImage {
    /// Columns and rows.
    pub size: [u32; 2],
    /// Number of planes, 1 or 3, which follow each other in [`AlphaTable::texels`].
    pub planes: u32,
    /// Index of the first plane's first texel.
    pub first: u32,
    /// Index into [`AlphaTable::decodings`].
    pub decoding: u32,
}

/// The greatest magnitude of a number, 2⁴⁰: nothing that is computed from such numbers overflows.
const LARGEST: f32 = (1u64 << 40) as f32;

/// The greatest number of columns or rows: each is a number in single precision.
const MOST_TEXELS: u32 = 1 << 24;

impl AlphaTable {
    /// A table that lets all hits of so many primitives count.
    pub fn new(primitives: usize) -> Self {
        Self { rows: vec![AlphaRow::Opaque; primitives], ..Self::default() }
    }

    /// Adds an image, one plane or three of row-major texels, the first row on top. `decoding` has each byte's value.
    /// `None` if the image is too large for a table.
    ///
    /// # Panics
    /// If it has another number of planes, or a plane another number of texels than the size says.
    pub fn add_image(&mut self, size: [u32; 2], planes: &[Vec<u8>], decoding: [f32; 256]) -> Option<u32> {
        let texels = u64::from(size[0]) * u64::from(size[1]);
        assert!(matches!(planes.len(), 1 | 3) && texels > 0, "one plane or three of at least a texel");
        assert!(planes.iter().all(|plane| plane.len() as u64 == texels), "planes are as large as the image");
        let end = self.texels.len() as u64 + texels * planes.len() as u64;
        if size.iter().any(|&side| side > MOST_TEXELS) || end > u64::from(u32::MAX) {
            return None;
        }
        let first = self.texels.len() as u32;
        planes.iter().for_each(|plane| self.texels.extend_from_slice(plane));
        let known = self.decodings.iter().position(|known| *known == decoding);
        let decoding = known.unwrap_or_else(|| {
            self.decodings.push(decoding);
            self.decodings.len() - 1
        });
        self.images.push(AlphaImage { size, planes: planes.len() as u32, first, decoding: decoding as u32 });
        Some(self.images.len() as u32 - 1)
    }

    /// Adds a material and returns its index.
    ///
    /// # Panics
    /// If it names an image that has not been added.
    pub fn add_material(&mut self, material: AlphaMaterial) -> u32 {
        let is_known = |look_up: AlphaLookUp| (look_up.image as usize) < self.images.len();
        assert!(material.look_up.is_none_or(is_known), "the image has been added");
        self.materials.push(material);
        self.materials.len() as u32 - 1
    }

    /// Decides a primitive's hits by a triangle; by the filter if the table cannot.
    ///
    /// # Panics
    /// If the table has no such primitive or material.
    pub fn set(&mut self, primitive: u32, triangle: AlphaTriangle) {
        let material = &self.materials[triangle.material as usize];
        let uvs = triangle.uvs.as_flattened().iter().chain(&triangle.alphas);
        self.rows[primitive as usize] = if uvs.copied().all(is_usable) && material.is_usable() {
            self.triangles.push(triangle);
            AlphaRow::Triangle(self.triangles.len() as u32 - 1)
        } else {
            AlphaRow::Filter
        };
    }

    /// Leaves a primitive's hits to the filter.
    ///
    /// # Panics
    /// If the table has no such primitive.
    pub fn leave(&mut self, primitive: u32) {
        self.rows[primitive as usize] = AlphaRow::Filter;
    }

    /// A row for each primitive.
    pub fn rows(&self) -> &[AlphaRow] {
        &self.rows
    }

    /// Masked triangles.
    pub fn triangles(&self) -> &[AlphaTriangle] {
        &self.triangles
    }

    /// Materials of masked triangles.
    pub fn materials(&self) -> &[AlphaMaterial] {
        &self.materials
    }

    /// Images of materials.
    pub fn images(&self) -> &[AlphaImage] {
        &self.images
    }

    /// Values of each byte.
    pub fn decodings(&self) -> &[[f32; 256]] {
        &self.decodings
    }

    /// Texels of all images.
    pub fn texels(&self) -> &[u8] {
        &self.texels
    }
}

impl AlphaMaterial {
    fn is_usable(&self) -> bool {
        let cutoff = match self.rule {
            AlphaRule::AtLeast(cutoff) => cutoff,
            AlphaRule::Chance => 0.0,
        };
        let look_up = self.look_up.iter().all(|look_up| {
            let rotation = look_up.rotation.unwrap_or_default();
            [look_up.scale, look_up.offset, rotation].as_flattened().iter().copied().all(is_usable)
        });
        is_usable(cutoff) && is_usable(self.factor) && look_up
    }
}

fn is_usable(x: f32) -> bool {
    x.abs() <= LARGEST
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: AlphaMaterial =
        AlphaMaterial { rule: AlphaRule::Chance, factor: 0.5, vertex: false, look_up: None };
    const TRIANGLE: AlphaTriangle = AlphaTriangle { uvs: [[0.0; 2]; 3], alphas: [1.0; 3], material: 0 };

    #[test]
    fn numbers_that_could_overflow_stay_the_filters() {
        let mut table = AlphaTable::new(5);
        table.add_material(PLAIN);
        table.add_material(AlphaMaterial { rule: AlphaRule::AtLeast(f32::NAN), ..PLAIN });
        table.set(1, TRIANGLE);
        table.set(2, AlphaTriangle { uvs: [[0.0; 2], [0.0, 2e12], [0.0; 2]], ..TRIANGLE });
        table.set(3, AlphaTriangle { material: 1, ..TRIANGLE });
        table.leave(4);
        let filter = AlphaRow::Filter;
        assert_eq!(table.rows(), [AlphaRow::Opaque, AlphaRow::Triangle(0), filter, filter, filter]);
        assert_eq!(table.triangles(), [TRIANGLE]);
    }

    #[test]
    fn images_lie_one_after_the_other_and_share_decodings() {
        let mut table = AlphaTable::new(0);
        let decoding = std::array::from_fn(|byte| byte as f32);
        assert_eq!(table.add_image([2, 1], &[vec![1, 2]], decoding), Some(0));
        assert_eq!(table.add_image([1, 1], &[vec![3], vec![4], vec![5]], decoding), Some(1));
        assert_eq!(table.texels(), [1, 2, 3, 4, 5]);
        assert_eq!(table.images()[1], AlphaImage { size: [1, 1], planes: 3, first: 2, decoding: 0 });
        let columns = MOST_TEXELS + 1;
        assert_eq!(table.add_image([columns, 1], &[vec![0; columns as usize]], decoding), None);
    }
}
