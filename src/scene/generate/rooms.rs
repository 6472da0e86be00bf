//! Closed rooms of large triangles, seen from inside.

use super::builder::{Builder, Made};
use super::nature::noise;
use crate::scene::Scene;
use glam::Vec3;

/// A number in 0..1 from two others.
fn random(a: u32, b: u32) -> f32 {
    0.5 + 0.5 * noise(a, b)
}

/// An empty box: six walls of `cells` × `cells` cells. Every camera ray and bounce hits a wall, no shadow ray does.
pub fn empty_box(cells: u32) -> Scene {
    let size = Vec3::new(4.0, 3.0, 5.0);
    let mut builder = Builder::seen(Vec3::new(0.5, 1.6, 4.8), Vec3::new(2.2, 1.4, 0.0), 60.0);
    let wall = builder.matte("wall", 0.7);
    builder.block(size, Vec3::ZERO, cells, wall);
    builder.finish()
}

/// Thickness of inner walls and ceilings.
const THICK: f32 = 0.05;

/// A closed room with `pieces` pieces of furniture, alternately tables and vases, and a lamp above its ceiling. A small
/// hole in the ceiling is all that shows the lamp, so nearly all shadow rays are occluded by a few large triangles.
pub fn hidden_lamp(pieces: u32) -> Scene {
    const WIDTH: f32 = 10.0;
    const HEIGHT: f32 = 3.0;
    const DEPTH: f32 = 8.0;
    const HOLE: f32 = 0.3;
    let mut builder = Builder::seen(Vec3::new(0.5, 1.7, 7.6), Vec3::new(6.0, 0.6, 1.5), 60.0);
    let (wall, wood, clay) =
        (builder.matte("wall", 0.7), builder.matte("wood", 0.4), builder.matte("clay", 0.5));
    let lamp = builder.lamp();
    let top = HEIGHT + 0.5;
    builder.block(Vec3::new(WIDTH, top, DEPTH), Vec3::ZERO, 1, wall);
    builder.quad(Vec3::new(0.5, top - 0.1, 0.5), Vec3::X * (WIDTH - 1.0), Vec3::Z * (DEPTH - 1.0), 1, lamp);
    let [left, right] = [-HOLE, HOLE].map(|edge| 0.5 * (WIDTH + edge));
    let [back, front] = [-HOLE, HOLE].map(|edge| 0.5 * (DEPTH + edge));
    for (x, z) in [
        ([0.0, left], [0.0, DEPTH]),
        ([right, WIDTH], [0.0, DEPTH]),
        ([left, right], [0.0, back]),
        ([left, right], [front, DEPTH]),
    ] {
        builder.block(Vec3::new(x[0], HEIGHT, z[0]), Vec3::new(x[1], HEIGHT + THICK, z[1]), 1, wall);
    }
    let columns = (pieces as f32).sqrt().ceil() as u32;
    let pitch = Vec3::new(WIDTH / columns as f32, 0.0, DEPTH / columns as f32);
    let size = 0.7 * pitch.x.min(pitch.z).min(2.0);
    for piece in 0..pieces {
        let place = Vec3::new((piece % columns) as f32, 0.0, (piece / columns) as f32);
        let shift = Vec3::new(random(piece, 1), 0.0, random(piece, 2)) * 0.2;
        let centre = (place + 0.4 + shift) * pitch;
        if piece % 2 == 0 {
            table(&mut builder, centre, size, wood);
        } else {
            let radii: Vec<f32> = (0..=16).map(|i| size * vase(i as f32 / 16.0)).collect();
            builder.turned(centre, 1.2 * size, &radii, 24, clay);
        }
    }
    builder.finish()
}

/// A vase's radius at a height, both in 0..1.
fn vase(height: f32) -> f32 {
    0.08 + 0.2 * libm::sinf(0.4 + 2.6 * height).max(0.0) * (1.0 - 0.3 * height)
}

/// A plate on four legs.
fn table(builder: &mut Builder, centre: Vec3, size: f32, material: Made) {
    let (half, thick, height) = (0.5 * size, 0.06 * size, 0.7 * size);
    let plate = Vec3::new(centre.x - half, height, centre.z - half);
    builder.block(plate, plate + Vec3::new(size, thick, size), 1, material);
    for (x, z) in [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)] {
        let foot = Vec3::new(plate.x + x * (size - thick), 0.0, plate.z + z * (size - thick));
        builder.block(foot, foot + Vec3::new(thick, height, thick), 1, material);
    }
}

