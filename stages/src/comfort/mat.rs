//! A virtual pressure mat under the paddle: what a sheet of square sensors would show.
//!
//! Every sensor shows the force on it along the compression over its own area, and nothing below a
//! threshold. The force of a node is spread over its share of the skin.

use crate::compress::Compression;
use mammotwin_data::{Vec3, mesh::Patch};
use std::collections::BTreeMap;

/// Samples along the edge of a face, times its own length over the pitch.
const SAMPLES: usize = 6;

/// What the sensors show.
#[derive(Debug, Clone, PartialEq)]
pub struct PressureMat {
    /// Edge of a sensor (mm).
    pub pitch_mm: f64,
    /// Sensors along the chest-wall edge, and away from it.
    pub size: [usize; 2],
    /// Corner of the first sensor in the detector's frame (mm): x along the edge, y away from it.
    pub corner_mm: [f64; 2],
    /// By sensor (kPa), x running fastest; zero below the threshold.
    pub pressure_kpa: Vec<f64>,
}

impl PressureMat {
    /// The mat under the paddle of a compression.
    pub fn under_paddle(compression: &Compression, pitch_mm: f64, threshold_kpa: f64) -> Self {
        let points = &compression.solution.points;
        let skin = compression.mesh.patch(Patch::Skin);
        let forces = &compression.plates[1].force_mn;
        let mut whole: BTreeMap<u32, f64> = BTreeMap::new();
        let mut samples: Vec<(u32, [f64; 2], f64)> = Vec::new();
        for face in skin {
            let pushed = |n: &u32| forces.get(*n as usize).is_some_and(|f| *f != Vec3::zeros());
            if !face.iter().any(pushed) {
                continue;
            }
            let corners = face.map(|n| points[n as usize]);
            let [a, b, c] = corners;
            let area = 0.5 * (b - a).cross(&(c - a)).norm();
            let share = area / (SAMPLES * SAMPLES) as f64;
            for weights in barycentric() {
                let nearest = (0..3).max_by(|&i, &j| weights[i].total_cmp(&weights[j]));
                let node = face[nearest.unwrap_or(0)];
                let place: Vec3 = (0..3).map(|n| weights[n] * corners[n]).sum();
                *whole.entry(node).or_insert(0.0) += share;
                if pushed(&node) {
                    samples.push((node, [place.x, place.y], share));
                }
            }
        }
        let ends = |axis: usize| {
            let along = samples.iter().map(|sample| sample.1[axis]);
            along.fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], v| [l.min(v), h.max(v)])
        };
        let [x, y] = [ends(0), ends(1)];
        // Sensors lie on a grid that passes through the middle of the chest-wall edge.
        let first = |low: f64| if low.is_finite() { (low / pitch_mm).floor() } else { 0.0 };
        let count = |[low, high]: [f64; 2]| {
            if low <= high { (high / pitch_mm).floor() as i64 - first(low) as i64 + 1 } else { 0 }
        };
        let size = [count(x), count(y)].map(|n| n.max(0) as usize);
        let start = [first(x[0]), first(y[0])];
        let mut pressure_kpa = vec![0.0; size[0] * size[1]];
        for (node, place, share) in &samples {
            let force = -forces[*node as usize].z;
            let at = [0, 1].map(|axis| ((place[axis] / pitch_mm).floor() - start[axis]) as usize);
            let of_node = share / whole.get(node).copied().unwrap_or(f64::INFINITY);
            pressure_kpa[at[1] * size[0] + at[0]] += force * of_node / (pitch_mm * pitch_mm);
        }
        for pressure in &mut pressure_kpa {
            if *pressure < threshold_kpa {
                *pressure = 0.0;
            }
        }
        Self { pitch_mm, size, corner_mm: start.map(|n| n * pitch_mm), pressure_kpa }
    }

    /// Area (mm²) of the sensors that show something.
    pub fn contact_area_mm2(&self) -> f64 {
        let shown = self.pressure_kpa.iter().filter(|pressure| **pressure > 0.0).count();
        shown as f64 * self.pitch_mm * self.pitch_mm
    }

    /// Force (mN) on the sensors that show something.
    pub fn force_mn(&self) -> f64 {
        self.pressure_kpa.iter().sum::<f64>() * self.pitch_mm * self.pitch_mm
    }

    /// Mean pressure (kPa) of the sensors that show something; zero when none does.
    pub fn mean_kpa(&self) -> f64 {
        let area = self.contact_area_mm2();
        if area > 0.0 { self.force_mn() / area } else { 0.0 }
    }

    /// Largest pressure (kPa).
    pub fn peak_kpa(&self) -> f64 {
        self.pressure_kpa.iter().copied().fold(0.0, f64::max)
    }
}

