//! Average glandular dose: AGD = K g c s (Dance 1990, 2000, 2009; Mîra 2018, eq. 5.6).

use mammotwin_data::tables;

/// Why there is no dose.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DoseError {
    /// Beyond the tables.
    #[error(
        "{what} {value} is outside of Dance's tables ({low} - {high}); they are not extrapolated"
    )]
    Outside {
        /// Quantity with its unit.
        what: &'static str,
        /// Asked for.
        value: f64,
        /// Smallest of the table.
        low: f64,
        /// Largest of the table.
        high: f64,
    },
    /// No factor for this beam.
    #[error("no {factor}-factor for {beam}: use a beam that the tables have")]
    NoFactor {
        /// `s` or `c`.
        factor: &'static str,
        /// Target/filter.
        beam: String,
    },
}

/// The beam that the dose is reckoned for, as Dance's tables know it.
#[derive(Debug, Clone, PartialEq)]
pub struct DoseBeam {
    /// Target and filter: `Rh/Ag`.
    pub target_filter: String,
    /// Half-value layer (mm of aluminium).
    pub hvl_mm_al: f64,
}

impl DoseBeam {
    /// Rh/Ag at 34 kVp behind the paddle, HVL 0.535 mm Al (computed): the beam that 24 keV stands
    /// for (Mîra 2018, § 5.2.1). The HVL of 24 keV itself, 1.25 mm Al, is beyond Dance's tables.
    pub fn rhodium_silver_34_kvp() -> Self {
        Self { target_filter: "Rh/Ag".into(), hvl_mm_al: 0.535 }
    }
}

/// Average glandular dose and its factors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dose {
    /// AGD (mGy).
    pub agd_mgy: f64,
    /// Incident air kerma K (mGy) at the upper surface of the breast, without backscatter.
    pub kerma_mgy: f64,
    /// Kerma to dose at 50 % glandularity.
    pub g: f64,
    /// Correction for glandularity.
    pub c: f64,
    /// Correction for the spectrum.
    pub s: f64,
}

/// Dose of a breast of this thickness and glandularity (mass fraction 0..1).
///
/// g is Dance's table, linear between its nodes. s is published for Mo/Mo, Mo/Rh, Rh/Rh, Rh/Al and
/// W/Rh; no published value for Rh/Ag was found, so its s (1.03 - 1.11, by thickness) is what a
/// Monte Carlo of Dance's own model implies (`dance_check.csv`). c comes from the same Monte
/// Carlo (`dance_c.csv`), not from Dance 2000.
pub fn average_glandular_dose(
    kerma_mgy: f64,
    thickness_mm: f64,
    glandularity: f64,
    beam: &DoseBeam,
) -> Result<Dose, DoseError> {
    let g = factor_g(thickness_mm, beam.hvl_mm_al)?;
    let c = factor_c(thickness_mm, glandularity, &beam.target_filter)?;
    let s = factor_s(thickness_mm, &beam.target_filter)?;
    Ok(Dose { agd_mgy: kerma_mgy * g * c * s, kerma_mgy, g, c, s })
}

/// Thickness (mm) that a paddle which tilts or bends is given: the mean of the largest and the
/// smallest distance of the plates over the contact area (Mîra 2018, § 5.3.3); for a rigid paddle
/// all are alike. `None` without contact.
pub fn nominal_thickness_mm(distances_mm: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut distances = distances_mm.into_iter();
    let first = distances.next()?;
    let (low, high) = distances.fold((first, first), |(l, h), d| (f64::min(l, d), f64::max(h, d)));
    Some(0.5 * (low + high))
}

/// Kerma to dose at 50 % glandularity (no unit).
pub fn factor_g(thickness_mm: f64, hvl_mm_al: f64) -> Result<f64, DoseError> {
    const HVL: [f64; 7] = [0.30, 0.35, 0.40, 0.45, 0.50, 0.55, 0.60];
    let rows: Vec<Vec<f64>> = tables::rows(tables::DANCE_G).map(|row| numbers(&row)).collect();
    bilinear("half-value layer (mm Al)", &HVL, hvl_mm_al, &rows, thickness_mm)
}

