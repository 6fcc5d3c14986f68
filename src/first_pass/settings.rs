//! What a user may choose about the first pass.

use crate::error::{Error, Result};

/// How the form factor between a sample point and an element is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Kernel {
    /// The paper's: cos cos δS / π r², centre to centre, capped at 1. Over-estimates near pairs.
    Paper,
    /// Exact from the point to the element's polygon where it subtends much, the paper's beyond.
    #[default]
    Analytic,
}

/// How the system of equation (7) is solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Solver {
    /// All points at once: GMRES, all wavelengths sharing each sweep.
    #[default]
    Iterative,
    /// Progressive shooting, the point with most unshot power first.
    Shooting,
}

/// Limits of the specular chains D(S...)D (the paper's lgmax and EFFMIN).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChainLimits {
    /// lgmax: most specular reflections or transmissions in a row; `None`: as many as `tolerance` asks.
    pub lg_max: Option<u32>,
    /// EFFMIN: a specular point passes nothing on when what the last bounce brought it is less than
    /// this share of the strongest irradiance that the chains started from.
    pub eff_min: f64,
    /// Chains end when the flux still in them is below this share of the flux that entered them.
    pub tolerance: f64,
}

impl Default for ChainLimits {
    fn default() -> Self {
        ChainLimits { lg_max: None, eff_min: 0.0, tolerance: 1e-4 }
    }
}

/// Settings of [`super::solve`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FirstPassSettings {
    /// The form factor.
    pub kernel: Kernel,
    /// Specular chains.
    pub chain: ChainLimits,
    /// The method.
    pub solver: Solver,
    /// Stop when the flux not yet absorbed is below this share of the flux emitted. What is left would
    /// be reflected 1 / (1 - ρ) times, as what was emitted is: of the flux in the scene it is the same share.
    pub tolerance: f64,
    /// Give up after this many sweeps over all pairs of points (N shots count as one sweep).
    pub max_sweeps: u32,
    /// Rough lobes are found from their values between a few directions, where no more than about this share of their
    /// height is lost by it in cells of directions (root mean square; of lobes wider than m = 0.4 some 0.04
    /// at least, near grazing angles); 0: between all pairs of directions.
    pub lobe_tolerance: f64,
    /// About so many bytes at most are kept of form factors, and as many of lobes, so that the next sweep, bounce or
    /// appearance need not find them again. What is not kept is found anew each time; the bits are the same.
    pub kept_bytes: u64,
    /// Whether to count what the paper's algorithm would have asked without a graph (takes time).
    pub count_visibility_calls: bool,
    /// Whether what is left over by the solutions of earlier appearances is all that is solved: in a fraction of the
    /// time, to the same tolerance, but not to the bit; and whether lobes are scaled from what they were scaled by at another
    /// roughness. The first solution takes a little longer for it: where there are up to
    /// four lamps and something specular, each lamp is solved for.
    pub recall: bool,
    /// Where more points than this are specular, what they reflect is spread evenly instead of along its way: see
    /// [`Evenly`](super::Evenly). No limit by default.
    pub most_specular: usize,
    /// Whether the solution keeps its parts apart ([`Parts`](super::Parts)): one sweep more.
    pub parts: bool,
}

impl Default for FirstPassSettings {
    fn default() -> Self {
        FirstPassSettings {
            kernel: Kernel::default(),
            chain: ChainLimits::default(),
            solver: Solver::default(),
            tolerance: 1e-4,
            max_sweeps: 2000,
            lobe_tolerance: 0.1,
            kept_bytes: 1 << 30,
            count_visibility_calls: false,
            parts: false,
            recall: false,
            most_specular: usize::MAX,
        }
    }
}

impl FirstPassSettings {
    /// Refuses what no run can use.
    pub fn validate(&self) -> Result<()> {
        let share = |name: &str, x: f64, least: f64| {
            if x >= least && x < 1.0 {
                Ok(())
            } else {
                Err(Error::Settings(format!("{name} is {x}: it must be at least {least} and less than 1")))
            }
        };
        // Radiances travel as f32: a residual below a few units in the last place is noise.
        share("the first pass's tolerance", self.tolerance, 1e-6)?;
        share("the chains' tolerance", self.chain.tolerance, 0.0)?;
        share("eff_min", self.chain.eff_min, 0.0)?;
        share("the tolerance of lobes", self.lobe_tolerance, 0.0)?;
        if self.max_sweeps == 0 {
            return Err(Error::Settings("max_sweeps must be at least 1".into()));
        }
        Ok(())
    }
}
