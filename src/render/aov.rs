//! AOVs (arbitrary output variables): the layers that a frame can have besides its picture.

use super::Frame;
use crate::film::{COVERAGE_ID_BITS, GuideSums, LayerPlan};
use crate::memory::OutOfMemory;
use crate::scene::Scene;
use std::fmt;
use std::str::FromStr;

/// Defines [`Aov`] from the table of its names.
macro_rules! aovs {
    ($($name:ident $text:literal $doc:literal;)*) => {
        /// A layer of a picture. `docs/guide/layers.md` says what each holds.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum Aov {
            $(#[doc = $doc] $name,)*
        }

        impl Aov {
            /// All AOVs.
            pub const ALL: &[Self] = &[$(Self::$name,)*];

            /// Its name on the command line and in files.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$name => $text,)*
                }
            }
        }
    };
}

aovs! {
    Depth "depth" "Distance to the first hit along the ray through the pixel's centre.";
    Z "z" "Distance of that hit along the view axis.";
    Normal "normal" "Unit normals of the triangles on the viewer's side, in world space, averaged over the hits.";
    ShadingNormal "shading-normal" "Unit shading normals (interpolated and mapped), averaged over the hits.";
    Position "position" "Positions in world space, averaged over the hits.";
    Albedo "albedo" "Base colour, averaged over all samples.";
    Uv "uv" "Texture coordinates of the mesh, averaged over the hits.";
    Emission "emission" "Radiance that the first surface emits, averaged over all samples.";
    Object "object" "The object that the ray through the pixel's centre hits.";
    Material "material" "The material that it hits.";
    Instance "instance" "The number of the object among those that show the same geometry.";
    Primitive "primitive" "The triangle that it hits.";
    Samples "samples" "Number of samples.";
    Variance "variance" "Estimated variance of the pixel's mean radiance.";
    CryptoObject "crypto-object" "How many samples show which object.";
    CryptoMaterial "crypto-material" "How many samples show which material.";
    CryptoAsset "crypto-asset" "How many samples show which asset: the topmost object above the one that is hit.";
    DenoisingAlbedo "denoising-albedo" "Base colour and light, seen through glass and in mirrors; a mean.";
    DenoisingNormal "denoising-normal" "Shading normal, seen through glass and in mirrors; a mean.";
    Noisy "noisy" "Radiance before noise was removed from the picture.";
}

/// Sums over the hits of samples, by the names of their channels in OpenEXR.
pub(super) const MEANS: &[(Aov, &[&str])] = &[
    (Aov::Normal, &["X", "Y", "Z"]),
    (Aov::ShadingNormal, &["X", "Y", "Z"]),
    (Aov::Position, &["X", "Y", "Z"]),
    (Aov::Albedo, &["R", "G", "B"]),
    (Aov::Uv, &["U", "V"]),
    (Aov::Emission, &["R", "G", "B"]),
    (Aov::DenoisingAlbedo, &["R", "G", "B"]),
    (Aov::DenoisingNormal, &["X", "Y", "Z"]),
];

/// Number of channels of the features that guide a denoiser, which are the last of [`MEANS`].
pub(super) const FEATURES: usize = 6;

/// AOVs that guide the filter of moving frames: normal, position, colour, emission.
const GUIDES: [Aov; 4] = [Aov::ShadingNormal, Aov::Position, Aov::Albedo, Aov::Emission];

/// AOVs that count samples by id.
pub(super) const COUNTS: &[Aov] = &[Aov::CryptoObject, Aov::CryptoMaterial, Aov::CryptoAsset];

/// Bits of the greatest magnitude of texture coordinates in a layer. Greater ones are clamped.
const UV_BITS: i32 = 16;

/// Bits of the greatest emitted radiance, as in the picture.
const RADIANCE_BITS: i32 = 20;

impl Aov {
    /// True if it comes from the ray through the pixel's centre and is never blended.
    pub const fn is_of_centre(self) -> bool {
        matches!(
            self,
            Self::Depth | Self::Z | Self::Object | Self::Material | Self::Instance | Self::Primitive
        )
    }

    /// True if it guides a denoiser. Films hold all such layers or none.
    pub const fn is_feature(self) -> bool {
        matches!(self, Self::DenoisingAlbedo | Self::DenoisingNormal)
    }

    /// Its bit in [`AovSet::bits`].
    #[inline]
    pub(super) const fn bit(self) -> u32 {
        1 << self as u32
    }

