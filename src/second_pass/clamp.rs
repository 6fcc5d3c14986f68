//! A limit to light that only chance finds.
//!
//! Lamps are asked for what a rough lobe reflects of them, but not over mirrors or through glass: there a ray of the
//! lobe has to go the whole way by chance, and where the lamp is small few do, each with very much. Their mean is
//! right, and the image has specks. So one ray may bring a pixel no more than a share of what surfaces reflect in the
//! mean. The more samples a pixel takes the less is left out; how much is counted.

use super::LitScene;
use super::settings::SecondPassSettings;

/// How bright a ray that comes so may be to a pixel sample. `bright` tells how bright a spectrum is. Without end where
/// surfaces reflect nothing diffusely.
pub(super) fn limit(scene: &LitScene, settings: &SecondPassSettings, bright: impl Fn(&[f32]) -> f64) -> f32 {
    let w = scene.solution.wavelengths.len();
    let (mut sum, mut area) = (0.0, 0.0);
    for (element, radiance) in scene.solution.radiance.chunks_exact(w.max(1)).enumerate() {
        let surface = scene.interpolator.surface(element);
        let size = scene.interpolator.spacing(surface).powi(2);
        sum += size * (bright(radiance) - bright(&scene.appearance.of(surface).emission)).max(0.0);
        area += size;
    }
    let samples = settings.noise.map_or(settings.samples, |noise| noise.most_samples);
    if sum > 0.0 { (settings.clamp * f64::from(samples) * sum / area) as f32 } else { f32::INFINITY }
}
