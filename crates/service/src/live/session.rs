//! How many views there may be, and how large.

use super::{LiveView, Request, ViewScene};
use raystream::render::Settings;
use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Limits of live views.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct LiveLimits {
    /// The most views at the same time.
    pub views: usize,
    /// The most pixels of a picture.
    pub pixels: u64,
    /// The longest side of a picture in pixels. JPEG has 65,535.
    pub side: u32,
    /// The most samples of a pixel.
    pub spp: u32,
    /// The most bounces.
    pub bounces: u32,
}

impl Default for LiveLimits {
    fn default() -> Self {
        Self { views: 8, pixels: 3840 * 2160, side: 8192, spp: 1 << 16, bounces: 64 }
    }
}

impl LiveLimits {
    /// Checks the numbers of a request.
    ///
    /// # Errors
    /// Which limit is exceeded.
    pub fn check(&self, request: &Request) -> Result<(), String> {
        let Self { pixels, side, spp: most_spp, bounces, .. } = *self;
        match *request {
            Request::Size { width, height, .. } => {
                let area = u64::from(width) * u64::from(height);
                let fits = width >= 1 && height >= 1 && width.max(height) <= side && area <= pixels;
                let told = || {
                    format!(
                        "a live picture of {width}x{height} pixels; at most {pixels} pixels, each side 1 to {side}"
                    )
                };
                if fits { Ok(()) } else { Err(told()) }
            }
            Request::Quality { spp, max_bounces, .. } => {
                let fits = (1..=most_spp.min(Settings::MAX_SPP)).contains(&spp) && max_bounces <= bounces;
                let told =
                    || format!("{spp} samples, {max_bounces} bounces; at most {most_spp} and {bounces}");
                if fits { Ok(()) } else { Err(told()) }
            }
            _ => Ok(()),
        }
    }
}

/// There are as many views as are allowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0} live views are open, which is the limit; close one")]
pub struct TooManyViews(pub usize);

/// The views of a service.
#[derive(Debug, Default)]
pub struct LiveViews {
    limits: LiveLimits,
    open: AtomicUsize,
}

/// A view that counts.
#[derive(Debug)]
pub struct CountedView {
    view: Option<LiveView>,
    views: Arc<LiveViews>,
}

impl LiveViews {
    /// No views, with these limits.
    pub fn new(limits: LiveLimits) -> Self {
        Self { limits, open: AtomicUsize::new(0) }
    }

    /// The limits.
    pub fn limits(&self) -> &LiveLimits {
        &self.limits
    }

    /// Opens a view.
    ///
    /// # Errors
    /// If there are too many ([`TooManyViews`] as the error's source), or the system gives no thread.
    pub fn open(
        self: &Arc<Self>,
        view_scene: ViewScene,
        wake: impl Fn() + Send + Sync + 'static,
    ) -> io::Result<CountedView> {
        let mut counted = self.enter().map_err(io::Error::other)?;
        counted.view = Some(LiveView::new(view_scene, wake)?);
        Ok(counted)
    }

    /// Takes the place of a view that is to be opened, until the value is dropped.
    ///
    /// # Errors
    /// If there are too many.
    pub fn enter(self: &Arc<Self>) -> Result<CountedView, TooManyViews> {
        let most = self.limits.views;
        let counted = self
            .open
            .try_update(Ordering::Relaxed, Ordering::Relaxed, |open| (open < most).then_some(open + 1));
        counted.map_err(|_| TooManyViews(most))?;
        Ok(CountedView { view: None, views: Arc::clone(self) })
    }
}

impl std::ops::Deref for CountedView {
    type Target = LiveView;

    fn deref(&self) -> &LiveView {
        self.view.as_ref().expect("a counted view has a view until it is dropped")
    }
}

impl Drop for CountedView {
    fn drop(&mut self) {
        drop(self.view.take());
        self.views.open.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_beyond_the_limits_are_refused() {
        let limits = LiveLimits::default();
        let size = |width, height| limits.check(&Request::Size { generation: 1, width, height });
        assert!(size(1280, 720).is_ok() && size(3840, 2160).is_ok());
        for (width, height) in [(0, 720), (1280, 0), (8193, 1), (8192, 8192), (u32::MAX, u32::MAX)] {
            assert!(size(width, height).is_err(), "{width}x{height}");
        }
        let quality = |spp, max_bounces| limits.check(&Request::Quality { generation: 1, spp, max_bounces });
        assert!(quality(256, 8).is_ok());
        assert!(quality(0, 8).is_err() && quality(1 << 17, 8).is_err() && quality(1, 65).is_err());
    }
}
