//! Built-in tables by name. Sources and licences: `data/LICENSES.md`.
//!
//! Names do not distinguish upper from lower case, `_` from `-`. Nothing is extrapolated: beyond the
//! end of a table its last value stands.

use super::{Spectrum, table};
use std::sync::LazyLock;

/// One table: its name, other names it answers to, and its text.
struct Entry(&'static str, &'static [&'static str], &'static str);

const ILLUMINANTS: [Entry; 7] = [
    Entry("D65", &[], include_str!("data/illuminant_d65_1nm.csv")),
    Entry("A", &[], include_str!("data/illuminant_a_1nm.csv")),
    Entry("D50", &[], include_str!("data/illuminant_d50_5nm.csv")),
    Entry("E", &[], include_str!("data/illuminant_e_5nm.csv")),
    Entry("FL2", &["F2"], include_str!("data/illuminant_fl2_5nm.csv")),
    Entry("FL11", &["F11"], include_str!("data/illuminant_fl11_5nm.csv")),
    Entry("LED-B3", &[], include_str!("data/illuminant_led_b3_5nm.csv")),
];

const INDICES: [Entry; 19] = [
    Entry("gold_johnson_christy", &["gold"], include_str!("data/gold_johnson_christy.csv")),
    Entry("gold_mcpeak2015", &[], include_str!("data/gold_mcpeak2015.csv")),
    Entry("silver_johnson_christy", &["silver"], include_str!("data/silver_johnson_christy.csv")),
    Entry("silver_mcpeak2015", &[], include_str!("data/silver_mcpeak2015.csv")),
    Entry("copper_johnson_christy", &["copper"], include_str!("data/copper_johnson_christy.csv")),
    Entry("iron_johnson_christy", &["iron"], include_str!("data/iron_johnson_christy.csv")),
    Entry("chromium_johnson_christy", &["chromium"], include_str!("data/chromium_johnson_christy.csv")),
    Entry("aluminium_rakic1995", &["aluminium", "aluminum"], include_str!("data/aluminium_rakic1995.csv")),
    Entry("bk7_schott", &["bk7"], include_str!("data/bk7_schott.csv")),
    Entry("sf11_schott", &["sf11"], include_str!("data/sf11_schott.csv")),
    Entry("fused_silica_malitson", &["fused_silica"], include_str!("data/fused_silica_malitson.csv")),
    Entry("water_segelstein1981", &["water"], include_str!("data/water_segelstein1981_nk.csv")),
    Entry("water_daimon2007_20c", &[], include_str!("data/water_daimon2007_20c.csv")),
    Entry("pmma_zhang2020", &["pmma"], include_str!("data/pmma_zhang2020_nk.csv")),
    Entry("pmma_beadie2015", &[], include_str!("data/pmma_beadie2015.csv")),
    Entry("colour_glass_blue_ieb400", &["blue_glass"], include_str!("data/colour_glass_blue_ieb400.csv")),
    Entry("colour_glass_cyan_ieb470", &["cyan_glass"], include_str!("data/colour_glass_cyan_ieb470.csv")),
    Entry("colour_glass_green_ivg540", &["green_glass"], include_str!("data/colour_glass_green_ivg540.csv")),
    Entry("colour_glass_amber_ila400", &["amber_glass"], include_str!("data/colour_glass_amber_ila400.csv")),
];

/// Real part n and imaginary part k of a complex index.
type Index = (Spectrum, Spectrum);

static ILLUMINANT_TABLES: LazyLock<Vec<Spectrum>> = LazyLock::new(|| {
    ILLUMINANTS.iter().flat_map(|entry| table::columns(entry.2)).map(|(_, spectrum)| spectrum).collect()
});

static INDEX_TABLES: LazyLock<Vec<Index>> = LazyLock::new(|| {
    let index = |entry: &Entry| {
        let mut columns = table::columns(entry.2).into_iter().map(|(_, spectrum)| spectrum);
        // A table without k is of a transparent medium whose absorption its source does not give.
        (columns.next().unwrap_or(Spectrum::Constant(1.0)), columns.next().unwrap_or(Spectrum::Constant(0.0)))
    };
    INDICES.iter().map(index).collect()
});

static COLORCHECKER: LazyLock<Vec<(&str, Spectrum)>> =
    LazyLock::new(|| table::columns(include_str!("data/colorchecker_ohta1997_5nm.csv")));

/// Whether a user's `name` means `known`.
fn same(name: &str, known: &str) -> bool {
    let folded = |s: &str| s.trim().to_ascii_lowercase().replace('-', "_");
    folded(name) == folded(known)
}

fn position(entries: &[Entry], name: &str) -> Option<usize> {
    entries.iter().position(|e| same(name, e.0) || e.1.iter().any(|alias| same(name, alias)))
}

fn names(entries: &'static [Entry]) -> Vec<&'static str> {
    entries.iter().flat_map(|e| e.1.iter().copied().chain([e.0])).collect()
}

/// Relative spectral power of a CIE illuminant: D65, A, D50, E, FL2, FL11, LED-B3.
pub fn illuminant(name: &str) -> Option<Spectrum> {
    position(&ILLUMINANTS, name).map(|i| ILLUMINANT_TABLES[i].clone())
}

/// The names [`illuminant`] knows, for messages.
pub fn illuminant_names() -> Vec<&'static str> {
    names(&ILLUMINANTS)
}

/// n and k of the complex refractive index n + ik: metals, glasses, water, acrylic, coloured
/// filter glasses. k is 0 where the source gives none.
pub fn refractive_index(name: &str) -> Option<(Spectrum, Spectrum)> {
    position(&INDICES, name).map(|i| INDEX_TABLES[i].clone())
}

/// The names [`refractive_index`] knows, short names before the publications they stand for.
pub fn refractive_index_names() -> Vec<&'static str> {
    names(&INDICES)
}

/// Diffuse reflectance of a patch of the ColorChecker (Ohta 1997), such as `dark_skin`.
pub fn reflectance(name: &str) -> Option<Spectrum> {
    COLORCHECKER.iter().find(|(known, _)| same(name, known)).map(|(_, spectrum)| spectrum.clone())
}

/// The names [`reflectance`] knows, in the order of the chart.
pub fn reflectance_names() -> Vec<&'static str> {
    COLORCHECKER.iter().map(|(name, _)| *name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_leads_to_a_sound_table() {
        for name in illuminant_names() {
            let light = illuminant(name).unwrap();
            assert!(light.min() >= 0.0 && light.range().unwrap()[1] >= 780.0, "{name}");
        }
        for name in refractive_index_names() {
            let (n, k) = refractive_index(name).unwrap();
            assert!(n.min() > 0.0 && k.min() >= 0.0 && k.max() < 20.0, "{name}");
        }
        for name in reflectance_names() {
            let patch = reflectance(name).unwrap();
            assert!(patch.min() > 0.0 && patch.max() < 1.0, "{name}");
        }
        assert_eq!(reflectance_names().len(), 24);
    }

    #[test]
    fn short_names_stand_for_publications() {
        assert_eq!(refractive_index("Gold"), refractive_index("gold_johnson_christy"));
        assert_eq!(illuminant("led_b3"), illuminant("LED-B3"));
        assert!((refractive_index("bk7").unwrap().0.at(587.56) - 1.5168).abs() < 1e-4);
        assert!((refractive_index("water").unwrap().0.at(589.3) - 1.333).abs() < 1.5e-3);
        assert!(
            illuminant("D75").is_none() && refractive_index("").is_none() && reflectance("D65").is_none()
        );
    }
}
