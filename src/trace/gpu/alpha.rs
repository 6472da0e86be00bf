//! The alpha test as words, which kernels of exact hits read (`shaders/exact/alpha.wgsl`).

use crate::bvh::{Addressing, AlphaMaterial, AlphaRow, AlphaRule, AlphaTable, AlphaTriangle};
use std::fmt::Write as _;

/// Index of the first row; the words before are those of triangles, materials, values and texels.
const ROWS: u32 = 4;
const TRIANGLE_WORDS: u32 = 10;
const MATERIAL_WORDS: u32 = 13;

/// Rows that are no triangles.
const OPAQUE: u32 = u32::MAX;
const OF_FILTER: u32 = u32::MAX - 1;

/// Bits of a material's kind.
const HAS_CUTOFF: u32 = 1;
const HAS_VERTICES: u32 = 2;
const HAS_TEXTURE: u32 = 4;
const HAS_THREE: u32 = 8;
const IS_TURNED: u32 = 16;

/// Constants of the kernels.
pub(super) fn constants() -> String {
    let all = [
        ("ROWS", ROWS),
        ("TRIANGLE_WORDS", TRIANGLE_WORDS),
        ("MATERIAL_WORDS", MATERIAL_WORDS),
        ("OPAQUE", OPAQUE),
        ("OF_FILTER", OF_FILTER),
        ("HAS_CUTOFF", HAS_CUTOFF),
        ("HAS_VERTICES", HAS_VERTICES),
        ("HAS_TEXTURE", HAS_TEXTURE),
        ("HAS_THREE", HAS_THREE),
        ("IS_TURNED", IS_TURNED),
        ("REPEAT", addressing(Addressing::Repeat)),
        ("MIRROR", addressing(Addressing::Mirror)),
    ];
    all.iter().fold(String::new(), |mut text, (name, value)| {
        let _ = writeln!(text, "const ALPHA_{name}: u32 = {value}u;");
        text
    })
}

/// A table as words: where its parts begin, rows, triangles, materials, values of bytes, texels.
pub(super) fn words(table: &AlphaTable) -> Vec<u32> {
    let mut words = vec![0; ROWS as usize];
    words.extend(table.rows().iter().map(|row| match *row {
        AlphaRow::Opaque => OPAQUE,
        AlphaRow::Filter => OF_FILTER,
        AlphaRow::Triangle(index) => index,
    }));
    words[0] = words.len() as u32;
    words.extend(table.triangles().iter().flat_map(triangle));
    words[1] = words.len() as u32;
    words.extend(table.materials().iter().flat_map(|of| material(table, of)));
    words[2] = words.len() as u32;
    words.extend(table.decodings().as_flattened().iter().map(|value| value.to_bits()));
    words[3] = words.len() as u32;
    words.extend(table.texels().chunks(4).map(|bytes| {
        let mut word = [0; 4];
        word[..bytes.len()].copy_from_slice(bytes);
        u32::from_le_bytes(word)
    }));
    words
}

fn triangle(of: &AlphaTriangle) -> [u32; TRIANGLE_WORDS as usize] {
    let [[u0, v0], [u1, v1], [u2, v2]] = of.uvs.map(|uv| uv.map(f32::to_bits));
    let [a0, a1, a2] = of.alphas.map(f32::to_bits);
    [u0, u1, u2, v0, v1, v2, a0, a1, a2, of.material]
}

fn material(table: &AlphaTable, of: &AlphaMaterial) -> [u32; MATERIAL_WORDS as usize] {
    let mut words = [0; MATERIAL_WORDS as usize];
    let mut kind = if of.vertex { HAS_VERTICES } else { 0 };
    if let AlphaRule::AtLeast(cutoff) = of.rule {
        kind |= HAS_CUTOFF;
        words[1] = cutoff.to_bits();
    }
    words[2] = of.factor.to_bits();
    if let Some(look_up) = of.look_up {
        let image = table.images()[look_up.image as usize];
        let [across, down] = look_up.addressing.map(addressing);
        kind |= HAS_TEXTURE | (across << 8) | (down << 10);
        kind |= if image.planes == 3 { HAS_THREE } else { 0 };
        kind |= if look_up.rotation.is_some() { IS_TURNED } else { 0 };
        words[3..5].copy_from_slice(&image.size);
        let turn = look_up.rotation.unwrap_or_default();
        let numbers = [look_up.scale, turn, look_up.offset];
        for (word, number) in words[5..11].iter_mut().zip(numbers.as_flattened()) {
            *word = number.to_bits();
        }
        words[11..].copy_from_slice(&[image.first, 256 * image.decoding]);
    }
    words[0] = kind;
    words
}

