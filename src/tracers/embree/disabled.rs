//! The stand-in of a build without Embree: same signatures, a clear error.

use crate::error::{Error, Result};
use crate::geometry::{Hit, Ray, SurfaceId};
use crate::scene::Geometry;
use crate::tracers::{RayTracer, Segment};
use glam::Vec3;
use std::convert::Infallible;
use std::marker::PhantomData;

/// The version of Embree that is loaded: none in this build.
pub fn available() -> Option<String> {
    None
}

/// A tracer that cannot exist in this build.
pub struct EmbreeTracer(Infallible);

impl EmbreeTracer {
    /// Fails and says how to build Embree in.
    ///
    /// # Errors
    /// Always [`Error::Tracer`].
    pub fn new(_geometry: &Geometry) -> Result<Self> {
        Err(Error::Tracer(
            "Embree is not in this build: build with `--features embree` (Debian and Ubuntu: apt install \
             libembree-dev libclang-dev) or choose the voxel tracer"
                .into(),
        ))
    }

    /// Fails as [`EmbreeTracer::new`] does.
    ///
    /// # Errors
    /// Always [`Error::Tracer`].
    pub fn bare(geometry: &Geometry) -> Result<Self> {
        Self::new(geometry)
    }

    /// Counts free segments: never called.
    pub fn count_free<'p>(&self, _fans: impl IntoIterator<Item = (Vec3, &'p [Vec3])>) -> u64 {
        match self.0 {}
    }

    /// Rays made ready for a bare loop: never, in this build.
    pub fn bare_loop(&self, _rays: &[Ray]) -> BareLoop<'_> {
        match self.0 {}
    }
}

/// See [`EmbreeTracer::bare_loop`].
pub struct BareLoop<'a>(Infallible, PhantomData<&'a ()>);

impl BareLoop<'_> {
    /// Traces all rays.
    pub fn run(&mut self) -> usize {
        match self.0 {}
    }

    /// Traces all rays on this thread.
    pub fn run_here(&mut self) -> usize {
        match self.0 {}
    }
}

impl RayTracer for EmbreeTracer {
    fn name(&self) -> String {
        match self.0 {}
    }

    fn closest(&self, _ray: &Ray) -> Option<Hit> {
        match self.0 {}
    }

    fn blocker(&self, _segment: &Segment) -> Option<SurfaceId> {
        match self.0 {}
    }
}
