//! Do spectra become the colours that independent colorimetry says?

use luxgraph::colour::{delta_e_76, delta_e_2000, encode_srgb, lab, xyz_to_linear_srgb};
use luxgraph::report::wavelength_table::{LIGHTS, WavelengthTable, colour_error};
use luxgraph::spectrum::{LUMENS_PER_WATT, Spectrum, Wavelengths, library, luminance_of, xyz_of};
use serde_json::Value;

fn colorimetry() -> Value {
    serde_json::from_str(include_str!("data/colorimetry.json")).unwrap()
}

fn numbers(value: &Value) -> [f64; 3] {
    [0, 1, 2].map(|c| value[c].as_f64().unwrap())
}

fn product(light: &Spectrum, reflectance: &Spectrum) -> Spectrum {
    light.times(|nm| reflectance.at(nm))
}

fn scaled(xyz: [f64; 3], factor: f64) -> [f64; 3] {
    xyz.map(|x| (factor * x).max(0.0))
}

#[test]
fn illuminants_have_the_published_white_points() {
    for (name, white) in colorimetry()["white"].as_object().unwrap() {
        let light = library::illuminant(name).unwrap();
        let (xyz, expected) = (xyz_of(&light), numbers(&white["XYZ"]));
        for c in 0..3 {
            assert!((100.0 * xyz[c] / xyz[1] - expected[c]).abs() < 1e-6, "{name} {xyz:?}");
        }
        assert_eq!(luminance_of(&light), xyz[1]);
    }
}

#[test]
fn the_luminance_of_equal_energy_is_683_times_the_area_of_v_lambda() {
    assert!((luminance_of(&Spectrum::Constant(1.0)) / (LUMENS_PER_WATT * 106.8566) - 1.0).abs() < 1e-5);
}

#[test]
fn the_colorchecker_under_d65_has_the_expected_colours() {
    let light = library::illuminant("D65").unwrap();
    let white = xyz_of(&light);
    for (name, patch) in colorimetry()["colorchecker_D65"].as_object().unwrap() {
        let xyz = xyz_of(&product(&light, &library::reflectance(name).unwrap())).map(|x| x / white[1]);
        let found_lab = lab(xyz, white.map(|x| x / white[1]));
        let linear = xyz_to_linear_srgb(xyz);
        for c in 0..3 {
            assert!((100.0 * xyz[c] - numbers(&patch["XYZ"])[c]).abs() < 1e-6, "{name}");
            assert!((found_lab[c] - numbers(&patch["Lab"])[c]).abs() < 1e-6, "{name}");
            assert!((linear[c] - numbers(&patch["srgb_linear"])[c]).abs() < 1e-8, "{name}");
            if patch["in_gamut"].as_bool().unwrap() {
                let encoded = 255.0 * encode_srgb(linear[c]);
                assert!((encoded - numbers(&patch["srgb_encoded_0_255"])[c]).abs() < 1e-3, "{name}");
            }
        }
    }
}

/// Mean and largest ΔE76, mean and largest ΔE2000 of the 24 patches, and ΔE76 of the white.
/// `lamp` are the samples of the light; with `own_white` each side is seen against its own white.
fn patch_errors(wavelengths: &Wavelengths, light: &Spectrum, lamp: &[f64], own_white: bool) -> [f64; 5] {
    let (exact, sampled) = (xyz_of(light), wavelengths.xyz(lamp));
    let white = scaled(exact, 1.0 / exact[1]);
    let (scale, sampled_white) = match own_white {
        true => (1.0 / sampled[1], scaled(sampled, 1.0 / sampled[1])),
        false => (1.0 / exact[1], white),
    };
    let (mut mean_76, mut max_76, mut mean_00, mut max_00) = (0.0, 0.0_f64, 0.0, 0.0_f64);
    for name in library::reflectance_names() {
        let patch = library::reflectance(name).unwrap();
        let a = lab(scaled(xyz_of(&product(light, &patch)), 1.0 / exact[1]), white);
        let reflected: Vec<f64> = wavelengths.sample(&patch).iter().zip(lamp).map(|(r, s)| r * s).collect();
        let b = lab(scaled(wavelengths.xyz(&reflected), scale), sampled_white);
        mean_76 += delta_e_76(a, b) / 24.0;
        max_76 = max_76.max(delta_e_76(a, b));
        mean_00 += delta_e_2000(a, b) / 24.0;
        max_00 = max_00.max(delta_e_2000(a, b));
    }
    let white_76 = delta_e_76(lab(white, white), lab(scaled(sampled, 1.0 / exact[1]), white));
    [mean_76, max_76, mean_00, max_00, white_76]
}

