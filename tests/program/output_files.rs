//! Do image files hold what was computed, and nothing else?

use luxgraph::error::Error;
use luxgraph::output::png::Exposure;
use luxgraph::output::{compare, exr, png};
use luxgraph::second_pass::SpectralImage;
use luxgraph::spectrum::Wavelengths;
use std::path::Path;

fn image() -> SpectralImage {
    let nm = vec![456.4, 490.9, 557.7, 631.4];
    let xyz_weights = vec![[15.0, 3.0, 80.0], [2.0, 12.0, 20.0], [50.0, 62.0, 0.5], [40.0, 23.0, 0.0]];
    let wavelengths = Wavelengths::points(nm, xyz_weights);
    let (width, height) = (37u32, 19u32);
    let radiance = (0..width * height * 4).map(|i| (i * 7919 % 1009) as f32 / 300.0).collect();
    SpectralImage { width, height, wavelengths, radiance }
}

#[test]
fn exr_keeps_every_bit_and_the_same_image_gives_the_same_bytes() {
    let directory = tempfile::tempdir().unwrap();
    let (a, b) = (directory.path().join("a.exr"), directory.path().join("b.exr"));
    let image = image();
    let options = exr::ExrOptions { xyz: true, spectral: true };
    exr::write(&a, &image, &options).unwrap();
    exr::write(&b, &image, &options).unwrap();
    assert_eq!(std::fs::read(&a).unwrap(), std::fs::read(&b).unwrap());
    let read = exr::read(&a).unwrap();
    let difference = compare(&image.to_linear(), &read).unwrap();
    assert!(difference.same_bits && difference.max_abs == 0.0, "{difference:?}");
    let names: Vec<_> =
        std::fs::read_dir(directory.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(names.len(), 2, "no temporary file is left: {names:?}");
}

#[test]
fn exr_holds_the_spectra_and_states_its_units() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("spectral.exr");
    let image = image();
    exr::write(&path, &image, &exr::ExrOptions { xyz: true, spectral: true }).unwrap();
    let file = ::exr::prelude::read_first_flat_layer_from_file(&path).unwrap();
    let channel = |name: &str| {
        let found = file.layer_data.channel_data.list.iter().find(|c| c.name.eq(name));
        found.unwrap_or_else(|| panic!("{name}")).sample_data.values_as_f32().collect::<Vec<_>>()
    };
    let second: Vec<f32> = image.radiance.iter().skip(1).step_by(4).copied().collect();
    assert_eq!(channel("S0.490,9nm"), second);
    let y: Vec<f32> = (0..image.pixels()).map(|p| image.xyz(p)[1] as f32).collect();
    assert_eq!(channel("CIE.Y"), y);
    assert_eq!(file.layer_data.attributes.white_luminance, Some(1.0));
    let attributes = [&file.attributes.other, &file.layer_data.attributes.other];
    let has = |name: &str| attributes.iter().any(|a| a.keys().any(|k| k.eq(name)));
    assert!(has("spectralLayoutVersion") && has("emissiveUnits"));

    exr::write(&path, &image, &exr::ExrOptions::default()).unwrap();
    let plain = ::exr::prelude::read_first_flat_layer_from_file(&path).unwrap();
    assert_eq!(plain.layer_data.channel_data.list.len(), 3, "an older file is replaced");
}

fn decode(path: &Path) -> (Vec<u8>, Vec<(String, String)>) {
    let decoder = ::png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).unwrap()));
    let mut reader = decoder.read_info().unwrap();
    let mut data = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut data).unwrap();
    let texts = &reader.info().uncompressed_latin1_text;
    let texts = texts.iter().map(|t| (t.keyword.clone(), t.text.clone())).collect();
    (data, texts)
}

#[test]
fn png_is_exposed_as_asked_and_says_so() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("grey.png");
    // White of 50 cd/m2 (x 0.3127, y 0.3290) at every pixel: half of full white at EV 0, sRGB code 188.
    let mut image = image();
    image.wavelengths.xyz_weights =
        vec![[0.3127 / 0.3290, 1.0, 0.3583 / 0.3290], [0.0; 3], [0.0; 3], [0.0; 3]];
    image.radiance.fill(50.0 / 683.0);
    assert_eq!(png::write(&path, &image, Exposure::Ev(0.0)).unwrap(), 0.0);
    let (data, texts) = decode(&path);
    assert!(data.iter().all(|c| *c == 188), "{:?}", &data[..3]);
    assert!(texts.iter().any(|(k, t)| k == "Exposure" && t.contains("EV 0.0")), "{texts:?}");

    png::write(&path, &image, Exposure::Ev(-1.0)).unwrap();
    assert!(decode(&path).0.iter().all(|c| *c == 137), "a quarter of full white");
    let ev = png::write(&path, &image, Exposure::Auto).unwrap();
    assert!((ev - 1.6f64.log2()).abs() < 1e-4);
    assert!(decode(&path).0.iter().all(|c| *c == 231), "0.8 of full white");

    image.radiance.fill(0.0);
    assert_eq!(png::write(&path, &image, Exposure::Auto).unwrap(), 0.0);
    assert!(matches!(png::write(&path, &image, Exposure::Ev(f64::NAN)), Err(Error::Settings(_))));
}

#[test]
fn errors_name_the_path_and_what_to_do() {
    let directory = tempfile::tempdir().unwrap();
    let missing = directory.path().join("nowhere").join("a.exr");
    let message = exr::write(&missing, &image(), &exr::ExrOptions::default()).unwrap_err().to_string();
    assert!(message.contains("nowhere") && message.contains("create it"), "{message}");
    let message = png::write(directory.path(), &image(), Exposure::Auto).unwrap_err().to_string();
    assert!(message.contains("is a directory"), "{message}");
    let message = exr::read(&missing).unwrap_err().to_string();
    assert!(message.contains("nowhere"), "{message}");
    let damaged = directory.path().join("damaged.exr");
    std::fs::write(&damaged, b"not an image").unwrap();
    assert!(exr::read(&damaged).unwrap_err().to_string().contains("not an OpenEXR"));
    let mut empty = image();
    empty.width = 0;
    empty.radiance.clear();
    assert!(exr::write(&damaged, &empty, &exr::ExrOptions::default()).is_err());
    assert!(png::write(&directory.path().join("e.png"), &empty, Exposure::Auto).is_err());
}
