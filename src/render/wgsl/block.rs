//! A block of points for which a piece of an integrator runs: the host of its program.

use super::loop_entries::{EntrySession, HEADER, LARGE};
use super::shading::{Emitted, Ended};
use super::surfaces::{Surfaces, truth};
use super::{DEPTH, PAYLOAD, QUESTION, WgslState};
use crate::geom::{Sampler, warp::lanes as warp};
use crate::lanes::{Int, Lanes, Mask, Num, OutlinedTask, Vector, each, for_pairs};
use crate::program::BLOCK;
use crate::program::integrator::{Columns, Host, HostCall, HostFunction, IntegratorShader, Piece};
use crate::render::frame::CAMERA_DIMENSION;
use crate::render::{Contribution, Frame, NewRays};
use crate::stream::Ray;

/// Marks a point that has spawned no ray.
const NONE: u32 = u32::MAX;

/// Data of a block's points besides columns.
pub(super) struct Points {
    pub pixel: [u32; BLOCK],
    pub sample: [u32; BLOCK],
    /// Depth and cone of the rays that follow.
    pub onward: [u32; BLOCK],
    pub head: [u32; BLOCK],
    /// Turns of the entry that goes on.
    pub turn: [u32; BLOCK],
}

impl Points {
    pub fn new() -> Self {
        let none = [0; BLOCK];
        Self { pixel: none, sample: none, onward: none, head: none, turn: none }
    }
}

/// A ray that a point has spawned.
struct Spawned {
    point: u32,
    ray: Ray,
    own: [u32; PAYLOAD],
}

/// A block while its piece runs.
pub(super) struct Block<'a, 'b, L: Lanes> {
    pub frame: &'a Frame,
    pub shader: &'a IntegratorShader,
    pub piece: &'a Piece,
    /// The material of all points.
    pub material: Option<u32>,
    /// The surfaces of hit shaders.
    pub surfaces: &'b [Surfaces<'a, L>],
    pub points: &'b mut Points,
    pub count: usize,
    pub session: &'b mut EntrySession<'a>,
    pub emitted: &'b mut Emitted,
    /// The first ray that each point has spawned.
    first: [u32; BLOCK],
    /// Points that wait for a ray.
    waits: [bool; BLOCK],
    spawned: Vec<Spawned>,
}