    /// Bits of the greatest magnitude of a mean's channel.
    pub(super) fn bound_bits(self, scene: &Scene) -> i32 {
        match self {
            Self::Position => {
                let bounds = scene.bounds();
                let most = bounds.min.abs().max(bounds.max.abs()).max_element();
                // Barycentric interpolation may round up.
                libm::ilogbf(most.max(f32::MIN_POSITIVE)) + 2
            }
            Self::Uv => UV_BITS,
            Self::Emission => RADIANCE_BITS,
            _ => 1,
        }
    }
}

impl fmt::Display for Aov {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The layers that a frame is asked for ([`super::Integrator::with_aovs`]), in the order of the files.
///
/// ```
/// use raystream::render::{Aov, AovSet};
///
/// let aovs: AovSet = "depth,normal".parse()?;
/// assert_eq!(aovs, AovSet::default().with(Aov::Depth).with(Aov::Normal));
/// let error = "depth,colour".parse::<AovSet>().unwrap_err();
/// assert!(error.to_string().starts_with("\"colour\" is no AOV; there are depth, z, normal, "));
/// # Ok::<(), raystream::render::UnknownAov>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AovSet {
    list: Vec<Aov>,
    transparent: bool,
    denoised: bool,
}

impl AovSet {
    pub(super) const NONE: Self = Self { list: Vec::new(), transparent: false, denoised: false };

    /// The same set with another AOV, if it is not in it.
    pub fn with(mut self, aov: Aov) -> Self {
        if !self.has(aov) {
            self.list.push(aov);
        }
        self
    }

    /// The layers that guide the filter of moving frames ([`super::Frame::develop_filtered`]).
    pub fn guides() -> Self {
        Self { list: GUIDES.to_vec(), ..Self::NONE }
    }

    /// The first sum of each layer of [`AovSet::guides`], if a film with these layers has them.
    pub(super) fn guide_sums(&self) -> Option<GuideSums> {
        let sum = |wanted: Aov| {
            let before =
                MEANS.iter().filter(|(aov, _)| self.holds(*aov)).take_while(|(aov, _)| *aov != wanted);
            self.holds(wanted).then(|| before.map(|(_, channels)| channels.len()).sum())
        };
        let [normal, position, colour, emission] = GUIDES.map(sum);
        Some(GuideSums { normal: normal?, position: position?, colour: colour?, emission: emission? })
    }

    /// The same set with alpha. The picture then lacks the radiance of the environment that camera rays see directly.
    /// Radiance is therefore premultiplied by alpha, as compositors expect. The environment still lights the scene and
    /// is seen in mirrors and through glass; glass is opaque in alpha.
    pub fn with_transparent(self, transparent: bool) -> Self {
        Self { transparent, ..self }
    }

    /// The same set with what the picture's denoiser needs: features and the halves of the samples. They are kept with
    /// the film and are no layers of the picture unless these are asked for.
    pub fn with_denoised(self, denoised: bool) -> Self {
        Self { denoised, ..self }
    }

    /// True if the picture is to be denoised.
    pub fn is_denoised(&self) -> bool {
        self.denoised
    }

    /// True if the film holds an AOV of [`MEANS`].
    pub(super) fn holds(&self, aov: Aov) -> bool {
        self.has(aov) || aov.is_feature() && self.has_features()
    }

    /// True if the film holds the features that guide a denoiser.
    pub(super) fn has_features(&self) -> bool {
        self.denoised || self.list.iter().any(|aov| aov.is_feature())
    }

    /// True if the film holds the halves of the samples.
    pub fn has_halves(&self) -> bool {
        self.denoised || self.has(Aov::Variance)
    }

    /// True if the set has an AOV.
    pub fn has(&self, aov: Aov) -> bool {
        self.list.contains(&aov)
    }

    /// One bit for each AOV of the set: see [`Aov::bit`].
    pub(super) fn bits(&self) -> u32 {
        self.iter().fold(0, |bits, aov| bits | aov.bit())
    }

    /// True if the set has alpha.
    pub fn is_transparent(&self) -> bool {
        self.transparent
    }

    /// True if nothing is asked for.
    pub fn is_empty(&self) -> bool {
        self.list.is_empty() && !self.transparent && !self.denoised
    }

    /// The AOVs, in their order.
    pub fn iter(&self) -> impl Iterator<Item = Aov> {
        self.list.iter().copied()
    }

    /// True if an AOV of the set comes from rays through the pixels' centres.
    pub(super) fn has_centres(&self) -> bool {
        self.iter().any(Aov::is_of_centre)
    }

