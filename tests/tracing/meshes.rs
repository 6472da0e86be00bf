//! Meshes to trace: soups, grids, coincident boxes, and degenerate triangles.

use glam::Vec3;

/// Numbers from a seed (xorshift64*).
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    pub fn bits(&mut self) -> u32 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 32) as u32
    }

    /// In [-1, 1).
    pub fn signed(&mut self) -> f32 {
        (self.bits() >> 8) as f32 / (1 << 23) as f32 - 1.0
    }

    pub fn below(&mut self, n: u32) -> u32 {
        self.bits() % n
    }

    /// In the cube of side 2 around the origin.
    pub fn point(&mut self) -> Vec3 {
        Vec3::new(self.signed(), self.signed(), self.signed())
    }
}

/// An indexed mesh.
#[derive(Clone, Default)]
pub struct Mesh {
    pub positions: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    pub fn corners(&self, primitive: usize) -> [Vec3; 3] {
        self.triangles[primitive].map(|i| self.positions[i as usize])
    }

    pub fn push(&mut self, corners: [Vec3; 3]) {
        let first = self.positions.len() as u32;
        self.positions.extend(corners);
        self.triangles.push([first, first + 1, first + 2]);
    }

    pub fn scaled(mut self, factor: f32) -> Self {
        self.positions.iter_mut().for_each(|p| *p *= factor);
        self
    }

    pub fn moved(mut self, by: Vec3) -> Self {
        self.positions.iter_mut().for_each(|p| *p += by);
        self
    }
}

/// Random triangles of about one size.
pub fn soup(count: usize, size: f32, seed: u64) -> Mesh {
    let mut random = Random::new(seed);
    let mut mesh = Mesh::default();
    for _ in 0..count {
        let centre = random.point();
        mesh.push([0; 3].map(|_| centre + random.point() * size));
    }
    mesh
}

/// A bumpy `n` by `n` grid whose triangles share edges and vertices; flat where `height` is 0.
pub fn grid(n: u32, height: f32, seed: u64) -> Mesh {
    let mut random = Random::new(seed);
    let mut mesh = Mesh::default();
    for y in 0..=n {
        for x in 0..=n {
            let at = |i: u32| i as f32 / n as f32 * 2.0 - 1.0;
            mesh.positions.push(Vec3::new(at(x), at(y), height * random.signed()));
        }
    }
    for y in 0..n {
        for x in 0..n {
            let i = y * (n + 1) + x;
            mesh.triangles.push([i, i + 1, i + n + 1]);
            mesh.triangles.push([i + 1, i + n + 2, i + n + 1]);
        }
    }
    mesh
}

/// Axis-aligned boxes with faces in common planes, many of them coincident.
pub fn blocks(count: usize, seed: u64) -> Mesh {
    let mut random = Random::new(seed);
    let mut mesh = Mesh::default();
    for _ in 0..count {
        let mut coordinate = || random.below(5) as f32 * 0.5 - 1.0;
        let low = Vec3::new(coordinate(), coordinate(), coordinate());
        let corner = |i: u32| low + 0.5 * Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32);
        for [a, b, c, d] in
            [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]]
        {
            mesh.push([corner(a), corner(b), corner(c)]);
            mesh.push([corner(a), corner(c), corner(d)]);
        }
    }
    mesh
}

/// Points, segments, slivers and repeated triangles between ordinary ones.
pub fn degenerate(seed: u64) -> Mesh {
    let mut random = Random::new(seed);
    let mut mesh = soup(60, 0.3, seed);
    for i in 0..60 {
        let (p, q) = (random.point(), random.point());
        mesh.push(match i % 5 {
            0 => [p, p, p],
            1 => [p, q, p],
            2 => [p, 0.5 * (p + q), q],
            3 => [p, p + 1e-6 * q, q * 30.0],
            _ => mesh.corners(i as usize),
        });
    }
    mesh
}