fn addressing(of: Addressing) -> u32 {
    match of {
        Addressing::Repeat => 0,
        Addressing::Mirror => 1,
        Addressing::Clamp => 2,
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::bvh::{AlphaLookUp, Filter};
    use crate::geom::mix;

    /// A table, and what it says in plain arithmetic.
    #[derive(Clone)]
    pub(in crate::trace::gpu) struct Cutouts(AlphaTable);

    impl Cutouts {
        /// Every kind of material, image and addressing, on three of four primitives.
        pub fn new(primitives: usize) -> Self {
            let mut table = AlphaTable::new(primitives);
            let byte = |at: u32| (mix(at) >> 11) as u8;
            let plane = |texels: u32, seed: u32| (0..texels).map(|at| byte(at ^ mix(seed))).collect();
            let curved = std::array::from_fn(|byte| (byte as f32 / 255.0).powi(2));
            let linear = std::array::from_fn(|byte| byte as f32 * (1.0 / 255.0));
            let images = [
                table.add_image([7, 5], &[plane(35, 1)], linear).expect("it is small"),
                table
                    .add_image([4, 9], &[plane(36, 2), plane(36, 3), plane(36, 4)], curved)
                    .expect("so is this"),
                table.add_image([1, 1], &[vec![128]], linear).expect("and this"),
            ];
            let ways = [Addressing::Repeat, Addressing::Mirror, Addressing::Clamp];
            for kind in 0..36 {
                let turned = kind % 4 > 1;
                let look_up = AlphaLookUp {
                    image: images[kind % 3],
                    addressing: [ways[kind / 3 % 3], ways[kind / 9 % 3]],
                    scale: if turned { [-1.5, 0.7] } else { [1.0, 1.0] },
                    rotation: turned.then_some([0.6, 0.8]),
                    offset: if turned { [0.25, -3.125] } else { [0.0, 0.0] },
                };
                table.add_material(AlphaMaterial {
                    rule: if kind % 2 == 0 { AlphaRule::AtLeast(0.4) } else { AlphaRule::Chance },
                    factor: if kind % 5 == 0 { 1.0 } else { 0.9 },
                    vertex: kind % 7 > 3,
                    look_up: (kind % 6 != 5).then_some(look_up),
                });
            }
            for primitive in (0..primitives as u32).filter(|primitive| Self::is_masked(*primitive)) {
                let number = |k: u32| (mix(primitive ^ mix(k)) >> 8) as f32 / (1 << 22) as f32 - 2.0;
                let uvs = [0, 1, 2].map(|k| [number(2 * k), number(2 * k + 1)]);
                let alphas = [7, 8, 9].map(|k| number(k).abs().min(1.0));
                table.set(primitive, AlphaTriangle { uvs, alphas, material: mix(primitive) % 36 });
            }
            Self(table)
        }

        pub fn is_masked(primitive: u32) -> bool {
            !primitive.is_multiple_of(4)
        }

        fn texel(&self, look_up: AlphaLookUp, [u, v]: [f32; 2]) -> f32 {
            let image = self.0.images()[look_up.image as usize];
            let [mut x, mut y] = [u * look_up.scale[0], v * look_up.scale[1]];
            if let Some([sine, cosine]) = look_up.rotation {
                [x, y] = [cosine * x + sine * y, cosine * y - sine * x];
            }
            let taps = |c: f32, size: u32, way| {
                let share = match way {
                    Addressing::Repeat => c - c.floor(),
                    Addressing::Mirror => {
                        let m = c - 2.0 * (c * 0.5).floor();
                        if m > 1.0 { 2.0 - m } else { m }
                    }
                    Addressing::Clamp => c.clamp(0.0, 1.0),
                };
                let place = share * size as f32 - 0.5;
                let index = |at: i64| match way {
                    Addressing::Repeat => at.rem_euclid(size.into()) as usize,
                    _ => at.clamp(0, i64::from(size) - 1) as usize,
                };
                let low = place.floor() as i64;
                ([index(low), index(low + 1)], place - place.floor())
            };
            let (across, right) = taps(x + look_up.offset[0], image.size[0], look_up.addressing[0]);
            let (down, low) = taps(y + look_up.offset[1], image.size[1], look_up.addressing[1]);
            let texels = image.size[0] as usize * image.size[1] as usize;
            let planes = (0..image.planes as usize).map(|plane| {
                let at = |row: usize, column: usize| {
                    let index = plane * texels + row * image.size[0] as usize + column;
                    let byte = self.0.texels()[image.first as usize + index];
                    self.0.decodings()[image.decoding as usize][byte as usize]
                };
                let lerp = |a: f32, b: f32, share: f32| a + (b - a) * share;
                let rows = down.map(|row| lerp(at(row, across[0]), at(row, across[1]), right));
                lerp(rows[0], rows[1], low)
            });
            match *planes.collect::<Vec<_>>() {
                [r, g, b] => (r + g + b) * (1.0 / 3.0),
                [value] => value,
                _ => unreachable!("one plane or three"),
            }
        }
    }

    impl Filter for Cutouts {
        fn accepts(&self, primitive: u32, u: f32, v: f32) -> bool {
            let AlphaRow::Triangle(index) = self.0.rows()[primitive as usize] else { return true };
            let triangle = self.0.triangles()[index as usize];
            let material = self.0.materials()[triangle.material as usize];
            let at = |[a, b, c]: [f32; 3]| a * (1.0 - u - v) + b * u + c * v;
            let uv = [0, 1].map(|k| at(triangle.uvs.map(|uv| uv[k])));
            let texel = material.look_up.map_or(1.0, |look_up| self.texel(look_up, uv));
            let mut alpha = material.factor * texel;
            if material.vertex {
                alpha *= at(triangle.alphas);
            }
            match material.rule {
                AlphaRule::AtLeast(cutoff) => alpha >= cutoff,
                AlphaRule::Chance => {
                    let bits = mix(primitive ^ mix(u.to_bits() ^ mix(v.to_bits())));
                    alpha > (bits >> 8) as f32 * (1.0 / (1 << 24) as f32)
                }
            }
        }

        fn alpha_table(&self) -> Option<AlphaTable> {
            Some(self.0.clone())
        }
    }

    #[test]
    fn parts_follow_each_other() {
        let table = Cutouts::new(10).0;
        let words = words(&table);
        let sizes = [10, 7 * TRIANGLE_WORDS, 36 * MATERIAL_WORDS, 2 * 256, (35 + 3 * 36 + 1) / 4];
        let mut end = ROWS;
        for (part, size) in sizes.into_iter().enumerate() {
            end += size;
            assert_eq!(words.get(part).filter(|_| part < 4).copied().unwrap_or(words.len() as u32), end);
        }
        assert_eq!(words[ROWS as usize..][..3], [OPAQUE, 0, 1]);
    }
}
