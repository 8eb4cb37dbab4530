//! Published tables, embedded; each names its source in its first lines.

/// Mass attenuation and energy-transfer coefficients (cm²/g), 5 - 50 keV, by material.
pub const ATTENUATION: &str = include_str!("../tables/attenuation.csv");
/// Densities (g/cm³) and compositions (mass fractions).
pub const MATERIALS: &str = include_str!("../tables/materials.csv");
/// Dance's g by thickness and half-value layer.
pub const DANCE_G: &str = include_str!("../tables/dance_g.csv");
/// Dance's s by target and filter.
pub const DANCE_S: &str = include_str!("../tables/dance_s.csv");
/// Glandularity factor c by Monte Carlo.
pub const DANCE_C: &str = include_str!("../tables/dance_c.csv");
/// Monte Carlo of Dance's breast: check of g, and the s that it implies.
pub const DANCE_CHECK: &str = include_str!("../tables/dance_check.csv");
/// Presampled modulation transfer of detectors.
pub const DETECTOR_MTF: &str = include_str!("../tables/detector_mtf.csv");
/// Atomic form factors by momentum transfer and element.
pub const FORM_FACTOR: &str = include_str!("../tables/form_factor.csv");
/// Incoherent scattering functions by momentum transfer and element.
pub const INCOHERENT_FUNCTION: &str = include_str!("../tables/incoherent_function.csv");
/// X-ray spectra by beam.
pub const SPECTRA: &str = include_str!("../tables/spectra.csv");
/// Half-value layers: cited ranges by beam, tube voltage.
pub const HALF_VALUE_LAYERS: &str = include_str!("../tables/half_value_layers.csv");
/// AAPM TG-195, case 3: energies absorbed in a breast.
pub const TG195_CASE_3: &str = include_str!("../tables/tg195_case_3.csv");
/// Scatter-to-primary ratios of Boone and Cooper (2000).
pub const BOONE_SPR: &str = include_str!("../tables/boone2000_spr.csv");
/// Table 5.10 of Mîra (2018).
pub const THESIS_5_10: &str = include_str!("../tables/thesis_table_5_10.csv");
/// Published thicknesses, pressures and shares of force of compressed women.
pub const COMPRESSION_PUBLISHED: &str = include_str!("../tables/compression_published.csv");

/// Cells of the rows after the comments (`#`) and the line of column names.
///
/// Cells are split at each comma: columns after a quoted one cannot be read with it.
pub fn rows(table: &'static str) -> impl Iterator<Item = Vec<&'static str>> {
    table.lines().filter(|line| !line.starts_with('#')).skip(1).map(|l| l.split(',').collect())
}

/// Names of the columns.
pub fn header(table: &'static str) -> impl Iterator<Item = &'static str> {
    table.lines().find(|line| !line.starts_with('#')).unwrap_or_default().split(',')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_table_names_its_source_and_has_rows() {
        for table in [
            ATTENUATION,
            MATERIALS,
            DANCE_G,
            DANCE_S,
            DANCE_C,
            DANCE_CHECK,
            DETECTOR_MTF,
            FORM_FACTOR,
            INCOHERENT_FUNCTION,
            SPECTRA,
            HALF_VALUE_LAYERS,
            TG195_CASE_3,
            BOONE_SPR,
            THESIS_5_10,
            COMPRESSION_PUBLISHED,
        ] {
            assert!(table.starts_with('#'));
            assert!(rows(table).count() >= 4);
        }
        assert_eq!(rows(DANCE_G).next().unwrap()[1], "0.39");
    }
}
