//! Intel Embree, where it is built in (feature `embree`): the default tracer.
//!
//! Callers see the same [`EmbreeTracer`] and [`available`] in every build; without the feature the
//! tracer cannot be made and says how to get it.

#[cfg(feature = "embree")]
mod decide;
#[cfg(feature = "embree")]
mod enabled;
#[cfg(feature = "embree")]
mod face;
#[cfg(feature = "embree")]
mod packet;
#[cfg(feature = "embree")]
mod query;
#[cfg(feature = "embree")]
#[allow(unsafe_code)]
mod raw;
#[cfg(feature = "embree")]
use enabled as implementation;

#[cfg(not(feature = "embree"))]
mod disabled;
#[cfg(not(feature = "embree"))]
use disabled as implementation;

pub use implementation::{BareLoop, EmbreeTracer, available};