/// Middles of the small triangles that a face is cut into: its barycentric coordinates.
fn barycentric() -> impl Iterator<Item = [f64; 3]> {
    let n = SAMPLES;
    (0..n).flat_map(move |i| {
        (0..n - i).flat_map(move |j| {
            let middle = |i: usize, j: usize, part: f64| {
                let [a, b] = [i, j].map(|k| (k as f64 + part) / n as f64);
                [a, b, 1.0 - a - b]
            };
            let down = (i + j + 1 < n).then(|| middle(i, j, 2.0 / 3.0));
            std::iter::once(middle(i, j, 1.0 / 3.0)).chain(down)
        })
    })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::compress::{Course, PlateContact};
    use mammotwin_data::{labels::Tissue, mesh::TetMesh, solution::Solution};

    /// A square of skin, 40 mm wide, that bears 2 kPa on its face.
    pub(in crate::comfort) fn pressed() -> Compression {
        let mut points = Vec::new();
        let mut skin = Vec::new();
        let nodes = 11;
        for j in 0..nodes {
            for i in 0..nodes {
                points.push(Vec3::new(4.0 * f64::from(i) - 20.0, 4.0 * f64::from(j), 30.0));
            }
        }
        let at = |i: i32, j: i32| (j * nodes + i) as u32;
        for j in 0..nodes - 1 {
            for i in 0..nodes - 1 {
                skin.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                skin.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
        let mut area = vec![0.0; points.len()];
        for face in &skin {
            face.iter().for_each(|n| area[*n as usize] += 8.0 / 3.0);
        }
        let force = area.iter().map(|area| Vec3::new(0.0, 0.0, -2.0 * area)).collect();
        let mesh = TetMesh {
            points: points.clone(),
            tets: vec![],
            tissues: Vec::<Tissue>::new(),
            patches: BTreeMap::from([(Patch::Skin, skin)]),
        };
        Compression {
            mesh,
            solution: Solution { points, ..Solution::default() },
            contact_pressure_kpa: vec![2.0; area.len()],
            plates: [PlateContact::default(), PlateContact { force_mn: force, area_mm2: area }],
            ..Compression::of_course(Course::default())
        }
    }

    #[test]
    fn a_mat_shows_the_pressure_and_the_force_of_an_even_load() {
        let mat = PressureMat::under_paddle(&pressed(), 10.0, 0.1);
        assert_eq!((mat.size, mat.corner_mm), ([4, 4], [-20.0, 0.0]));
        assert!((mat.force_mn() - 3200.0).abs() < 1e-6, "{}", mat.force_mn());
        assert_eq!(mat.contact_area_mm2(), 1600.0);
        for pressure in &mat.pressure_kpa {
            assert!((pressure - 2.0).abs() < 0.25, "{pressure}");
        }
        assert!((mat.mean_kpa() - 2.0).abs() < 1e-9);
        // Sensors that are larger than the skin share its force.
        let coarse = PressureMat::under_paddle(&pressed(), 80.0, 0.1);
        assert_eq!(coarse.size, [2, 1]);
        assert!((coarse.peak_kpa() - 0.25).abs() < 0.03, "{}", coarse.peak_kpa());
        let deaf = PressureMat::under_paddle(&pressed(), 10.0, 3.0);
        assert_eq!((deaf.contact_area_mm2(), deaf.mean_kpa()), (0.0, 0.0));
    }
}
