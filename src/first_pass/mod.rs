//! The first pass (section 3.3): the global diffuse radiance of every sample point.
//!
//! Diffuse light goes from point to point by form factors ([`form_factor`], [`diffuse`]); specular
//! points pass radiance on in chains ([`specular`], [`chain`]); both together are the extended form
//! factors of equation (7), which [`system`] solves without ever storing them. Where a scene has links in place of a
//! graph, diffuse light goes from clusters to points ([`linked`]).

mod balance;
mod bounce;
mod cells;
pub mod chain;
mod corrections;
pub mod diffuse;
pub mod directions;
mod evenly;
mod exchange;
pub mod flow;
pub mod form_factor;
mod gmres;
pub mod ideal;
mod iterative;
mod known;
mod layout;
pub mod lights;
pub mod linked;
mod linked_solve;
pub mod lobe;
pub mod lobe_table;
mod lobes;
pub mod member;
pub mod near;
mod nodes;
mod normalise;
mod openings;
mod pair_kernel;
mod recalled;
pub mod reference;
mod relighter;
mod response;
mod rooms;
pub(crate) mod round;
pub mod rows;
mod scaling;
mod scatter;
mod schedule;
mod settings;
mod shooting;
mod sky;
mod span;
pub mod specular;
pub mod specular_material;
mod stats;
pub mod system;
pub mod visibility_calls;

pub use evenly::{Evenly, specular_points};
pub use linked_solve::LinkedRelighter;
pub use relighter::Relighter;
pub use response::Response;
pub use settings::{ChainLimits, FirstPassSettings, Kernel, Solver};
pub use stats::{FirstPassStats, FluxBalance, Range};

use crate::error::{Error, Result};
use crate::geometry::SurfaceId;
use crate::material::{FresnelTable, SampledMaterial, Transmission};
use crate::observer::Observer;
use crate::points::SamplePoints;
use crate::scene::{Geometry, SampledAppearance, SampledSky};
use crate::spectrum::{LUMENS_PER_WATT, Wavelengths};
use crate::visibility::VisibilityGraph;

/// Steps of the solution as progress is told.
const STEPS: u64 = 100;

/// L^d of every sample point.
#[derive(Clone, Debug)]
pub struct DiffuseSolution {
    /// What the radiances are sampled at.
    pub wavelengths: Wavelengths,
    /// L^d_i, the emitted radiance included, W m⁻² sr⁻¹ nm⁻¹: `[N][W]`.
    pub radiance: Vec<f32>,
    /// What it is made of, where that was asked for.
    pub parts: Option<Parts>,
    /// How it was found.
    pub stats: FirstPassStats,
}

/// Parts of the diffuse radiance, W m⁻² sr⁻¹ nm⁻¹: `[N][W]` each. What is left is reflected light of diffuse surfaces.
#[derive(Clone, Debug, PartialEq)]
pub struct Parts {
    /// What is emitted.
    pub emission: Vec<f32>,
    /// Reflected of light straight from emitting surfaces and lights without a body, that of directional ones through
    /// panes included.
    pub direct: Vec<f32>,
    /// Reflected of light that came over mirrors, gloss or glass, or from the sky.
    pub specular: Vec<f32>,
}

impl DiffuseSolution {
    /// Luminance of what is interpolated between `points`, cd m⁻²: of reflected light, and where the parts were kept
    /// apart, of that without what comes straight from lamps.
    pub fn interpolated_luminance(&self, appearance: &SampledAppearance, points: &SamplePoints) -> Vec<f64> {
        let w = self.wavelengths.len();
        let of = |(i, &surface): (usize, &SurfaceId)| {
            let emission = &appearance.of(surface).emission;
            let direct = self.parts.as_ref().map(|parts| &parts.direct[i * w..][..w]);
            let weights = self.wavelengths.xyz_weights.iter().enumerate();
            let sum = weights.map(|(k, xyz)| {
                let direct = direct.map_or(0.0, |direct| direct[k]);
                xyz[1] * f64::from(self.radiance[i * w + k] - emission[k] - direct)
            });
            LUMENS_PER_WATT * sum.sum::<f64>()
        };
        points.surface.iter().enumerate().map(of).collect()
    }

    /// L^d of point `i`, `[W]`.
    pub fn of(&self, i: usize) -> &[f32] {
        let w = self.wavelengths.len();
        &self.radiance[i * w..(i + 1) * w]
    }
}

/// A scene that can be lit under one appearance after another.
pub trait FirstPass {
    /// Solves for the global diffuse radiance under `appearance`. No ray is cast.
    ///
    /// # Errors
    /// [`Error::Settings`] when the appearance does not belong to the scene; [`Error::Numerical`] when the
    /// tolerance is not reached or the light grows without end.
    fn light(&mut self, appearance: &SampledAppearance, observer: &dyn Observer) -> Result<DiffuseSolution>;
}

impl FirstPass for Relighter<'_> {
    fn light(&mut self, appearance: &SampledAppearance, observer: &dyn Observer) -> Result<DiffuseSolution> {
        Relighter::light(self, appearance, observer)
    }
}

impl FirstPass for LinkedRelighter<'_> {
    fn light(&mut self, appearance: &SampledAppearance, observer: &dyn Observer) -> Result<DiffuseSolution> {
        LinkedRelighter::light(self, appearance, observer)
    }
}

