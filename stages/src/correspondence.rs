//! Which place of one skin is which of another: a smooth motion of space that carries the one onto the other.
//!
//! A cascade of free-form deformations on refined grids: each step moves the control points of cubic B-splines (twice
//! continuously differentiable) by what brings the carried nodes nearer to the other skin, and the other skin's nodes
//! nearer to the carried one. No component of a control point goes farther than 0.403 of the spacing, within
//! which such a step folds nowhere (Choi & Lee, *Graph. Models* 62 (2000) 411,
//! <https://doi.org/10.1006/gmod.2000.0531>); nor does one step after the other. The method of Bucki, Lobos & Payan (*Med. Image Anal.*
//! 14 (2010) 303, <https://doi.org/10.1016/j.media.2010.02.003>), which the thesis took, does the same on hexahedra with another spline.

use mammotwin_data::{Mat3, Vec3, surface::TriMesh};
use mammotwin_imaging::mri::lattice::Lattice;
use mammotwin_solver::distance::{Closest, DistanceError, SurfaceIndex};
use std::collections::BTreeSet;

/// Part of the spacing beyond which a step may fold.
const FOLDING: f64 = 0.403;
/// Halvings of the largest spacing, half of the box about all that is moved.
const LEVELS: i32 = 7;
/// Steps of one spacing, and the gain of the mean distance below which the next spacing follows.
const STEPS: usize = 12;
const GAIN: f64 = 0.02;
/// Mean distance (mm) below which there is nothing to gain.
const NEAR_MM: f64 = 0.02;
/// Steps count as much for a mark as for so many nodes.
const MARK: f64 = 20.0;
/// Spacings around all that is moved, beyond which nothing moves: the motion fades as smoothly as it goes.
const MARGIN: f64 = 2.0;
/// About so many nodes of the other skin pull, and not all of a finer one.
const PULLING: usize = 5000;

/// A step: displacements (mm) of control points.
struct Step {
    lattice: Lattice,
    moved: Vec<Vec3>,
}

impl Step {
    /// Where it carries a point, and the derivative of that by the point.
    fn carry(&self, p: &Vec3) -> (Vec3, Mat3) {
        let (mut to, mut slope) = (*p, Mat3::identity());
        for support in self.lattice.at(p) {
            let moved = &self.moved[support.index];
            to += support.weight * moved;
            slope += moved * support.slope.transpose();
        }
        (to, slope)
    }

    /// What brings points to where they are to be (mm), each with its weight, as near as local averages can (Lee, Wolberg & Shin,
    /// *IEEE Trans. Vis. Comput. Graph.* 3 (1997) 228); `None` where nothing moves.
    fn toward(lattice: Lattice, pulls: &[(Vec3, Vec3, f64)]) -> Option<Self> {
        let mut moved = vec![Vec3::zeros(); lattice.count()];
        let mut weights = vec![0.0; lattice.count()];
        for (from, to, weight) in pulls {
            let supports = lattice.at(from);
            let squares: f64 = supports.iter().map(|s| s.weight * s.weight).sum();
            for s in supports {
                let square = weight * s.weight * s.weight;
                moved[s.index] += square * s.weight / squares * (to - from);
                weights[s.index] += square;
            }
        }
        let most = FOLDING * lattice.spacing_mm();
        for (moved, weight) in moved.iter_mut().zip(&weights).filter(|(_, w)| **w > 0.0) {
            *moved /= *weight;
            *moved *= f64::min(1.0, most / moved.amax().max(f64::MIN_POSITIVE));
        }
        moved.iter().any(|m| m.amax() > 0.0).then_some(Self { lattice, moved })
    }
}

/// A motion of space that folds nowhere.
#[derive(Default)]
pub struct Correspondence {
    steps: Vec<Step>,
}

