//! What is left of the distances at best where one modulus is held: what the poses can tell of it.

use super::ErrorMap;
use mammotwin_stages::{
    report::chart::{Axis, Chart, Line, lines},
    sensitivity::{ErrorPoint, Errors},
};
use std::fmt::Write;

/// The moduli of a map, in the order of their axes.
const AXES: [&str; 3] = ["breast", "skin", "fascia"];
const SIDES: [&str; 2] = ["right", "left"];

/// Least mean distances over one modulus, the others free.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// Which modulus.
    pub parameter: &'static str,
    /// Of the right and the left breast: value (kPa) and least mean distance over all fitted poses (mm).
    pub sides: [Vec<[f64; 2]>; 2],
}

impl Profile {
    /// Largest less least of the distances (mm): how much the poses mind the value.
    fn range_mm(&self, side: usize) -> f64 {
        let all = || self.sides[side].iter().map(|[_, mm]| *mm);
        all().fold(f64::NEG_INFINITY, f64::max) - all().fold(f64::INFINITY, f64::min)
    }
}

/// Profiles over each modulus that has two values and more.
pub fn profiles(map: &ErrorMap, rows: &[Errors]) -> Vec<Profile> {
    let of = |axis: usize| {
        let side = |side: usize| {
            let mut least: Vec<[f64; 2]> = Vec::new();
            for (&[skin, fascia], Errors(points)) in map.rows.iter().zip(rows) {
                for point in points {
                    let value = [point.breast_kpa, skin, fascia][axis];
                    let Some(mm) = distance(point, side) else { continue };
                    match least.iter_mut().find(|known| known[0] == value) {
                        Some(known) => known[1] = known[1].min(mm),
                        None => least.push([value, mm]),
                    }
                }
            }
            least.sort_by(|a, b| a[0].total_cmp(&b[0]));
            least
        };
        Profile { parameter: AXES[axis], sides: [side(0), side(1)] }
    };
    (0..AXES.len())
        .map(of)
        .filter(|profile| profile.sides.iter().any(|side| side.len() > 1))
        .collect()
}

/// Mean distance (mm) of one side over the fitted poses: the reference pose is met by all.
fn distance(point: &ErrorPoint, side: usize) -> Option<f64> {
    let fitted: Vec<f64> = point.poses.iter().skip(1).filter_map(|p| p.mean_mm[side]).collect();
    (!fitted.is_empty()).then(|| fitted.iter().sum::<f64>() / fitted.len() as f64)
}

/// The profiles as CSV.
pub fn csv(profiles: &[Profile]) -> String {
    let mut text = String::from("parameter,value_kpa,side,least_mean_distance_mm\n");
    for profile in profiles {
        for (side, name) in profile.sides.iter().zip(SIDES) {
            for [value, mm] in side {
                // Writing to a string does not fail.
                let _ = writeln!(text, "{},{value},{name},{mm:.4}", profile.parameter);
            }
        }
    }
    text
}

/// Figures by their file names.
pub fn figures(profiles: &[Profile]) -> Vec<(String, String)> {
    let figure = |profile: &Profile| {
        let line = |(side, name): (&Vec<[f64; 2]>, &str)| Line {
            name: name.into(),
            points: side.iter().map(|&[value, mm]| (value, mm)).collect(),
        };
        let svg = lines(&Chart {
            title: format!("Least distance over the modulus of the {}", profile.parameter),
            caption: String::new(),
            x_label: format!("Young's modulus of the {} (kPa)", profile.parameter),
            y_label: "least mean distance (mm)".into(),
            lines: profile.sides.iter().zip(SIDES).map(line).collect(),
            marks: Vec::new(),
            x_axis: Axis::Rising,
        });
        (format!("profile_{}.svg", profile.parameter), svg)
    };
    profiles.iter().map(figure).collect()
}

/// What the profiles say.
pub fn said(profiles: &[Profile]) -> String {
    let mut text = String::from(
        "Least mean distance over all fitted poses where one modulus is held and the others are what suits \
         it best. Where a curve is flat, the poses do not tell this modulus from the others.",
    );
    for profile in profiles {
        let [right, left] = [0, 1].map(|side| profile.range_mm(side));
        let _ = write!(
            text,
            " The {} changes it by {right:.2} (right) and {left:.2} mm (left).",
            profile.parameter
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use mammotwin_stages::sensitivity::PoseError;

    /// Distances that know the product of breast and skin, on the right, and the breast alone, on the left.
    fn point(breast_kpa: f64, skin: f64) -> ErrorPoint {
        let pose = |name: &str, mean_mm: [Option<f64>; 2]| PoseError {
            pose: name.into(),
            modified_hausdorff_mm: 1.0,
            max_mm: 2.0,
            mean_mm,
        };
        let right = 1.0 + (breast_kpa * skin / 4.0).ln().abs();
        let left = 1.0 + (breast_kpa / 2.0).ln().abs();
        let poses = vec![pose("supine", [Some(9.0); 2]), pose("prone", [Some(right), Some(left)])];
        ErrorPoint { breast_kpa, round_trip_mm: None, poses, failed: None }
    }

    #[test]
    fn what_another_modulus_makes_up_for_is_flat() {
        let breast_kpa = vec![1.0, 2.0, 4.0];
        let map = ErrorMap {
            breast_kpa: breast_kpa.clone(),
            rows: vec![[1.0, 100.0], [2.0, 100.0], [4.0, 100.0]],
        };
        let row = |[skin, _]: &[f64; 2]| {
            let mut points: Vec<_> =
                breast_kpa.iter().map(|&breast| point(breast, *skin)).collect();
            // No equilibrium here.
            points[0].poses.truncate(if *skin == 1.0 { 0 } else { 2 });
            Errors(points)
        };
        let rows: Vec<Errors> = map.rows.iter().map(row).collect();
        let found = profiles(&map, &rows);
        let names: Vec<&str> = found.iter().map(|profile| profile.parameter).collect();
        assert_eq!(names, ["breast", "skin"]);
        let far = 1.0 + 2f64.ln();
        assert_eq!(found[0].sides[0], [[1.0, 1.0], [2.0, 1.0], [4.0, 1.0]]);
        assert_eq!(found[0].sides[1], [[1.0, far], [2.0, 1.0], [4.0, far]]);
        assert_eq!(found[1].sides[1], [[1.0, 1.0], [2.0, 1.0], [4.0, 1.0]]);
        assert!(said(&found).contains("The breast changes it by 0.00 (right) and 0.69 mm (left)."));
        assert!(csv(&found).contains("breast,2,left,1.0000\n"));
        assert_eq!(figures(&found).len(), 2);
    }
}
