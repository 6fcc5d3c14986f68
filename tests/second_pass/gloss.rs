//! Do rough surfaces show lamps as their lobes say, with little noise, and lights without a body too?

use crate::folder::Folder;
use crate::lit::Lit;
use glam::DVec3;
use luxgraph::geometry::SurfaceId;
use luxgraph::material::SampledMaterial;
use luxgraph::material::microfacet::rs_over_f;
use luxgraph::observer::Silent;
use luxgraph::pipeline;
use luxgraph::scene::load;
use luxgraph::second_pass::{Passes, Rung, SecondPassStats, SpectralImage};
use luxgraph::settings::Settings;
use luxgraph::spectrum::Wavelengths;

/// A metal floor of 4 x 4 m seen obliquely, and nothing else but what is given.
fn room(m: f64, rest: &str) -> Lit {
    let toml = format!(
        r#"format = 1
[sampling]
max_area = 0.5
[materials.metal]
specular = 0.6
reflectance = 0.0
roughness = {m}
fresnel = {{ normal = 0.7 }}
[materials.lamp]
reflectance = 0.0
emission = {{ spectrum = 1.0, radiance = 10.0 }}
[[cameras]]
name = "main"
position = [0.2, -1.8, 1.1]
target = [0.1, 0.2, 0]
fov_deg = 30
resolution = [24, 18]
[[objects]]
name = "floor"
material = "metal"
quads = [[[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0]]]
{rest}"#
    );
    let folder = Folder::new();
    let scene = load(&folder.write("scene.toml", &toml)).unwrap_or_else(|error| panic!("{error}"));
    let mut settings = Settings { wavelengths: Wavelengths::meyer4(), ..Settings::default() };
    settings.second_pass.passes = Passes::Both;
    settings.first_pass.parts = true;
    Lit::new(scene, settings)
}

fn view(lit: &Lit, rung: Rung, samples: u32, seed: u32) -> SpectralImage {
    clamped_view(lit, rung, f64::INFINITY, (samples, seed)).0
}

fn clamped_view(
    lit: &Lit,
    rung: Rung,
    clamp: f64,
    (samples, seed): (u32, u32),
) -> (SpectralImage, SecondPassStats) {
    let mut settings = lit.settings.second_pass;
    (settings.rung, settings.clamp, settings.samples, settings.seed) = (rung, clamp, samples, seed);
    let (geometry, camera) = (&lit.scene.geometry, &lit.scene.cameras[0]);
    let tracer = lit.tracer();
    pipeline::view(geometry, &lit.prepared, &lit.light, camera, tracer.as_ref(), &settings, &Silent)
        .expect("a view")
}

/// What the floor sends from `place` towards the camera of the light of a source of `irradiance` on a plane that faces it.
fn reflected(metal: &SampledMaterial, eye: DVec3, place: DVec3, from: DVec3, irradiance: f64) -> f64 {
    let (i, r) = ((eye - place).normalize(), (from - place).normalize());
    let h = (i + r).normalize();
    let mut fresnel = vec![0.0; 4];
    metal.reflect.eval(i.dot(h) as f32, &mut fresnel);
    metal.s * f64::from(fresnel[0]) * rs_over_f(i.z, r.z, h.z, i.dot(h), metal.m) * r.z * irradiance
}

/// The mean of what is `sent` over the places of the floor that a pixel shows, of which so many are taken each way.
fn over_pixel(lit: &Lit, (x, y): (u32, u32), n: usize, sent: impl Fn(DVec3) -> f64) -> f64 {
    let at = |k: usize| {
        let inside = |k: usize| (k as f64 + 0.5) / n as f64;
        let (x, y) = (f64::from(x) + inside(k % n), f64::from(y) + inside(k / n));
        let ray = lit.scene.cameras[0].ray(x, y, DVec3::ZERO);
        sent(ray.origin - ray.origin.z / ray.direction.z * ray.direction)
    };
    (0..n * n).map(at).sum::<f64>() / (n * n) as f64
}

/// How far an image is from `expected`, as a share of it, both as the root mean square.
fn off(image: &SpectralImage, expected: &[f64]) -> f64 {
    let first = image.radiance.chunks_exact(image.wavelengths.len()).map(|l| f64::from(l[0]));
    let sum: f64 = first.zip(expected).map(|(l, e)| (l - e) * (l - e)).sum();
    (sum / expected.iter().map(|e| e * e).sum::<f64>()).sqrt()
}

