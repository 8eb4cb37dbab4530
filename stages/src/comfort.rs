//! What the compression does to the breast: pressure, stress and strain.

use crate::{compress::Compression, quality::Metrics, results::principal_stretches};
use mammotwin_data::{
    Failure, Mat3, metric::Metric, progress::Progress, solution::von_mises_kpa, store::Stage,
    units::NEWTON,
};
use serde::Serialize;

/// Measures comfort at the end of the compression.
#[derive(Debug, Clone, Serialize)]
pub struct Comfort;

/// A value with its share of area or volume.
type Weighted = (f64, f64);

/// The value that the given share of all weight does not exceed.
fn percentile(mut values: Vec<Weighted>, share: f64) -> f64 {
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = values.iter().map(|v| v.1).sum();
    let mut sum = 0.0;
    for (value, weight) in &values {
        sum += weight;
        if sum >= share * total {
            return *value;
        }
    }
    values.last().map_or(0.0, |v| v.0)
}

/// Largest principal logarithmic strain (no unit).
fn largest_strain(f: &Mat3) -> f64 {
    principal_stretches(f)[0].ln()
}

impl Stage for Comfort {
    const NAME: &'static str = "comfort";
    const VERSION: u32 = 2;
    const METHODS: &'static str = "Comfort is described by the contact pressure by area, and by von Mises stress and \
         largest logarithmic strain by volume (after Mîra 2018, § 5.3.1); percentiles are given since \
         maxima depend on the mesh.";
    type Input = Compression;
    type Output = Metrics;

    fn run(&self, compression: &Compression, _: &dyn Progress) -> Result<Metrics, Failure> {
        let mut metrics = Vec::new();
        let mut add = |name: &str, long: &str, unit: &str, value: f64, thesis: Option<f64>| {
            let metric = Metric::new(name, long, unit, value, "Mîra 2018, § 5.3.1, § 5.4.1");
            metrics.push(Metric { thesis, ..metric });
        };
        let curve = &compression.curve;
        let last = |values: &[f64]| values.last().copied().unwrap_or(0.0);
        let force_n = last(&curve.force_n);
        let thickness = compression.thickness_mm;
        add("thickness_mm", "compressed breast thickness", "mm", thickness, None);
        add("force_n", "compression force", "N", force_n, None);
        let area_mm2 = last(&curve.contact_area_mm2);
        add("contact_area_cm2", "contact area of the paddle", "cm2", area_mm2 / 100.0, None);
        let mean_kpa = if area_mm2 > 0.0 { force_n * NEWTON / area_mm2 } else { 0.0 };
        add("mean_pressure_kpa", "mean contact pressure", "kPa", mean_kpa, None);

        let pressures = compression.contact_pressures();
        let peak = pressures.iter().map(|p| p.0).fold(0.0, f64::max);
        add("peak_pressure_kpa", "largest contact pressure", "kPa", peak, Some(77.7));
        for (share, word) in [(0.95, "p95"), (0.99, "p99")] {
            let value = percentile(pressures.clone(), share);
            let long = format!("contact pressure, {:.0} % of the contact area", 100.0 * share);
            add(&format!("pressure_{word}_kpa"), &long, "kPa", value, None);
        }
        let volumes = compression.volumes_mm3();
        let solution = &compression.solution;
        let by_volume = |values: Vec<f64>| -> Vec<Weighted> {
            values.into_iter().zip(volumes.iter().copied()).collect()
        };
        let stress = by_volume(solution.cauchy_kpa.iter().map(von_mises_kpa).collect());
        let strain = by_volume(solution.deformation_gradient.iter().map(largest_strain).collect());
        for (share, word) in [(0.5, "p50"), (0.95, "p95"), (0.99, "p99")] {
            let percent = 100.0 * share;
            let long = format!("von Mises stress, {percent:.0} % of the volume");
            let value = percentile(stress.clone(), share);
            add(&format!("von_mises_{word}_kpa"), &long, "kPa", value, None);
            let long = format!("largest logarithmic strain, {percent:.0} % of the volume");
            add(&format!("strain_{word}"), &long, "", percentile(strain.clone(), share), None);
        }
        Ok(Metrics { metrics, ..Metrics::default() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_go_by_weight() {
        let values = vec![(3.0, 1.0), (1.0, 8.0), (2.0, 1.0)];
        assert_eq!(percentile(values.clone(), 0.5), 1.0);
        assert_eq!(percentile(values.clone(), 0.85), 2.0);
        assert_eq!(percentile(values, 0.95), 3.0);
    }
}
