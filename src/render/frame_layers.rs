//! The layers that a frame is asked for, and the picture with them that its film gives.

#[cfg(feature = "formats")]
pub(super) mod layer_record;

use super::Frame;
use super::aov::{Aov, AovError, AovSet, COUNTS, FEATURES, MEANS};
use crate::film::{
    Coverage, DENOISER_VERSION, Film, GuidedPicture, Image, Layer, LayerValues, NoisyPicture, Oidn, Picture,
    Region, Viewpoint, power_of_two,
};
use crate::lanes::SimdLevel;
use crate::scene::{Lens, Objects, Scene};
use glam::Vec3;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// The layers of a frame.
#[derive(Debug)]
pub(super) struct FrameLayers {
    pub aovs: AovSet,
    /// [`AovSet::bits`].
    pub bits: u32,
    /// Conversions of the numbers of hits to integers, one for each sum.
    pub columns: Vec<Column>,
    /// The sums of the features that guide a denoiser, which are the last, if there are any.
    pub features: Option<usize>,
    /// The topmost object above each object.
    assets: Vec<u32>,
}

/// Conversion of numbers to integers.
#[derive(Clone, Copy, Debug)]
pub(super) struct Column {
    /// The greatest magnitude; greater ones are clamped.
    pub bound: f32,
    /// The factor from numbers to integers.
    pub scale: f64,
}

impl FrameLayers {
    /// The topmost object above an object.
    #[inline]
    pub fn asset(&self, object: u32) -> u32 {
        self.assets[object as usize]
    }
}

/// Makes pictures of a frame's films.
#[derive(Clone, Debug)]
pub(super) struct Developer {
    scene: Arc<Scene>,
    lens: Lens,
    /// The part of the film that pictures show.
    pub region: Region,
    layers: Option<Arc<FrameLayers>>,
}

/// Layers.
impl Frame {
    /// The same frame with these layers, and its own film.
    ///
    /// # Errors
    /// If a layer cannot be made, or the system does not give the film's memory.
    pub fn with_aovs(&self, aovs: &AovSet) -> Result<Self, AovError> {
        aovs.check(self)?;
        let plan = aovs.plan(self.scene(), self.settings().spp);
        let means = MEANS.iter().filter(|(aov, _)| aovs.holds(*aov));
        let bounds = means.flat_map(|(aov, channels)| channels.iter().map(|_| aov.bound_bits(self.scene())));
        let column = |(bound, &bits): (i32, &i32)| Column {
            bound: power_of_two(bound) as f32,
            scale: power_of_two(bits),
        };
        let columns: Vec<Column> = bounds.zip(&plan.sums).map(column).collect();
        let features = aovs.has_features().then(|| columns.len() - FEATURES);
        let film = self.film().with_layers(plan)?;
        let assets = if aovs.has(Aov::CryptoAsset) { assets(&self.scene().objects) } else { Vec::new() };
        let layers = FrameLayers { aovs: aovs.clone(), bits: aovs.bits(), columns, features, assets };
        Ok(self.with_layers((!aovs.is_empty()).then(|| Arc::new(layers)), film))
    }

    /// The layers that the frame is asked for.
    pub fn aovs(&self) -> &AovSet {
        const NONE: &AovSet = &AovSet::NONE;
        self.layers().map_or(NONE, |layers| &layers.aovs)
    }

    pub(super) fn developer(&self) -> Developer {
        let (scene, region) = (Arc::clone(self.lit_scene().scene()), self.part().region);
        Developer { scene, lens: *self.lens(), region, layers: self.layers().cloned() }
    }

    /// The picture of a film of this frame, or of its part, with the layers that it was asked for. See
    /// `docs/guide/layers.md`.
    ///
    /// ```
    /// use raystream::engine::{PreparedScene, Units};
    /// use raystream::film::LayerValues;
    /// use raystream::render::{Aov, AovSet, Integrator, Settings};
    /// use raystream::scene::{Camera, recipe::Recipe};
    /// use raystream::schedule::{JobOptions, Service, ServiceOptions};
    /// use std::sync::Arc;
    ///
    /// let text = r#"{ "environment": [1, 1, 1], "materials": { "grey": { "colour": [0.5, 0.5, 0.5] } },
    ///     "shapes": [ { "shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 8, "material": "grey" } ] }"#;
    /// let prepared = PreparedScene::new(Recipe::parse(text)?.build()?, &Units::cpu())?;
    /// let service = Service::new(ServiceOptions::default())?;
    /// let camera = Camera::framing(&prepared.scene.bounds(), 1.0);
    ///
    /// let aovs = AovSet::default().with(Aov::Depth).with(Aov::Normal).with_transparent(true);
    /// let path = prepared.path(&camera, Settings::new(32, 32).with_spp(4).with_max_bounces(2))?;
    /// let path = Arc::new(path.with_aovs(&aovs)?);
    /// prepared.submit(&service, path.clone(), JobOptions::default())?.wait()?;
    ///
    /// let picture = path.frame().develop(path.film());
    /// assert_eq!(picture.alpha.expect("asked for")[0], 0.0);
    /// let LayerValues::Floats { values, .. } = &picture.layers[0].values else { panic!("depths are numbers") };
    /// assert!(values[0].is_infinite() && values[16 * 32 + 16] > 1.0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Panics
    /// If the film is of another kind of frame.
    pub fn develop(&self, film: &Film) -> Picture {
        self.developer().develop(film)
    }

