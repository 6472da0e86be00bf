//! A device that answers while its caller waits.

use super::{DeviceError, DeviceReport, DeviceStream, DeviceTracer, Queries, Resolve, Ticket};
use std::sync::Arc;
use std::time::Duration;

/// Answers the queries of a stream before it returns. [`Blocking`] makes a [`DeviceTracer`] of it.
pub trait BlockingTracer: Send + Sync {
    /// The device's name in reports.
    fn name(&self) -> &str;

    /// The largest number of rays, and of shadow rays, in one call of [`BlockingTracer::trace`].
    fn max_rays(&self) -> usize;

    /// Answers queries with the same bytes as a [`super::Tracer`].
    ///
    /// # Errors
    /// [`DeviceError::Lost`] if the device cannot answer, now or ever again.
    fn trace(&self, queries: Queries<'_>) -> Result<DeviceReport, DeviceError>;
}

/// A device tracer that traces a bundle while it is waited for.
#[derive(Debug)]
pub struct Blocking<T>(Arc<T>);

impl<T> Blocking<T> {
    /// The tracer, which other threads may call too.
    pub fn new(tracer: impl Into<Arc<T>>) -> Self {
        Self(tracer.into())
    }
}

impl<T: BlockingTracer + 'static> DeviceTracer for Blocking<T> {
    fn name(&self) -> &str {
        self.0.name()
    }

    fn submit(&self, bundle: Vec<DeviceStream>) -> Result<Box<dyn Ticket>, DeviceError> {
        Ok(Box::new(Untraced { tracer: Arc::clone(&self.0), bundle }))
    }
}

/// A bundle that is traced when it is waited for.
struct Untraced<T> {
    tracer: Arc<T>,
    bundle: Vec<DeviceStream>,
}

impl<T: BlockingTracer> Ticket for Untraced<T> {
    fn wait(&mut self, _: Duration) -> Result<Option<Vec<Box<dyn Resolve>>>, DeviceError> {
        let bundle = std::mem::take(&mut self.bundle);
        let traced = bundle.iter().map(|stream| trace_in_pieces(stream, &*self.tracer));
        let resolved = |report: DeviceReport| Box::new(Resolved(report)) as Box<dyn Resolve>;
        Ok(Some(traced.map(|report| report.map(resolved)).collect::<Result<_, _>>()?))
    }
}

fn trace_in_pieces(stream: &DeviceStream, tracer: &impl BlockingTracer) -> Result<DeviceReport, DeviceError> {
    let most = tracer.max_rays();
    if most == 0 {
        return Err(DeviceError::Lost("it takes no rays".to_owned()));
    }
    let (rays, shadow_rays) = (stream.rays(), stream.shadow_rays());
    let mut answers = stream.answers();
    let (hits, occluded) = answers.slices();
    let mut report = DeviceReport::default();
    for start in (0..rays.len().max(shadow_rays.len())).step_by(most) {
        let piece = |len: usize| start.min(len)..start.saturating_add(most).min(len);
        let (some, shadows) = (piece(rays.len()), piece(shadow_rays.len()));
        report += tracer.trace(Queries {
            rays: &rays[some.clone()],
            hits: &mut hits[some],
            shadow_rays: &shadow_rays[shadows.clone()],
            occluded: &mut occluded[shadows],
        })?;
    }
    Ok(report)
}

/// A stream that has its answers.
struct Resolved(DeviceReport);

impl Resolve for Resolved {
    fn resolve(self: Box<Self>, _: &DeviceStream) -> Result<DeviceReport, DeviceError> {
        Ok(self.0)
    }
}