/// Correction for a glandularity (mass fraction) other than 50 %.
pub fn factor_c(
    thickness_mm: f64,
    glandularity: f64,
    target_filter: &str,
) -> Result<f64, DoseError> {
    const GLANDULARITY: [f64; 5] = [0.001, 0.25, 0.5, 0.75, 1.0];
    let all: Vec<_> = tables::rows(tables::DANCE_C).filter(|row| row[0] == target_filter).collect();
    // A beam that was computed at several voltages is represented by the last one.
    let kv = all.last().map(|row| row[1]);
    let of_kv = all.iter().filter(|row| Some(row[1]) == kv);
    let rows: Vec<Vec<f64>> = of_kv.map(|row| numbers(&row[3..])).collect();
    if rows.is_empty() {
        return Err(DoseError::NoFactor { factor: "c", beam: target_filter.into() });
    }
    bilinear("glandularity", &GLANDULARITY, glandularity, &rows, thickness_mm)
}

/// Correction for the spectrum.
pub fn factor_s(thickness_mm: f64, target_filter: &str) -> Result<f64, DoseError> {
    let name = |row: &[&str]| format!("{}/{}", row[0], row[1]);
    if let Some(row) = tables::rows(tables::DANCE_S).find(|row| name(row) == target_filter) {
        return Ok(numbers(&row[2..3])[0]);
    }
    let rows: Vec<Vec<f64>> = tables::rows(tables::DANCE_CHECK)
        .filter(|row| row[0] == target_filter)
        .map(|row| numbers(&[row[3], row[6]]))
        .collect();
    if rows.is_empty() {
        return Err(DoseError::NoFactor { factor: "s", beam: target_filter.into() });
    }
    let [thickness, s] = [0, 1].map(|k| rows.iter().map(|row| row[k]).collect::<Vec<_>>());
    let (after, part) = bracket(THICKNESS, &thickness, thickness_mm)?;
    Ok(mix(s[after - 1], s[after], part))
}

const THICKNESS: &str = "breast thickness (mm)";

/// Rows begin with the thickness (mm); the other cells belong to the nodes of the columns.
fn bilinear(
    what: &'static str,
    columns: &[f64],
    column: f64,
    rows: &[Vec<f64>],
    thickness_mm: f64,
) -> Result<f64, DoseError> {
    let thickness: Vec<f64> = rows.iter().map(|row| row[0]).collect();
    let (lower, down) = bracket(THICKNESS, &thickness, thickness_mm)?;
    let (right, across) = bracket(what, columns, column)?;
    let [above, below] =
        [lower - 1, lower].map(|r| mix(rows[r][right], rows[r][right + 1], across));
    Ok(mix(above, below, down))
}

fn mix(from: f64, to: f64, part: f64) -> f64 {
    (1.0 - part) * from + part * to
}

/// Index of the node after a value, and how far the value is on its way to it.
fn bracket(what: &'static str, nodes: &[f64], value: f64) -> Result<(usize, f64), DoseError> {
    let (low, high) = (nodes[0], nodes[nodes.len() - 1]);
    if !(low..=high).contains(&value) {
        return Err(DoseError::Outside { what, value, low, high });
    }
    let after = nodes.partition_point(|&node| node <= value).clamp(1, nodes.len() - 1);
    Ok((after, (value - nodes[after - 1]) / (nodes[after] - nodes[after - 1])))
}