    /// [`Frame::develop`], and the picture denoised on `threads` threads if that was asked for
    /// ([`AovSet::with_denoised`]): by OIDN if it is given, else by raystream's own filter.
    ///
    /// # Panics
    /// If the film is of another kind of frame.
    pub fn develop_denoised(&self, film: &Film, threads: usize, oidn: Option<&Oidn>) -> Picture {
        self.developer().develop_denoised(film, self.simd(), threads, oidn)
    }

    /// The picture of a film of this frame, or of its part, after a filter of milliseconds that removes most noise of
    /// few samples, on `threads` threads. Without [`AovSet::guides`] the picture is as it is. It has no layers.
    ///
    /// # Panics
    /// If the film is of another kind of frame.
    pub fn develop_filtered(&self, film: &Film, threads: usize) -> Image {
        let (lens, region) = (self.lens(), self.part().region);
        let Some(sums) = self.aovs().guide_sums() else { return Image::of(film, region) };
        let middle = lens.ray(self.settings().width / 2, self.settings().height / 2, [0.5; 2]);
        let eye = middle.map_or(Vec3::ZERO, |(origin, _)| origin);
        let viewpoint = Viewpoint { eye, cone: lens.cone() };
        GuidedPicture::of(film, region, sums, viewpoint, threads).filtered(self.simd(), threads)
    }
}

impl Developer {
    pub fn develop_denoised(
        &self,
        film: &Film,
        simd: SimdLevel,
        threads: usize,
        oidn: Option<&Oidn>,
    ) -> Picture {
        let picture = self.develop(film);
        if !self.layers.as_ref().is_some_and(|layers| layers.aovs.is_denoised()) {
            return picture;
        }
        let noisy = NoisyPicture::of(film, self.region);
        let Some(oidn) = oidn else {
            return picture
                .with_denoised(noisy.denoise(simd, threads), format!("raystream {DENOISER_VERSION}"));
        };
        match oidn.denoise(&noisy, threads) {
            Ok(image) => picture.with_denoised(image, format!("oidn {}", oidn.version())),
            Err(error) => Picture { kept_noise: Some(error.to_string()), ..picture },
        }
    }

    pub fn develop(&self, film: &Film) -> Picture {
        let mut picture = Picture::new(Image::of(film, self.region));
        let Some(layers) = &self.layers else { return picture };
        let seen = Seen { developer: self, aovs: &layers.aovs, film };
        if layers.aovs.is_transparent() {
            let share = |pixel: usize| film.hits(pixel) as f32 / film.samples_of(pixel).max(1) as f32;
            picture.alpha = Some(seen.pixels().map(share).collect());
        }
        let layer = |aov: Aov| Layer { name: aov.name(), values: seen.values(aov) };
        picture.layers = layers.aovs.iter().map(layer).collect();
        picture
    }
}

/// A film being developed.
struct Seen<'a> {
    developer: &'a Developer,
    aovs: &'a AovSet,
    film: &'a Film,
}

