//! A batch that an integrator in WGSL shades.

use super::block::{Block, Points, component, set_lanes};
use super::loop_entries::{EntrySession, HEADER, LARGE};
use super::surfaces::{MakeSurfaces, ReadFact, Surfaces};
use super::{DEPTH_BITS, PAYLOAD, QUESTION, WgslState};
use crate::lanes::{Int, LaneTask, Lanes};
use crate::program::BLOCK;
use crate::program::integrator::{
    Columns, HIT_FIELDS, HitFact, HostFunction, IntegratorShader, Piece, PieceColumns,
};
use crate::render::{Contribution, Frame, hits_of, rays_of};
use crate::schedule::Batch;
use crate::shade::bsdf::Smoothness;
use crate::shade::{Cone, sort};
use crate::stream::Ray;
use std::cell::RefCell;

/// Rays and splats that a batch has emitted.
#[derive(Default)]
pub(super) struct Emitted {
    pub rays: Vec<Ray>,
    pub states: Vec<WgslState>,
    pub shadow_rays: Vec<Ray>,
    pub contributions: Vec<Contribution>,
}

/// A path that has ended, and what its last ray has brought.
#[derive(Clone, Copy)]
pub(super) struct Ended {
    pub pixel: u32,
    pub sample: u32,
    pub head: u32,
    pub came: [u32; 3],
}

/// Points that wait for a loop shader.
#[derive(Default)]
struct Ready {
    paths: Vec<Ended>,
    /// The entries, one after another.
    words: Vec<u32>,
}

/// A batch being shaded.
pub(super) struct Shading<'a> {
    shader: &'a IntegratorShader,
    frame: &'a Frame,
    batch: Batch<'a, WgslState>,
    session: EntrySession<'a>,
    emitted: Emitted,
    ended: Vec<Ended>,
    ready: Vec<Ready>,
    points: Box<Points>,
    /// Facts that the scalars of `Hit` hold.
    facts: Vec<(HitFact, usize)>,
    /// Way in which the BSDFs that the shader asks are made.
    smoothness: Option<Smoothness>,
}

impl<'a> Shading<'a> {
    pub fn new(
        shader: &'a IntegratorShader,
        frame: &'a Frame,
        batch: Batch<'a, WgslState>,
        session: EntrySession<'a>,
    ) -> Self {
        let facts: Vec<(HitFact, usize)> = HIT_FIELDS
            .iter()
            .flat_map(|field| (0..field.kind.numbers()).map(|component| (field.what, component)))
            .collect();
        let asks = shader.hit().asks(|function| {
            use HostFunction as F;
            matches!(function, F::Evaluate | F::Sample | F::Ways)
        });
        let lights =
            |&(input, _): &(u32, u32)| matches!(facts.get(input as usize), Some((HitFact::Lights, _)));
        let needs_bsdf = asks || shader.hit().inputs().iter().any(lights);
        let exact = Smoothness::EXACT;
        let smoothness = needs_bsdf.then(|| shader.mirror_below().map_or(exact, Smoothness::followed));
        let ready = shader.loop_shaders().iter().map(|_| Ready::default()).collect();
        Self {
            shader,
            frame,
            batch,
            session,
            emitted: Emitted::default(),
            ended: Vec::new(),
            ready,
            points: Box::new(Points::new()),
            facts,
            smoothness,
        }
    }
}

thread_local! {
    static COLUMNS: RefCell<PieceColumns> = RefCell::default();
}

#[inline]
fn take(piece: &Piece) -> Columns {
    COLUMNS.with_borrow_mut(|all| all.take(piece))
}

#[inline]
fn put(piece: &Piece, columns: Columns) {
    COLUMNS.with_borrow_mut(|all| all.put(piece, columns));
}

impl LaneTask for Shading<'_> {
    type Output = Emitted;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(mut self, l: L) -> Emitted {
        let mut surfaces = Vec::with_capacity(BLOCK / L::LANES);
        let mut others = Vec::new();
        for run in sort(l, self.batch.hits, self.frame.scene()).runs() {
            let rays = match self.shader.asks_questions() {
                true => self.answer(run.rays, run.material.is_some(), &mut others),
                false => run.rays,
            };
            for rays in rays.chunks(BLOCK) {
                match run.material {
                    None => self.miss(l, rays),
                    Some(material) => self.hit(l, material, rays, &mut surfaces),
                }
            }
        }
        self.take_up(l);
        self.emitted
    }
}