/// Solves for the global diffuse radiance of all sample points. No ray is cast, so a new appearance
/// under the same graph costs this call and nothing else; a [`Relighter`] makes it cheaper still.
///
/// # Errors
/// [`Error::Settings`] when graph, points and appearance do not belong together or a setting cannot
/// be used; [`Error::Numerical`] when the tolerance is not reached or the light grows without end.
pub fn solve(
    geometry: &Geometry,
    points: &SamplePoints,
    graph: &VisibilityGraph,
    appearance: &SampledAppearance,
    settings: &FirstPassSettings,
    observer: &dyn Observer,
) -> Result<DiffuseSolution> {
    Relighter::new(geometry, points, graph, settings, observer)?.light(appearance, observer)
}

/// Tells `observer` how far a residual has come down, given how many times its goal it is: equal steps
/// are equal factors, for that is how residuals fall.
fn descent(observer: &dyn Observer) -> impl FnMut(f64) + '_ {
    let (mut first, mut done) = (None, 0);
    move |excess: f64| {
        let first: f64 = *first.get_or_insert(excess.max(1.0));
        let share = if first > 1.0 { 1.0 - excess.max(1.0).ln() / first.ln() } else { 1.0 };
        let steps = (STEPS as f64 * share) as u64;
        observer.advance(steps.saturating_sub(done));
        done = done.max(steps);
    }
}

/// Whether an appearance belongs to a scene, of which it must be known what the point lights reach, and holds nothing
/// that is not a number.
fn check_appearance(geometry: &Geometry, knows_lights: bool, appearance: &SampledAppearance) -> Result<()> {
    let refuse = |message: &str| Err(Error::Settings(message.into()));
    if appearance.surface_material.len() != geometry.surfaces.len() {
        return refuse("the appearance does not name a material for every surface of the geometry");
    }
    let w = appearance.wavelengths.len();
    let known = |id: &crate::scene::MaterialId| (id.0 as usize) < appearance.materials.len();
    if !appearance.surface_material.iter().all(known) {
        return refuse("a surface wears a material that the appearance does not have");
    }
    if w == 0 {
        return refuse("a run needs at least one wavelength");
    }
    if !knows_lights {
        return refuse("it is not known what the lights and the sky reach: let the graph look at them");
    }
    let sane = |l: &Vec<f32>| l.len() == w && l.iter().all(|i| (0.0..=f32::MAX).contains(i));
    if appearance.lights.len() != geometry.lights.len() || !appearance.lights.iter().all(sane) {
        return refuse("the appearance does not say what each light gives at every wavelength");
    }
    let sound = |sky: &SampledSky| sane(&sky.zenith) && sane(&sky.ground);
    if appearance.sky.is_some() != geometry.zenith.is_some() || !appearance.sky.iter().all(sound) {
        return refuse("the appearance does not say what the sky gives at every wavelength");
    }
    appearance.materials.iter().try_for_each(|m| check_material(m, w))
}

/// Whether a material is sampled at `w` wavelengths and creates no light.
fn check_material(material: &SampledMaterial, w: usize) -> Result<()> {
    let mut tables = vec![&material.reflect];
    let mut sampled = vec![(&material.emission, f32::MAX), (&material.diffuse, 1.0)];
    match &material.transmission {
        None => {}
        Some(Transmission::Pane { transmit }) => tables.push(transmit),
        Some(Transmission::Solid { n, inside, absorption }) => {
            tables.push(inside);
            sampled.push((absorption, f32::MAX));
            if !(1.0..100.0).contains(n) {
                return Err(Error::Settings(format!(
                    "a solid's refractive index is {n}: it must be 1 or more"
                )));
            }
        }
    }
    if let Some(spread) = &material.spread {
        sampled.extend([&spread.inwards, &spread.outwards, &spread.inside].map(|share| (share, 1.0)));
    }
    // Interpolated tables may stand a rounding above 1.
    let sane = |v: &[f32], most: f32| v.iter().all(|&x| (0.0..=most).contains(&x));
    let table = |t: &&FresnelTable| {
        t.wavelengths == w
            && t.values.len() >= 2 * w
            && t.values.len().is_multiple_of(w)
            && sane(&t.values, 1.0001)
    };
    if !sampled.iter().all(|(v, _)| v.len() == w) || material.is_specular() && !tables.iter().all(table) {
        return Err(Error::Settings("a material is not sampled at the wavelengths of the run".into()));
    }
    if !sampled.iter().all(|(v, most)| sane(v, *most))
        || !(0.0..=1.0).contains(&material.s)
        || !(0.0..=10.0).contains(&material.m)
    {
        return Err(Error::Settings("a material emits, reflects or scatters what no material can".into()));
    }
    Ok(())
}

/// More flux than this times what is emitted says more of rounding than of the scene: an error of 1e-6 in
/// the form factors, which `f32` sums may have, is then a tenth of the answer.
const MOST_GAIN: f64 = 1e5;

/// A system that gains energy has a solution, but not a positive one (Perron and Frobenius), and one that
/// neither gains nor loses any has none: refuses both. Negative radiance within the tolerance is rounding
/// and becomes 0.
fn refuse_endless(
    radiance: &mut [f32],
    emitted: &[f64],
    flux: impl Fn(&[f32]) -> Vec<f64>,
    settings: &FirstPassSettings,
) -> Result<()> {
    let n = radiance.len() / emitted.len().max(1);
    let negative: Vec<f32> = radiance.iter().map(|l| l.min(0.0)).collect();
    let whole = flux(radiance);
    for (k, negative) in flux(&negative).into_iter().enumerate() {
        let rounding = (10.0 * settings.tolerance).min(0.1) * emitted[k].max(whole[k]);
        let endless = whole[k] > MOST_GAIN * emitted[k];
        if !whole[k].is_finite() || endless || negative > rounding {
            return Err(shooting::diverged());
        }
        radiance[k * n..(k + 1) * n].iter_mut().for_each(|l| *l = l.max(0.0));
    }
    Ok(())
}
