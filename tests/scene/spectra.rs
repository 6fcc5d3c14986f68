//! Do spectra become colours? (What independent colorimetry says is among the cases of `validate`.)

use luxgraph::report::wavelength_table::{LIGHTS, WavelengthTable, colour_error, patch_errors};
use luxgraph::spectrum::{LUMENS_PER_WATT, Spectrum, Wavelengths, library, luminance_of, xyz_of};

#[test]
fn the_luminance_of_equal_energy_is_683_times_the_area_of_v_lambda() {
    assert!((luminance_of(&Spectrum::Constant(1.0)) / (LUMENS_PER_WATT * 106.8566) - 1.0).abs() < 1e-5);
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
        let plain = patch_errors(&wavelengths, &light, &wavelengths.sample_emission(&light), false, 1);
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