impl<'a> Shading<'a> {
    /// Answers the questions among rays that have all hit something or all nothing. Returns the other rays.
    fn answer<'r>(&mut self, rays: &[u32], is_hit: bool, others: &'r mut Vec<u32>) -> &'r [u32] {
        others.clear();
        let visible = if is_hit { 0.0f32 } else { 1.0 };
        for &ray in rays {
            let WgslState { pixel, sample, depth_and_cone, head, .. } = self.batch.payloads[ray as usize];
            match depth_and_cone & QUESTION {
                0 => others.push(ray),
                _ => self.ended.push(Ended { pixel, sample, head, came: [visible.to_bits(), 0, 0] }),
            }
        }
        others
    }

    /// Notes what a block knows of its points.
    #[inline(always)]
    fn note(&mut self, rays: &[u32]) {
        let Points { pixel, sample, onward, head, turn } = &mut *self.points;
        for (point, &ray) in rays.iter().enumerate() {
            let state = &self.batch.payloads[ray as usize];
            (pixel[point], sample[point], head[point]) = (state.pixel, state.sample, state.head);
            (onward[point], turn[point]) = (state.depth_and_cone + 1, 0);
        }
    }

    /// A word of the payloads of some rays.
    #[inline(always)]
    fn payload<L: Lanes>(&self, ids: Int<L>, word: usize) -> Int<L> {
        let mut words = ids.to_array();
        for id in words.as_mut() {
            *id = self.batch.payloads[*id as usize].own[word.min(PAYLOAD - 1)];
        }
        Int::from_array(ids.lanes(), &words)
    }

    /// The hit shader for some rays.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn hit<L: Lanes>(&mut self, l: L, number: u32, rays: &[u32], surfaces: &mut Vec<Surfaces<'a, L>>) {
        let (frame, shader) = (self.frame, self.shader);
        let piece = shader.hit();
        let material = &frame.scene().materials[number as usize];
        let columns = take(piece);
        self.note(rays);
        surfaces.clear();
        for start in (0..rays.len().next_multiple_of(crate::lanes::MAX_LANES)).step_by(L::LANES) {
            // Lanes that are left over repeat the first ray and count for nothing.
            let (ids, _) = Int::some(l, rays.get(start..).unwrap_or_default(), rays[0]);
            let hits = hits_of(&self.batch, ids);
            let (_, direction) = rays_of(&self.batch, ids);
            let packed = Int::load(l, &self.points.onward[start..]);
            let cone = Cone::unpack(packed >> DEPTH_BITS).at(hits.t);
            let onward = (packed & super::DEPTH) + (cone.pack() << DEPTH_BITS);
            onward.store(&mut self.points.onward[start..]);
            let (width, smoothness) = (cone.width, self.smoothness);
            let hits = &hits;
            let made = l.outlined(MakeSurfaces { frame, material, direction, hits, width, smoothness });
            for &(input, register) in piece.inputs() {
                let words = match self.facts.get(input as usize) {
                    Some(&(what, component)) => {
                        l.outlined(ReadFact { surfaces: &made, frame, material, what, component })
                    }
                    None => self.payload(ids, input as usize - self.facts.len()),
                };
                set_lanes(&piece.column(&columns, register)[start..], words);
            }
            surfaces.push(made);
        }
        let points = (&mut *self.points, rays.len());
        let out = (&mut self.session, &mut self.emitted);
        let mut block = Block::new((frame, shader), (piece, Some(number)), surfaces, points, out);
        piece.run(l, &columns, rays.len(), &mut block, shader);
        block.finish(&columns, &mut self.ended);
        put(piece, columns);
    }

    /// The miss shader for some rays.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn miss<L: Lanes>(&mut self, l: L, rays: &[u32]) {
        let (frame, shader) = (self.frame, self.shader);
        let piece = shader.miss();
        let columns = take(piece);
        self.note(rays);
        for start in (0..rays.len().next_multiple_of(crate::lanes::MAX_LANES)).step_by(L::LANES) {
            let (ids, _) = Int::some(l, rays.get(start..).unwrap_or_default(), rays[0]);
            let (_, direction) = rays_of(&self.batch, ids);
            for &(input, register) in piece.inputs() {
                let words = match input {
                    0..=2 => component(direction, input),
                    payload => self.payload(ids, payload as usize - 3),
                };
                set_lanes(&piece.column(&columns, register)[start..], words);
            }
        }
        let points = (&mut *self.points, rays.len());
        let out = (&mut self.session, &mut self.emitted);
        let mut block = Block::<L>::new((frame, shader), (piece, None), &[], points, out);
        piece.run(l, &columns, rays.len(), &mut block, shader);
        block.finish(&columns, &mut self.ended);
        put(piece, columns);
    }

    /// The loop shaders: every path that has ended pops its topmost entry, until each emits a ray or has none left.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn take_up<L: Lanes>(&mut self, l: L) {
        while !self.ended.is_empty() {
            self.pop();
            for number in 0..self.ready.len() {
                let Ready { paths, words } = std::mem::take(&mut self.ready[number]);
                let piece = &self.shader.loop_shaders()[number];
                let stride = stride(piece);
                for (paths, words) in paths.chunks(BLOCK).zip(words.chunks(BLOCK * stride)) {
                    self.go_on(l, piece, paths, words);
                }
            }
        }
    }

    /// Pops the topmost entries of the paths that have ended.
    fn pop(&mut self) {
        let mut entry = [0; LARGE];
        for path in std::mem::take(&mut self.ended) {
            let Ended { pixel, sample, came, .. } = path;
            let Some(head) = self.session.pop(path.head, &mut entry) else {
                // The camera ray's own result.
                let radiance = glam::Vec3::from_array(came.map(f32::from_bits));
                if radiance != glam::Vec3::ZERO {
                    self.frame.splat(None, self.frame.target_of(pixel, sample), radiance);
                }
                continue;
            };
            match (entry[0] & 0xff).checked_sub(1) {
                Some(number) => {
                    let ready = &mut self.ready[number as usize];
                    ready.paths.push(Ended { head, ..path });
                    let stride = stride(&self.shader.loop_shaders()[number as usize]);
                    ready.words.extend_from_slice(&entry[..stride]);
                }
                None => {
                    let mut own = [0; PAYLOAD];
                    own.copy_from_slice(&entry[HEADER + 8..][..PAYLOAD]);
                    let depth_and_cone = entry[1];
                    let ray = bytemuck::pod_read_unaligned(bytemuck::cast_slice(&entry[HEADER..HEADER + 8]));
                    self.emitted.rays.push(ray);
                    self.emitted.states.push(WgslState { own, pixel, sample, depth_and_cone, head });
                }
            }
        }
    }

    /// A loop shader for some paths.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn go_on<L: Lanes>(&mut self, l: L, piece: &'a Piece, paths: &[Ended], words: &[u32]) {
        let (frame, shader) = (self.frame, self.shader);
        let columns = take(piece);
        let stride = stride(piece);
        // A pushed entry counts its turns.
        let again = u32::from(words[0] & 0xff == shader.resume().map_or(0, |resume| resume + 1));
        let Points { pixel, sample, onward, head, turn } = &mut *self.points;
        for (point, (path, entry)) in paths.iter().zip(words.chunks(stride)).enumerate() {
            (pixel[point], sample[point], head[point]) = (path.pixel, path.sample, path.head);
            (onward[point], turn[point]) = (entry[1], (entry[0] >> 8) + again);
        }
        let (kept, truths) = (piece.words(), piece.truths());
        let bits = truths.div_ceil(32);
        for &(input, register) in piece.inputs() {
            let cells = piece.column(&columns, register);
            let input = input as usize;
            for (point, cell) in
                cells[..paths.len().next_multiple_of(crate::lanes::MAX_LANES)].iter().enumerate()
            {
                // Lanes that are left over repeat the first path and count for nothing.
                let point = if point < paths.len() { point } else { 0 };
                let entry = &words[point * stride..][..stride];
                cell.set(if input < kept {
                    entry[HEADER + bits + input]
                } else if input < kept + truths {
                    let truth = input - kept;
                    0u32.wrapping_sub(entry[HEADER + truth / 32] >> (truth % 32) & 1)
                } else {
                    paths[point].came[input - kept - truths]
                });
            }
        }
        let points = (&mut *self.points, paths.len());
        let out = (&mut self.session, &mut self.emitted);
        let mut block = Block::<L>::new((frame, shader), (piece, None), &[], points, out);
        piece.run(l, &columns, paths.len(), &mut block, shader);
        block.finish(&columns, &mut self.ended);
        put(piece, columns);
    }
}

/// Words of a loop shader's entries.
#[inline]
fn stride(piece: &Piece) -> usize {
    HEADER + piece.truths().div_ceil(32) + piece.words()
}