/// A level of a game: `edge` × `edge` rooms with walls, doors, pillars, crates and ramps, all of large polygons.
pub fn level(edge: u32) -> Scene {
    const ROOM: f32 = 8.0;
    const HEIGHT: f32 = 4.0;
    let middle = (edge / 2) as f32 * ROOM;
    let eye = Vec3::new(middle + 1.5, 1.7, middle + 6.5);
    let mut builder = Builder::seen(eye, eye + Vec3::new(4.0, -0.4, -3.7), 70.0);
    let (stone, crate_) = (builder.matte("stone", 0.6), builder.matte("crate", 0.4));
    let size = ROOM * edge as f32;
    builder.block(Vec3::new(size, HEIGHT, size), Vec3::ZERO, edge, stone);
    for (i, j) in (0..edge).flat_map(|i| (0..edge).map(move |j| (i, j))) {
        let room = i * edge + j;
        let corner = Vec3::new(i as f32, 0.0, j as f32) * ROOM;
        for (side, is_inner) in [(Vec3::X, j > 0), (Vec3::Z, i > 0)] {
            // One wall in five is left out.
            if is_inner && random(room, side.x as u32) < 0.8 {
                wall_with_door(&mut builder, corner, side, [ROOM, HEIGHT], stone);
            }
        }
        for k in 0..2 {
            let foot =
                corner + Vec3::new(2.5 + 3.0 * k as f32, 0.0, 2.5 + 3.0 * random(room, 10 + k).round());
            builder.block(foot, foot + Vec3::new(0.5, HEIGHT, 0.5), 1, stone);
        }
        for k in 0..4 {
            let [x, z, edge] = [20, 30, 40].map(|salt| random(room, salt + k));
            let (foot, edge) = (corner + Vec3::new(0.5 + 6.0 * x, 0.0, 0.5 + 6.0 * z), 0.4 + 0.6 * edge);
            builder.block(foot, foot + edge, 1, crate_);
        }
        let ramp = corner + Vec3::new(5.0, 0.0, 1.0);
        builder.quad(ramp, Vec3::Z * 1.5, Vec3::new(2.0, 1.2, 0.0), 1, stone);
    }
    builder.finish()
}

/// A wall along `side` with a door in its middle: two jambs and a lintel.
fn wall_with_door(
    builder: &mut Builder,
    corner: Vec3,
    side: Vec3,
    [length, height]: [f32; 2],
    material: Made,
) {
    const DOOR: [f32; 2] = [1.4, 2.4];
    let thick = (Vec3::X + Vec3::Z - side) * 2.0 * THICK;
    let jamb = 0.5 * (length - DOOR[0]);
    for (from, to, bottom) in [(0.0, jamb, 0.0), (jamb, length - jamb, DOOR[1]), (length - jamb, length, 0.0)]
    {
        let min = corner + side * from + Vec3::Y * bottom;
        builder.block(min, corner + side * to + Vec3::Y * height + thick, 1, material);
    }
}

/// A hall with mirrors for walls and `edge` × `edge` mirrored pillars: bounces stay as coherent as camera rays.
pub fn mirrors(edge: u32) -> Scene {
    const SIZE: f32 = 20.0;
    const HEIGHT: f32 = 6.0;
    let eye = Vec3::new(0.7, 2.0, 19.2);
    let mut builder = Builder::seen(eye, Vec3::new(12.0, 1.6, 6.0), 65.0);
    let (mirror, floor) = (builder.mirror(), builder.matte("floor", 0.5));
    let ([x, z], y) = ([Vec3::X, Vec3::Z].map(|axis| axis * SIZE), Vec3::Y * HEIGHT);
    for (corner, u) in [(Vec3::ZERO, x), (z, -z), (x + z, -x), (x, z)] {
        builder.quad(corner, u, y, 1, mirror);
    }
    builder.quad(Vec3::ZERO, z, x, 1, floor);
    builder.quad(y, x, z, 1, floor);
    let pitch = SIZE / edge as f32;
    for (i, j) in (0..edge).flat_map(|i| (0..edge).map(move |j| (i as f32, j as f32))) {
        let foot = Vec3::new(i + 0.5, 0.0, j + 0.5) * pitch;
        // None around the camera.
        if (foot.with_y(eye.y) - eye).length() < 0.3 * pitch {
            continue;
        }
        builder.turned(foot, HEIGHT, &[0.15 * pitch; 2], 24, mirror);
    }
    builder.finish()
}