/// A lamp of 20 x 20 cm, 1 m above the floor, and the truth by a dense sum over it: on every rung, for lobes that show
/// it small and large, 16 samples a pixel come near, and what is left is noise.
#[test]
fn a_lamp_in_a_rough_lobe_is_neither_noisy_nor_counted_twice() {
    let lamp = r#"[[objects]]
name = "lamp"
material = "lamp"
quads = [[[-0.1, 0.9, 1], [-0.1, 1.1, 1], [0.1, 1.1, 1], [0.1, 0.9, 1]]]
"#;
    for (m, noise) in [(0.1, 0.09), (0.2, 0.05), (0.5, 0.03)] {
        let lit = room(m, lamp);
        let metal = lit.light.0.of(SurfaceId(0));
        assert!(metal.is_specular() && metal.m == m);
        let eye = lit.scene.cameras[0].position;
        let cells = 16;
        let truth = |place: DVec3| -> f64 {
            let cell = |k: usize, low: f64| low + 0.2 * (k as f64 + 0.5) / cells as f64;
            (0..cells * cells)
                .map(|k| {
                    let on = DVec3::new(cell(k % cells, -0.1), cell(k / cells, 0.9), 1.0);
                    let way = on - place;
                    let seen = 0.04 / (cells * cells) as f64 * way.normalize().z / way.length_squared();
                    reflected(metal, eye, place, on, 10.0 * seen)
                })
                .sum()
        };
        let [width, height] = lit.scene.cameras[0].resolution;
        let pixels = (0..width * height).map(|k| (k % width, k / width));
        let expected: Vec<f64> = pixels.map(|pixel| over_pixel(&lit, pixel, 4, truth)).collect();
        for rung in [Rung::Interpolate, Rung::Direct] {
            let few = off(&view(&lit, rung, 16, 1), &expected);
            let many = view(&lit, rung, 1024, 2);
            let bias = many.radiance.chunks_exact(4).map(|l| f64::from(l[0])).sum::<f64>()
                / expected.iter().sum::<f64>();
            println!("m {m} {rung:?}: {few:.4}, with 1024 {:.4}, sum {bias:.5}", off(&many, &expected));
            assert!(few < noise, "m {m} {rung:?}: {few}");
            assert!((bias - 1.0).abs() < 3e-3, "m {m} {rung:?}: {bias}");
        }
    }
}

/// A point light shows a highlight: R^s cos θ I / d².
#[test]
fn a_light_without_a_body_has_its_highlight() {
    let lit = room(
        0.3,
        "[[lights]]\nname = \"bulb\"\nposition = [0, 0.8, 1]\nspectrum = 1.0\nluminous_intensity = 5000\n",
    );
    let metal = lit.light.0.of(SurfaceId(0));
    let (eye, bulb) = (lit.scene.cameras[0].position, DVec3::new(0.0, 0.8, 1.0));
    let image = view(&lit, Rung::Interpolate, 64, 3);
    let intensity = f64::from(lit.light.0.lights[0][0]);
    let sent = |place| reflected(metal, eye, place, bulb, intensity / (bulb - place).length_squared());
    let pixels = (0..image.width * image.height).map(|k| (k % image.width, k / image.width));
    let expected: Vec<f64> = pixels.map(|pixel| over_pixel(&lit, pixel, 8, sent)).collect();
    let found = off(&image, &expected);
    println!("{found:.4}, brightest {:.3}", expected.iter().fold(0.0_f64, |most, e| most.max(*e)));
    assert!(found < 0.02, "{found}");
}

/// A small lamp that shines up at a mirror, so that the floor's lobes meet it by chance alone: what the clamp takes is
/// what it says, the specks are gone, and in many samples it takes little.
#[test]
fn what_only_chance_finds_is_limited_and_what_that_leaves_out_is_told() {
    let lit = room(
        0.3,
        r#"[materials.mirror]
specular = 1.0
reflectance = 0.0
roughness = 0.0
fresnel = { normal = 0.9 }
[materials.paper]
reflectance = 0.5
[materials.glowing]
reflectance = 0.5
emission = { spectrum = 1.0, radiance = 0.3 }
[[objects]]
name = "mirror"
material = "mirror"
quads = [[[-2, -2, 2], [-2, 2, 2], [2, 2, 2], [2, -2, 2]]]
[[objects]]
name = "lamp"
material = "lamp"
quads = [[[-0.02, 0.98, 1], [0.02, 0.98, 1], [0.02, 1.02, 1], [-0.02, 1.02, 1]]]
[[objects]]
name = "paper"
material = "glowing"
quads = [[[2, -2, 0], [3, -2, 0], [3, 2, 0], [2, 2, 0]]]
[[objects]]
name = "wall"
material = "paper"
quads = [[[-2, 2, 0], [2, 2, 0], [2, 2, 2], [-2, 2, 2]]]
"#,
    );
    let sum = |image: &SpectralImage| image.radiance.iter().map(|&l| f64::from(l)).sum::<f64>();
    let view = |rung, clamp, samples, seed| clamped_view(&lit, rung, clamp, (samples, seed));
    for rung in [Rung::Interpolate, Rung::Direct] {
        let (whole, unlimited) = view(rung, f64::INFINITY, 16, 1);
        assert_eq!(unlimited.clamped_share, 0.0);
        let (image, stats) = view(rung, 0.25, 16, 1);
        let left_out = 1.0 - sum(&image) / sum(&whole);
        println!("{rung:?}: {} by chance, {left_out} left out", stats.by_chance_share);
        assert!((stats.by_chance_share - unlimited.by_chance_share).abs() < 1e-6);
        assert!(left_out > 0.01 && (stats.clamped_share - left_out).abs() < 1e-3 * left_out, "{left_out}");
        let speckled = |clamp: f64| {
            let [(a, _), (b, _)] = [1, 2].map(|seed| view(rung, clamp, 16, seed));
            let apart: f64 = a.radiance.iter().zip(&b.radiance).map(|(a, b)| f64::from(a - b).powi(2)).sum();
            (0.5 * apart / a.radiance.len() as f64).sqrt() / (sum(&whole) / whole.radiance.len() as f64)
        };
        let noise = [f64::INFINITY, 0.25].map(speckled);
        println!("noise without and with the clamp: {noise:?}");
        assert!(noise[1] < 0.3 * noise[0], "{noise:?}");
        let (_, more) = view(rung, 0.25, 1024, 1);
        println!("of 1,024 samples: {} left out", more.clamped_share);
        assert!(more.clamped_share < 0.2 * stats.clamped_share);
    }
}
