//! A finished picture.

use super::{Film, Region};
use xxhash_rust::xxh3::Xxh3;

/// A picture of linear Rec. 709 radiance, row major, first row on top.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Image {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `width × height` pixels.
    pub pixels: Vec<[f32; 3]>,
}

impl Image {
    /// A picture of `width × height` pixels.
    ///
    /// # Panics
    /// If there are not as many pixels.
    pub fn new(width: u32, height: u32, pixels: Vec<[f32; 3]>) -> Self {
        assert_eq!(pixels.len() as u64, u64::from(width) * u64::from(height), "width × height pixels");
        Self { width, height, pixels }
    }

    /// A film's mean radiance in a region ([`Film::resolve`]).
    ///
    /// # Panics
    /// If the film does not have the region.
    pub fn of(film: &Film, region: Region) -> Self {
        let of_row = |y: u32| y as usize * film.width() as usize;
        let rows = film.resolve_some(of_row(region.y)..of_row(region.rows().end));
        Self::new(film.width(), region.height, rows).cropped(Region { y: 0, ..region })
    }

    /// The pixels of a region.
    ///
    /// # Panics
    /// If the picture does not have all of them.
    pub fn cropped(self, region: Region) -> Self {
        if region == Region::whole(self.width, self.height) {
            return self;
        }
        Self::new(region.width, region.height, region.crop(&self.pixels, self.width, 1))
    }

    /// The picture hash: XXH3 (64 bits) of the size and of the bits of every channel, in hexadecimal digits. Equal
    /// pictures have equal hashes, and in practice different pictures have different ones.
    pub fn hash(&self) -> String {
        let mut hash = Xxh3::new();
        for size in [self.width, self.height] {
            hash.update(&size.to_le_bytes());
        }
        for channel in self.pixels.as_flattened() {
            hash.update(&channel.to_le_bytes());
        }
        format!("{:016x}", hash.digest())
    }
}

impl Film {
    /// The mean radiance of each pixel, as a picture: [`Film::resolve`] with the film's size.
    ///
    /// ```
    /// use raystream::prelude::*;
    /// # use raystream::glam::Vec3;
    /// # use raystream::scene::TriangleMesh;
    /// # let mesh = TriangleMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]]);
    /// # let mut scene = Scene::new(mesh, vec![Material::matte("paper", Vec3::splat(0.8))]);
    /// # scene.environment = Environment::Constant(Vec3::ONE);
    /// # let camera = Camera::framing(&scene.bounds(), 1.0);
    /// let prepared = PreparedScene::new(scene, &Units::cpu())?;
    /// let service = Service::new(ServiceOptions::default())?;
    /// let frame = prepared.path(&camera, Settings::new(16, 16).with_spp(4))?;
    /// prepared.submit(&service, frame.clone(), JobOptions::default())?.wait()?;
    /// let image = frame.film().image();
    /// assert_eq!((image.width, image.height, image.pixels[0]), (16, 16, [1.0; 3]));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn image(&self) -> Image {
        Image::new(self.width(), self.height(), self.resolve())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crop_has_the_pixels_of_its_region() {
        let image = Image::new(3, 2, (0..6).map(|i| [i as f32; 3]).collect());
        let cropped = |text: &str| image.clone().cropped(text.parse().expect("a region"));
        assert_eq!(cropped("1,0,2,2"), Image::new(2, 2, [1.0, 2.0, 4.0, 5.0].map(|i| [i; 3]).to_vec()));
        assert_eq!(cropped("0,0,3,2"), image);
    }

    #[test]
    fn the_hash_depends_on_every_bit_and_the_shape() {
        let image = Image { width: 2, height: 3, pixels: vec![[0.25; 3]; 6] };
        assert_eq!(image.hash(), image.clone().hash());
        let turned = Image { width: 3, height: 2, ..image.clone() };
        assert_ne!(image.hash(), turned.hash());
        let mut nudged = image.clone();
        nudged.pixels[5][2] = 0.25_f32.next_up();
        assert_ne!(image.hash(), nudged.hash());
    }
}