#[test]
fn four_wavelengths_have_the_colour_error_of_meyers_scheme() {
    let light = library::illuminant("D65").unwrap();
    let meyer = Wavelengths::meyer4();
    let (plain, moved) = (meyer.sample(&light), meyer.sample_emission(&light));
    let rows = [
        (patch_errors(&meyer, &light, &plain, false), [8.0250, 23.5988, 4.6519, 10.7148, 7.6236]),
        (patch_errors(&meyer, &light, &plain, true), [6.1448, 24.8969, 3.2472, 12.0597, 7.6236]),
        (patch_errors(&meyer, &light, &moved, false), [6.0241, 27.4369, 3.1907, 12.5748, 0.0]),
    ];
    for (found, expected) in rows {
        for (f, e) in found.into_iter().zip(expected) {
            assert!((f - e).abs() < 0.01, "{found:?} {expected:?}");
        }
    }
}

#[test]
fn more_bands_bring_the_colours_closer() {
    let table = WavelengthTable::measure().unwrap();
    println!("{table}");
    // Limits on the mean and the worst CIEDE2000 of light reflected once, under any of the lights.
    let limits = [("8", 1.5, 4.0), ("16", 0.4, 0.8), ("32", 0.1, 0.25), ("80", 0.05, 0.15)];
    for (choice, mean, worst) in limits {
        let row = table.0.iter().find(|row| row.wavelengths == choice).unwrap();
        for (light, error) in LIGHTS.iter().zip(&row.once) {
            assert!(error.mean < mean && error.worst < worst, "{choice} {light} {error:?}");
        }
    }
}

#[test]
fn spiky_light_does_not_alias() {
    // Bands whose products of light and reflectance are averaged, beside bands whose reflectance is.
    let light = library::illuminant("FL11").unwrap();
    for count in [4, 8, 16, 32] {
        let wavelengths = Wavelengths::bands(count).unwrap();
        let plain = patch_errors(&wavelengths, &light, &wavelengths.sample_emission(&light), false);
        let averaged = colour_error(&wavelengths, &light, 1);
        println!("{count}: reflectance averaged {:.2}, product {:.2}", plain[2], averaged.mean);
        assert!(averaged.mean < 0.6 * plain[2], "{count}: {averaged:?} {plain:?}");
    }
}

#[test]
fn what_is_white_under_a_lamp_has_the_lamps_colour() {
    for name in library::illuminant_names() {
        let light = library::illuminant(name).unwrap();
        for wavelengths in
            [4, 8, 16, 80].map(|n| Wavelengths::bands(n).unwrap()).into_iter().chain([Wavelengths::meyer4()])
        {
            let wavelengths = wavelengths.under(&light);
            let lamp = wavelengths.sample_emission(&light);
            let white = wavelengths.sample(&Spectrum::Constant(0.9));
            let reflected: Vec<f64> = lamp.iter().zip(white).map(|(s, r)| s * r).collect();
            let (found, exact) = (wavelengths.xyz(&reflected), xyz_of(&light));
            for c in 0..3 {
                assert!((found[c] / (0.9 * exact[c]) - 1.0).abs() < 1e-8, "{name} {}", wavelengths.len());
            }
        }
    }
}