impl<'a, 'b, L: Lanes> Block<'a, 'b, L> {
    #[inline(always)]
    pub fn new(
        (frame, shader): (&'a Frame, &'a IntegratorShader),
        (piece, material): (&'a Piece, Option<u32>),
        surfaces: &'b [Surfaces<'a, L>],
        (points, count): (&'b mut Points, usize),
        (session, emitted): (&'b mut EntrySession<'a>, &'b mut Emitted),
    ) -> Self {
        let (first, waits, spawned) = ([NONE; BLOCK], [false; BLOCK], Vec::new());
        Self {
            frame,
            shader,
            piece,
            material,
            surfaces,
            points,
            count,
            session,
            emitted,
            first,
            waits,
            spawned,
        }
    }

    /// The lanes of a call from a point on that are points of the block.
    #[inline(always)]
    fn lanes(&self, l: L, call: &HostCall<'_>, start: usize) -> Mask<L> {
        call.lanes(l, start) & Mask::first(l, self.count.saturating_sub(start))
    }

    #[inline(always)]
    fn target(&self, l: L, start: usize) -> Int<L> {
        let (pixel, sample) = (&self.points.pixel[start..], &self.points.sample[start..]);
        self.frame.target(Int::load(l, pixel), Int::load(l, sample))
    }

    #[inline(always)]
    fn splat(&mut self, l: L, call: &HostCall<'_>) {
        for start in (0..call.points).step_by(L::LANES) {
            let radiance = call.vector(l, 0, start);
            let lanes = self.lanes(l, call, start) & !radiance.is_zero();
            if lanes.any() {
                self.frame.splat_lanes(self.material, lanes, self.target(l, start), radiance);
            }
        }
    }

    #[inline(always)]
    fn shadow(&mut self, l: L, call: &HostCall<'_>) {
        for start in (0..call.points).step_by(L::LANES) {
            let radiance = call.vector(l, 7, start);
            let lanes = self.lanes(l, call, start) & !radiance.is_zero();
            if lanes.none() {
                continue;
            }
            let target = self.target(l, start);
            let lanes = self.frame.addable_lanes(self.material, lanes, target, radiance);
            let (origin, direction) = (call.vector(l, 0, start), call.vector(l, 3, start));
            let rays = NewRays { origin, direction, t_max: call.number(l, 6, start) }.rows(lanes);
            let brought = [radiance.x, radiance.y, radiance.z, target.to_num_bits()];
            let contributions = Num::packed_quads(lanes, brought);
            let rays: &[Ray] = bytemuck::cast_slice(rays.as_ref());
            let contributions: &[Contribution] = bytemuck::cast_slice(contributions.as_ref());
            self.emitted.shadow_rays.extend_from_slice(&rays[..lanes.count()]);
            self.emitted.contributions.extend_from_slice(&contributions[..lanes.count()]);
        }
    }

    /// True if a ray from a point is traced.
    #[inline(always)]
    fn goes_on(&self, point: usize) -> bool {
        (self.points.onward[point] & DEPTH) <= self.frame.settings().max_bounces
    }

    #[inline(always)]
    fn spawn(&mut self, call: &HostCall<'_>) {
        for point in 0..self.count {
            if !call.holds(point) || !self.goes_on(point) {
                continue;
            }
            let (ray, own) = ray_of(call, point, call.operands() - 7);
            if self.first[point] == NONE {
                self.first[point] = self.spawned.len() as u32;
            }
            self.spawned.push(Spawned { point: point as u32, ray, own });
        }
    }

    #[inline(always)]
    fn push(&mut self, call: &HostCall<'_>) {
        let Some(resume) = self.shader.resume() else { return };
        for point in (0..self.count).filter(|&point| call.holds(point)) {
            let turn = self.points.turn[point];
            if turn > self.shader.turns() {
                self.shader.stop_turning(call.place);
            }
            let mut entry = [0; LARGE];
            entry[0] = (resume + 1) | (turn << 8);
            entry[1] = self.points.onward[point];
            for (i, word) in entry[HEADER..][..call.operands()].iter_mut().enumerate() {
                *word = call.word(i, point);
            }
            self.points.head[point] = self.session.push(self.points.head[point], &entry);
        }
    }

    /// Lets the rays that a point has spawned wait on the loop stack, the earliest on top.
    #[inline(always)]
    fn keep_spawned(&mut self, point: usize) {
        if self.first[point] == NONE {
            return;
        }
        self.first[point] = NONE;
        for index in (0..self.spawned.len()).rev() {
            if self.spawned[index].point == point as u32 {
                self.push_ray(index);
                self.spawned[index].point = NONE;
            }
        }
    }

    /// Pushes a spawned ray on the loop stack of its point.
    #[inline(always)]
    fn push_ray(&mut self, index: usize) {
        let Spawned { point, ray, own } = &self.spawned[index];
        let point = *point as usize;
        let mut entry = [0; LARGE];
        entry[1] = self.points.onward[point];
        entry[HEADER..HEADER + 8].copy_from_slice(bytemuck::cast_slice(&[*ray]));
        entry[HEADER + 8..][..PAYLOAD].copy_from_slice(own);
        self.points.head[point] = self.session.push(self.points.head[point], &entry);
    }

    /// `trace`, or with `is_question` `visible`: its rays are traced after the last bounce, too, and only if
    /// something is left to do with the answer.
    #[inline(always)]
    fn wait(&mut self, call: &HostCall<'_>, number: u32, is_question: bool) {
        let next = self.piece.loop_shader(number);
        let (words, truths) = match next {
            Some(next) => {
                let piece = &self.shader.loop_shaders()[next as usize];
                (piece.words(), piece.truths())
            }
            None => (0, 0),
        };
        let kept = call.operands() - words - truths;
        for point in 0..call.points {
            let results = if is_question { 1 } else { 3 };
            for result in 0..results {
                call.set_word(result, point, 0);
            }
            let is_traced = if is_question { next.is_some() } else { self.goes_on(point) };
            let waits = point < self.count && call.holds(point) && is_traced;
            call.set_word(results, point, if waits { u32::MAX } else { 0 });
            if !waits {
                continue;
            }
            self.waits[point] = true;
            self.keep_spawned(point);
            let mut head = self.points.head[point];
            if let Some(next) = next {
                let mut entry = [0; LARGE];
                entry[0] = (next + 1) | (self.points.turn[point] << 8);
                entry[1] = self.points.onward[point];
                let bits = truths.div_ceil(32);
                for truth in 0..truths {
                    let bit = call.word(kept + words + truth, point) & 1;
                    entry[HEADER + truth / 32] |= bit << (truth % 32);
                }
                for (i, word) in entry[HEADER + bits..][..words].iter_mut().enumerate() {
                    *word = call.word(kept + i, point);
                }
                head = self.session.push(head, &entry);
            }
            let (ray, own) = ray_of(call, point, kept - 7);
            let onward = self.points.onward[point] | if is_question { QUESTION } else { 0 };
            self.emit(point, ray, own, onward, head);
        }
    }

    #[inline(always)]
    fn emit(&mut self, point: usize, ray: Ray, own: [u32; PAYLOAD], depth_and_cone: u32, head: u32) {
        let (pixel, sample) = (self.points.pixel[point], self.points.sample[point]);
        self.emitted.rays.push(ray);
        self.emitted.states.push(WgslState { own, pixel, sample, depth_and_cone, head });
    }

    #[inline(always)]
    fn random(&mut self, l: L, call: &HostCall<'_>) {
        let seed = self.frame.settings().seed;
        for start in (0..call.points).step_by(L::LANES) {
            if self.lanes(l, call, start).none() {
                continue;
            }
            let pixel = Int::load(l, &self.points.pixel[start..]);
            let sampler = Sampler::of(pixel, Int::load(l, &self.points.sample[start..]), seed);
            let dimension = call.int(l, 0, start) + (CAMERA_DIMENSION + 1);
            if call.function == HostFunction::Random {
                call.set_number(0, start, sampler.one(dimension));
            } else {
                let [u, v] = sampler.two(dimension);
                call.set_number(0, start, u);
                call.set_number(1, start, v);
            }
        }
    }

    /// Functions of single numbers.
    #[inline(always)]
    fn plain(&mut self, l: L, call: &HostCall<'_>) {
        for start in (0..call.points).step_by(L::LANES) {
            match call.function {
                HostFunction::Sky => {
                    let (radiance, _) = self.frame.lights().sky(call.vector(l, 0, start));
                    call.set_vector(0, start, radiance);
                }
                HostFunction::Hemisphere => {
                    let u = [call.number(l, 0, start), call.number(l, 1, start)];
                    call.set_vector(0, start, warp::cosine_hemisphere(u));
                }
                HostFunction::Depth => {
                    let depth = (Int::load(l, &self.points.onward[start..]) & DEPTH) + u32::MAX;
                    call.set_number(0, start, depth.to_num_bits());
                }
                _ => {
                    let next = Int::load(l, &self.points.onward[start..]) & DEPTH;
                    let last = !next.below(self.frame.settings().max_bounces + 1);
                    call.set_number(0, start, truth(last).to_num_bits());
                }
            }
        }
    }

    /// Functions of the surfaces.
    #[inline(always)]
    fn surface(&mut self, l: L, call: &HostCall<'_>) {
        for (surfaces, start) in self.surfaces.iter().zip((0..).step_by(L::LANES)) {
            let lanes = self.lanes(l, call, start);
            if lanes.none() {
                continue;
            }
            match call.function {
                HostFunction::World => surfaces.world(l, call, start),
                HostFunction::Leave => surfaces.leave(l, call, start),
                HostFunction::Above => surfaces.is_above(l, call, start),
                HostFunction::Light => surfaces.light(l, self.frame, call, start, lanes),
                HostFunction::Evaluate => surfaces.evaluate(l, call, start),
                HostFunction::Sample => surfaces.sample(l, call, start),
                _ => surfaces.ways(l, call, start),
            }
        }
    }

    /// Emits the rays that were spawned, and tells which paths have ended.
    #[inline(always)]
    pub fn finish(mut self, columns: &Columns, ended: &mut Vec<Ended>) {
        // The topmost waiting ray is the earliest.
        for index in (0..self.spawned.len()).rev() {
            let point = self.spawned[index].point;
            if point != NONE && self.first[point as usize] != index as u32 {
                self.push_ray(index);
            }
        }
        let spawned = std::mem::take(&mut self.spawned);
        for point in 0..self.count {
            if self.waits[point] {
                continue;
            }
            let head = self.points.head[point];
            match spawned.get(self.first[point] as usize) {
                Some(Spawned { ray, own, .. }) => {
                    self.emit(point, *ray, *own, self.points.onward[point], head);
                }
                None => {
                    let came = match self.shader.returns() {
                        true => each([0, 1, 2], |i| self.piece.result(columns, i, point)),
                        false => [0; 3],
                    };
                    let Points { pixel, sample, .. } = self.points;
                    ended.push(Ended { pixel: pixel[point], sample: sample[point], head, came });
                }
            }
        }
    }
}

/// A ray and a payload among the operands of a call.
#[inline(always)]
fn ray_of(call: &HostCall<'_>, point: usize, payload: usize) -> (Ray, [u32; PAYLOAD]) {
    let number = |i| f32::from_bits(call.word(i, point));
    let (origin, direction) = ([number(0), number(1), number(2)], [number(3), number(4), number(5)]);
    let ray = Ray { t_max: number(6), ..Ray::new(origin, direction) };
    let mut own = [0; PAYLOAD];
    for (i, word) in own[..payload].iter_mut().enumerate() {
        *word = call.word(7 + i, point);
    }
    (ray, own)
}

impl<L: Lanes> Host<L> for Block<'_, '_, L> {
    #[inline(always)]
    fn call(&mut self, l: L, call: &HostCall<'_>) {
        l.outlined(Answer { block: self, call });
    }
}

/// A call of a block, answered out of line: hit, miss and loop shaders share the code.
struct Answer<'a, 'b, 'c, L: Lanes> {
    block: &'c mut Block<'a, 'b, L>,
    call: &'c HostCall<'c>,
}

impl<L: Lanes> OutlinedTask<L> for Answer<'_, '_, '_, L> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) {
        let Self { block, call } = self;
        match call.function {
            HostFunction::Splat => block.splat(l, call),
            HostFunction::Shadow => block.shadow(l, call),
            HostFunction::Spawn => block.spawn(call),
            HostFunction::Push => block.push(call),
            HostFunction::Trace(number) => block.wait(call, number, false),
            HostFunction::Visible(number) => block.wait(call, number, true),
            HostFunction::Random | HostFunction::Random2 => block.random(l, call),
            function if function.needs_hit() => block.surface(l, call),
            _ => block.plain(l, call),
        }
    }
}

/// Words in the lanes of some cells.
#[inline(always)]
pub(super) fn set_lanes<L: Lanes>(cells: &[std::cell::Cell<u32>], words: Int<L>) {
    let words = words.to_array();
    for_pairs(cells, words.as_ref(), |cell, &word| cell.set(word));
}

/// A component of vectors as words.
#[inline(always)]
pub(super) fn component<L: Lanes>(vector: Vector<L>, index: u32) -> Int<L> {
    [vector.x, vector.y, vector.z][index as usize].to_bits()
}