    /// Layers that a film needs for these of a scene, with at most `samples` samples a pixel. [`LayerPlan::bytes`]
    /// gives its size.
    pub fn plan(&self, scene: &Scene, samples: u32) -> LayerPlan {
        let bits = |aov: Aov| LayerPlan::fraction_bits(aov.bound_bits(scene), samples);
        let ids = |aov| match aov {
            Aov::CryptoMaterial => scene.materials.len(),
            _ => scene.objects.len(),
        };
        self.plan_with(samples, bits, |aov| ids(aov) as u32)
    }

    /// The most bytes that these layers of any scene add to a film of this many pixels.
    pub fn most_bytes(&self, pixels: u64, samples: u32) -> u64 {
        self.plan_with(samples, |_| 0, |_| u32::MAX).bytes(pixels)
    }

    fn plan_with(&self, samples: u32, bits: impl Fn(Aov) -> i32, ids: impl Fn(Aov) -> u32) -> LayerPlan {
        let mut plan = LayerPlan { samples, halves: self.has_halves(), ..LayerPlan::default() };
        for (aov, channels) in MEANS.iter().filter(|(aov, _)| self.holds(*aov)) {
            plan.sums.extend(channels.iter().map(|_| bits(*aov)));
        }
        plan.hits = self.transparent || !plan.sums.is_empty();
        plan.centres = self.has_centres();
        plan.coverage.extend(COUNTS.iter().filter(|aov| self.has(**aov)).map(|aov| ids(*aov)));
        plan
    }

    /// Checks that these layers can be made from this many samples a pixel.
    ///
    /// # Errors
    /// [`AovError::Variance`] for variance of one sample, [`AovError::Denoised`] for a denoised picture of one.
    pub fn check_samples(&self, samples: u32) -> Result<(), AovError> {
        match samples {
            0..2 if self.denoised => Err(AovError::Denoised),
            0..2 if self.has(Aov::Variance) => Err(AovError::Variance),
            _ => Ok(()),
        }
    }

    /// Checks that a frame's layers can be made.
    pub(super) fn check(&self, frame: &Frame) -> Result<(), AovError> {
        self.check_samples(frame.settings().spp)?;
        let scene = frame.scene();
        let most = scene.objects.len().max(scene.materials.len());
        if COUNTS.iter().any(|aov| self.has(*aov)) && most > 1 << COVERAGE_ID_BITS {
            return Err(AovError::Ids(most));
        }
        Ok(())
    }
}

/// The names, separated by commas; `alpha` for [`AovSet::is_transparent`].
impl fmt::Display for AovSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let alpha = self.transparent.then_some("alpha");
        let names: Vec<&str> = self.iter().map(Aov::name).chain(alpha).collect();
        f.write_str(&names.join(","))
    }
}

/// A name that no AOV has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{0:?} is no AOV; there are {list}",
    list = Aov::ALL.iter().map(|aov| aov.name()).collect::<Vec<_>>().join(", ")
)]
pub struct UnknownAov(pub String);

impl FromStr for Aov {
    type Err = UnknownAov;

    fn from_str(name: &str) -> Result<Self, UnknownAov> {
        let found = Self::ALL.iter().find(|aov| aov.name() == name);
        found.copied().ok_or_else(|| UnknownAov(name.into()))
    }
}

impl FromStr for AovSet {
    type Err = UnknownAov;

    fn from_str(names: &str) -> Result<Self, UnknownAov> {
        let aovs = names.split(',').map(|name| name.trim().parse());
        aovs.collect::<Result<Vec<Aov>, _>>().map(|aovs| aovs.into_iter().fold(Self::default(), Self::with))
    }
}

/// Error of layers that a frame cannot have.
#[derive(Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AovError {
    /// The integrator does not tell which rays come from the camera.
    #[error("this integrator has no layers, because it does not tell which of its rays come from the camera")]
    NoFirstHits,
    /// Variance needs two samples.
    #[error(
        "the AOV variance compares the halves of a pixel's samples, so it needs at least 2 samples per pixel"
    )]
    Variance,
    /// A denoiser needs two samples.
    #[error("denoising compares the halves of a pixel's samples, so it needs at least 2 samples per pixel")]
    Denoised,
    /// Too many ids to count.
    #[error("{0} objects or materials; Cryptomatte layers can count at most {max}", max = 1 << COVERAGE_ID_BITS)]
    Ids(usize),
    /// There is too little memory for the film.
    #[error(transparent)]
    Memory(#[from] OutOfMemory),
}