fn numbers(cells: &[&str]) -> Vec<f64> {
    cells.iter().map(|cell| cell.parse().expect("embedded tables hold numbers")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_of_the_published_table_are_reproduced() {
        assert_eq!(factor_g(20.0, 0.30).unwrap(), 0.39);
        assert_eq!(factor_g(45.0, 0.50).unwrap(), 0.285);
        assert_eq!(factor_g(60.0, 0.45).unwrap(), 0.192);
        assert_eq!(factor_g(110.0, 0.60).unwrap(), 0.1385);
        #[allow(clippy::approx_constant)] // 0.318 is a node of the table
        let middle = 0.25 * (0.289 + 0.318 + 0.258 + 0.285);
        assert!((factor_g(42.5, 0.475).unwrap() - middle).abs() < 1e-12);
        assert_eq!(factor_s(33.0, "W/Rh").unwrap(), 1.042);
        assert_eq!(factor_s(45.0, "Rh/Ag").unwrap(), 1.076);
        assert_eq!(factor_c(60.0, 0.25, "Rh/Ag").unwrap(), 1.113);
        for thickness in [20.0, 57.0, 110.0] {
            assert_eq!(factor_c(thickness, 0.5, "Mo/Mo").unwrap(), 1.0);
        }
    }

    /// Every cell of every table is met at its node, and nothing between nodes leaves their range.
    #[test]
    fn all_nodes_of_all_tables_are_reproduced() {
        let mut checked = 0;
        let hvls: Vec<f64> = tables::header(tables::DANCE_G)
            .skip(1)
            .map(|name| name[4..8].parse().unwrap())
            .collect();
        assert_eq!(hvls, [0.30, 0.35, 0.40, 0.45, 0.50, 0.55, 0.60]);
        for row in tables::rows(tables::DANCE_G) {
            let cells = numbers(&row);
            for (hvl, cell) in hvls.iter().zip(&cells[1..]) {
                assert!((factor_g(cells[0], *hvl).unwrap() - cell).abs() < 1e-15);
                checked += 1;
            }
        }
        let shares: Vec<f64> = tables::header(tables::DANCE_C)
            .skip(4)
            .map(|name| 0.01 * name.trim_start_matches("c_").parse::<f64>().unwrap())
            .collect();
        for (beam, kv) in [("Mo/Mo", "28"), ("W/Rh", "28"), ("Rh/Ag", "34")] {
            let of_beam = |row: &Vec<&str>| row[0] == beam && row[1] == kv;
            for row in tables::rows(tables::DANCE_C).filter(of_beam) {
                for (share, cell) in shares.iter().zip(numbers(&row[4..])) {
                    let got = factor_c(numbers(&row[3..4])[0], *share, beam).unwrap();
                    assert!((got - cell).abs() < 1e-14, "{beam} {row:?}");
                    checked += 1;
                }
            }
        }
        for row in tables::rows(tables::DANCE_S) {
            let got = factor_s(50.0, &format!("{}/{}", row[0], row[1])).unwrap();
            assert_eq!(got, numbers(&row[2..3])[0]);
            checked += 1;
        }
        assert_eq!(checked, 77 + 3 * 55 + 6);
    }

    #[test]
    fn between_nodes_g_falls_with_thickness_and_rises_with_hardness() {
        let g = |t: u32, h: u32| factor_g(f64::from(t), f64::from(h) / 1000.0).unwrap();
        for thickness in 20..110 {
            for hvl in 300..600 {
                assert!(g(thickness, hvl) > g(thickness + 1, hvl));
                assert!(g(thickness, hvl) < g(thickness, hvl + 1));
            }
        }
    }

    #[test]
    fn a_flexed_paddle_has_the_mean_of_its_extremes() {
        assert_eq!(nominal_thickness_mm([46.0, 48.0, 47.5, 42.0]), Some(45.0));
        assert_eq!(nominal_thickness_mm([46.0; 3]), Some(46.0));
        assert_eq!(nominal_thickness_mm([]), None);
    }

    #[test]
    fn nothing_is_extrapolated() {
        let beam = DoseBeam::rhodium_silver_34_kvp();
        for thickness in [19.9, 110.1, f64::NAN] {
            let error = average_glandular_dose(1.0, thickness, 0.2, &beam).unwrap_err();
            assert!(matches!(error, DoseError::Outside { what: THICKNESS, .. }), "{error}");
        }
        assert!(factor_g(50.0, 1.2498).is_err());
        assert!(factor_c(50.0, 1.01, "Rh/Ag").is_err());
        assert!(matches!(factor_s(50.0, "Cu/Au"), Err(DoseError::NoFactor { factor: "s", .. })));
        assert!(matches!(
            factor_c(50.0, 0.2, "Rh/Rh"),
            Err(DoseError::NoFactor { factor: "c", .. })
        ));
    }

    #[test]
    fn the_dose_is_the_product_of_its_factors() {
        let dose =
            average_glandular_dose(3.0, 46.0, 0.2, &DoseBeam::rhodium_silver_34_kvp()).unwrap();
        assert!((dose.agd_mgy - 3.0 * dose.g * dose.c * dose.s).abs() < 1e-15);
        assert!((0.29..0.31).contains(&dose.g) && (1.1..1.2).contains(&dose.c), "{dose:?}");
    }
}