impl Correspondence {
    /// Carries the skin `from` onto the skin `to`, which goes on beyond its rims (mm). `marks` are places of
    /// the first that are known on the second: nipples, fiducials.
    ///
    /// # Errors
    /// A skin without triangles, or with nodes that are not finite.
    pub fn new(
        from: &TriMesh,
        to: &TriMesh,
        marks: &[(Vec3, Vec3)],
    ) -> Result<Self, DistanceError> {
        let target = SurfaceIndex::new(to)?;
        let to = to.compacted().0.points;
        let to: Vec<Vec3> = to.iter().step_by(1 + to.len() / PULLING).copied().collect();
        let rim = rim(from);
        let mut carried = from.clone();
        let mut marked: Vec<Vec3> = marks.iter().map(|(from, _)| *from).collect();
        let mut found = Self::default();
        let mut widest_mm = 0.0;
        for level in 0..LEVELS {
            let mut before = f64::INFINITY;
            for _ in 0..STEPS {
                let pulls = pulls(&carried, &rim, &to, &target)?;
                let mean =
                    pulls.iter().map(|(p, q, _)| (q - p).norm()).sum::<f64>() / pulls.len() as f64;
                if mean < NEAR_MM || mean > (1.0 - GAIN) * before {
                    break;
                }
                before = mean;
                let known = marked.iter().zip(marks).map(|(now, (_, to))| (*now, *to, MARK));
                let pulls: Vec<(Vec3, Vec3, f64)> = pulls.into_iter().chain(known).collect();
                let all = || pulls.iter().map(|(p, ..)| p).chain(&carried.points).chain(&marked);
                let low = all().fold(Vec3::repeat(f64::INFINITY), |a, b| a.inf(b));
                let high = all().fold(Vec3::repeat(f64::NEG_INFINITY), |a, b| a.sup(b));
                if widest_mm == 0.0 {
                    widest_mm = 0.5 * (high - low).max();
                }
                let spacing_mm = widest_mm / f64::powi(2.0, level);
                let margin = MARGIN * spacing_mm;
                let (low, high) = (low.add_scalar(-margin), high.add_scalar(margin));
                let lattice = Lattice::covering(&low, &high, spacing_mm);
                let Some(step) = Step::toward(lattice, &pulls) else { break };
                for p in carried.points.iter_mut().chain(&mut marked) {
                    *p = step.carry(p).0;
                }
                found.steps.push(step);
            }
        }
        Ok(found)
    }

    /// Where a point is carried (mm), and the Jacobian of the motion there.
    pub fn carry(&self, p: &Vec3) -> (Vec3, f64) {
        let begin = (*p, 1.0);
        self.steps.iter().fold(begin, |(p, jacobian), step| {
            let (to, slope) = step.carry(&p);
            (to, jacobian * slope.determinant())
        })
    }
}

/// Nodes of edges that one triangle alone has.
fn rim(skin: &TriMesh) -> BTreeSet<u32> {
    let mut once = BTreeSet::new();
    for [a, b, c] in &skin.triangles {
        for edge in [[a, b], [b, c], [c, a]] {
            let edge = [edge[0].min(edge[1]), edge[0].max(edge[1])];
            if !once.remove(&edge) {
                once.insert(edge);
            }
        }
    }
    once.into_iter().flatten().copied().collect()
}

