//! Which of some lookouts on hills see each other: `cargo run --release --example visibility`.

use glam::Vec3;
use raystream::query::{GeometryError, Mesh, Ray};
use raystream::scene::generate;

/// How high a lookout stands above the ground.
const HEIGHT: f32 = 1.5;

/// Puts lookouts on the ground, and answers for each pair whether they see each other.
fn survey(mesh: &Mesh, places: &[[f32; 2]]) -> Vec<Vec<bool>> {
    let sky = mesh.bvh().bounds().max.y + 1.0;
    let down: Vec<Ray> = places.iter().map(|&[x, z]| Ray::new(Vec3::new(x, sky, z), -Vec3::Y)).collect();
    let grounds = mesh.closest(&down);
    let eyes: Vec<Vec3> = down
        .iter()
        .zip(&grounds)
        .map(|(ray, ground)| {
            Vec3::from(ray.origin) - Vec3::Y * (if ground.is_miss() { 0.0 } else { ground.t } - HEIGHT)
        })
        .collect();
    let pairs: Vec<Ray> = eyes.iter().flat_map(|&a| eyes.iter().map(move |&b| Ray::between(a, b))).collect();
    let hidden = mesh.occluded(&pairs);
    hidden.chunks(eyes.len().max(1)).map(|row| row.iter().map(|hidden| !hidden).collect()).collect()
}

/// `n` × `n` places on the hills.
fn lookouts(n: u32) -> Vec<[f32; 2]> {
    let at = |i: u32| (i as f32 + 0.5) / n as f32 * 90.0 - 45.0;
    (0..n * n).map(|i| [at(i % n), at(i / n)]).collect()
}

fn main() -> Result<(), GeometryError> {
    let (positions, triangles) = generate::terrain(512);
    let mesh = Mesh::build(&positions, &triangles)?;
    let seen = survey(&mesh, &lookouts(6));
    for (i, row) in seen.iter().enumerate() {
        let line: String = row.iter().map(|&sees| if sees { " #" } else { " ." }).collect();
        println!("{i:>3}{line}");
    }
    let pairs = seen.iter().flatten().count() - seen.len();
    println!(
        "{} of {pairs} ordered pairs see each other",
        seen.iter().flatten().filter(|&&s| s).count() - seen.len()
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seeing_is_mutual_and_hills_are_in_the_way_of_some() {
        let (positions, triangles) = generate::terrain(64);
        let seen = survey(&Mesh::build(&positions, &triangles).expect("sound"), &lookouts(5));
        let mut visible = 0;
        for (a, row) in seen.iter().enumerate() {
            for (b, &sees) in row.iter().enumerate() {
                visible += usize::from(sees);
                assert_eq!(sees, seen[b][a], "{a}, {b}");
            }
        }
        assert!(visible > 2 * seen.len() && visible < seen.len() * seen.len(), "{visible}");
    }
}