impl Seen<'_> {
    /// The indices of the region's pixels.
    fn pixels(&self) -> impl Iterator<Item = usize> + use<> {
        let (region, width) = (self.developer.region, self.film.width() as usize);
        region.rows().flat_map(move |y| region.columns().map(move |x| y as usize * width + x as usize))
    }

    fn values(&self, aov: Aov) -> LayerValues {
        let film = self.film;
        let floats = |channels: &'static [&'static str], values| LayerValues::Floats { channels, values };
        let far = f32::INFINITY;
        match aov {
            _ if MEANS.iter().any(|mean| mean.0 == aov) => self.mean(aov),
            _ if COUNTS.contains(&aov) => self.coverage(aov),
            Aov::Depth => {
                floats(&["Z"], self.pixels().map(|i| film.centre(i).map_or(far, |hit| hit.t)).collect())
            }
            Aov::Z => {
                let z = |i| film.centre(i).map_or(far, |hit| hit.t * self.cosine(i));
                floats(&["Z"], self.pixels().map(z).collect())
            }
            Aov::Samples => floats(&["Y"], self.pixels().map(|i| film.samples_of(i) as f32).collect()),
            Aov::Noisy => {
                let image = Image::of(film, self.developer.region);
                floats(&["R", "G", "B"], image.pixels.into_flattened())
            }
            Aov::Variance => floats(&["R", "G", "B"], self.pixels().flat_map(|i| film.variance(i)).collect()),
            _ => self.ids(aov),
        }
    }

    /// Cosine between the view axis and the ray through a pixel's centre.
    fn cosine(&self, pixel: usize) -> f32 {
        let (lens, width) = (&self.developer.lens, self.film.width());
        let (x, y) = (pixel as u32 % width, pixel as u32 / width);
        lens.ray(x, y, [0.5; 2]).map_or(0.0, |(_, direction)| direction.dot(lens.axis()))
    }

    fn ids(&self, aov: Aov) -> LayerValues {
        let objects = &self.developer.scene.objects;
        let id = |pixel| {
            let hit = self.film.centre(pixel)?;
            match aov {
                Aov::Object => objects.of(hit.primitive),
                Aov::Material => Some(hit.material),
                Aov::Instance => objects.get(objects.of(hit.primitive)?)?.instance,
                _ => Some(hit.primitive),
            }
        };
        let ids = self.pixels().map(|pixel| id(pixel).unwrap_or(LayerValues::NO_ID)).collect();
        LayerValues::Ids { ids, names: self.names(aov) }
    }

    fn names(&self, aov: Aov) -> Vec<String> {
        let scene = &self.developer.scene;
        match aov {
            Aov::Object | Aov::CryptoObject | Aov::CryptoAsset => object_names(&scene.objects),
            Aov::Material | Aov::CryptoMaterial => {
                unique(scene.materials.iter().map(|material| material.name.clone()).collect(), "material")
            }
            _ => Vec::new(),
        }
    }

    fn coverage(&self, aov: Aov) -> LayerValues {
        let mut tables = COUNTS.iter().filter(|other| self.aovs.has(**other));
        let table = tables.position(|other| *other == aov).expect("the frame has the layer");
        let (all_starts, all) = self.film.coverage(table);
        let mut coverage = Coverage { names: self.names(aov), starts: vec![0], ..Coverage::default() };
        for pixel in self.pixels() {
            coverage.entries.extend(&all[all_starts[pixel] as usize..all_starts[pixel + 1] as usize]);
            coverage.starts.push(coverage.entries.len() as u32);
            coverage.samples.push(self.film.samples_of(pixel));
        }
        LayerValues::Coverage(coverage)
    }

    /// Means over hits, or over all samples if they are shares of the pixel's radiance.
    fn mean(&self, aov: Aov) -> LayerValues {
        let (mut entry, mut channels): (usize, &'static [&'static str]) = (0, &[]);
        for (other, names) in MEANS.iter().filter(|(other, _)| self.aovs.holds(*other)) {
            channels = names;
            if *other == aov {
                break;
            }
            entry += names.len();
        }
        let of_all = aov.is_feature() || matches!(aov, Aov::Albedo | Aov::Emission);
        let mut values = Vec::with_capacity(self.developer.region.area() as usize * channels.len());
        for pixel in self.pixels() {
            let count = if of_all { self.film.samples_of(pixel) } else { self.film.hits(pixel) };
            let sum = |channel| self.film.layer_sum(pixel, entry + channel) / f64::from(count.max(1));
            values.extend((0..channels.len()).map(|channel| sum(channel) as f32));
        }
        LayerValues::Floats { channels, values }
    }
}

/// The topmost object above each object.
fn assets(objects: &Objects) -> Vec<u32> {
    let topmost = |object| {
        let mut top = object;
        // No path is longer than the table, even if parents form a cycle.
        for _ in 0..objects.len() {
            match objects.get(top).and_then(|object| object.parent) {
                Some(parent) => top = parent,
                None => break,
            }
        }
        top
    };
    (0..objects.len() as u32).map(topmost).collect()
}

/// A name for each object that no other has: its own, or its path if others have the same name.
fn object_names(objects: &Objects) -> Vec<String> {
    let mut uses = BTreeMap::<&str, u32>::new();
    objects.iter().for_each(|object| *uses.entry(&object.name).or_default() += 1);
    let name = |(i, object): (u32, &crate::scene::Object)| match uses[&*object.name] {
        1 => object.name.clone(),
        _ => objects.path(i),
    };
    unique((0..).zip(objects.iter()).map(name).collect(), "object")
}

/// The names. One that repeats an earlier one gets a number; `what` stands for an empty name.
fn unique(mut names: Vec<String>, what: &str) -> Vec<String> {
    let (mut uses, mut taken) = (BTreeMap::<String, u32>::new(), BTreeSet::new());
    for name in &mut names {
        if name.is_empty() {
            what.clone_into(name);
        }
        let base = name.clone();
        let uses = uses.entry(base.clone()).or_default();
        *uses += 1;
        while !taken.insert(name.clone()) {
            *name = format!("{base}#{uses}");
            *uses += 1;
        }
    }
    names
}