/// Where places of the carried skin are to go: its nodes to the nearest place of the other one, and what is
/// nearest to a node of the other one to that node, where that is not on the rim.
fn pulls(
    carried: &TriMesh,
    rim: &BTreeSet<u32>,
    to: &[Vec3],
    target: &SurfaceIndex,
) -> Result<Vec<(Vec3, Vec3, f64)>, DistanceError> {
    let used: BTreeSet<u32> = carried.triangles.iter().flatten().copied().collect();
    let nodes: Vec<Vec3> = used.iter().map(|&n| carried.points[n as usize]).collect();
    let there = target.closest_of(&nodes)?;
    let here = SurfaceIndex::new(carried)?.closest_of(to)?;
    let beside =
        |found: &Closest| carried.triangles[found.triangle].iter().any(|node| rim.contains(node));
    let back: Vec<(Vec3, Vec3)> = here
        .iter()
        .zip(to)
        .filter(|(found, _)| !beside(found))
        .map(|(found, p)| (found.point, *p))
        .collect();
    // Both skins count alike, however fine each is.
    let weight = nodes.len() as f64 / back.len().max(1) as f64;
    let forth = nodes.iter().zip(&there).map(|(p, found)| (*p, found.point, 1.0));
    Ok(forth.chain(back.into_iter().map(|(p, q)| (p, q, weight))).collect())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test may fail at once
mod tests {
    use super::*;

    /// A dome over a disc: height (mm) by the distance from the axis over the radius, sheared by `lean`.
    fn dome(rings: u32, height: impl Fn(f64) -> f64, lean: f64, radius_mm: f64) -> TriMesh {
        let around = 3 * rings;
        let mut points = vec![Vec3::new(0.0, lean * height(0.0), height(0.0))];
        let mut triangles = Vec::new();
        for ring in 1..=rings {
            let part = f64::from(ring) / f64::from(rings);
            for n in 0..around {
                let angle = f64::from(n) * std::f64::consts::TAU / f64::from(around);
                let (z, r) = (height(part), radius_mm * part);
                points.push(Vec3::new(r * angle.cos(), r * angle.sin() + lean * z, z));
            }
            for n in 0..around {
                let at = |ring: u32, n: u32| {
                    if ring == 0 { 0 } else { 1 + (ring - 1) * around + n % around }
                };
                triangles.push([at(ring - 1, n), at(ring, n), at(ring, n + 1)]);
                if ring > 1 {
                    triangles.push([at(ring - 1, n), at(ring, n + 1), at(ring - 1, n + 1)]);
                }
            }
        }
        TriMesh { points, triangles }
    }

    /// A breast that lies and one that hangs: twice as high, and leaning.
    fn lying_and_hanging() -> (TriMesh, TriMesh) {
        let lying = dome(10, |r| 30.0 * (1.0 - r * r), 0.0, 60.0);
        // Finer, and beyond the rim of the other.
        let hanging = dome(33, |r| 65.0 * (1.0 - (1.1 * r).powi(2)).max(0.0).powf(0.8), 0.3, 66.0);
        (lying, hanging)
    }

    fn mean(of: impl Iterator<Item = f64> + Clone) -> f64 {
        of.clone().sum::<f64>() / of.count() as f64
    }

    #[test]
    fn a_skin_is_carried_onto_another_and_space_folds_nowhere() {
        let (lying, hanging) = lying_and_hanging();
        let found = Correspondence::new(&lying, &hanging, &[]).unwrap();
        let carried: Vec<Vec3> = lying.points.iter().map(|p| found.carry(p).0).collect();
        let index = SurfaceIndex::new(&hanging).unwrap();
        let off: Vec<f64> =
            index.closest_of(&carried).unwrap().iter().map(|c| c.distance_mm).collect();
        let worst = off.iter().copied().fold(0.0, f64::max);
        println!("{:.3} mm, {worst:.2} mm, {} steps", mean(off.iter().copied()), found.steps.len());
        assert!(mean(off.iter().copied()) < 0.1 && worst < 0.5, "{worst}");
        // Between the nodes, in front of and behind the skin, too.
        let mut least = f64::INFINITY;
        for n in 0..40_000 {
            let [x, y, z] = [n % 40, n / 40 % 40, n / 1600].map(f64::from);
            let p = Vec3::new(4.0 * x - 80.0, 4.0 * y - 80.0, 4.0 * z - 20.0);
            least = least.min(found.carry(&p).1);
        }
        println!("least Jacobian {least:.3}");
        assert!(least > 0.0);
        // The derivative is one: it is that of the motion.
        let (p, step) = (Vec3::new(11.0, -17.0, 23.0), 1e-5);
        let columns = [Vec3::x(), Vec3::y(), Vec3::z()].map(|axis| {
            (found.carry(&(p + step * axis)).0 - found.carry(&(p - step * axis)).0) / (2.0 * step)
        });
        let jacobian = Mat3::from_columns(&columns).determinant();
        assert!((found.carry(&p).1 / jacobian - 1.0).abs() < 1e-6);
    }

    #[test]
    fn the_other_skin_is_covered_and_marks_are_followed() {
        let (lying, hanging) = lying_and_hanging();
        let tip = hanging.points[0];
        let off = |marks: &[(Vec3, Vec3)]| {
            let found = Correspondence::new(&lying, &hanging, marks).unwrap();
            let points: Vec<Vec3> = lying.points.iter().map(|p| found.carry(p).0).collect();
            let nipple = (points[0] - tip).norm();
            let carried = SurfaceIndex::new(&TriMesh { points, ..lying.clone() }).unwrap();
            (nipple, carried.closest(&tip).unwrap().distance_mm)
        };
        let (slid, uncovered) = off(&[]);
        // From nodes to the other skin alone the tip would stay bare.
        assert!(uncovered < 1.0, "{uncovered}");
        let (followed, uncovered) = off(&[(lying.points[0], tip)]);
        println!("nipple {slid:.2} mm off without a mark, {followed:.2} mm with one");
        assert!(followed < 1.0 && followed < slid && uncovered < 1.0);
    }

    #[test]
    fn the_same_skin_stays() {
        let (lying, _) = lying_and_hanging();
        let found = Correspondence::new(&lying, &lying, &[]).unwrap();
        assert!(lying.points.iter().all(|p| (found.carry(p).0 - p).norm() < 1e-9));
        assert!(Correspondence::new(&lying, &TriMesh::default(), &[]).is_err());
    }
}
