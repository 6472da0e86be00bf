//! Effects that a procedural surface computes beside the reflection of light.

/// Effects that a [`super::Procedural`] computes beside colour, metal, roughness and clear coat. Others cost nothing.
/// Values of [`super::Finish`] that are computed without being declared here fail the job with a message.
///
/// ```
/// use raystream::scene::Effects;
///
/// let lava = Effects::default().emission(40.0);
/// let leaf = Effects::default().opacity().thin_transmission();
/// # let _ = (lava, leaf);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct Effects {
    /// The greatest radiance of any channel that the surface emits. 0 if it emits nothing.
    pub emission_bound: f32,
    /// True if opacity is computed. Otherwise the surface is opaque.
    pub has_opacity: bool,
    /// True if normals are computed. Otherwise they are the mesh's or the normal map's.
    pub has_normals: bool,
    /// Transmission of light. `None` if there is none.
    pub transmission: Option<Transmission>,
    /// True if the roughness may differ by direction. Otherwise it is the same along all directions.
    pub has_anisotropy: bool,
    /// True if there may be sheen.
    pub has_sheen: bool,
    /// True if there may be a thin film.
    pub has_film: bool,
    /// True if light may be transmitted diffusely.
    pub has_diffuse_transmission: bool,
}

/// Way in which a surface transmits light.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Transmission {
    /// A thin wall, through which light passes without refraction.
    ThinWall,
    /// The boundary of a closed body, which refracts.
    Body {
        /// Index of refraction of the inside, ≥ 1.
        ior: f32,
    },
}

impl Effects {
    /// The surface emits light, in each channel at most `bound`. Paths keep looking for such surfaces after their last
    /// bounce. More is clamped.
    ///
    /// # Panics
    /// If the bound is not a finite number above 0.
    pub fn emission(self, bound: f32) -> Self {
        assert!(
            bound > 0.0 && bound.is_finite(),
            "the bound of emission is {bound}; it must be finite and above 0"
        );
        Self { emission_bound: bound, ..self }
    }

    /// The surface computes opacity.
    pub fn opacity(self) -> Self {
        Self { has_opacity: true, ..self }
    }

    /// The surface computes normals.
    pub fn normals(self) -> Self {
        Self { has_normals: true, ..self }
    }

    /// The surface transmits light as a thin wall.
    pub fn thin_transmission(self) -> Self {
        Self { transmission: Some(Transmission::ThinWall), ..self }
    }

    /// The surface bounds a closed body, which refracts light.
    ///
    /// # Panics
    /// If the index of refraction is not a finite number of at least 1.
    pub fn body_transmission(self, ior: f32) -> Self {
        assert!(
            ior >= 1.0 && ior.is_finite(),
            "the index of refraction is {ior}; it must be finite and at least 1"
        );
        Self { transmission: Some(Transmission::Body { ior }), ..self }
    }

    /// The surface computes anisotropy.
    pub fn anisotropy(self) -> Self {
        Self { has_anisotropy: true, ..self }
    }

    /// The surface computes sheen.
    pub fn sheen(self) -> Self {
        Self { has_sheen: true, ..self }
    }

    /// The surface computes a thin film.
    pub fn film(self) -> Self {
        Self { has_film: true, ..self }
    }

    /// The surface computes diffuse transmission.
    pub fn diffuse_transmission(self) -> Self {
        Self { has_diffuse_transmission: true, ..self }
    }

    /// True if the surface emits light.
    #[inline]
    pub fn emits(&self) -> bool {
        self.emission_bound > 0.0
    }

    /// True if the finish must be known before the surface scatters light.
    #[inline]
    pub(crate) fn act_before_scattering(&self) -> bool {
        self.emits() || self.has_opacity || self.has_normals || self.has_anisotropy
    }
}
