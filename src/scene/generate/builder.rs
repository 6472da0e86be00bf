//! Scenes put together from flat pieces.

use crate::scene::{Camera, Colour, Emission, Material, Scene, Surface};
use glam::{Vec2, Vec3};
use std::f32::consts::TAU;

/// A scene in the making.
pub struct Builder {
    scene: Scene,
}

/// A material's number.
#[derive(Clone, Copy)]
pub struct Made(u32);

impl Builder {
    /// An empty scene, seen from `eye`; y is up.
    pub fn seen(eye: Vec3, target: Vec3, fov_degrees: f32) -> Self {
        let camera = Some(Camera::new(eye, target).with_fov(fov_degrees));
        Self { scene: Scene { camera, ..Scene::default() } }
    }

    /// The scene.
    pub fn finish(self) -> Scene {
        self.scene
    }

    /// The scene so far.
    pub fn scene(&mut self) -> &mut Scene {
        &mut self.scene
    }

    /// Adds a material.
    pub fn material(&mut self, material: Material) -> Made {
        self.scene.materials.push(material);
        Made(self.scene.materials.len() as u32 - 1)
    }

    /// Adds a matte material.
    pub fn matte(&mut self, name: &str, albedo: f32) -> Made {
        self.material(Material::matte(name, Vec3::splat(albedo)))
    }

    /// Adds a mirror.
    pub fn mirror(&mut self) -> Made {
        let surface = Surface::Mirror { reflectance: Colour::constant(Vec3::splat(0.95)) };
        self.material(Material { surface, ..Material::matte("mirror", Vec3::ZERO) })
    }

    /// Adds a lamp's material.
    pub fn lamp(&mut self) -> Made {
        let emission =
            Emission { radiance: Colour::constant(Vec3::splat(10.0)), two_sided: false, is_light: true };
        self.material(Material { emission: Some(emission), ..Material::matte("lamp", Vec3::ZERO) })
    }

    /// A parallelogram of `cells` × `cells` cells that faces along `u` × `v`.
    pub fn quad(&mut self, corner: Vec3, u: Vec3, v: Vec3, cells: u32, material: Made) {
        let mesh = &mut self.scene.mesh;
        let first = mesh.positions.len() as u32;
        let at = |i: u32| i as f32 / cells as f32;
        for (row, column) in (0..=cells).flat_map(|row| (0..=cells).map(move |column| (row, column))) {
            mesh.positions.push(corner + u * at(column) + v * at(row));
            mesh.uvs.push(Vec2::new(at(column), at(row)));
        }
        for (row, column) in (0..cells).flat_map(|row| (0..cells).map(move |column| (row, column))) {
            let i = first + row * (cells + 1) + column;
            mesh.triangles.extend([[i, i + 1, i + cells + 1], [i + 1, i + cells + 2, i + cells + 1]]);
            mesh.materials.extend([material.0; 2]);
        }
    }

    /// A box from corner to corner: its six faces, outwards, or inwards if `max` is the lower corner on all axes.
    pub fn block(&mut self, min: Vec3, max: Vec3, cells: u32, material: Made) {
        let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| axis * (max - min));
        for (corner, u, v) in
            [(min, z, y), (max, -y, -z), (min, x, z), (max, -z, -x), (min, y, x), (max, -x, -y)]
        {
            self.quad(corner, u, v, cells, material);
        }
    }

    /// A body of revolution around a vertical axis: its radius at heights that are spaced evenly from `foot` up.
    pub fn turned(&mut self, foot: Vec3, height: f32, radii: &[f32], sides: u32, material: Made) {
        let mesh = &mut self.scene.mesh;
        let first = mesh.positions.len() as u32;
        for (ring, &radius) in radii.iter().enumerate() {
            let v = ring as f32 / (radii.len() - 1) as f32;
            for side in 0..=sides {
                let u = side as f32 / sides as f32;
                let (sin, cos) = libm::sincosf(u * TAU);
                mesh.positions.push(foot + Vec3::new(radius * cos, v * height, -radius * sin));
                mesh.uvs.push(Vec2::new(u, v));
            }
        }
        for (ring, side) in (1..radii.len() as u32).flat_map(|ring| (0..sides).map(move |side| (ring, side)))
        {
            let i = first + (ring - 1) * (sides + 1) + side;
            mesh.triangles.extend([[i, i + 1, i + sides + 1], [i + 1, i + sides + 2, i + sides + 1]]);
            mesh.materials.extend([material.0; 2]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_look_outwards() {
        let mut builder = Builder::seen(Vec3::Z * 9.0, Vec3::ZERO, 40.0);
        let grey = builder.matte("grey", 0.5);
        builder.block(Vec3::splat(-1.0), Vec3::new(1.0, 2.0, 3.0), 2, grey);
        builder.turned(Vec3::X * 9.0, 2.0, &[1.0, 1.0], 12, grey);
        let mesh = builder.finish().mesh;
        for (i, triangle) in mesh.triangles.iter().enumerate() {
            let middle = if i < 48 { Vec3::new(0.0, 0.5, 1.0) } else { Vec3::new(9.0, 1.0, 0.0) };
            let [a, b, c] = triangle.map(|vertex| mesh.positions[vertex as usize]);
            assert!((b - a).cross(c - a).dot(a + b + c - 3.0 * middle) > 0.0, "triangle {i}");
        }
    }
}
