//! Distances of the chest walls of two poses: what the rigid motion leaves (Mîra 2018, fig. 3.4).

use crate::surface::PoseSurfaces;
use mammotwin_data::{
    Vec3, labels::LabelMap, metric::Metric, rigid::RigidTransform, surface::TriMesh, volume::Volume,
};
use mammotwin_imaging::mri::register;
use mammotwin_solver::distance::{DistanceError, SurfaceIndex};
use serde::{Deserialize, Serialize};

/// Height (mm) over which the end of an image rounds the end of a chest wall.
const END_MM: f64 = 5.0;
/// "Well aligned, within an error of" (mm; Mîra 2018, § 3.1.3).
const THESIS_MM: f64 = 5.0;
/// Its largest distance (mm), in the prone pose.
const THESIS_MAX_MM: f64 = 16.25;

/// Signed distances of the front of the muscle of a pose, moved, from the chest wall of the
/// reference pose: positive in front of it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WallDistances {
    /// Their mean (mm).
    pub mean_mm: f64,
    /// 95 % of them are smaller in magnitude (mm).
    pub p95_mm: f64,
    /// Their largest magnitude (mm).
    pub max_mm: f64,
    /// Part of them that is within 5 mm, 0..=1.
    pub within_5mm: f64,
}

impl WallDistances {
    /// Over those nodes of the pose's chest wall that lie at the front of the muscle, in the slices
    /// that show a breast; `None` when there is none.
    ///
    /// # Errors
    /// When the reference has no chest wall.
    pub fn of(
        moving: &PoseSurfaces,
        labels: &LabelMap,
        fixed: &PoseSurfaces,
        transform: &RigidTransform,
    ) -> Result<Option<Self>, DistanceError> {
        let front = front(labels);
        let (moved, distances) = moved(&moving.chest_wall, &fixed.chest_wall, transform)?;
        let own = &moving.chest_wall.points;
        let on_front = |n: &usize| distances[*n].is_finite() && front.near(&own[*n]);
        Ok(Self::over((0..moved.points.len()).filter(on_front).map(|n| distances[n]).collect()))
    }

    fn over(signed_mm: Vec<f64>) -> Option<Self> {
        let count = signed_mm.len() as f64;
        let mean_mm = signed_mm.iter().sum::<f64>() / count;
        let mut sizes: Vec<f64> = signed_mm.iter().map(|d| d.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let last = sizes.len().checked_sub(1)?;
        Some(Self {
            mean_mm,
            p95_mm: sizes[(0.95 * last as f64).round() as usize],
            max_mm: sizes[last],
            within_5mm: sizes.partition_point(|d| *d <= THESIS_MM) as f64 / count,
        })
    }

    /// The numbers of the report for a pose.
    pub fn metrics(&self, pose: &str) -> Vec<Metric> {
        let source = "fig. 3.4";
        let long =
            |what: &str| format!("Front of the muscle, {pose}, from the reference's: {what}");
        let mm = |name: &str, what: &str, value: f64| {
            Metric::new(&format!("{pose}_wall_{name}_mm"), &long(what), "mm", value, source)
        };
        vec![
            mm("mean", "mean signed distance", self.mean_mm),
            mm("p95", "95 % are within", self.p95_mm).beside(THESIS_MM),
            mm("max", "largest (thesis: prone, beside the arm)", self.max_mm).beside(THESIS_MAX_MM),
        ]
    }
}

/// The chest wall of a pose, moved, and the signed distance (mm) of its nodes to that of the
/// reference; NaN beyond the end of either image, where there is nothing to compare.
///
/// # Errors
/// When the reference has no chest wall.
pub fn moved(
    moving: &TriMesh,
    fixed: &TriMesh,
    transform: &RigidTransform,
) -> Result<(TriMesh, Vec<f64>), DistanceError> {
    let surface = TriMesh {
        points: moving.points.iter().map(|p| transform.point(p)).collect(),
        triangles: moving.triangles.clone(),
    };
    let closest = SurfaceIndex::new(fixed)?.closest_of(&surface.points)?;
    // z in the frames of both.
    let (own, other) = (inner_z(&moving.points), inner_z(&fixed.points));
    let value = |(n, p): (usize, &Vec3)| {
        let inside = own.contains(&moving.points[n].z) && other.contains(&p.z);
        if inside { closest[n].signed_mm(p) } else { f64::NAN }
    };
    let values = surface.points.iter().enumerate().map(value).collect();
    Ok((surface, values))
}

/// Heights (mm) of a surface but its ends.
fn inner_z(points: &[Vec3]) -> std::ops::Range<f64> {
    let (low, high) = points
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| (low.min(p.z), high.max(p.z)));
    low + END_MM..high - END_MM
}

/// Voxels at the front of the muscle.
struct Front(Volume<bool>);

fn front(labels: &LabelMap) -> Front {
    let mut marks = Volume::filled(labels.grid.clone(), false);
    let to_voxel = labels.grid.to_voxel();
    for place in register::chest_wall_front(labels) {
        let voxel = to_voxel.apply(&place);
        let n = marks.grid.index([0, 1, 2].map(|axis| voxel[axis].round() as usize));
        marks.values[n] = true;
    }
    Front(marks)
}

impl Front {
    /// Whether a place (mm) is in such a voxel or beside one.
    fn near(&self, p: &Vec3) -> bool {
        let voxel = self.0.grid.to_voxel().apply(p);
        (0..27).any(|n| {
            let step = Vec3::from([n % 3, n / 3 % 3, n / 9].map(|s| f64::from(s) - 1.0));
            self.0.nearest(&(voxel + step)).unwrap_or(false)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::Surface;
    use mammotwin_data::{labels::Tissue, progress::Silent, store::Stage, volume::Grid};

    /// A thorax with muscle in front of it, flat but for a dent at the right.
    fn chest(dent_mm: f64) -> LabelMap {
        let grid = Grid::aligned([80, 50, 60], [1.0; 3], Vec3::new(-40.0, -30.0, -30.0));
        let tissue = |n: usize| {
            let p = grid.center(grid.voxel(n));
            let depth = p.y + if p.x > 0.0 { dent_mm } else { 0.0 };
            match depth {
                d if d < -8.0 => Tissue::Thorax,
                d if d < 0.0 => Tissue::PectoralMuscle,
                _ if p.y > 15.0 => Tissue::Background,
                _ if p.x > 0.0 => Tissue::AdiposeRight,
                _ => Tissue::AdiposeLeft,
            }
        };
        Volume { values: (0..grid.len()).map(tissue).collect(), grid }
    }

    #[test]
    fn a_dent_and_a_shift_are_seen_at_the_front_alone() {
        let [fixed, dented] = [0.0, 3.0].map(|dent| {
            let labels = chest(dent);
            (Surface::default().run(&labels, &Silent).unwrap(), labels)
        });
        let of = |shift: Vec3| {
            let transform = RigidTransform { translation: shift, ..RigidTransform::identity() };
            WallDistances::of(&dented.0, &dented.1, &fixed.0, &transform).unwrap().unwrap()
        };
        let still = of(Vec3::zeros());
        println!("{still:?}");
        // Half of the front lies 3 mm behind.
        assert!((still.mean_mm + 1.5).abs() < 0.2, "{still:?}");
        assert!((still.p95_mm - 3.0).abs() < 0.2 && (still.max_mm - 3.0).abs() < 0.3, "{still:?}");
        assert_eq!(still.within_5mm, 1.0);
        // 4 mm ahead there, and 7 mm where the front is not dented.
        let forward = of(Vec3::new(0.0, 7.0, 0.0));
        println!("{forward:?}");
        assert!((forward.mean_mm - 5.5).abs() < 0.2, "{forward:?}");
        assert!((forward.within_5mm - 0.5).abs() < 0.1, "{forward:?}");
    }

    #[test]
    fn without_a_breast_there_is_no_front() {
        let labels = chest(0.0).map(|t| if t.is_breast() { Tissue::Other } else { t });
        let surfaces = Surface::default().run(&labels, &Silent).unwrap();
        let still = RigidTransform::identity();
        assert_eq!(WallDistances::of(&surfaces, &labels, &surfaces, &still).unwrap(), None);
    }
}
